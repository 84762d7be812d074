"""The studio's page in a browser: draw, drive, drag and save linkages, and compare them with the suite's own verbs."""

import contextlib
import io
import json
import re
import shutil
import subprocess
from graphlib import TopologicalSorter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gauss_bench.cli import main
from tests.published import watch
from tests.studio import ended, started

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "gauss_bench" / "studio" / "page_source"
BUILT = ROOT / "gauss_bench" / "studio" / "page"
WHERE = "c => [...c.querySelectorAll('g.linkage [data-pin]')].map(x => [x.dataset.pin, x.getAttribute('transform')])"
SCRIPTS = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "tests" / "data" / "page").glob("*.js")}


@pytest.fixture
def folder(studio_server):
    """The working folder of the studio that tests share."""
    return studio_server.folder


@contextlib.contextmanager
def studio(folder):
    """Start a studio with a cache of its own, and end it after the test."""
    running = started(folder)
    yield running
    if running.process.poll() is None:
        ended(running)


class Page:
    """A page of the studio; places are in metres unless they are called pixels."""

    def __init__(self, browser, url, asked=None, sockets=None, **look):
        self.page = browser.new_page(**({"viewport": {"width": 1440, "height": 900}} | look))
        if sockets is not None:
            self.page.route_web_socket(re.compile("/socket"), sockets)
        own = url.split("?")[0]
        self.wrong = watch(self.page, own, "ws" + own[4:])
        if asked is not None:
            self.page.on("request", lambda r: asked.append(r.url + (r.post_data or "")))
        self.page.on("dialog", lambda d: d.accept())
        self.page.add_init_script("localStorage.setItem('studio.tour', 'seen')")
        self.page.goto(url)
        self.canvas = self.page.get_by_role("application", name="Drawing area")
        self.page.wait_for_selector("#canvas[data-revision]", timeout=60_000)

    def begin(self):
        """Open an empty drawing."""
        self.button("Open").click()
        self.button("Empty drawing").click()
        self.page.wait_for_selector("dialog", state="detached")

    def template(self, name):
        """Open a linkage of the gallery by the beginning of its name."""
        self.button("Open").click()
        self.page.get_by_role("button", name=re.compile(f"^{name}", re.I)).click()
        self.page.wait_for_selector("dialog", state="detached")
        self.settled()

    def download(self, kind):
        """Return name and content of an export."""
        with self.page.expect_download(timeout=60_000) as waiting:
            self.page.locator("ul.kinds button", has_text=kind).first.click()
        return waiting.value.suggested_filename, Path(waiting.value.path()).read_bytes()

    def places(self):
        """Return pin -> transform in the drawing."""
        return dict(self.canvas.evaluate(WHERE))

    def drawn_at(self):
        """Return pin -> place in the drawing, in pixels."""
        return {k: tuple(map(float, re.findall(r"-?[\d.]+(?:e-?\d+)?", x)))[:2] for k, x in self.places().items()}

    def stands_at(self):
        """Return pin -> place in the world [m]."""
        scale, (x, y) = self.scale(), self.origin()
        return {k: ((at[0] - x) / scale, (y - at[1]) / scale) for k, at in self.drawn_at().items()}

    def button(self, name):
        return self.page.get_by_role("button", name=name, exact=True)

    def revision(self):
        return int(self.canvas.get_attribute("data-revision"))

    def until(self, happens, seconds=20):
        """Wait until a condition is true. The page forbids the evaluation of text, so the condition is asked repeatedly."""
        for _ in range(20 * seconds):
            if happens():
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"it does not come to that: {self.page.get_by_test_id('said').inner_text()}")

    def changed(self, before):
        """Wait until the drawing has a later revision than `before`."""
        self.until(lambda: self.revision() > before)
        self.settled()

    def settled(self):
        """Wait until every request has its reply."""
        self.until(lambda: bool(self.canvas.get_attribute("data-pending") == "0"), 60)

    def fitted(self):
        """Wait until the window has been fitted to the motion and to the room beside its curves, and no longer changes."""
        self.page.locator("path.path").first.wait_for(state="attached", timeout=60_000)
        seen = []

        def stays():
            seen.append(self.canvas.evaluate("c => [c.dataset.scale, c.dataset.origin, c.dataset.pending]"))
            return len(seen) > 12 and all(x == [*seen[-1][:2], "0"] for x in seen[-12:])

        self.until(stays, 60)

    def scale(self):
        return float(self.canvas.get_attribute("data-scale"))

    def origin(self):
        x, y = map(float, self.canvas.get_attribute("data-origin").split(","))
        return x, y

    def pixel(self, at):
        scale, (x, y), box = self.scale(), self.origin(), self.canvas.bounding_box()
        return box["x"] + x + scale * at[0], box["y"] + y - scale * at[1]

    def use(self, tool, *places, end=False):
        """Take a tool, click at places, and wait until the drawing has changed."""
        before = self.revision()
        self.button(tool).click()
        for place in places:
            self.page.mouse.click(*self.pixel(place))
        if end:
            self.page.keyboard.press("Enter")
        self.changed(before)

    def drive(self, coordinate):
        before = self.revision()
        self.page.locator("details.drive > summary").click()
        self.page.get_by_label("Driven coordinate").select_option(coordinate)
        self.changed(before)
        self.page.keyboard.press("Escape")
        self.page.locator(".drive .pop").wait_for(state="hidden")

    def status(self):
        return self.page.get_by_test_id("dof").inner_text(), self.page.get_by_test_id("loop-count").inner_text()

    def problems(self):
        return list(self.page.locator(".problems li").all_inner_texts())

    def path(self, point):
        """Return the drawn path (k, 2) [m] and the width of a pixel [m]."""
        drawn = self.page.locator(f'[data-path="{point}"] path.path')
        drawn.wait_for(state="attached", timeout=60_000)
        self.page.wait_for_timeout(500)  # the motion follows an edit a moment later, and its curves take room
        self.settled()
        scale = self.scale()
        pixels = np.array([[float(v) for v in pair.split()] for pair in re.findall(r"[ML]([-\d. ]+)", drawn.get_attribute("d"))])
        return (pixels - self.origin()) / [scale, -scale], 1 / scale

    def save(self, name):
        self.button("Save").click()
        self.page.locator('dialog input[name="path"]').fill(f"{name}.toml")
        self.button("Save the file").click()
        self.page.wait_for_selector("dialog", state="detached")


