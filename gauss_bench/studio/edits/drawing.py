"""Hold the document that an edit changes, with the poses of its links. Every edit is a function of a `Drawing`.

Tables and poses determine the places of all points; after the edit, the file's sketch (`assembly.sketch`, from which joints are
closed) is written anew. Places are complex numbers x + i y [m]. A reference is the text "LINK.POINT". The id of a pin is the name
of its joint, the reference of its point if it has no joint, or its name in the sketch if it joins nothing yet.
"""

import math
import re
from cmath import phase, rect
from dataclasses import dataclass
from itertools import product
from typing import Any

from gauss_bench.linkage.build import resolve_points
from gauss_bench.linkage.limits import follow
from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.studio.document import Document
from gauss_bench.studio.messages import Refused, place
from gauss_bench.studio.reading import Reading, lone_pins, new_faults
from gauss_bench.studio.scene import describe_pins

DIGITS = 11  # decimals of lengths [m] in the file; the rounding is far below the tolerance of closed joints
PLACED = 9  # decimals of positions [m] and angles [deg] in a sketch or start; on loading, the joints are closed again
SAME = 1e-9  # [m] distance below which two places are the same
NAME = re.compile(r"[A-Za-z0-9_]+")
LETTERS = "PQRSTUVWXYZ"  # names for points that are no pins
KG_PER_M = 0.8  # [kg/m] steel flat 20 x 5 mm, as in the linkages of the suite
BLOCK = {"mass": 0.1, "inertia": 5e-5}  # [kg], [kg m^2] of a sliding block, as in the shaper


@dataclass(frozen=True)
class Pin:
    """A pin of the drawing.

    Attributes:
        id: name of the joint, reference or name in the sketch, as described at the top of this file.
        at: place of the pin [m].
        members: references "LINK.POINT" of the points that the pin joins; empty if the pin joins nothing yet.
    """

    id: str
    at: complex
    members: tuple[str, ...]

    @property
    def is_grounded(self) -> bool:
        """Whether one of the points is a point of the ground."""
        return "ground" in map(owner, self.members)


def round_digits(x: Any, digits: int = PLACED) -> float:
    """Round a number for the file, without a negative zero."""
    return round(float(x), digits) + 0.0


def pair(x: complex, digits: int = DIGITS) -> list[float]:
    """Return a place as [x, y], rounded for the file."""
    return [round_digits(x.real, digits), round_digits(x.imag, digits)]


def owner(reference: str) -> str:
    """Return LINK of a reference "LINK.POINT", or the part of any other text before its first dot."""
    return reference.partition(".")[0]


def tail(reference: str) -> str:
    """Return POINT of a reference "LINK.POINT", or the part of any other text after its first dot."""
    return reference.partition(".")[2]


