"""Drawing in the tests of the studio: requests without a socket."""

import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("tomlkit")
from gauss_bench.studio.requests import answer
from gauss_bench.studio.session import Session

Scene = dict[str, Any]


class Pen:
    """A session, and what it answers."""

    def __init__(self, folder: Path):
        self.session = Session(folder)

    def ask(self, do: str, **more: Any) -> dict[str, Any]:
        found = answer(self.session, {"id": 1, "do": do} | more)
        assert found["ok"], found["error"]["text"]
        return found

    def refused(self, do: str, **more: Any) -> str:
        """The sentence of a refusal that is not a fault of the studio."""
        found = answer(self.session, {"id": 1, "do": do} | more)
        assert not found["ok"]
        assert not found["error"].get("fault"), found["error"]["text"]
        return str(found["error"]["text"])

    def scene(self, do: str, **more: Any) -> Scene:
        return dict(self.ask(do, **more)["scene"])

    def pin(self, x: float, y: float, ground: bool = False) -> str:
        """The id of a new pin."""
        made = self.ask("add_pin", at=[x, y], ground=ground)["made"]
        return str(next(x for x in made if x.startswith("pins."))).removeprefix("pins.")

    @property
    def now(self) -> Scene:
        return self.session.scene()

    def at(self, x: float, y: float) -> str:
        """The id of the pin that lies at a place."""
        near = [p for p in self.now["pins"] if abs(p["at"][0] - x) < 1e-6 and abs(p["at"][1] - y) < 1e-6]
        assert len(near) == 1, [(p["id"], p["at"]) for p in self.now["pins"]]
        return str(near[0]["id"])

    def bar(self, a: tuple[float, float], b: tuple[float, float]) -> str:
        """The name of a new bar between two places, at pins where there are some."""
        return self.link("add_bar", **{"from": self.spot(a), "to": self.spot(b)})

    def plate(self, *at: tuple[float, float]) -> str:
        return self.link("add_link", points=[self.spot(x) for x in at])

    def link(self, do: str, **more: Any) -> str:
        return str(next(x for x in self.ask(do, **more)["made"] if x.startswith("links."))).removeprefix("links.")

    def spot(self, at: tuple[float, float]) -> dict[str, Any]:
        near = [p for p in self.now["pins"] if abs(p["at"][0] - at[0]) < 1e-6 and abs(p["at"][1] - at[1]) < 1e-6]
        return {"pin": near[0]["id"]} if near else {"at": [*at]}


class Watched:
    """Events of one piece of work, until it is done."""

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
    """Drawn from nothing, with a point on the coupler, and driven."""
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
    """A crank whose pin slides in a slotted lever, which moves a ram on the ground."""
    pen = Pen(folder)
    for at in ((0.0, 0.0), (0.0, 0.3)):
        pen.pin(*at, ground=True)
    crank = pen.bar((0.0, 0.3), (0.1, 0.3))
    lever = pen.bar((0.0, 0.0), (0.2, 0.6))
    pen.ask("add_slide", pin=pen.at(0.1, 0.3), guide=lever, through=[0.0, 0.0])
    pen.bar((0.2, 0.6), (0.4, 0.6))
    pen.ask("add_slide", pin=pen.at(0.4, 0.6), guide="ground", angle_deg=0.0)
    pen.ask("drive", coordinate=crank)
    return pen


def eight_bar(folder: Path) -> Pen:
    """The class IV linkage of three loops, at round places."""
    pen = Pen(folder)
    for at in ((0.0, 0.0), (0.36, -0.08), (0.48, 0.48)):
        pen.pin(*at, ground=True)
    crank = pen.bar((0.0, 0.0), (0.08, 0.0))
    pen.plate((0.08, 0.0), (0.42, 0.11), (0.13, 0.22))
    pen.bar((0.36, -0.08), (0.42, 0.11))
    pen.plate((0.13, 0.22), (0.33, 0.35), (0.15, 0.39))
    rod = pen.bar((0.33, 0.35), (0.26, 0.58))
    pen.bar((0.15, 0.39), (0.38, 0.70))
    pen.plate((0.48, 0.48), (0.26, 0.58), (0.38, 0.70))
    pen.ask("add_point", link=rod, at=[0.295, 0.465], observe=True)
    pen.ask("drive", coordinate=crank)
    return pen


DRAWN = {"four_bar": four_bar, "quick_return": quick_return, "eight_bar": eight_bar}
