"""Expand cylinders into links and joints, and merge welded links into one body.

A cylinder C between the points P and Q is a link C_barrel pinned at P, a link C_rod pinned at Q, and the slide C between them
along the line of both pins. The coordinate of the slide is the length of the cylinder. The x axes of both links point from P to Q.

A body is made of links that are welded to each other. It has the frame and the name of one of these links, its root. A point P of
another link L of the body becomes the point L.P of the body. With mass m_i, centre of mass c_i and inertia I_i of the links, in the
frame of the body,

    m = sum m_i,    m c = sum m_i c_i,    I = sum (I_i + m_i |c_i - c|^2)        (parallel axes)

A point mass enters these sums with I_i = 0.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.linkage.errors import BuildError
from gauss_bench.mechanism.model import Link, Part, Point, Weld
from gauss_bench.mechanism.numbers import Number, angle_of, length, pair, turn_vector
from gauss_bench.terms import Array

Welds = Mapping[str, Mapping[str, Any]]  # name of a weld -> its table

BARREL, ROD = "barrel", "rod"
PIN, END = "pin", "end"  # names of the points of a barrel or rod
SAME = 1e-6  # the two points of a weld are equally far apart on both of its links, up to this relative difference


def expand_cylinders(document: dict[str, Any]) -> dict[str, Any]:
    """Return the document with two links, two revolute joints and a slide in place of each cylinder."""
    cylinders = document.get("cylinders")
    if not cylinders:
        return document
    links, joints = dict(document["links"]), dict(document.get("joints", {}))
    for name, cylinder in cylinders.items():
        # `mount`: the point of another link, or of the ground, at which the part is pinned
        for part, sense, mount in zip((BARREL, ROD), (1, -1), cylinder["between"], strict=True):
            links[f"{name}_{part}"] = _cylinder_part(cylinder[part], sense)
            joints[f"{name}_{part}"] = {"type": "revolute", "at": [mount, f"{name}_{part}.{PIN}"]}
        joints[name] = {"type": "prismatic", "guide": f"{name}_{BARREL}.{PIN}", "block": f"{name}_{ROD}.{PIN}"}
    return {key: value for key, value in document.items() if key != "cylinders"} | {"links": links, "joints": joints}


def _cylinder_part(part: dict[str, Any], sense: int) -> dict[str, Any]:
    """Return the table of barrel or rod: a bar from its pin at the origin along +x (`sense` 1, barrel) or -x (`sense` -1, rod)."""
    link: dict[str, Any] = {key: part[key] for key in ("mass", "kg_per_m", "inertia") if key in part}
    if "com" in part:
        link["com"] = [sense * part["com"], 0]
    return link | {"points": {PIN: [0, 0], END: [sense * part["length"], 0]}, "bars": [[PIN, END]]}


class Mass(NamedTuple):
    """A mass [kg], its centre (2,) [m], and its inertia about the centre [kg m^2]."""

    mass: Any
    com: Array
    inertia: Any


class Pose(NamedTuple):
    """The frame of a link in the frame of `root`, the link that gives the welded body its frame: origin (2,) [m], angle [rad]."""

    root: str
    origin: Array
    turn: Any


def combine_masses(parts: Sequence[Mass]) -> Mass:
    """Return mass, centre and inertia of one rigid body made of several parts, by the parallel-axis theorem."""
    mass = sum((x.mass for x in parts[1:]), start=parts[0].mass)
    com = sum((x.mass * x.com for x in parts[1:]), start=parts[0].mass * parts[0].com) / mass
    inertia = [x.inertia + x.mass * length(x.com - com) ** 2 for x in parts]
    return Mass(mass, com, sum(inertia[1:], start=inertia[0]))


def find_poses(links: Mapping[str, Link], welds: Welds, preferred: Sequence[str], number: Number) -> dict[str, Pose]:
    """Return link -> pose in its body, which consists of the links that welds connect directly or through other links.

    The root of a body is the first link in `preferred` that belongs to it, else the link that no weld attaches to another.

    Raises:
        BuildError: two pairs of points of a weld have different distances, so that they cannot coincide.
    """
    zero = number("0")
    poses = {name: Pose(name, pair(number, (0, 0)), zero) for name in links}
    waiting = dict(welds)
    while waiting:
        # welds form trees: there is always a weld that attaches its link to a link whose pose is known
        unknown = {weld["link"] for weld in waiting.values()}
        key = next(key for key, weld in waiting.items() if weld["to"] not in unknown)
        weld = waiting.pop(key)
        origin, turn = _pose_on(links[weld["to"]], links[weld["link"]], key, weld, number)
        base = poses[weld["to"]]
        poses[weld["link"]] = Pose(base.root, base.origin + turn_vector(origin, base.turn), base.turn + turn)
    for root in {x.root for x in poses.values()}:
        members = {name: x for name, x in poses.items() if x.root == root}
        chosen = next((name for name in preferred if name in members), root)
        if chosen != root:  # express all poses of the body in the frame of the preferred link
            base = members[chosen]
            for name, pose in members.items():
                poses[name] = Pose(chosen, turn_vector(pose.origin - base.origin, -base.turn), pose.turn - base.turn)
            poses[chosen] = Pose(chosen, pair(number, (0, 0)), zero)
    return poses


def _pose_on(to: Link, link: Link, key: str, weld: Mapping[str, Any], number: Number) -> tuple[Array, Any]:
    """Return origin (2,) [m] and angle [rad] of the frame of `link` in that of `to`, by the weld called `key`."""
    turn = angle_of(weld, "angle", number)
    if "points" not in weld:
        return pair(number, weld["origin"]), turn
    # positions of the points P and Q that coincide: P of "to.P" in the frame of `to`, Q of "link.Q" in that of `link`
    pairs = [(to.points[a.partition(".")[2]], link.points[b.partition(".")[2]]) for a, b in weld["points"]]
    on_to, on_link = pairs[0]
    if len(pairs) == 2:  # the line from the first pair to the second gives the angle
        line_to, line_link = pairs[1][0] - on_to, pairs[1][1] - on_link
        if length(line_link) == 0 or abs(length(line_to) - length(line_link)) > SAME * length(line_link):
            apart = f"{float(length(line_to)):.6g} m apart on {to.name}, {float(length(line_link)):.6g} m on {link.name}"
            raise BuildError(f"welds.{key}.points", f"the two pairs cannot both coincide: {apart}")
        turn = np.arctan2(line_to[1], line_to[0]) - np.arctan2(line_link[1], line_link[0])
    return on_to - turn_vector(on_link, turn), turn


def merge_welded(links: Mapping[str, Link], poses: Mapping[str, Pose]) -> tuple[Link, ...]:
    """Return one rigid link for each body, in the order in which the file first names a link of the body."""
    members: dict[str, dict[str, Pose]] = {}  # root -> the links of its body
    for name in links:
        members.setdefault(poses[name].root, {})[name] = poses[name]
    return tuple(_merge_group(links[root], group, links) for root, group in members.items())


def _merge_group(root: Link, members: Mapping[str, Pose], links: Mapping[str, Link]) -> Link:
    """Return a group of welded links as one link, in the frame and with the name of `root`.

    `members` are the links of the group with their poses in the root's frame; points, bars and masses are those of all members.
    """
    if len(members) == 1:
        return root
    points: dict[str, Array] = {}
    bars, masses = [], []
    for name, pose in members.items():
        link = links[name]
        renamed = {key: key if name == root.name else f"{name}.{key}" for key in link.points}
        points |= {renamed[key]: pose.origin + turn_vector(x, pose.turn) for key, x in link.points.items()}
        bars += [(renamed[a], renamed[b]) for a, b in link.bars]
        masses.append(Mass(link.mass, pose.origin + turn_vector(link.com, pose.turn), link.inertia))
    total = combine_masses(masses)
    return Link(root.name, total.mass, total.inertia, total.com, points, tuple(bars))


def list_parts(links: Mapping[str, Link], poses: Mapping[str, Pose], bodies: Sequence[Link]) -> tuple[Part, ...]:
    """Return every link of the file as a `Part`: the index of its body, and the pose of the link in the body."""
    index = {body.name: i for i, body in enumerate(bodies)}  # a body has the name of its root link
    parts = []
    for name, link in links.items():
        root, origin, turn = poses[name]
        i = index[root]
        parts.append(Part(name, i, origin + turn_vector(link.com, turn) - bodies[i].com, turn))
    return tuple(parts)


def read_welds(links: Mapping[str, Link], welds: Welds) -> tuple[Weld, ...]:
    """Return the welds of a file, each with the links that it carries and the point about which its moment is reported."""
    names = list(links)
    result = []
    for key, weld in welds.items():
        carried = {weld["link"]}  # grows by the links that are welded to it; one round for each weld reaches all of them
        for _ in welds:
            carried |= {x["link"] for x in welds.values() if x["to"] in carried}
        link = links[weld["link"]]
        # the link's own point in the first pair ["to.P", "link.Q"] of the weld, else the origin of the link's frame
        point = weld["points"][0][1].partition(".")[2] if "points" in weld else ""
        position = link.points[point] if point else 0 * link.com  # zero in the type of the numbers
        place = Point(names.index(link.name), position - link.com, f"{link.name}.{point}")
        result.append(Weld(key, place, tuple(i for i, name in enumerate(names) if name in carried)))
    return tuple(result)
