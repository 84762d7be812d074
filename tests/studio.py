"""What the tests of the studio share: drawing by requests without a socket, and servers in processes of their own."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("tomlkit")
pytest.importorskip("uvicorn")
from websockets.sync.client import ClientConnection, connect

from gauss_bench.studio.requests import answer
from gauss_bench.studio.session import Session

Scene = dict[str, Any]
XY = tuple[float, float]


class Pen:
    """A session that draws by requests."""

    def __init__(self, folder: Path):
        self.session = Session(folder)

    def ask(self, do: str, **more: Any) -> dict[str, Any]:
        found = answer(self.session, {"id": 1, "do": do} | more)
        assert found["ok"], found["error"]["text"]
        return found

    def refused(self, do: str, **more: Any) -> str:
        """Return the sentence by which a request is refused, and check that it is not a fault of the studio."""
        found = answer(self.session, {"id": 1, "do": do} | more)
        assert not found["ok"]
        assert not found["error"].get("fault"), found["error"]["text"]
        return str(found["error"]["text"])

    def scene(self, do: str, **more: Any) -> Scene:
        return dict(self.ask(do, **more)["scene"])

    def pin(self, x: float, y: float, ground: bool = False) -> None:
        """Draw a pin."""
        self.ask("add_pin", at=[x, y], ground=ground)

    @property
    def now(self) -> Scene:
        return self.session.scene()

    def near(self, x: float, y: float) -> list[str]:
        """Return the ids of the pins at a place."""
        return [p["id"] for p in self.now["pins"] if abs(p["at"][0] - x) < 1e-6 and abs(p["at"][1] - y) < 1e-6]

    def at(self, x: float, y: float) -> str:
        """Return the id of the only pin at a place."""
        (id,) = self.near(x, y)
        return id

    def bar(self, *at: XY) -> str:
        """Draw a bar between two places, at pins if there are any, and return its name."""
        a, b = map(self.spot, at)
        return self.link("add_bar", **{"from": a, "to": b})

    def plate(self, *at: XY) -> str:
        return self.link("add_link", points=[self.spot(x) for x in at])

    def link(self, do: str, **more: Any) -> str:
        return str(next(x for x in self.ask(do, **more)["made"] if x.startswith("links."))).removeprefix("links.")

    def spot(self, at: XY) -> dict[str, Any]:
        """Return the pin at a place, or the place if there is no pin, in the form of messages."""
        near = self.near(*at)
        return {"pin": near[0]} if near else {"at": [*at]}


class Watched:
    """A collection of the events that a session sends."""

    def __init__(self, pen: Pen):
        self.events: list[dict[str, Any]] = []
        pen.session.tell = self.events.append

    def until(self, word: str) -> dict[str, Any]:
        for _ in range(1200):
            if found := [x for x in self.events if x["event"] == word]:
                return found[0]
            time.sleep(0.1)
        raise AssertionError(f"no {word}: {self.events}")


def four_bar(folder: Path) -> Pen:
    """Draw a four-bar with an observed point on its coupler and a driven crank."""
    pen = Pen(folder)
    pen.pin(0.0, 0.0, ground=True)
    pen.pin(0.4, 0.0, ground=True)
    crank = pen.bar((0.0, 0.0), (0.0, 0.12))
    coupler = pen.bar((0.0, 0.12), (0.3, 0.28))
    pen.bar((0.3, 0.28), (0.4, 0.0))
    pen.ask("add_point", link=coupler, at=[0.1, 0.3], observe=True)
    pen.ask("drive", coordinate=crank, law="constant", speed=6.283185307179586)
    return pen


def quick_return(folder: Path) -> Pen:
    """Draw a crank whose pin slides in a slotted lever, which moves a ram on the ground."""
    pen = Pen(folder)
    for at in ((0.0, 0.0), (0.0, 0.3)):
        pen.pin(*at, ground=True)
    crank = pen.bar((0.0, 0.3), (0.1, 0.3))
    lever = pen.bar((0.0, 0.0), (0.2, 0.6))
    pen.ask("add_slide", pin=pen.at(0.1, 0.3), guide=lever, through=[0.0, 0.0], angle_deg=math.degrees(math.atan2(0.3, 0.1)))
    pen.bar((0.2, 0.6), (0.4, 0.6))
    pen.ask("add_slide", pin=pen.at(0.4, 0.6), guide="ground", through=[0.4, 0.6], angle_deg=0.0)
    pen.ask("drive", coordinate=crank)
    return pen


DRAWN = {"four_bar": four_bar, "quick_return": quick_return}


@dataclass(frozen=True)
class Running:
    """A studio in a process of its own."""

    process: "subprocess.Popen[str]"
    port: int
    token: str
    folder: Path

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def get(self, path: str, **headers: str) -> tuple[int, str, Any]:
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, answer.read().decode(), answer.headers
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode(), error.headers

    def socket(self, token: str | None = None, **headers: str) -> ClientConnection:
        address = f"ws://127.0.0.1:{self.port}/socket?token={self.token if token is None else token}"
        return connect(address, additional_headers=headers, max_size=None, open_timeout=20)


def started(folder: Path, *arguments: str) -> Running:
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-m", "gauss_bench", "studio", "--no-browser", *arguments]
    process = subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", line):
            return Running(process, int(found[1]), found[2], folder)
    raise AssertionError("the studio did not say where it is")


def ended(running: Running, by: int = signal.SIGINT) -> int:
    running.process.send_signal(by)
    _, said = running.process.communicate(timeout=60)
    assert "Traceback" not in said, said
    return running.process.returncode


def ask(socket: ClientConnection, do: str, **more: Any) -> dict[str, Any]:
    socket.send(json.dumps({"id": 1, "do": do} | more))
    while True:
        found: dict[str, Any] = json.loads(socket.recv(60))
        if "event" not in found:
            return found