@pytest.fixture(scope="module")
def one(browser, studio_server):
    """The page that tests share."""
    opened = Page(browser, studio_server.address)
    yield opened
    opened.page.close()


@pytest.fixture
def page(one):
    """The shared page with an empty drawing; at the end, check that nothing went wrong."""
    one.page.keyboard.press("Escape")
    one.begin()
    yield one
    wrong, one.wrong[:] = [*one.wrong], []
    assert not wrong, wrong[:3]


def told(verb, file, *arguments, fine=(0,)):
    """Return the answer of a verb with --json on a file; `fine` are the exit codes that are allowed."""
    said, wrong = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(wrong):
        code = main([verb, str(file), *arguments, "--json"])
    assert code in fine, wrong.getvalue()[-2000:]
    return dict(json.loads(said.getvalue()))


A, B, C, D, P = (0.0, 0.0), (0.0, 0.12), (0.32, 0.28), (0.4, 0.0), (0.12, 0.28)


def four_bar(page):
    for pivot in (A, D):
        page.use("Ground pivot", pivot)
    page.use("Bar", A, B)
    page.use("Link", B, C, P, end=True)
    page.use("Bar", C, D)
    page.use("Observe", P)


@pytest.mark.slow
def test_a_linkage_drawn_from_nothing_moves_as_the_suite_has_it(page, folder):
    """The drawn path is that of `gauss-bench kinematics` on the saved file, to a pixel; two engines follow it."""
    for _ in range(2):
        page.button("Zoom out").click()
    four_bar(page)
    assert not [x for x in page.problems() if x.startswith("Error")]
    assert page.status() == ("1", "1")
    assert page.page.get_by_test_id("loops").locator("li").count() == 1
    page.drive("bar1")
    page.save("drawn")
    file = folder / "drawn.toml"
    assert told("show", file)["loops"] == 1
    computed = told("kinematics", file, "--intervals", "180")
    (point,) = computed["points"]
    shown, pixel = page.path(point)
    truth = np.column_stack([computed["points"][point][k] for k in "xy"])
    assert shown.shape == truth.shape
    assert np.abs(shown - truth).max() < pixel

    for engine, near, fine in (("gauss-native", 1e-6, (0,)), ("mujoco", 1e-2, (0, 1))):  # soft loops may cost MuJoCo the verdict
        ran = told("simulate", file, "--engine", engine, "--scenario", "driven", fine=fine)
        followed = np.column_stack([ran["points"][point][k] for k in "xy"])
        moved = np.array([np.interp(ran["t"], computed["t"], truth[:, k]) for k in (0, 1)]).T
        assert np.abs(followed - moved).max() < near + 1e-3  # chords of the path between 181 places


