"""What a file says in short is written out before anything is computed: cylinders as links and joints, welded links as one body.

Between the points P and Q a cylinder C is a link C_barrel pinned at P, a link C_rod pinned at Q, and the slide C between them,
along the line of both pins: its coordinate is the length of the cylinder. The x axes of barrel and rod run from P to Q.

The frame of a body is that of one of its links, its root, after which it is called; a point P of another link L of it is its point
L.P. With m_i, c_i and I_i of the parts, in the frame of the body,

    m = sum m_i,    m c = sum m_i c_i,    I = sum (I_i + m_i |c_i - c|^2)        (parallel axes)

Point masses are parts without inertia of their own. Results are told by the links of the file again (`spread`), and what a weld
carries follows from what the links beyond it lack (`weld_forces` in metrics.py).
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.linkage.errors import BuildError
from gauss_bench.mechanism.model import Link, Part, Point, Weld
from gauss_bench.mechanism.numbers import Number, angle_of, length, pair, turn_vector
from gauss_bench.terms import Array

Welds = Mapping[str, Mapping[str, Any]]  # tables by name

BARREL, ROD = "barrel", "rod"
PIN, END = "pin", "end"  # points of either part of a cylinder
SAME = 1e-6  # of their distance: points of two links that are said to coincide


def write_out(document: dict[str, Any]) -> dict[str, Any]:
    """The document with links and joints instead of cylinders; itself where it has none."""
    cylinders = document.get("cylinders")
    if not cylinders:
        return document
    links, joints = dict(document["links"]), dict(document.get("joints", {}))
    for name, cylinder in cylinders.items():
        ends = dict(zip((BARREL, ROD), cylinder["between"], strict=True))
        for part, at in ends.items():
            links[f"{name}_{part}"] = _cylinder_part(cylinder[part], 1 if part == BARREL else -1)
            joints[f"{name}_{part}"] = {"type": "revolute", "at": [at, f"{name}_{part}.{PIN}"]}
        joints[name] = {"type": "prismatic", "guide": f"{name}_{BARREL}.{PIN}", "block": f"{name}_{ROD}.{PIN}"}
    return {key: x for key, x in document.items() if key != "cylinders"} | {"links": links, "joints": joints}


def _cylinder_part(part: dict[str, Any], sense: int) -> dict[str, Any]:
    """A uniform bar from the pin along the cylinder, +1 towards the other pin's side along x, -1 against it."""
    link: dict[str, Any] = {key: part[key] for key in ("mass", "kg_per_m", "inertia") if key in part}
    if "com" in part:
        link["com"] = [sense * part["com"], 0]
    return link | {"points": {PIN: [0, 0], END: [sense * part["length"], 0]}, "bars": [[PIN, END]]}


class Mass(NamedTuple):
    """Mass, centre (2,) and inertia about it."""

    mass: Any
    com: Array
    inertia: Any


class Pose(NamedTuple):
    """The frame of a link in that of the root of its body: its origin (2,) [m] and its angle [rad]."""

    root: str
    origin: Array
    turn: Any


def together(parts: Sequence[Mass]) -> Mass:
    """Rigidly connected parts as one."""
    mass = sum((x.mass for x in parts[1:]), start=parts[0].mass)
    com = sum((x.mass * x.com for x in parts[1:]), start=parts[0].mass * parts[0].com) / mass
    inertia = [x.inertia + x.mass * length(x.com - com) ** 2 for x in parts]
    return Mass(mass, com, sum(inertia[1:], start=inertia[0]))


