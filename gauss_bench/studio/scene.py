"""Make the scene: the plain data that the page draws, from a document and the positions read from it.

The page itself computes only the places of points on rigid links.
"""

import tomllib
from cmath import rect
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.kinematics.topology import find_graph, pin_loose_links
from gauss_bench.linkage.bodies import expand_cylinders
from gauss_bench.linkage.references import items, sequence, table
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, Point
from gauss_bench.mechanism.spaces import angle_at
from gauss_bench.studio.document import Document, is_driven
from gauss_bench.studio.reading import Reading, is_place, lone_pins

FORCES = tomllib.loads((Path(__file__).parent / "forces.toml").read_text(encoding="utf-8"))  # labels and default numbers


def scene(reading: Reading, locks: Iterable[str] = ()) -> dict[str, Any]:
    """Return the scene: the data that the page draws for a reading.

    `locks` are ids of locked parts: the id of a pin or slide; `links.NAME` for the angle of a link; `links.NAME:a-b` for the
    distance of two points of a link; `joints.NAME` for the angle between the links of a pin.
    """
    document, locked = reading.document, {*locks}
    return {
        "name": _text(document, "name"),
        "title": _text(document, "title"),
        "gravity": document["gravity"] if is_place(document.get("gravity")) else [0.0, -9.81],
        "crank": _text(document, "crank") or None,
        "ground": {"points": _ground_points(reading)},
        "links": describe_links(reading, locked),
        "pins": describe_pins(reading, locked),
        "slides": describe_slides(reading, locked),
        "forces": describe_forces(reading),
        "observe": [x for x in sequence(table(document, "observe"), "points") if isinstance(x, str)],
        "scenarios": [
            {"name": name, "kind": "driven" if is_driven(entry) else "free", "table": entry}
            for name, entry in items(document, "scenarios")
        ],
        "drivers_possible": find_drivable(reading),
        "status": describe_status(reading),
        "problems": [asdict(x) for x in reading.problems],
    }


def _text(document: Document, key: str) -> str:
    """Return the text at a key; empty if there is none."""
    value = document.get(key)
    return value if isinstance(value, str) else ""


def _ground_points(reading: Reading) -> dict[str, list[float]]:
    """Return name -> [x, y] of the points of the ground; without a mechanism, only those that the file gives as two numbers."""
    if reading.mechanism is not None:
        return {name: x.tolist() for name, x in reading.mechanism.ground_points.items()}
    given = table(table(reading.document, "ground"), "points")
    return {name: x for name, x in given.items() if is_place(x)}


def place_points(reading: Reading) -> dict[str, list[float]]:
    """Return LINK.POINT -> [x, y] in the world, for every point of the ground and of the links."""
    places = {f"ground.{name}": x for name, x in _ground_points(reading).items()}
    poses = reading.poses(reading.q)
    for link in reading.mechanism.whole.links if reading.mechanism else ():  # `whole`: every link of the file is a body of its own
        x, y, theta = poses[link.name]
        for name, point in link.points.items():
            at = complex(x, y) + rect(1.0, theta) * complex(*point)
            places[f"{link.name}.{name}"] = [at.real, at.imag]
    return places


def describe_links(reading: Reading, locked: set[str]) -> list[dict[str, Any]]:
    """Return the data of every link; `drawn` is false for the two parts of a cylinder, which have no table in the file."""
    poses, tables = reading.poses(reading.q), table(reading.document, "links")
    shown = []
    for link in reading.mechanism.whole.links if reading.mechanism else ():
        prefix = f"links.{link.name}:"  # of a locked length, "links.NAME:a-b"
        lengths = [x.removeprefix(prefix).split("-") for x in sorted(locked) if x.startswith(prefix)]
        per_metre = table(tables, link.name).get("kg_per_m")
        shown.append(
            {
                "name": link.name,
                "pose": poses[link.name],
                "points": {name: x.tolist() for name, x in link.points.items()},
                "bars": link.bars,
                "mass": link.mass,
                "inertia": link.inertia,
                "kg_per_m": per_metre if isinstance(per_metre, (int, float)) else None,
                "placed": link.name not in reading.unplaced,
                "locked": {"angle": f"links.{link.name}" in locked, "lengths": lengths},
                "drawn": link.name in tables,
            }
        )
    return shown