@pytest.mark.long
def test_a_drag_all_around_answers_every_move_and_jumps_to_no_branch(page):
    """A script in the page drags a joint of the eight-bar around, and waits for the frame of every move."""
    page.template("eight bar")
    page.button("Select").click()
    page.fitted()
    begun, moves = page.stands_at(), 180
    found = page.page.evaluate(SCRIPTS["drag"], [page.pixel((0.08, 0.0)), page.pixel((0.0, 0.0)), moves])
    page.settled()
    assert found["frames"] == moves + 1
    assert found["jump"] < 0.6, f"a link turned by {found['jump']} rad from one frame to the next"
    assert page.status() == ("1", "3")
    assert not page.problems()
    ended = page.stands_at()
    assert ended.keys() == begun.keys()
    assert max(np.hypot(*np.subtract(ended[k], begun[k])) for k in begun) < 1.0 / page.scale()


@pytest.mark.slow
def test_what_is_half_drawn_is_explained_and_stays_on_show(page):
    page.use("Ground pivot", A)
    page.use("Bar", (0.2, 0.1), (0.3, 0.2))  # is loose
    page.use("Bar", A, B)
    page.use("Spring", B, (0.3, 0.2))
    for way, forces in ((None, 1), ("Undo", 0), ("Redo", 1)):
        if way:
            page.button(way).click()
            page.settled()
        assert page.page.locator("g.linkage [data-pin]").count() >= 4, "the drawing has gone"
        assert page.page.locator("[data-force]").count() == forces
    page.button("Play").click()
    page.page.locator(".timeline .note, .prompt.refused").first.wait_for()


@pytest.mark.slow
def test_a_held_arrow_moves_the_selected_pin_in_one_step_of_the_history(page):
    """The bar is drawn by keys alone, with which test_studio_means makes every edit; Shift moves the cross by five steps."""
    press = page.page.keyboard.press

    def go(*keys):
        """Press keys, then Enter at the place of the cross."""
        for key in (*keys, "Enter"):
            press(key)
        page.settled()

    page.canvas.focus()
    go("g", *["Shift+ArrowLeft"] * 3)
    go("b")
    go(*["Shift+ArrowUp"] * 3)
    go("v")  # the free end of the bar
    assert page.page.locator(".properties h2").inner_text() == "Pin"
    for key, step in (("v", 1), ("m", 2)):  # first the linkage is moved, then the length is changed
        press(key)
        before, revision = page.stands_at(), page.revision()
        for _ in range(5):
            page.page.keyboard.down("ArrowLeft")
        page.page.keyboard.up("ArrowLeft")
        page.changed(revision)
        moved = page.stands_at()
        assert sum(np.hypot(*np.subtract(moved[x], before[x])) > 1e-4 for x in before) == 1
        assert page.revision() == revision + 1, step
    press("Control+z")
    page.changed(revision + 1)
    assert page.stands_at() == before