def poses(links: Mapping[str, Link], welds: Welds, first: Sequence[str], number: Number) -> dict[str, Pose]:
    """The pose of every link in its body; the root is the body's link that comes first in `first`, else the one welded to none.

    Raises:
        BuildError: points that a weld says to coincide lie at different distances.
    """
    zero = number("0")
    own = {name: Pose(name, pair(number, (0, 0)), zero) for name in links}
    waiting = dict(welds)
    while waiting:  # in a forest, some weld leads to a link whose own are done
        key, weld = next((k, x) for k, x in waiting.items() if all(x["to"] != other["link"] for other in waiting.values()))
        del waiting[key]
        origin, turn = _on(links[weld["to"]], links[weld["link"]], key, weld, number)
        base = own[weld["to"]]
        own[weld["link"]] = Pose(base.root, base.origin + turn_vector(origin, base.turn), base.turn + turn)
    poses = dict(own)
    for root in {x.root for x in own.values()}:
        members = [name for name, x in own.items() if x.root == root]
        chosen = next((x for x in first if x in members), root)
        if chosen != root:
            base = own[chosen]
            for name in members:
                poses[name] = Pose(chosen, turn_vector(own[name].origin - base.origin, -base.turn), own[name].turn - base.turn)
            poses[chosen] = Pose(chosen, pair(number, (0, 0)), zero)
    return poses


def _on(to: Link, link: Link, key: str, weld: Mapping[str, Any], number: Number) -> tuple[Array, Any]:
    """Origin (2,) and angle of a link's frame in that of the link it is welded to."""
    turn = angle_of(weld, "angle", number)
    if "points" not in weld:
        return pair(number, weld["origin"]), turn
    pairs = [(to.points[a.partition(".")[2]], link.points[b.partition(".")[2]]) for a, b in weld["points"]]
    if len(pairs) == 2:
        there, here = (b - a for a, b in zip(*pairs, strict=True))
        if length(here) == 0 or abs(length(there) - length(here)) > SAME * length(here):
            apart = f"{float(length(there)):.6g} m apart on {to.name}, {float(length(here)):.6g} m on {link.name}"
            raise BuildError(f"welds.{key}.points", f"two pairs of points cannot coincide: {apart}")
        turn = np.arctan2(there[1], there[0]) - np.arctan2(here[1], here[0])
    a, b = pairs[0]
    return a - turn_vector(b, turn), turn


def bodies(links: Mapping[str, Link], placed: Mapping[str, Pose]) -> tuple[Link, ...]:
    """One link for each body, in the order of the file."""
    roots = list(dict.fromkeys(placed[name].root for name in links))
    return tuple(_body(links[root], {k: x for k, x in placed.items() if x.root == root}, links) for root in roots)


def _body(root: Link, members: Mapping[str, Pose], links: Mapping[str, Link]) -> Link:
    if len(members) == 1:
        return root
    points: dict[str, Array] = {}
    bars, masses = [], []
    for name, pose in members.items():
        link = links[name]
        said = {key: key if name == root.name else f"{name}.{key}" for key in link.points}
        points |= {said[key]: pose.origin + turn_vector(x, pose.turn) for key, x in link.points.items()}
        bars += [(said[a], said[b]) for a, b in link.bars]
        masses.append(Mass(link.mass, pose.origin + turn_vector(link.com, pose.turn), link.inertia))
    whole = together(masses)
    return Link(root.name, whole.mass, whole.inertia, whole.com, points, tuple(bars))


def parts(links: Mapping[str, Link], placed: Mapping[str, Pose], bodies: Sequence[Link]) -> tuple[Part, ...]:
    """Every link of the file as part of its body."""
    index = {body.name: i for i, body in enumerate(bodies)}
    told = []
    for name, link in links.items():
        pose = placed[name]
        i = index[pose.root]
        told.append(Part(name, i, pose.origin + turn_vector(link.com, pose.turn) - bodies[i].com, pose.turn))
    return tuple(told)


def read_welds(links: Mapping[str, Link], welds: Welds) -> tuple[Weld, ...]:
    """Read welds: the links of the file that each holds, and where its moment is told."""
    names = list(links)
    told = []
    for key, weld in welds.items():
        beyond = {weld["link"]}
        while more := {x["link"] for x in welds.values() if x["to"] in beyond} - beyond:
            beyond |= more
        link = links[weld["link"]]
        point = weld["points"][0][1].partition(".")[2] if "points" in weld else None
        at = link.points[point] if point else 0 * link.com
        place = Point(names.index(link.name), at - link.com, f"{link.name}.{point or ''}")
        told.append(Weld(key, place, tuple(i for i, name in enumerate(names) if name in beyond)))
    return tuple(told)
