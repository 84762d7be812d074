"""The studio's page in a real browser: linkages drawn from nothing by mouse, driven, dragged and saved, and what the suite makes of them."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "gauss_bench" / "studio" / "page_source"
BUILT = ROOT / "gauss_bench" / "studio" / "page"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
XY = tuple[float, float]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = (
        pytest.importorskip("playwright.sync_api") if not os.environ.get("CI") else __import__("playwright.sync_api").sync_api
    )
    if CHROMIUM is None:
        assert not os.environ.get("CI"), "no Chromium here, and the page must be looked at where CI is set"
        pytest.skip("no Chromium here to draw with")
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-quic", "--disable-gpu"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("drawn")


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    """A studio of its own, with its own cache."""
    pytest.importorskip("starlette")
    command = [sys.executable, "-m", "gauss_bench", "studio", "--no-browser"]
    cache = {"XDG_CACHE_HOME": str(folder / "cache")}
    with subprocess.Popen(
        command, cwd=folder, env=os.environ | cache, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as server:
        assert server.stdout is not None
        said = ""
        for line in server.stdout:
            said += line
            if found := re.search(r"http://\S+", line):
                yield found[0]
                break
        else:
            pytest.fail(f"the studio did not start: {said}")
        server.terminate()
        server.wait(20)


class Page:
    """A page and a hand that points at metres."""

    def __init__(self, browser: Any, url: str, **look: Any):
        self.page = browser.new_page(**({"viewport": {"width": 1440, "height": 900}} | look))
        self.wrong: list[str] = []
        own = url.split("?")[0]
        self.page.on("console", lambda m: self.wrong.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda e: self.wrong.append(str(e)))
        self.page.on(
            "request",
            lambda r: self.wrong.append(r.url) if not r.url.startswith((own, "ws" + own[4:], "data:", "blob:")) else None,
        )
        self.page.on("dialog", lambda d: d.accept())
        self.page.add_init_script("localStorage.setItem('studio.tour', 'seen')")
        self.page.goto(url)
        self.canvas = self.page.get_by_role("application", name="Drawing area")
        self.page.wait_for_selector("#canvas[data-revision]", timeout=60_000)

    def begin(self) -> None:
        """An empty drawing."""
        self.button("Open").click()
        self.button("Empty drawing").click()
        self.page.wait_for_selector("dialog", state="detached")

    def button(self, name: str) -> Any:
        return self.page.get_by_role("button", name=name, exact=True)

    def revision(self) -> int:
        return int(self.canvas.get_attribute("data-revision"))

    def changed(self, before: int) -> None:
        """Waits until the drawing is another; the page lets nobody evaluate text, so that it is asked again and again."""
        for _ in range(400):
            if self.revision() > before:
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"nothing has changed: {self.page.get_by_test_id('said').inner_text()}")

    def pixel(self, at: XY) -> XY:
        scale = float(self.canvas.get_attribute("data-scale"))
        x, y = map(float, self.canvas.get_attribute("data-origin").split(","))
        box = self.canvas.bounding_box()
        return box["x"] + x + scale * at[0], box["y"] + y - scale * at[1]

    def use(self, tool: str, *places: XY, end: bool = False) -> None:
        """Take a tool and click; waits until the drawing has changed."""
        before = self.revision()
        self.button(tool).click()
        for place in places:
            self.page.mouse.click(*self.pixel(place))
        if end:
            self.page.keyboard.press("Enter")
        self.changed(before)

    def drive(self, coordinate: str) -> None:
        before = self.revision()
        self.page.locator("details.drive > summary").click()
        self.page.get_by_label("Driven coordinate").select_option(coordinate)
        self.changed(before)
        self.page.locator("details.drive > summary").click()

    def status(self) -> tuple[str, str]:
        return self.page.get_by_test_id("dof").inner_text(), self.page.get_by_test_id("loop-count").inner_text()

    def problems(self) -> list[str]:
        return list(self.page.locator(".problems li").all_inner_texts())

    def path(self, point: str) -> Any:
        """The path on show, in metres (k, 2), and the width of a pixel."""
        drawn = self.page.locator(f'[data-path="{point}"] path.path')
        drawn.wait_for(state="attached", timeout=30_000)
        scale = float(self.canvas.get_attribute("data-scale"))
        x, y = map(float, self.canvas.get_attribute("data-origin").split(","))
        pixels = np.array([[float(v) for v in pair.split()] for pair in re.findall(r"[ML]([-\d. ]+)", drawn.get_attribute("d"))])
        return (pixels - [x, y]) / [scale, -scale], 1 / scale

    def save(self, name: str) -> None:
        self.button("Save").click()
        self.page.locator('dialog input[name="path"]').fill(f"{name}.toml")
        self.button("Save the file").click()
        self.page.wait_for_selector("dialog", state="detached")


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Page]:
    opened = Page(browser, address)
    opened.begin()
    yield opened
    opened.page.close()
    assert not opened.wrong, opened.wrong[:3]


def told(folder: Path, *arguments: str) -> dict[str, Any]:
    """What a command of the suite says with --json, in the folder of the drawing."""
    done = subprocess.run([sys.executable, "-m", "gauss_bench", *arguments, "--json"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return dict(json.loads(done.stdout))


A, B, C, D, P = (0.0, 0.0), (0.0, 0.12), (0.32, 0.28), (0.4, 0.0), (0.12, 0.28)


def four_bar(page: Page) -> None:
    for pivot in (A, D):
        page.use("Ground pivot", pivot)
    page.use("Bar", A, B)
    page.use("Link", B, C, P, end=True)
    page.use("Bar", C, D)
    page.use("Observe", P)