@pytest.mark.slow
@pytest.mark.long("__proto__")
@pytest.mark.parametrize("name", ["constructor", "__proto__"])
def test_names_of_a_file_are_text_though_every_object_of_a_script_has_them(page, folder, name):
    title = "<img src=x onerror=alert(1)>"
    text = (ROOT / "mechanisms" / "four_bar.toml").read_text(encoding="utf-8")
    text = re.sub(r"\bcrank\b", name, text.replace("Crank-rocker four-bar with a coupler point", title))
    (folder / "hostile.toml").write_text(re.sub(f"^{name}( *=)", r"crank\1", text, flags=re.M), encoding="utf-8")
    page.button("Open").click()
    page.page.locator('dialog input[type="file"]').set_input_files(folder / "hostile.toml")
    page.page.wait_for_selector("dialog", state="detached")
    page.fitted()
    assert page.page.get_by_label("Title").input_value() == title
    assert page.page.locator("img").count() == 0
    assert page.button(f"link {name}").count() == 1

    def is_whole():
        """Tell whether pivots and crank are as in the file, to a tenth of a pixel."""
        at = {k: complex(*x) for k, x in page.stands_at().items()}
        return abs(at["A"]) < 2e-4 and abs(at["D"] - 0.4) < 2e-4 and abs(abs(at["B"] - at["A"]) - 0.12) < 2e-4

    page.until(is_whole)
    still = page.stands_at()["B"]
    page.page.get_by_label("Time", exact=True).focus()
    page.page.keyboard.press("PageUp")
    page.until(lambda: is_whole() and np.hypot(*np.subtract(page.stands_at()["B"], still)) > 0.02)


