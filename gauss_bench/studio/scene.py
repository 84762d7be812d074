"""The scene that the page draws: a reading in plain data. The page computes nothing but where a rigid link's points are."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from gauss_bench.linkage.bodies import write_out
from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Mechanism, Point, Prismatic
from gauss_bench.studio.document import Document
from gauss_bench.studio.reading import Reading, lone_pins, loops_of, pins_of

UNITS = {
    "torque": ("value", "N m"),
    "spring_damper": ("k", "N/m"),
    "axis_spring_damper": ("k", "N/m"),
    "rotational_spring_damper": ("k", "N m/rad"),
    "joint_damping": ("c", "N m s"),
    "coulomb_friction": ("mu", ""),
}  # type of a force -> the number that it is called by, and its unit


def scene(reading: Reading, locks: Iterable[str] = ()) -> dict[str, Any]:
    """The drawing; `locks` are ids of pins and slides, `links.NAME`, `links.NAME:a-b` of lengths, `joints.NAME` of angles."""
    document, locked = reading.document, {*locks}
    ground = _ground(reading)
    return {
        "name": _text(document, "name"),
        "title": _text(document, "title"),
        "gravity": _pair(document.get("gravity"), [0.0, -9.81]),
        "crank": _text(document, "crank") or None,
        "ground": {"points": ground},
        "links": links(reading, locked),
        "pins": pins(reading, locked),
        "slides": slides(reading, locked),
        "forces": forces(reading),
        "observe": [x for x in sequence(table(document, "observe"), "points") if isinstance(x, str)],
        "scenarios": [
            {"name": name, "kind": "driven" if {"driver", "drivers"} & entry.keys() else "free", "table": entry}
            for name, entry in items(document, "scenarios")
        ],
        "drivers_possible": drivers_possible(document),
        "status": status(reading),
        "problems": [x.as_dict() for x in reading.problems],
    }


def _text(document: Document, key: str) -> str:
    return x if isinstance(x := document.get(key), str) else ""


def _pair(x: Any, otherwise: list[float]) -> list[float]:
    return (
        [float(y) for y in x] if isinstance(x, list) and len(x) == 2 and all(isinstance(y, (int, float)) for y in x) else otherwise
    )


def _ground(reading: Reading) -> dict[str, list[float]]:
    """Name -> place of every point of the ground; those that are given as [x, y] even where there is nothing else."""
    if reading.mechanism is not None:
        return {name: [float(y) for y in x] for name, x in reading.mechanism.ground_points.items()}
    given = table(table(reading.document, "ground"), "points")
    return {name: [float(y) for y in x] for name, x in given.items() if _pair(x, [])}


def where(reading: Reading) -> dict[str, list[float]]:
    """Reference -> place in the world of every point of the ground and of the links."""
    places = {f"ground.{name}": x for name, x in _ground(reading).items()}
    poses = reading.poses(reading.q)
    for link in reading.mechanism.whole.links if reading.mechanism else ():
        x, y, theta = poses[link.name]
        c, s = np.cos(theta), np.sin(theta)
        for name, (px, py) in link.points.items():
            places[f"{link.name}.{name}"] = [float(x + c * px - s * py), float(y + s * px + c * py)]
    return places


def links(reading: Reading, locked: set[str]) -> list[dict[str, Any]]:
    if reading.mechanism is None:
        return []
    poses, given = reading.poses(reading.q), table(reading.document, "links")
    shown = []
    for link in reading.mechanism.whole.links:
        lengths = [x.split(":")[1].split("-") for x in sorted(locked) if x.startswith(f"links.{link.name}:")]
        per_metre = table(given, link.name).get("kg_per_m")
        shown.append(
            {
                "name": link.name,
                "pose": poses[link.name],
                "points": {name: [float(y) for y in x] for name, x in link.points.items()},
                "bars": [[a, b] for a, b in link.bars],
                "mass": link.mass,
                "inertia": link.inertia,
                "kg_per_m": per_metre if isinstance(per_metre, (int, float)) else None,
                "placed": link.name not in reading.unplaced,
                "locked": {"angle": f"links.{link.name}" in locked, "lengths": lengths},
                "drawn": link.name in given,
            }
        )
    return shown


def pins(reading: Reading, locked: set[str]) -> list[dict[str, Any]]:
    """Every place where points lie: joints, points on their own, and pins that hold nothing yet."""
    places, grouped = where(reading), dict[str, list[str]]()
    of: dict[str, str] = {}
    for joint, references in pins_of(reading.rest):
        known = [x for x in references if isinstance(x, str) and x in places]
        id = next((of[x] for x in known if x in of), joint)
        members = grouped.setdefault(id, [])
        members += [x for x in known if x not in members]
        of |= dict.fromkeys(known, id)
    for reference in places:
        if reference not in of:
            grouped[reference] = [reference]
    joints = table(reading.document, "joints")
    shown = [
        {
            "id": id,
            "at": _middle([places[x] for x in members]),
            "members": members,
            "joint": id if id in joints or len(members) > 1 else None,
            "ground": any(x.startswith("ground.") for x in members),
            "locked": f"pins.{id}" in locked,
            "stiff": f"joints.{id}" in locked,
        }
        for id, members in grouped.items()
        if members
    ]
    return [
        *shown,
        *(
            {
                "id": name,
                "at": [float(y) for y in x],
                "members": [],
                "joint": None,
                "ground": False,
                "locked": False,
                "stiff": False,
            }
            for name, x in lone_pins(reading.document).items()
        ),
    ]


def _middle(places: list[list[float]]) -> list[float]:
    """The place of a pin: of one that stays open, in the middle of its ends."""
    return [float(x) for x in np.mean(places, axis=0)]


def slides(reading: Reading, locked: set[str]) -> list[dict[str, Any]]:
    if (mechanism := reading.mechanism) is None:
        return []
    shown = []
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic):
            turn = 0.0 if joint.guide.link == GROUND else float(reading.q[3 * joint.guide.link + 2])
            shown.append(
                {
                    "id": joint.name,
                    "guide": as_written(mechanism, joint.guide),
                    "at": position(reading.q, joint.guide).tolist(),
                    "angle": turn + joint.angle,
                    "block": as_written(mechanism, joint.block),
                    "block_at": position(reading.q, joint.block).tolist(),
                    "offset": joint.offset,
                    "locked": f"slides.{joint.name}" in locked,
                }
            )
    return shown


def as_written(mechanism: Mechanism, point: Point) -> str:
    """The reference of a point as the file has it: a welded link's point is named after the link, and not its body."""
    owner, _, name = point.name.partition(".")
    return name if "." in name else f"{owner}.{name}"