class Drawing:
    """The document of a linkage that is being edited: its tables (as in the TOML file), and the places of its links and pins.

    Attributes:
        document: the tables of the document, which the edit changes.
        poses: link -> place of the origin [m] and angle [rad] of its frame; the ground has (0, 0).
        pins: id -> pin.
        reading: the mechanism and the assembled positions as read from the document before the edit.
        made: ids of the parts that the edit has made; links and slides first.
    """

    def __init__(self, document: Document, reading: Reading):
        """Take the poses and pins from a reading of the document."""
        self.document, self.reading = document, reading
        self.set_poses(reading.poses(reading.q))
        self.pins = {x["id"]: Pin(x["id"], complex(*x["at"]), tuple(x["members"])) for x in describe_pins(reading, set())}
        self.made: list[str] = []

    def set_poses(self, poses: dict[str, list[float]]) -> None:
        """Set the poses of the links from a dict link -> [x, y, theta]."""
        self.poses = {"ground": (0j, 0.0)} | {name: (complex(x, y), theta) for name, (x, y, theta) in poses.items()}

    def check(self, where: tuple[str, ...] = ()) -> None:
        """Refuse the edit if it has given the file a new fault; `where` has the ids of the parts that the refusal concerns."""
        faults = new_faults(self.reading.document, self.document)
        if faults:
            raise Refused("; ".join(str(x) for x in faults[:3]), where, faults[0].path.rpartition(".")[2])

    def group(self, name: str, key: str | None = None) -> dict[str, Any]:
        """Return the table `name` of the file, or the table `key` in that table; add a table that is missing."""
        entries, path = self.document.setdefault(name, {}), name
        if key is not None and isinstance(entries, dict):
            entries, path = entries.setdefault(key, {}), f"{name}.{key}"
        if not isinstance(entries, dict):
            raise Refused(f"{path} is no table in this file: correct the file first", field=path)
        return entries

    def link(self, name: Any) -> dict[str, Any]:
        """Return the table of a link in the file; refuse a name that no link of the mechanism has."""
        entries = self.group("links").get(name) if isinstance(name, str) else None
        if not isinstance(entries, dict) or name not in self.poses:
            raise Refused(f"there is no link {str(name)[:60]!r}", field="link")
        return entries

    def is_written(self, link: str) -> bool:
        """Tell whether the file can name points of a link: true for the ground and all links, false for the parts of a cylinder."""
        return link == "ground" or link in self.group("links")

    def written_points(self, link: str) -> dict[str, Any]:
        """Return name -> value of the points of a link or of the ground, as the file gives them."""
        points = self.group("ground", "points") if link == "ground" else self.link(link).setdefault("points", {})
        return points if isinstance(points, dict) else {}

    def points(self, link: str) -> dict[str, complex]:
        """Return name -> place of a link's points in its own frame, or of the ground's points in the world."""
        written = self.written_points(link)  # outside `try`: it may raise Refused, a ValueError, which must not be caught below
        try:
            points = resolve_points(written)
        except (RecursionError, KeyError, TypeError, ValueError):  # a point is faulty: take the points that could be read
            # `reading.rest` is the document without its faulty parts
            rest = self.reading.rest.get("ground", {}) if link == "ground" else self.reading.rest["links"][link]
            points = resolve_points(rest.get("points", {}))
        return {name: complex(*x) for name, x in points.items()}

    def place(self, reference: str) -> complex:
        """Return the place of the point LINK.POINT in the world; refuse a point that the file does not have."""
        link, name = owner(reference), tail(reference)
        points = self.points(link) if self.is_written(link) else {}
        if name not in points:
            raise Refused(f"there is no point {reference[:80]!r}", field="point")
        return self.to_world(link, points[name])

    def to_world(self, link: str, local: complex) -> complex:
        """Return a place in a link's own frame as a place in the world."""
        origin, theta = self.poses[link]
        return origin + rect(1.0, theta) * local

    def to_local(self, link: str, at: complex) -> complex:
        """Return a place in the world as a place in a link's own frame."""
        origin, theta = self.poses[link]
        return (at - origin) * rect(1.0, -theta)

    def set_point(self, reference: str, at: complex) -> None:
        """Move a point of a link or of the ground to a place in the world; points that are defined from it keep their places."""
        link, name = owner(reference), tail(reference)
        places, written = self.points(link), self.written_points(link)
        for other in written:
            # `follow` returns the chain of points from which a point is defined, each by its key `from`
            if other != name and name in written and name in follow(written, other)[0]:
                written[other] = pair(places[other])
        written[name] = pair(self.to_local(link, at))

    # names

    def new_name(self, word: str, *groups: str) -> str:
        """Return a new name: the word followed by the smallest number for which no entry of the groups has this name.

        Groups are tables of the file, by default joints and cylinders. With an empty word the name is a number, and also differs
        from the names of all pins and points.
        """
        taken = {name for group in groups or ("joints", "cylinders") for name in table(self.document, group)}
        if not word:
            taken = taken.union(table(table(self.document, "assembly"), "sketch"), table(table(self.document, "ground"), "points"))
            taken = taken.union(*(table(link, "points") for _, link in items(self.document, "links")))
        # of len(taken) + 1 numbers, at least one is free
        return next(f"{word}{k}" for k in range(1, len(taken) + 2) if f"{word}{k}" not in taken)

    def new_point_name(self, link: str) -> str:
        """Return an unused name for a point that is no pin: on a link an unused letter if there is any, else a number."""
        unused = [] if link == "ground" else [x for x in LETTERS if x not in self.points(link)]
        return unused[0] if unused else self.new_name("")

    # pins

    def pin(self, choice: Any) -> Pin:
        """Return a pin of the drawing, or draw a new one.

        Args:
            choice: a value of a message: the id of a pin, `{"pin": id}`, or `{"at": [x, y], "ground": bool}` for a new pin.
        """
        if isinstance(choice, dict) and "pin" in choice:
            choice = choice["pin"]
        if isinstance(choice, str):
            if choice not in self.pins:
                raise Refused(f"there is no pin {choice[:60]!r}", field="pin")
            return self.pins[choice]
        if not isinstance(choice, dict):
            raise Refused("give the id or the place of a pin", field="pin")
        at, name = place(choice.get("at")), self.new_name("")
        if choice.get("ground"):
            self.group("ground", "points")[name] = pair(at)
            pin = Pin(f"ground.{name}", at, (f"ground.{name}",))
        else:
            self.group("assembly", "sketch")[name] = pair(at)
            pin = Pin(name, at, ())
        self.pins[pin.id] = pin
        self.made.append(f"pins.{pin.id}")
        return pin

    def joint_of(self, pin: Pin) -> str | None:
        """Return the name of the joint of the file that joins points of a pin; None if there is no such joint."""
        for name, joint in items(self.document, "joints"):
            if joint.get("type") == "revolute" and any(x in pin.members for x in sequence(joint, "at")):
                return name
        return None

    def name_at(self, pin: Pin, taken: Any) -> str:
        """Return a name for a new point at a pin: that of its joint or first point, else the pin's id; a number if it is taken."""
        wanted = self.joint_of(pin) or (tail(pin.members[0]) if pin.members else pin.id)
        return wanted if wanted not in taken and NAME.fullmatch(wanted) else self.new_name("")

    def remove_from_sketch(self, pin: Pin) -> None:
        """Remove the entry with a pin's id from the sketch of the file; only a pin that joins nothing has such an entry."""
        table(table(self.document, "assembly"), "sketch").pop(pin.id, None)

    def attach(self, pin: Pin, link: str) -> Pin:
        """Add a new point to a link at the place of a pin, and join the new point with the points that the pin already joins.

        Return the changed pin.
        """
        if link in map(owner, pin.members):
            raise Refused(f"pin {pin.id} is on {link} already", (f"pins.{pin.id}",))
        name = self.name_at(pin, self.points(link))
        self.written_points(link)[name] = pair(self.to_local(link, pin.at))
        return self.join_at_pin(pin, f"{link}.{name}")

    def join_at_pin(self, pin: Pin, reference: str) -> Pin:
        """Join the point `reference` ("LINK.POINT"), which lies at the place of a pin, with the points of this pin.

        Return the changed pin, whose id may be new. If the pin has a joint in the document, the point is added to this joint. If
        the pin has one point that the file can name, a new joint gets both points. Otherwise no joint is needed, because the file
        can name the new point alone.
        """
        del self.pins[pin.id]
        joint, joints = self.joint_of(pin), self.group("joints")
        # points that a joint can name: not those of the parts of a cylinder, which have no table
        written = [x for x in pin.members if self.is_written(owner(x))]
        if joint is not None:
            joints[joint]["at"].append(reference)
            id = pin.id
        elif written:  # a second point makes a joint
            id = tail(written[0])
            if id in joints or id in self.group("cylinders"):
                id = self.new_name("")
            joints[id] = {"type": "revolute", "at": [written[0], reference]}
        else:  # a single point is a pin without a joint
            self.remove_from_sketch(pin)
            id = reference
        self.made = [f"pins.{id}" if x == f"pins.{pin.id}" else x for x in self.made]
        self.pins[id] = Pin(id, pin.at, (*pin.members, reference))
        return self.pins[id]

    def find_ends(self, a: Any, b: Any) -> list[str]:
        """Return the references of two points of different links: one at a, the other at b (ids of pins, or references)."""
        for x, y in product(self.points_at(str(a)), self.points_at(str(b))):
            if owner(x) != owner(y):
                self.place(x)  # raises if there is no such point
                self.place(y)
                return [x, y]
        where = tuple(f"pins.{x}" for x in (a, b) if str(x) in self.pins)
        raise Refused("two points of different links are needed", where, "b")

    def points_at(self, point: str) -> list[str]:
        """Return the references "LINK.POINT" of all points at the pin `point`, with points of the ground last.

        If no pin has this id, `point` is itself a reference, and is returned alone.
        """
        members = self.pins[point].members if point in self.pins else (point,)
        return sorted(members, key=lambda reference: owner(reference) == "ground")

    def point_on_link(self, point: str) -> str:
        """Return the reference "LINK.POINT" of one point at the pin with the id `point`: on a link, or else on the ground."""
        reference = next(iter(self.points_at(point)), point)
        self.place(reference)  # raises if there is no such point
        return reference

    # links

    def add_link(self, name: str, at: complex, theta: float, entries: dict[str, Any]) -> None:
        """Add a link without points.

        Args:
            at, theta: place x + i y of the origin [m] and angle [rad] of the link's frame.
            entries: all other keys of the link's table, with their values.
        """
        self.group("links")[name] = {"points": {}} | entries
        self.poses[name] = at, theta
        self.made.insert(0, f"links.{name}")  # before pins, because callers ask for the first part that was made

    def is_aligned(self, link: str) -> bool:
        """Tell whether a link's frame lies along its first bar, and only points are given in this frame.

        Only then can `align` turn the frame: no centre of mass, point mass, weld or force is given in it.
        """
        entries = {} if link == "ground" else self.link(link)
        bars, points = sequence(entries, "bars"), self.points(link)
        is_welded = any(link in (x.get("link"), x.get("to")) for _, x in items(self.document, "welds"))
        carries_force = any(x.get("frame") in (link, "body") for _, x in items(self.document, "forces"))
        if not bars or "com" in entries or "point_masses" in entries or is_welded or carries_force:
            return False
        a, b = (points[x] for x in bars[0])
        return abs(a) < SAME and abs(b.imag) < SAME and b.real > 0

    def align(self, link: str) -> None:
        """Put a link's frame at the first point of its first bar, along this bar, and rewrite its points in this frame."""
        entries = self.link(link)
        places = {key: self.place(f"{link}.{key}") for key in entries["points"]}
        a, b = (places[x] for x in entries["bars"][0])
        _, theta = self.poses[link]
        self.poses[link] = a, theta + math.remainder(phase(b - a) - theta, 2 * math.pi)  # without a jump by whole turns
        entries["points"] = {key: pair(self.to_local(link, x)) for key, x in places.items()}

    def write_sketch(self) -> None:
        """Write the places of pins and links into the table `assembly`, from which the loader places the links.

        `assembly.sketch` gets places, and `assembly.angles` or `angles_deg` the angles of links whose points do not determine them.
        """
        assembly = self.group("assembly")
        old, joints = table(assembly, "sketch"), [*items(self.document, "joints")]
        drawn: dict[str, list[float]] = {}  # the new sketch: joint or reference -> place
        pinned: set[str] = set()  # references of the points that joints connect, which lie at the joints
        # pins that are not on the ground, and blocks of the slides that have an entry in the old sketch
        for name, joint in joints:
            ends = [x for x in sequence(joint, "at") if isinstance(x, str) and owner(x) in self.poses]
            pinned.update(ends)
            if joint.get("type") == "revolute" and ends and "ground" not in map(owner, ends):
                drawn[name] = pair(sum(map(self.place, ends)) / len(ends), PLACED)
            elif joint.get("type") == "prismatic" and name in old and owner(str(joint.get("block"))) in self.poses:
                drawn[name] = pair(self.place(str(joint["block"])), PLACED)
        # links: points that place them; and an angle if neither the points nor a slide determine it
        angles = {name for key in ("angles", "angles_deg") for name in table(assembly, key)}
        slid = {owner(str(x.get(end))) for _, x in joints for end in ("guide", "block")}
        for link in [x for x in self.group("links") if x in self.poses]:
            references, shows_angle = self._choose_points(link, pinned | old.keys())
            drawn |= {x: pair(self.place(x), PLACED) for x in references if x not in pinned}
            if not shows_angle and link not in angles and link not in slid:
                angles.add(link)
                assembly.setdefault("angles_deg", {})[link] = 0.0  # an entry, whose value is written below
        off_ground = {k for k, x in joints if "ground" not in (owner(str(y)) for y in sequence(x, "at"))}
        # keep the old entries of joints and links that could not be read
        kept = {k: x for k, x in old.items() if k in off_ground or ("." in k and owner(k) not in self.poses)}
        assembly["sketch"] = kept | drawn | lone_pins(self.document)
        for name in angles & self.poses.keys():  # write the angles under the key that the file uses
            for key, unit in (("angles_deg", math.degrees(1.0)), ("angles", 1.0)):
                if name in table(assembly, key):
                    assembly[key][name] = round_digits(self.poses[name][1] * unit)
        self.tidy()

    def _choose_points(self, link: str, known: set[str]) -> tuple[list[str], bool]:
        """Return references to the points that fix the position of a link, and whether these points also fix its angle.

        They are the link's points in `known` (references), else its first point; and another point if the angle needs it.
        """
        points = self.points(link)
        chosen = [name for name in points if f"{link}.{name}" in known] or [*points][:1]
        apart = [name for name, x in points.items() if abs(x - points[chosen[0]]) > SAME]  # points away from the first one
        if apart and not {*apart} & {*chosen}:
            chosen.append(apart[0])
        return [f"{link}.{name}" for name in chosen], bool(apart)

    def tidy(self) -> None:
        """Remove empty tables from the document."""
        for group in ("ground", "observe", "assembly"):
            entry = table(self.document, group)
            for key in [k for k, x in entry.items() if x in ({}, [])]:
                del entry[key]
        for group in ("joints", "cylinders", "forces", "welds", "scenarios", "ground", "observe", "assembly"):
            if self.document.get(group) == {}:
                del self.document[group]