@pytest.mark.slow
@pytest.mark.long("dark")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious_and_nothing_is_wider_than_the_screen(browser, studio_server, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    here = Page(browser, studio_server.address, color_scheme=scheme, bypass_csp=True)
    here.template("four bar")
    shown = {375: ("", "Properties"), 768: (), 1440: ("", "Open", "Share", "Help", "Release")}
    for width, buttons in shown.items():
        here.page.set_viewport_size({"width": width, "height": 900})
        assert here.page.evaluate("document.documentElement.scrollWidth") <= width
        for button in buttons:
            if button:
                here.button(button).click()
            here.page.wait_for_timeout(300)
            assert here.page.evaluate("document.documentElement.scrollWidth") <= width
            found = axe.run(here.page).response["violations"]
            faults = [x for x in found if x["impact"] in ("serious", "critical")]
            said = [(x["id"], x["nodes"][0]["html"][:160], x["nodes"][0]["failureSummary"][:200]) for x in faults]
            assert not faults, f"{width} {scheme} {button}: {said}"
            here.page.keyboard.press("Escape")
        if here.button("Close properties").is_visible():
            here.button("Close properties").click()
            here.button("Close properties").wait_for(state="hidden")
    assert not here.wrong, here.wrong[:3]
    here.page.close()


@pytest.mark.slow
def test_the_page_is_what_its_sources_give(tmp_path):
    """A build of the sources gives the same bytes, if node and the packages of the lock file are installed."""
    node, esbuild = shutil.which("node"), SOURCE / "node_modules" / "esbuild"
    if node is None or not esbuild.is_dir():
        pytest.skip("no node here with the packages of page_source/package-lock.json: the page is not rebuilt")
    subprocess.run([node, "build.mjs", str(tmp_path)], cwd=SOURCE, check=True, capture_output=True)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {p.name: p.read_bytes() for p in BUILT.iterdir()}


def test_the_page_is_small_and_names_no_other_place():
    assert sum(p.stat().st_size for p in BUILT.iterdir()) < 150_000
    for path in (*BUILT.iterdir(), SOURCE / "package.json"):
        addresses = {x for x in re.findall(r"https?://[^\s\"'`)]+", path.read_text(encoding="utf-8")) if "www.w3.org/" not in x}
        assert not addresses, f"{path.name}: {addresses}"
    lock = (SOURCE / "package-lock.json").read_text(encoding="utf-8")
    assert "://" not in lock, "no address at all: take out `funding`, which npm writes there"
    page = (BUILT / "index.html").read_text(encoding="utf-8")
    assert not re.findall(r"<script(?![^>]*\ssrc=)|<style|\son\w+=", page)
    for package in re.findall(r'^    "node_modules/(preact|@preact/[\w-]+)"', lock, re.M):
        assert f"## {package} " in (BUILT.parent / "THIRD_PARTY.md").read_text(encoding="utf-8")


def test_the_sources_of_the_page_import_each_other_in_no_circle():
    sources = {x.stem: x.read_text(encoding="utf-8") for x in (SOURCE / "src").glob("*.ts*")}
    arrows = {name: set(re.findall(r'from "\./([\w-]+)"', text)) for name, text in sources.items()}
    assert sum(map(len, arrows.values())) > 40
    order = [*TopologicalSorter(arrows).static_order()]  # raises where there is a circle
    assert order[-1] == "main"


@pytest.mark.long
def test_exports_are_what_they_are_called(page):
    """The browser downloads each kind of export that needs no engine; it makes the film itself."""
    page.template("four bar")
    page.page.locator("path.path").first.wait_for(state="attached", timeout=60_000)
    page.button("Share").click()
    for kind, ending, begins in (
        ("Linkage file", "toml", b"format"),
        ("Drawing", "svg", b"<svg"),
        ("Motion", "csv", b"t"),
        ("Animation", "gif", b"GIF89a"),
        ("Film", "webm", b"\x1a\x45\xdf\xa3"),  # EBML
    ):
        name, content = page.download(kind)
        assert name == f"four_bar.{ending}"
        assert begins in content[:200]
        assert len(content) > 300
    assert b"V_VP8" in content
    page.page.keyboard.press("Escape")


@pytest.mark.long
def test_a_link_opens_the_same_linkage_and_is_sent_nowhere(page, browser, studio_server):
    """The text after the # sign is in no request. `Page` checks that no page asks another server."""
    page.template("four bar")
    drawn = page.places()
    page.button("Share").click()
    page.button("Make a link").click()
    link = page.page.get_by_role("textbox", name="Link")
    link.wait_for()
    fragment = link.input_value().partition("#")[2]
    page.page.keyboard.press("Escape")
    page.begin()
    asked = []
    other = Page(browser, f"{studio_server.address}#{fragment}", asked=asked)
    other.until(lambda: bool(other.page.locator("g.linkage [data-link]").count() == 3))
    other.settled()
    assert other.places().keys() == drawn.keys()
    assert other.status() == ("1", "1")
    assert asked
    assert not [x for x in asked if fragment[:20] in x]
    assert fragment not in other.page.url, "the address keeps it no longer than it is needed"
    revision = other.revision()
    other.page.evaluate("fragment => { location.hash = fragment }", "!!<script>alert(1)</script>")
    other.page.locator(".prompt.refused").wait_for()
    assert "no linkage" in other.page.get_by_test_id("said").inner_text()
    assert other.places().keys() == drawn.keys()
    other.page.evaluate("fragment => { location.hash = fragment }", fragment)  # pasted where the page is open already
    other.changed(revision)
    assert other.places().keys() == drawn.keys()
    assert "#" not in other.page.url
    assert not other.wrong
    other.page.close()


@pytest.mark.long
def test_branches_are_shown_and_taken(page):
    page.template("four bar")
    page.fitted()
    before = page.stands_at()

    def off():
        return float(max(np.hypot(*np.subtract(x, before[k])) for k, x in page.stands_at().items()))

    page.button("Other assemblies").click()
    choices = page.page.locator("dialog ul.chips button")
    choices.nth(1).wait_for(timeout=60_000)
    assert choices.all_inner_texts() == ["as drawn", "branch 1"]
    choices.nth(1).hover()
    page.until(lambda: off() > 1e-3)
    choices.nth(1).click()
    page.page.wait_for_selector("dialog", state="detached")
    page.settled()
    assert off() > 1e-3
    page.button("Undo").click()
    page.until(lambda: off() < 1e-4)


@pytest.mark.slow
def test_a_recommendation_comes_answer_by_answer_and_brings_its_program(browser, studio_server):
    """The first answer is shown while the search goes on; the best answer has a program that can be copied.

    This test sends the events itself; test_studio_motion tests that a recommendation sends them.
    """
    asked = []
    sockets = []

    def between(page):
        server = page.connect_to_server()
        sockets.append(page)

        def heard(message):
            wanted = json.loads(message)
            if wanted["do"] != "recommend":
                server.send(message)
                return
            asked.append(wanted)
            page.send(json.dumps({"id": wanted["id"], "ok": True, "job": 9}))
            page.send(json.dumps({"event": "recommend", "job": 9, "answer": early}))

        page.on_message(heard)

    early = {"engine": "gauss-native", "setting": "rk4, 1 ms", "ratio": None, "error": 1e-6}
    early |= {"status": "ok", "message": "", "snippet": ""}
    last = [early | {"ratio": 1.0, "snippet": "import gauss_bench"}]
    last += [early | {"engine": "mujoco", "status": "fail", "message": "too far"}]
    here = Page(browser, studio_server.address, sockets=between)
    here.template("four bar")
    here.button("Release").click()
    here.button("Which engine should I take?").click()
    here.page.get_by_label("Position to within, m").fill("1e-3")
    here.page.get_by_label("Of which engines").select_option("gauss-native")
    here.button("Recommend").click()
    answers = here.page.locator("ol.answers li")
    answers.first.wait_for()
    assert (asked[0]["position"], asked[0]["engines"]) == (1e-3, ["gauss-native"])
    assert here.button("Stop").count() == 1
    assert "not timed yet" in answers.first.inner_text()
    assert answers.locator("pre").count() == 0
    sockets[-1].send(json.dumps({"event": "recommend", "job": 9, "answers": last, "advice": "gauss-native is the fastest"}))
    sockets[-1].send(json.dumps({"event": "recommend_done", "job": 9}))
    answers.locator("pre").wait_for()
    assert answers.locator("pre").inner_text() == "import gauss_bench"
    assert "the fastest" in answers.inner_text()
    assert here.button("Stop").count() == 0
    assert here.page.locator(".fallen li", has_text="too far").count() == 1
    assert not here.wrong
    here.page.close()


@pytest.mark.long
def test_let_go_a_second_engine_is_laid_over_and_said_where_it_parts(page):
    page.use("Ground pivot", A)
    page.use("Bar", A, (0.3, 0.1))
    page.use("Bar", (0.3, 0.1), (0.5, 0.1))
    page.button("Release").click()
    page.page.get_by_label("Until, s").fill("0.5")
    page.page.get_by_label("Engine", exact=True).select_option("gauss-native")
    page.page.get_by_label("Laid over it").select_option("lagrange")
    page.button("Let it go").click()
    parted = page.page.locator(".verdicts li", has_text="parts by at most")
    parted.wait_for(timeout=90_000)
    said = " ".join(parted.inner_text().split())
    assert re.search(r"lagrange parts by at most [\d.e-]+ m at centre of bar\d, [\d.]+ s after the start", said), said
    assert parted.locator("svg path.curve-1").first.get_attribute("d")
    assert page.page.locator(".verdicts .verdict.good").count() == 2
    page.button("Watch it").click()
    assert page.page.locator(".link.ghost").count() == 2
    assert "lagrange" in page.page.locator(".badge").inner_text()
    page.button("Back to the sketch").click()


@pytest.mark.long
def test_a_pin_put_elsewhere_shows_its_links_meanwhile(page):
    """Lengths change on the page while the pointer moves, without a step of the history."""
    four_bar(page)
    page.button("Reshape").click()
    before, revision = page.places(), page.revision()
    mouse = page.page.mouse
    mouse.move(*page.pixel(C))
    mouse.down()
    for k in range(1, 9):
        mouse.move(*page.pixel((C[0] + 0.01 * k, C[1])))
        page.page.wait_for_timeout(30)
    page.until(lambda: page.places() != before)
    assert page.revision() == revision
    page.page.keyboard.press("Escape")
    mouse.up()
    page.settled()
    assert page.places() == before
    assert page.revision() == revision


@pytest.mark.slow
def test_a_picture_lies_behind_and_outlives_the_page(page, folder):
    """The picture is scaled by two points, is there after a reload, and is sent once but in no scene."""
    Image.new("L", (40, 20), 128).save(folder / "grey.png")
    page.button("Picture").click()
    sent = []
    page.page.once("websocket", lambda s: s.on("framereceived", lambda frame: sent.append(str(frame))))
    page.page.locator(".picturebar input[type=file]").set_input_files(folder / "grey.png")
    behind = page.page.locator("image.behind")
    behind.wait_for(state="attached")
    width = float(behind.get_attribute("width"))
    box = behind.bounding_box()
    for share in (0.25, 0.75):
        page.page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
    page.page.locator(".picturebar form input").fill("0.2")
    page.button("Scale").click()
    page.settled()
    page.until(lambda: bool(page.page.locator(".picturebar").count() == 0))
    scale = page.scale()
    assert float(behind.get_attribute("width")) / scale == pytest.approx(0.4, abs=0.01)
    assert width != float(behind.get_attribute("width"))
    page.page.reload()
    page.page.wait_for_selector("#canvas[data-revision]", timeout=60_000)
    behind.wait_for(state="attached")
    assert float(behind.get_attribute("width")) / page.scale() == pytest.approx(0.4, abs=0.01)
    assert sum("data:image/png" in x for x in sent) == 1
    page.begin()
    assert behind.count() == 0


TOUCH = {"viewport": {"width": 375, "height": 812}, "has_touch": True}


@pytest.mark.slow
def test_a_finger_drags_a_joint_and_a_second_one_ends_that(browser, studio_server):
    """The crank's end follows a finger. A second finger ends the drag without a change, and two fingers zoom."""
    here = Page(browser, studio_server.address, **TOUCH)
    here.template("four bar")
    here.fitted()
    hand = here.page.context.new_cdp_session(here.page)

    def touch(kind, *fingers):
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(fingers)]
        hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    before, revision = here.drawn_at(), here.revision()
    (x, _), (x0, y0) = before["B"], before["A"]
    box = here.canvas.bounding_box()
    way = [(box["x"] + x0 + (x - x0) * np.cos(t), box["y"] + y0 - (x - x0) * np.sin(t)) for t in np.linspace(0.0, 1.0, 8)]
    touch("touchStart", way[0])
    for at in way[1:]:
        touch("touchMove", at)
    here.until(lambda: np.hypot(*np.subtract(here.drawn_at()["B"], before["B"])) > 0.9 * (x - x0))
    assert here.revision() == revision, "no step of the history before the finger is lifted"
    touch("touchMove", way[-1], (40.0, 300.0))
    touch("touchStart", way[-1], (40.0, 300.0))
    touch("touchEnd")
    here.settled()
    assert max(np.hypot(*np.subtract(here.drawn_at()[k], before[k])) for k in before) < 1.0

    touch("touchStart", way[0])
    for at in way[1:]:
        touch("touchMove", at)
    touch("touchEnd")
    here.changed(revision)
    moved = here.drawn_at()
    turned = np.arctan2(before["A"][1] - moved["B"][1], moved["B"][0] - before["A"][0])
    assert turned == pytest.approx(1.0, abs=0.1)
    assert np.hypot(*np.subtract(moved["C"], before["C"])) > 10
    assert (moved["A"], moved["D"]) == (before["A"], before["D"])

    scale, (x, y) = here.scale(), here.pixel((0.1, 0.2))
    for kind, half in (("touchStart", 30), *(("touchMove", 30 + 5 * k) for k in range(1, 7))):
        touch(kind, (x - half, y), (x + half, y))
    touch("touchEnd")
    here.until(lambda: abs(here.scale() / scale - 2.0) < 0.1)
    assert here.pixel((0.1, 0.2)) == pytest.approx((x, y), abs=3.0)
    assert not here.wrong
    here.page.close()