def forces(reading: Reading) -> list[dict[str, Any]]:
    places, poses = where(reading), reading.poses(reading.q)
    at_joints = dict(pins_of(reading.rest))
    shown = []
    for name, entry in items(reading.document, "forces"):
        kind = str(entry.get("type"))
        ends = [entry.get("point"), entry.get("origin"), *sequence(entry, "between")]
        at = [places[x] for x in ends if isinstance(x, str) and x in places]
        at += [poses[x][:2] for x in (entry.get("link"), *sequence(entry, "links")) if isinstance(x, str) and x in poses]
        at += [places[x] for x in at_joints.get(str(entry.get("joint")), [])[:1] if x in places]
        shown.append({"id": name, "type": kind, "table": entry, "at": at, "label": label(name, kind, entry)})
    for name, entry in items(reading.document, "cylinders"):
        at = [places[x] for x in sequence(entry, "between") if isinstance(x, str) and x in places]
        shown.append({"id": name, "type": "cylinder", "table": entry, "at": at, "label": f"cylinder {name}"})
    return shown


def label(name: str, kind: str, entry: dict[str, Any]) -> str:
    """A force in a few words."""
    if kind == "force":
        return f"{name}: {entry.get('value')} N"
    key, unit = UNITS.get(kind, ("value", ""))
    return f"{name}: {entry.get(key, 0)} {unit}".strip()


def drivers_possible(document: Document) -> list[dict[str, str]]:
    """The coordinates that a law can prescribe: links that turn on the ground, slides, cylinders among them."""
    kinds: dict[str, str] = {}
    for name, joint in items(write_out(document) if _cylinders_are_sound(document) else document, "joints"):
        owners = [x.partition(".")[0] for x in sequence(joint, "at") if isinstance(x, str)]
        if "ground" in owners:
            kinds |= {x: "angle" for x in owners if x != "ground"}
        if joint.get("type") == "prismatic":
            kinds[name] = "slide"
    return [{"name": name, "kind": kind} for name, kind in kinds.items()]


def _cylinders_are_sound(document: Document) -> bool:
    cylinders = document.get("cylinders", {})
    sound = (
        isinstance(cylinders, dict) and isinstance(document.get("links", {}), dict) and isinstance(document.get("joints", {}), dict)
    )
    return sound and all(
        isinstance(x, dict)
        and len(sequence(x, "between")) == 2
        and isinstance(x.get("barrel"), dict)
        and isinstance(x.get("rod"), dict)
        for x in cylinders.values()
    )


def status(reading: Reading) -> dict[str, Any]:
    """The state of assembly, with counts at a position of no special kind near the drawing."""
    mechanism, joints = reading.mechanism, reading.joints
    if mechanism is None or joints is None:
        return {"assembles": False, "dof": None, "loops": 0, "redundant": 0, "loop_names": []}
    rank, loops = reading.rank, loops_of(mechanism)
    return {
        "assembles": reading.closed,
        "dof": mechanism.n - rank,
        "loops": len(loops),
        "redundant": len(joints(0.0, reading.q, np.zeros_like(reading.q)).phi) - rank,
        "loop_names": loops,
    }
