"""A document with the places of its points: what edits are made of.

An edit changes the tables; where things lie follows from the poses of the links, which it changes along. At the end the sketch of
the file is written anew from them, so that the file opens as it was drawn.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.linkage.build import resolve_points
from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.studio.document import Document
from gauss_bench.studio.errors import Refused
from gauss_bench.studio.messages import place
from gauss_bench.studio.reading import Reading, lone_pins
from gauss_bench.studio.scene import pins
from gauss_bench.terms import Array

DIGITS = 11  # after the point, of lengths [m] that are written: what is lost is far below what joints are closed to
PLACED = 9  # of places and degrees of a sketch or start, from which the linkage is closed
SAME = 1e-9  # [m] places that are one
NAME = re.compile(r"[A-Za-z0-9_]+")
LETTERS = "PQRSTUVWXYZ"  # names of points that are no pins
KG_PER_M = 0.8  # steel flat 20 x 5 mm, as in the linkages of the suite
BLOCK = {"mass": 0.1, "inertia": 5e-5}  # [kg], [kg m^2] of a sliding block, as in the shaper


@dataclass(frozen=True)
class Pin:
    """A place of the drawing: `members` are the points that lie there; none, where nothing is held yet."""

    id: str
    at: tuple[float, float]
    members: tuple[str, ...]


def round_digits(x: Any, digits: int = PLACED) -> float:
    """A number as it is written: without the noise of its last digits, and without a negative zero."""
    return round(float(x), digits) + 0.0


def pair(x: Iterable[Any], digits: int = DIGITS) -> list[float]:
    return [round_digits(y, digits) for y in x]


def owner(reference: str) -> str:
    """The link of "link.point"."""
    return reference.partition(".")[0]


class Drawing:
    """The tables of a document that is being edited, and where its links are."""

    def __init__(self, document: Document, reading: Reading):
        self.document, self.reading = document, reading
        self.poses = {name: np.array(x) for name, x in reading.poses(reading.q).items()}
        self.pins = {x["id"]: Pin(x["id"], (x["at"][0], x["at"][1]), tuple(x["members"])) for x in pins(reading, set())}
        self.made: list[str] = []

    def group(self, name: str) -> dict[str, Any]:
        """A table of the file, made where it is missing.

        Raises:
            Refused: the file has something else there.
        """
        entries = self.document.setdefault(name, {})
        if not isinstance(entries, dict):
            raise Refused(f"{name} is no table in this file: mend its text first", field=name)
        return entries

    def sub(self, name: str, key: str) -> dict[str, Any]:
        entries = self.group(name).setdefault(key, {})
        if not isinstance(entries, dict):
            raise Refused(f"{name}.{key} is no table in this file: mend its text first", field=f"{name}.{key}")
        return entries

    def link(self, name: Any) -> dict[str, Any]:
        """The table of a link.

        Raises:
            Refused: there is none of that name that could be read.
        """
        entries = self.group("links").get(name) if isinstance(name, str) else None
        if not isinstance(entries, dict) or name not in self.poses:
            raise Refused(f"there is no link {str(name)[:60]!r}", field="link")
        return entries

    def points(self, link: str) -> dict[str, Array]:
        """Name -> (2,) place of a link's points in its own frame; of the ground in the world."""
        given = self.sub("ground", "points") if link == "ground" else self.link(link).get("points", {})
        try:
            return resolve_points(given)
        except (RecursionError, KeyError, TypeError, ValueError):
            pass  # a fault of the file, which is told; what could be read of it counts
        rest = self.reading.rest.get("ground", {}) if link == "ground" else self.reading.rest["links"][link]
        return resolve_points(rest.get("points", {}))

    def place(self, reference: str) -> Array:
        """(2,) place of a point in the world.

        Raises:
            Refused: there is no such point.
        """
        link, _, name = reference.partition(".")
        known = self.points(link) if link == "ground" or link in self.group("links") else {}
        if name not in known:
            raise Refused(f"there is no point {reference[:80]!r}", field="point")
        return known[name] if link == "ground" else self.world(link, known[name])

    def world(self, link: str, local: Array) -> Array:
        x, y, theta = self.poses[link]
        c, s = math.cos(theta), math.sin(theta)
        return np.array([x + c * local[0] - s * local[1], y + s * local[0] + c * local[1]])

    def local(self, link: str, at: Any) -> Array:
        """(2,) of a place in the world in a link's own frame."""
        if link == "ground":
            return np.array(at, dtype=float)
        x, y, theta = self.poses[link]
        c, s = math.cos(theta), math.sin(theta)
        dx, dy = at[0] - x, at[1] - y
        return np.array([c * dx + s * dy, c * dy - s * dx])

    def set_point(self, reference: str, at: Any) -> None:
        """Put a point of a link or of the ground to a place in the world; points that are given from it stay where they are."""
        link, _, name = reference.partition(".")
        known = self.points(link)
        given = self.sub("ground", "points") if link == "ground" else self.link(link)["points"]
        for other, value in given.items():
            if isinstance(value, dict) and other != name and name in self._chain(given, other):
                given[other] = pair(known[other])
        given[name] = pair(self.local(link, at))

    @staticmethod
    def _chain(given: dict[str, Any], name: str) -> list[str]:
        """The points that a point is given from, one after the other."""
        chain: list[str] = []
        at: Any = given[name].get("from")
        while isinstance(at, str) and at not in chain and at in given:
            chain.append(at)
            at = given[at].get("from") if isinstance(given[at], dict) else None
        return chain

    def number(self) -> str:
        """The smallest number that names no pin, joint or point."""
        taken = {
            *table(self.document, "joints"),
            *table(self.document, "cylinders"),
            *table(table(self.document, "assembly"), "sketch"),
        }
        taken |= {*table(table(self.document, "ground"), "points")} | {
            x for _, link in items(self.document, "links") for x in table(link, "points")
        }
        return next(str(k) for k in range(1, len(taken) + 2) if str(k) not in taken)

    def fresh(self, word: str, *groups: str) -> str:
        """A name of a word and the smallest number that is new in these groups."""
        taken = {name for group in groups for name in table(self.document, group)}
        return next(f"{word}{k}" for k in range(1, len(taken) + 2) if f"{word}{k}" not in taken)

    def letter(self, link: str) -> str:
        """A letter for a point of a link that is no pin."""
        taken = self.points(link)
        return next((x for x in LETTERS if x not in taken), self.number())

    def pin(self, given: Any) -> Pin:
        """The pin that `{"pin": id}` or `{"at": [x, y], "ground": bool}` means; a new one is drawn.

        Raises:
            Refused: there is no such pin, or no place.
        """
        if isinstance(given, dict) and "pin" in given:
            given = given["pin"]
        if isinstance(given, str):
            if given not in self.pins:
                raise Refused(f"there is no pin {given[:60]!r}", field="pin")
            return self.pins[given]
        if not isinstance(given, dict):
            raise Refused("a pin is named, or placed", field="pin")
        at, name = place(given.get("at")), self.number()
        if given.get("ground"):
            self.sub("ground", "points")[name] = pair(at)
            return self._known(Pin(f"ground.{name}", at, (f"ground.{name}",)))
        self.sub("assembly", "sketch")[name] = pair(at)
        return self._known(Pin(name, at, ()))

    def _known(self, pin: Pin) -> Pin:
        self.pins[pin.id] = pin
        self.made.append(f"pins.{pin.id}")
        return pin

    def joint_of(self, pin: Pin) -> str | None:
        """The joint of the file that holds a pin, if any."""
        for name, joint in items(self.document, "joints"):
            if joint.get("type") == "revolute" and {*pin.members} & {x for x in sequence(joint, "at") if isinstance(x, str)}:
                return name
        return None

    def attach(self, pin: Pin, link: str) -> Pin:
        """Give a link a point at a pin, and join it to what lies there; the pin as it is then."""
        if link in map(owner, pin.members):
            raise Refused(f"pin {pin.id} is on {link} already", (f"pins.{pin.id}",))
        taken = self.points(link)
        wished = self.joint_of(pin) or (pin.members[0].partition(".")[2] if pin.members else pin.id)
        name = wished if wished not in taken and NAME.fullmatch(wished) else self.number()
        self.link(link)["points"][name] = pair(self.local(link, pin.at))
        return self.hold(pin, f"{link}.{name}")

    def hold(self, pin: Pin, reference: str) -> Pin:
        """Join a point that lies at a pin to it."""
        del self.pins[pin.id]
        joint = self.joint_of(pin)
        own = [x for x in pin.members if owner(x) == "ground" or owner(x) in self.group("links")]
        if joint is not None:
            self.group("joints")[joint]["at"].append(reference)
            id = pin.id
        elif own:
            joints, wished = self.group("joints"), own[0].partition(".")[2]
            id = wished if wished not in joints and wished not in self.group("cylinders") else self.number()
            joints[id] = {"type": "revolute", "at": [own[0], reference]}
        else:
            table(table(self.document, "assembly"), "sketch").pop(pin.id, None)
            id = reference
        self.made = [f"pins.{id}" if x == f"pins.{pin.id}" else x for x in self.made]
        held = Pin(id, pin.at, (*pin.members, reference))
        self.pins[id] = held
        return held

    def ends(self, a: Any, b: Any) -> tuple[str, str]:
        """Points of two different links at two pins, or as they are named; on links rather than on the ground.

        Raises:
            Refused: there are none.
        """
        sides = [self.pins[str(x)].members if str(x) in self.pins else (str(x),) for x in (a, b)]
        first, second = (sorted(x, key=lambda y: owner(y) == "ground") for x in sides)
        for x in first:
            for y in second:
                if owner(x) != owner(y):
                    self.place(x)
                    self.place(y)
                    return x, y
        where = tuple(f"pins.{x}" for x in (a, b) if str(x) in self.pins)
        raise Refused("it acts between points of two different links", where, "b")

    def on_link(self, point: str) -> str:
        """A point as it is named, or a link's point at the pin of that name.

        Raises:
            Refused: there is none.
        """
        members = self.pins[point].members if point in self.pins else (point,)
        reference = next((x for x in members if owner(x) != "ground"), members[0] if members else point)
        self.place(reference)
        return reference

    def add_link(self, name: str, at: Any, theta: float, more: dict[str, Any]) -> None:
        """A new link without points, whose frame lies at a place and an angle."""
        self.group("links")[name] = {"points": {}} | more
        self.poses[name] = np.array([at[0], at[1], theta])
        self.made.insert(0, f"links.{name}")

    def framed(self, link: str) -> bool:
        """Tell whether a link's frame runs along its first bar, and nothing but its points is given in it."""
        given = self.link(link)
        bars, points = sequence(given, "bars"), self.points(link)
        welded = any(link in (x.get("link"), x.get("to")) for _, x in items(self.document, "welds"))
        fixed = any(x.get("frame") in (link, "body") for _, x in items(self.document, "forces"))
        if not bars or "com" in given or "point_masses" in given or welded or fixed:
            return False
        a, b = (points[x] for x in bars[0])
        return bool(np.abs(a).max() < SAME and abs(b[1]) < SAME and b[0] > 0)

    def reframe(self, link: str) -> None:
        """Lay a link's frame along its first bar again, after a point of it has moved; lines of slides turn with the bar."""
        given = self.link(link)
        places = {key: self.place(f"{link}.{key}") for key in given["points"]}
        a, b = (places[x] for x in given["bars"][0])
        turn = math.atan2(b[1] - a[1], b[0] - a[0])
        old = float(self.poses[link][2])
        self.poses[link] = np.array([*a, old + math.remainder(turn - old, 2 * math.pi)])
        given["points"] = {key: pair(self.local(link, x)) for key, x in places.items()}

    def sketch(self) -> None:
        """Write where things lie into the table `assembly`: every pin, and one more point of links that one pin alone holds."""
        assembly = self.group("assembly")
        old, lone = table(assembly, "sketch"), lone_pins(self.document)
        drawn: dict[str, list[float]] = {}
        pinned: dict[str, list[str]] = {}
        for name, joint in items(self.document, "joints"):
            references = [x for x in sequence(joint, "at") if isinstance(x, str)]
            at = [x for x in references if owner(x) == "ground" or owner(x) in self.poses]
            for x in at:
                pinned.setdefault(owner(x), []).append(x)
            if joint.get("type") == "revolute" and at and not any(owner(x) == "ground" for x in references):
                drawn[name] = pair(np.mean([self.place(x) for x in at], axis=0), PLACED)
            elif joint.get("type") == "prismatic" and name in old and owner(str(joint.get("block"))) in self.poses:
                drawn[name] = pair(self.place(str(joint["block"])), PLACED)
        angles = {name for key in ("angles", "angles_deg") for name in table(assembly, key)}
        slid = {owner(str(x.get(end))) for _, x in items(self.document, "joints") for end in ("guide", "block")}
        for link in self.group("links"):
            if link not in self.poses:
                continue
            points = self.points(link)
            known = [x.partition(".")[2] for x in pinned.get(link, [])]
            known += [k for k in points if f"{link}.{k}" in old and k not in known]
            own = [k for k in known if f"{link}.{k}" in old and f"{link}.{k}" not in pinned.get(link, [])]
            drawn |= {f"{link}.{k}": pair(self.place(f"{link}.{k}"), PLACED) for k in own}
            for key in points:
                apart = [k for k in known if np.abs(points[k] - points[key]).max() > SAME]
                if len(known) == 0 or (key not in known and len(apart) == len(known) and not self._lie_apart(points, known)):
                    drawn[f"{link}.{key}"] = pair(self.place(f"{link}.{key}"), PLACED)
                    known.append(key)
            if not self._lie_apart(points, known) and link not in angles and link not in slid:
                angles.add(link)
                assembly.setdefault("angles_deg", {})[link] = 0.0
        joints = {k for k, x in items(self.document, "joints") if not any(owner(str(y)) == "ground" for y in sequence(x, "at"))}
        kept = {
            k: x for k, x in old.items() if k in joints or ("." in k and owner(k) not in self.poses)
        }  # of what could not be read
        assembly["sketch"] = kept | drawn | lone
        for name in angles & self.poses.keys():
            for key, unit in (("angles_deg", math.degrees(1.0)), ("angles", 1.0)):
                if name in table(assembly, key):
                    assembly[key][name] = round_digits(self.poses[name][2] * unit)
        if not assembly["sketch"]:
            del assembly["sketch"]
        if not assembly:
            del self.document["assembly"]

    @staticmethod
    def _lie_apart(points: dict[str, Array], known: list[str]) -> bool:
        """Tell whether two of the known points lie apart."""
        return any(np.abs(points[k] - points[known[0]]).max() > SAME for k in known)

    def tidy(self) -> None:
        """Leave no empty tables behind."""
        for group in ("joints", "cylinders", "forces", "welds", "scenarios"):
            if self.document.get(group) == {}:
                del self.document[group]
        for group in ("ground", "observe", "assembly"):
            entry = table(self.document, group)
            for key in [k for k, x in entry.items() if x in ({}, [])]:
                del entry[key]
            if self.document.get(group) == {}:
                del self.document[group]