@pytest.mark.long
def test_instant_centres_go_with_the_frame_on_show(page):
    """In every frame, the centre of a pin lies on the pin, and the coupler's pole at the intersection of crank and rocker."""
    page.template("four bar")
    page.fitted()
    page.button("Instant centres").click()
    page.page.get_by_label("Pace").select_option("0.5")
    page.button("Play").click()
    page.page.locator('[data-centre="crank,coupler"]').wait_for(state="attached", timeout=60_000)
    frames = page.page.evaluate(SCRIPTS["filmed"], 60)
    page.button("Pause").click()
    page.page.get_by_label("Pace").select_option("1")
    page.button("Instant centres").click()
    assert len({tuple(x["pins"]["B"]) for x in frames}) > 5, "nothing moves"
    seen = 0
    for frame in frames:
        if frame["BC"] is None:
            continue  # drawn before the centres of the motion have come
        A, B, C, D = (np.array(frame["pins"][k]) for k in "ABCD")
        assert np.hypot(*(B - frame["BC"])) < 1.0
        crank, rocker = B - A, C - D
        meet = np.linalg.det([crank, rocker])
        if abs(meet) < 0.3 * np.hypot(*crank) * np.hypot(*rocker) or frame["pole"] is None:
            continue  # far away, where a pixel of the pins is many of the pole
        pole = A + crank * np.linalg.det([D - A, rocker]) / meet
        assert np.hypot(*(pole - frame["pole"])) < 4.0
        seen += 1
    assert seen > 5


