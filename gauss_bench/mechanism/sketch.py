"""A first guess of every link's place from the rough drawing of a linkage file: two decimals are enough.

A link is placed by two known points, or by one and an angle; what placed links share with others becomes known in turn.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gauss_bench.mechanism.errors import AssemblyError
from gauss_bench.mechanism.model import GROUND, Mechanism, Point, Prismatic, Revolute
from gauss_bench.terms import Array


def sketch(mechanism: Mechanism, document: dict[str, Any]) -> Array:
    """First guess q (n,): each link from two known points, or from one and an angle (given, or that of a prismatic partner).

    Raises:
        AssemblyError: links that cannot be placed, by name.
    """
    assembly = document.get("assembly", {})
    given = {name: float(np.radians(x)) for name, x in assembly.get("angles_deg", {}).items()} | assembly.get("angles", {})
    drawn = drawn_points(mechanism, document, assembly.get("sketch", {}))
    theta: dict[int, float] = {GROUND: 0.0}
    centre: dict[int, Array] = {GROUND: np.zeros(2)}

    def world(point: Point) -> Array:
        return centre[point.link] + turned(point.local, theta[point.link])

    todo = list(range(len(mechanism.links)))
    while todo:
        placed = [i for i in todo if _place(mechanism, i, given, drawn, theta, centre, world)]
        if not placed:
            names = ", ".join(mechanism.links[i].name for i in todo)
            raise AssemblyError("assembly.sketch", f"not placed: {names}; give two points, or one point and an angle, of each")
        todo = [i for i in todo if i not in placed]
    return np.concatenate([[*centre[i], theta[i]] for i in range(len(mechanism.links))])


def turned(x: Array, theta: float) -> Array:
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])


def drawn_points(mechanism: Mechanism, document: dict[str, Any], drawing: dict[str, Any]) -> dict[str, Array]:
    """Reference "link.point" -> drawn world position, from joints, single points and ground pivots."""
    drawn: dict[str, Array] = {}
    for name, joint in document.get("joints", {}).items():
        references = joint.get("at") or [joint["block"]]
        grounded = [mechanism.ground_points[r.split(".")[1]] for r in references if r.startswith("ground.")]
        where = drawing.get(name, grounded[0] if grounded else None)
        if where is not None:
            drawn |= {r: np.array(where, dtype=float) for r in references}
    return drawn | {r: np.array(x, dtype=float) for r, x in drawing.items() if "." in r}


def _place(
    mechanism: Mechanism,
    i: int,
    given: dict[str, float],
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
                    known.setdefault(mine.name.split(".")[1], world(other))
    if not known:
        return False
    (first, at), *others = known.items()
    apart = next((name for name, _ in others if np.any(link.points[name] != link.points[first])), None)
    if link.name in given:
        turn = given[link.name]
    elif apart is not None:
        own, drawn_line = link.points[apart] - link.points[first], known[apart] - at
        turn = float(np.arctan2(drawn_line[1], drawn_line[0]) - np.arctan2(own[1], own[0]))
    else:
        partner = _partner_angle(mechanism, i, theta)
        if partner is None:
            return False
        turn = partner
    near = _partner_angle(mechanism, i, theta)
    if near is not None:  # the sketch fixes angles only up to whole turns; slides do not
        turn += 2 * np.pi * round((near - turn) / (2 * np.pi))
    theta[i] = turn
    centre[i] = at - turned(link.points[first] - link.com, turn)
    return True


def _partner_angle(mechanism: Mechanism, i: int, theta: dict[int, float]) -> float | None:
    for joint in mechanism.joints:
        if isinstance(joint, Prismatic):
            if joint.block.link == i and joint.guide.link in theta:
                return theta[joint.guide.link] + joint.turn
            if joint.guide.link == i and joint.block.link in theta:
                return theta[joint.block.link] - joint.turn
    return None