def describe_pins(reading: Reading, locked: set[str]) -> list[dict[str, Any]]:
    """Return the data of every pin: of joints, of single points, and of pins that join nothing yet."""
    places, joints = place_points(reading), table(reading.document, "joints")
    groups: dict[str, list[str]] = {}  # id of a pin -> its points
    pin_of: dict[str, str] = {}  # point -> id of its pin; joints that share a point are one pin
    for joint, references in points_of_pins(reading.rest).items():
        known = [x for x in references if isinstance(x, str) and x in places]
        shared = [pin_of[x] for x in known if x in pin_of]
        id = shared[0] if shared else joint
        groups[id] = [*dict.fromkeys([*groups.get(id, []), *known])]
        pin_of |= dict.fromkeys(known, id)
    groups = {id: members for id, members in groups.items() if members} | {x: [x] for x in places if x not in pin_of}
    # the points of an open pin lie apart: the pin is drawn between them
    drawn_at = {id: np.mean([places[x] for x in members], axis=0).tolist() for id, members in groups.items()}
    shown = []
    for id, at in (drawn_at | lone_pins(reading.document)).items():
        members = groups.get(id, [])  # empty for a pin that joins nothing
        shown.append(
            {
                "id": id,
                "at": at,
                "members": members,
                "joint": id if members and (id in joints or len(members) > 1) else None,
                "ground": any(x.startswith("ground.") for x in members),
                "locked": f"pins.{id}" in locked,  # the pin keeps its place
                "stiff": f"joints.{id}" in locked,  # its links keep their relative angle
            }
        )
    return shown


def describe_slides(reading: Reading, locked: set[str]) -> list[dict[str, Any]]:
    """Return the data of every slide, in the order of the file; empty without a mechanism."""
    q = reading.q
    return [
        {
            "id": joint.name,
            "guide": name_in_file(joint.guide),
            "at": position(q, joint.guide).tolist(),
            "angle": float(angle_at(q, joint.guide.link)) + joint.angle,
            "block": name_in_file(joint.block),
            "block_at": position(q, joint.block).tolist(),
            "offset": joint.offset,
            "locked": f"slides.{joint.name}" in locked,
        }
        for joint in (reading.mechanism.slides if reading.mechanism else ())
    ]


def name_in_file(point: Point) -> str:
    """Return the name LINK.POINT of a point in the file; in the mechanism, a point of a welded link is BODY.LINK.POINT."""
    return ".".join(point.name.split(".")[-2:])


def describe_forces(reading: Reading) -> list[dict[str, Any]]:
    """Return the data of every force and cylinder; `at` has the places [x, y] between or at which it is drawn."""
    places, joints = place_points(reading), points_of_pins(reading.rest)
    places |= {link: pose[:2] for link, pose in reading.poses(reading.q).items()}
    entries = [(name, str(entry.get("type")), entry) for name, entry in items(reading.document, "forces")]
    entries += [(name, "cylinder", entry) for name, entry in items(reading.document, "cylinders")]
    shown = []
    for name, kind, entry in entries:
        ends = [entry.get("point"), entry.get("origin"), *sequence(entry, "between"), entry.get("link"), *sequence(entry, "links")]
        ends += joints.get(str(entry.get("joint")), [])[:1]
        at = [places[x] for x in ends if isinstance(x, str) and x in places]
        label = f"cylinder {name}" if kind == "cylinder" else name
        if kind in FORCES["labels"]:
            key, unit = FORCES["labels"][kind]
            label = f"{name}: {entry.get(key, 0)} {unit}".strip()
        shown.append({"id": name, "type": kind, "table": entry, "at": at, "label": label})
    return shown


def find_drivable(reading: Reading) -> list[dict[str, str]]:
    """Return name and kind of the coordinates that can be driven: "angle" of a link with a pin on the ground, or "slide"."""
    kinds: dict[str, str] = {}
    # `rest` is the document without faulty parts; a cylinder becomes two links and a prismatic joint, and is thus listed as a slide
    for name, joint in items(expand_cylinders(reading.rest), "joints"):
        owners = [x.partition(".")[0] for x in sequence(joint, "at") if isinstance(x, str)]
        if "ground" in owners:
            kinds |= {x: "angle" for x in owners if x != "ground"}
        if joint.get("type") == "prismatic":
            kinds[name] = "slide"
    return [{"name": name, "kind": kind} for name, kind in kinds.items()]


def describe_status(reading: Reading) -> dict[str, Any]:
    """Return whether the drawing assembles, its degrees of freedom, its number of redundant joint constraints, and its loops."""
    mechanism, joints = reading.mechanism, reading.joints
    if mechanism is None or joints is None:
        return {"assembles": False, "dof": None, "loops": 0, "redundant": 0, "loop_names": []}
    loops = find_graph(pin_loose_links(mechanism)).loops
    return {
        "assembles": reading.closed,
        "dof": mechanism.n - reading.rank,
        "loops": len(loops),
        "redundant": len(joints(0.0, reading.q, np.zeros_like(reading.q)).phi) - reading.rank,
        "loop_names": [[mechanism.link_name(x.link) for x in loop.paths if x.link != GROUND] for loop in loops],
    }


def points_of_pins(document: Document) -> dict[str, list[str]]:
    """Return name of a pin joint -> references "LINK.POINT" of its points, also for the pins at the ends of cylinders."""
    joints = items(expand_cylinders(document), "joints")
    return {name: sequence(joint, "at") for name, joint in joints if joint.get("type") == "revolute"}
