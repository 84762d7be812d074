"""A first guess of every link's place from the rough drawing of a linkage file: two decimals are enough.

A link is placed by two known points, or by one and an angle; what placed links share with others becomes known in turn. The two
links of a slide have an angle too where the points are known that stand for the slide: the line runs from one to the other.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gauss_bench.linkage.cylinders import write_out
from gauss_bench.linkage.errors import NotPlaced
from gauss_bench.mechanism.model import GROUND, Mechanism, Point, Prismatic, Revolute
from gauss_bench.mechanism.numbers import turn_vector
from gauss_bench.terms import Array


def sketch(mechanism: Mechanism, document: dict[str, Any]) -> Array:
    """First guess q (n,): each link from two known points, or from one and an angle (given, or that of a prismatic partner).

    Raises:
        NotPlaced: links that cannot be placed, by name.
    """
    assembly = document.get("assembly", {})
    angles = {name: float(np.radians(x)) for name, x in assembly.get("angles_deg", {}).items()} | assembly.get("angles", {})
    given = {i: x - turn for name, x in angles.items() for i, turn in [mechanism.placed(name)]}
    drawn = draw_points(mechanism, document, assembly.get("sketch", {}))
    theta: dict[int, float] = {GROUND: 0.0}
    centre: dict[int, Array] = {GROUND: np.zeros(2)}

    def world(point: Point) -> Array:
        return np.asarray(centre[point.link] + turn_vector(point.local, theta[point.link]))

    todo = list(range(len(mechanism.links)))
    while todo:
        placed = [i for i in todo if _place(mechanism, i, given, drawn, theta, centre, world)]
        if not placed:
            raise NotPlaced(tuple(mechanism.links[i].name for i in todo))
        todo = [i for i in todo if i not in placed]
    return np.concatenate([[*centre[i], theta[i]] for i in range(len(mechanism.links))])


def draw_points(mechanism: Mechanism, document: dict[str, Any], drawing: dict[str, Any]) -> dict[str, Array]:
    """Name of a point -> drawn world position, from joints, single points and ground pivots."""
    drawn: dict[str, Array] = {}
    for name, joint in write_out(document).get("joints", {}).items():
        references = joint.get("at") or [joint["block"]]
        grounded = [mechanism.ground_points[r.split(".")[1]] for r in references if r.startswith("ground.")]
        where = drawing.get(name, grounded[0] if grounded else None)
        if where is not None:
            drawn |= {r: np.array(where, dtype=float) for r in references}
    drawn |= {r: np.array(x, dtype=float) for r, x in drawing.items() if "." in r}
    return {mechanism.named_point(r).name: x for r, x in drawn.items()}


def _place(
    mechanism: Mechanism,
    i: int,
    given: dict[int, float],
    drawn: dict[str, Array],
    theta: dict[int, float],
    centre: dict[int, Array],
    world: Callable[[Point], Array],
) -> bool:
    """Place link i if what is known suffices."""
    link = mechanism.links[i]
    known = {name: drawn[f"{link.name}.{name}"] for name in link.points if f"{link.name}.{name}" in drawn}
    for joint in mechanism.joints:
        if isinstance(joint, Revolute):
            for mine, other in ((joint.a, joint.b), (joint.b, joint.a)):
                if mine.link == i and other.link in theta:
                    known.setdefault(mine.name.partition(".")[2], world(other))
    if not known:
        return False
    (first, at), *others = known.items()
    apart = next((name for name, _ in others if np.any(link.points[name] != link.points[first])), None)
    if i in given:
        turn = given[i]
    elif apart is not None:
        own, drawn_line = link.points[apart] - link.points[first], known[apart] - at
        turn = float(np.arctan2(drawn_line[1], drawn_line[0]) - np.arctan2(own[1], own[0]))
    else:
        partner = _partner_angle(mechanism, i, theta)
        if partner is None:
            partner = _slide_angle(mechanism, i, drawn, theta, world)
        if partner is None:
            return False
        turn = partner
    near = _partner_angle(mechanism, i, theta)
    if near is not None:  # the sketch fixes angles only up to whole turns; slides do not
        turn += 2 * np.pi * round((near - turn) / (2 * np.pi))
    theta[i] = turn
    centre[i] = at - turn_vector(link.points[first] - link.com, turn)
    return True


def _slide_angle(
    mechanism: Mechanism, i: int, drawn: dict[str, Array], theta: dict[int, float], world: Callable[[Point], Array]
) -> float | None:
    """The angle of a link of a slide whose guide and block point are both known, the block ahead of the guide."""

    def where(point: Point) -> Array | None:
        pins = [j for j in mechanism.joints if isinstance(j, Revolute)]
        others = [b if a.name == point.name else a for a, b in ((j.a, j.b) for j in pins) if point.name in (a.name, b.name)]
        shared = next((x for x in others if x.link in theta), None)
        return drawn[point.name] if point.name in drawn else None if shared is None else world(shared)

    for joint in mechanism.joints:
        if isinstance(joint, Prismatic) and i in (joint.guide.link, joint.block.link):
            guide, block = where(joint.guide), where(joint.block)
            if guide is None or block is None or (apart := float(np.hypot(*(block - guide)))) <= abs(joint.offset):
                continue
            line = float(np.arctan2(*(block - guide)[::-1])) - float(np.arcsin(joint.offset / apart)) - joint.angle
            return line if i == joint.guide.link else line + joint.turn
    return None


def _partner_angle(mechanism: Mechanism, i: int, theta: dict[int, float]) -> float | None:
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic):
            if joint.block.link == i and joint.guide.link in theta:
                return theta[joint.guide.link] + joint.turn
            if joint.guide.link == i and joint.block.link in theta:
                return theta[joint.block.link] - joint.turn
    return None
