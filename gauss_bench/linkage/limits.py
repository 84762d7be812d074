"""How much and how large a linkage file may be: counts, magnitudes and characters, each bound with its reason.

Looked at before anything else is, in one pass without recursion, so that what is beyond is refused by its place and at once. What a
scenario overrides is bounded as what it replaces.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from gauss_bench.linkage.errors import Fault
from gauss_bench.untrusted import DEEPEST, harmless, unprintable

LONGEST_KEY = 200  # characters of a key
LONGEST_TEXT = 10_000  # characters of a text
CHAINED = 100  # points of which each is given from the one before
COUNTS = {  # entries of a table or list of that name
    "links": 1000,
    "joints": 3000,
    "welds": 1000,
    "cylinders": 300,
    "constraints": 1000,
    "forces": 2000,
    "scenarios": 100,
    "points": 2000,
    "point_masses": 1000,
    "bars": 2000,
    "rows": 2000,
    "at": 200,
}
SHOWN = 50  # faults that are told at once
MOST = 5000  # entries of any other
ENTRIES = 60_000  # of the whole file: the largest that is generated, 400 windows, has 20,000


@dataclass(frozen=True)
class Range:
    """What a number may be: 0, or of a size between `least` and `most`; and why."""

    most: float
    reason: str
    least: float = 0.0


RESOLVED = "joints are closed to 1e-10 m, and beyond that a double does not resolve it"
SQUARES = "beyond that sums and squares of it lose every digit of the rest"
PLACE = Range(1e5, RESOLVED)
DEGREES = Range(1e7, "it counts whole turns, and beyond that a double does not resolve 1e-8 degrees")
RADIANS = Range(2e5, "it counts whole turns, and beyond that a double does not resolve 1e-10 rad")
MASS = Range(1e12, SQUARES, 1e-12)
RATE = Range(1e6, "no step resolves what is faster")
TIME = Range(1e9, "no run takes so many steps", 1e-9)
ANY = Range(1e15, SQUARES, 1e-30)
RANGES = {
    **dict.fromkeys(("points", "xy", "r", "com", "sketch", "origin", "offset", "radius", "slides", "length"), PLACE),
    **dict.fromkeys(
        ("deg", "angle_deg", "block_angle_deg", "rest_deg", "start_deg", "travel_deg", "crank_deg", "phase_deg"), DEGREES
    ),
    "angles_deg": DEGREES,
    **dict.fromkeys(("angle", "block_angle", "angles", "crank", "phase", "travel"), RADIANS),
    **dict.fromkeys(("mass", "kg_per_m"), MASS),
    "inertia": Range(1e22, SQUARES, 1e-24),
    **dict.fromkeys(("speed", "speeds", "slide_speeds", "point_velocities", "frequency"), Range(1e6, RATE.reason)),
    **dict.fromkeys(("time", "duration"), TIME),
    "rows": Range(1e7, "times and angles in degrees are resolved up to there"),
    "gravity": Range(1e6, SQUARES),
    **dict.fromkeys(("k", "c", "value"), Range(1e15, SQUARES)),
    **dict.fromkeys(("rest", "start", "share", "mu"), Range(1e7, RESOLVED)),
}


def limit_faults(document: Mapping[str, Any]) -> list[Fault]:
    """List what is too deep, too many, too large, too small or not to be printed: the first that ends the search, or all."""
    faults: list[Fault] = []
    entries = 0
    waiting: list[tuple[str, str, Any, int]] = [("", "", document, 0)]  # path, the nearest key that bounds it, value, depth
    while waiting:
        path, key, item, depth = waiting.pop()
        if isinstance(item, str):
            faults += _text_faults(path, item)
        elif isinstance(item, (int, float, Decimal)) and not isinstance(item, bool):
            faults += _number_faults(path, key, item)
        elif isinstance(item, (dict, list)):
            entries += len(item)
            if depth > DEEPEST:
                return [Fault(_beginning(path), f"tables lie more than {DEEPEST} deep")]
            if len(item) > (most := COUNTS.get(key, MOST)):
                return [Fault(path, f"{len(item)} entries, and {most} are the most that are read")]
            if entries > ENTRIES:
                return [Fault("", f"more than {ENTRIES} entries in all, which are the most that are read")]
            if isinstance(item, list):
                waiting += [(f"{path}[{i}]", key, x, depth + 1) for i, x in enumerate(item)]
                continue
            for name, x in item.items():
                if len(name) > LONGEST_KEY or any(map(unprintable, name)):
                    said = f"a key {_show(name)}: keys are printable and have at most {LONGEST_KEY} characters"
                    faults.append(Fault(path, said))
                    continue
                bounds = name if name in RANGES or name in COUNTS else key
                waiting.append((f"{path}.{name}" if path else name, bounds, x, depth + 1))
    return sorted(faults[:SHOWN]) or list(_chains(document))


def _text_faults(path: str, text: str) -> list[Fault]:
    if len(text) > LONGEST_TEXT:
        return [Fault(path, f"a text of {len(text)} characters, and {LONGEST_TEXT} are the most that are read")]
    if any(unprintable(x) for x in text):
        return [Fault(path, f"{_show(text)} holds characters that cannot be printed")]
    return []


def _number_faults(path: str, key: str, x: Any) -> list[Fault]:
    if x - x != 0:
        return []  # not finite, which the grammar refuses
    bound = RANGES.get(key, ANY)
    size = abs(x)
    if size > bound.most:
        return [Fault(path, f"{_describe(x)} is larger than {bound.most:g}: {bound.reason}")]
    if 0 < size < bound.least:
        return [Fault(path, f"{_describe(x)} is smaller than {bound.least:g}, and not 0: {SQUARES}")]
    return []


def _describe(x: Any) -> str:
    if isinstance(x, int) and abs(x) > 10**15:
        return f"a number of {x.bit_length() * 30103 // 100_000 + 1} digits"
    return f"{x:g}"


def _chains(document: Mapping[str, Any]) -> Iterator[Fault]:
    """Points that are given from each other in too long a chain."""
    links = document.get("links")
    named = links.items() if isinstance(links, dict) else ()
    owners = [("ground", document.get("ground")), *((f"links.{key}", link) for key, link in named)]
    for path, owner in owners:
        given = owner.get("points") if isinstance(owner, dict) else None
        points: dict[str, Any] = given if isinstance(given, dict) else {}
        lengths: dict[str, int] = {}
        for name in points:
            way: list[str] = []
            at: Any = name
            while isinstance(at, str) and at not in lengths and at not in way[-1:] and len(way) <= CHAINED:
                way.append(at)
                at = points[at].get("from") if isinstance(points.get(at), dict) else None
            reached = lengths.get(at, 0) if isinstance(at, str) else 0
            lengths |= {x: reached + k for k, x in enumerate(reversed(way), 1)}
            if lengths[name] > CHAINED and name not in _circle(points, name):
                yield Fault(f"{path}.points.{name}.from", f"follows from more than {CHAINED} points, one after the other")
                return


def _circle(points: dict[str, Any], name: str) -> list[str]:
    """The points that a point follows from, where they come back to one of them; that is another fault, told elsewhere."""
    way: dict[str, None] = {}
    at: Any = name
    while isinstance(at, str) and at not in way:
        way[at] = None
        at = points[at].get("from") if isinstance(points.get(at), dict) else None
    return [*way] if isinstance(at, str) and at in way else []


def _show(text: str) -> str:
    """The beginning of a text of others, in quotes and harmless."""
    return harmless(repr(text[:40])) + (" ..." if len(text) > 40 else "")


def _beginning(path: str) -> str:
    return ".".join(path.split(".")[:4])