@pytest.mark.long
def test_an_import_says_what_it_left_out_until_that_is_read(page, folder):
    pytest.importorskip("mujoco")
    rod = '<geom type="capsule" fromto="0 0 0 {0} 0 0" size="0.01" mass="1" contype="0" conaffinity="0"/>'
    model = f"""<mujoco model="arm"><worldbody>
      <body><joint name="shoulder" type="hinge" axis="0 1 0"/>{rod.format(0.3)}
        <body pos="0.3 0 0"><joint name="elbow" type="hinge" axis="0 1 0" limited="true" range="-90 90"/>{rod.format(0.2)}</body>
      </body></worldbody></mujoco>"""
    (folder / "arm.xml").write_text(model, encoding="utf-8")
    page.button("Open").click()
    page.page.locator('dialog input[type="file"]').set_input_files(folder / "arm.xml")
    page.page.wait_for_selector("dialog", state="detached")
    said = page.page.get_by_test_id("said")
    assert "the range of joint elbow" in said.inner_text()
    assert page.status() == ("2", "0")
    page.settled()
    page.page.wait_for_timeout(6500)  # what is merely told goes after 6 s
    assert "the range of joint elbow" in said.inner_text()
    page.button("Dismiss").click()
    assert not said.inner_text()


@pytest.mark.long
def test_when_the_server_has_gone_nothing_is_lost(browser, tmp_path):
    """The page offers its copy for download, and a studio at another port offers the unsaved drawing of the file."""
    (tmp_path / "own.toml").write_text((ROOT / "mechanisms" / "crank_slider.toml").read_text(encoding="utf-8"), encoding="utf-8")
    with studio(tmp_path) as first:
        here = Page(browser, first.address)
        here.button("Open").click()
        here.button("own.toml").click()
        here.page.wait_for_selector("dialog", state="detached")
        before = here.page.locator("g.linkage [data-pin]").count()
        here.use("Ground pivot", (0.2, 0.3))
        here.page.wait_for_timeout(600)  # the copy follows a moment later
        here.settled()
        first.process.kill()
        here.page.get_by_role("alert").filter(has_text="The server has gone").wait_for()
        with here.page.expect_download() as waiting:
            here.button("Download a copy").click()
        assert "0.3" in Path(waiting.value.path()).read_text(encoding="utf-8")
        assert here.page.locator("g.linkage [data-pin]").count() == before + 1, "what was drawn stays on show"
        here.button("Undo").click()
        here.page.locator(".prompt.refused").wait_for()
        assert "does not answer" in here.page.get_by_test_id("said").inner_text()
        here.page.close()
    with studio(tmp_path) as second:
        assert second.port != first.port
        here = Page(browser, second.address)
        here.button("Open own.toml").click()
        here.button("Recover it").click()
        here.page.locator("g.linkage [data-pin]").nth(before).wait_for(state="attached")
        assert here.page.get_by_role("region", name="Kept").count() == 0
        assert not here.wrong
        here.page.close()
