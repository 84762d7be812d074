"""Constraint rows of a linkage as expressions, entry by entry; conventions and order of rows as in `mechanism/constraints.py`.

With arms r, centres z, the normal or axis n of a slide that turns with its guide, and Haug's bias gamma, J a = gamma:

    pin         z_b + r_b - z_a - r_a = 0                  gamma = r_b omega_b^2 - r_a omega_a^2
    slide       n . (p_b - p_g) = c, theta_b - theta_g = turn
                gamma = omega^2 (c - n . (r_b - r_g)) - 2 omega n x (u_b - u_g)
    bar         |p_b - p_a| = L(t),  e = (p_b - p_a) / L
                gamma = e . (r_b omega_b^2 - r_a omega_a^2) - (e x (p_b - p_a)')^2 / L + L''
    knife edge  n . p' = 0                                 gamma = -omega n x u

Here c (the offset, or the driven x(t)) and L(t) stand for the distances they are equal to on the constraints, which saves a root
and several products; off the constraints this changes the acceleration by as little as the state is off, and no row's zero.

Motion laws are the formulas of `mechanism/motion_laws.py`, with switches that are numbers 0 and 1.
"""

from dataclasses import dataclass
from typing import assert_never

import numpy as np

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, Vector
from gauss_bench.mechanism.model import (
    GROUND,
    AngleDriver,
    Driver,
    KnifeEdge,
    LengthDriver,
    Point,
    Prismatic,
    Revolute,
    SlideDriver,
)
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

Law = tuple[Node, Node, Node]  # value, rate, second rate


def law_of_time(law: MotionLaw, graph: ExpressionGraph, t: Node) -> Law:
    """Value, rate and second rate of a law at t.

    Raises:
        KernelError: a law of an unknown kind.
    """
    numbers = law.numbers
    match law.name:
        case "constant":
            speed = float(numbers["speed"])
            return t * speed + float(numbers["start"]), graph.constant(speed), graph.constant(0.0)
        case "table":
            knots = (numbers[key].astype(float) for key in ("times", "angles", "curvatures"))
            return _table(graph, t, float(numbers["start"]), *knots)
        case "sine" | "cosine" | "poly345":
            return _rise(graph, t, law.name, *(float(numbers[key]) for key in ("start", "travel", "time")))
    raise KernelError(f"no kernel for the motion law {law.name}")


def _rise(graph: ExpressionGraph, t: Node, name: str, start: float, travel: float, time: float) -> Law:
    zero, one = graph.constant(0.0), graph.constant(1.0)
    s = minimum(maximum(t * (1.0 / time), zero), one)
    moving = at_most(zero, t) * at_most(t, graph.constant(time))
    x, rate, second = RISES[name](graph, s)
    return x * travel + start, rate * moving * (travel / time), second * moving * (travel / time**2)


def _sine(graph: ExpressionGraph, s: Node) -> Law:
    w = 2 * np.pi
    angle = s * w
    wave, slope = graph.sin(angle), graph.cos(angle)
    return s - wave * (1 / w), 1.0 - slope, wave * w


def _cosine(graph: ExpressionGraph, s: Node) -> Law:
    angle = s * np.pi
    wave, slope = graph.sin(angle), graph.cos(angle)
    return (1.0 - slope) * 0.5, wave * (np.pi / 2), slope * (np.pi**2 / 2)


def _poly345(graph: ExpressionGraph, s: Node) -> Law:
    rest = 1.0 - s
    square = s * s
    return (
        square * s * (square * 6.0 - s * 15.0 + 10.0),
        square * (rest * rest) * 30.0,
        s * rest * (1.0 - s * 2.0) * 60.0,
    )


RISES = {"sine": _sine, "cosine": _cosine, "poly345": _poly345}


def _table(graph: ExpressionGraph, t: Node, start: float, knots: Array, values: Array, curvatures: Array) -> Law:
    """A cubic spline: the coefficients of the piece that t is in are picked by switches, one of which is 1."""
    h = knots[1:] - knots[:-1]
    bend = (curvatures[1:] - curvatures[:-1]) / h
    slope = (values[1:] - values[:-1]) / h - h * (2 * curvatures[:-1] + curvatures[1:]) / 6
    inside = minimum(maximum(t, graph.constant(knots[0])), graph.constant(knots[-1]))
    passed = [at_most(graph.constant(x), inside) for x in knots[1:-1]]
    left = [graph.constant(1.0), *passed]
    switches = [a - b for a, b in zip(left, [*passed, graph.constant(0.0)], strict=True)]
    s = inside - _picked(switches, knots[:-1])
    c3, c2, c1, c0 = (_picked(switches, x) for x in (bend / 6, curvatures[:-1] / 2, slope, values[:-1]))
    moving = at_most(graph.constant(knots[0]), t) * at_most(t, graph.constant(knots[-1]))
    value = ((c3 * s + c2) * s + c1) * s + c0
    rate = (c3 * s * 3.0 + c2 * 2.0) * s + c1
    return value + start, rate * moving, (c3 * s * 6.0 + c2 * 2.0) * moving


def _picked(switches: list[Node], values: Array) -> Node:
    return switches[0].graph.total(s * float(x) for s, x in zip(switches, values, strict=True))


def minimum(a: Node, b: Node) -> Node:
    return a.graph.opaque("FMIN", (a, b), np.minimum(a.at, b.at))


def maximum(a: Node, b: Node) -> Node:
    return a.graph.opaque("FMAX", (a, b), np.maximum(a.at, b.at))


def at_most(a: Node, b: Node) -> Node:
    """1 where a <= b, else 0."""
    return a.graph.opaque("LE", (a, b), (a.at <= b.at).astype(float))


@dataclass(frozen=True, eq=False)
class Row:
    """One constraint: name, entries of J by coordinate, bias, residual (None without a position level), explicit rate."""

    name: str
    entries: dict[int, Node]
    gamma: Node
    phi: Node | None
    phi_t: Node


def rows_of(links: Links) -> list[Row]:
    """All rows in the file's order: joints two each, drivers, knife edges."""
    rows: list[Row] = []
    for joint in links.mechanism.joints:
        rows += _pin(links, joint) if isinstance(joint, Revolute) else _slide(links, joint)
    rows += [_driver(links, driver) for driver in links.mechanism.drivers]
    return rows + [_knife_edge(links, edge) for edge in links.mechanism.knife_edges]


def rate_of(links: Links, row: Row) -> Node:
    """Rate of the residual, J v + dphi/dt."""
    return links.graph.total([*(e * links.rate(k) for k, e in row.entries.items()), row.phi_t])


class _Entries(dict[int, Node]):
    """Entries of one row; the ground has no columns, and zeros are left out."""

    def put(self, link: int, axis: int, entry: Node) -> None:
        if link != GROUND and not entry.zero:
            self[3 * link + axis] = entry

    def put_point(self, n: Vector, point: Point, arm: Vector, sign: float) -> None:
        """The gradient of sign n . p."""
        for axis, entry in enumerate((n.x, n.y, n.cross(-arm))):
            self.put(point.link, axis, entry * sign)


def _pin(links: Links, joint: Revolute) -> list[Row]:
    a, b = joint.a, joint.b
    r_a, r_b = links.arm(a), links.arm(b)
    gap = links.position(b) - links.position(a)
    bias = _centripetal(links, b) - _centripetal(links, a)
    rows = []
    for axis, n, phi, gamma in (("x", (1.0, 0.0), gap.x, bias.x), ("y", (0.0, 1.0), gap.y, bias.y)):
        entries = _Entries()
        entries.put_point(links.fixed(*n), b, r_b, 1.0)
        entries.put_point(links.fixed(*n), a, r_a, -1.0)
        rows.append(Row(f"{joint.name}.{axis}", entries, gamma, phi, links.zero))
    return rows


def _slide(links: Links, joint: Prismatic) -> list[Row]:
    guide, block = joint.guide, joint.block
    n = links.direction(guide.link, float(joint.angle) + np.pi / 2)
    offset = links.number(f"joints.{joint.name}.offset")
    entries, value, gamma = _along(links, n, guide, block, offset)
    turn = _Entries()
    turn.put(block.link, 2, links.graph.constant(1.0))
    turn.put(guide.link, 2, links.graph.constant(-1.0))
    gap = links.angle(block.link) - links.angle(guide.link) - float(joint.turn)
    return [
        Row(f"{joint.name}.normal", entries, gamma, value - offset, links.zero),
        Row(f"{joint.name}.turn", turn, links.zero, gap, links.zero),
    ]


def _along(links: Links, n: Vector, guide: Point, block: Point, value: Node) -> tuple[_Entries, Node, Node]:
    """n . (p_b - p_g) for a direction n that turns with the guide and a block that turns with it: entries, value, bias."""
    r_g, r_b = links.arm(guide), links.arm(block)
    gap = links.position(block) - links.position(guide)
    entries = _Entries()
    entries.put_point(n, block, r_b, 1.0)
    entries.put_point(n, guide, gap + r_g, -1.0)
    omega = links.omega(guide.link)
    if omega.zero:
        return entries, n.dot(gap), links.zero
    guide_speed = links.fixed(0.0, 0.0) if guide.link == GROUND else links.centre_velocity(guide.link)
    slip = n.cross(links.centre_velocity(block.link) - guide_speed) if block.link != GROUND else n.cross(-guide_speed)
    gamma = omega * (omega * (value - n.dot(r_b - r_g)) - slip * 2.0)
    return entries, n.dot(gap), gamma


def _driver(links: Links, driver: Driver) -> Row:
    value, rate, second = law_of_time(driver.law, links.graph, links.time)
    match driver:
        case AngleDriver():
            entries = _Entries()
            entries.put(driver.link, 2, links.graph.constant(1.0))
            return Row(driver.name, entries, second, links.angle(driver.link) - value, -rate)
        case SlideDriver():
            guide, block = driver.joint.guide, driver.joint.block
            axis = links.direction(guide.link, float(driver.joint.angle))
            entries, x, gamma = _along(links, axis, guide, block, value)
            return Row(driver.name, entries, gamma + second, x - value, -rate)
        case LengthDriver():
            return _bar(links, driver, value, rate, second)
        case _:
            assert_never(driver)


def _bar(links: Links, driver: LengthDriver, value: Node, rate: Node, second: Node) -> Row:
    a, b = driver.a, driver.b
    gap = links.position(b) - links.position(a)
    length = links.graph.sqrt(gap.dot(gap))
    per_length = links.graph.inverse(length if links.exact else value)
    e = gap * per_length
    entries = _Entries()
    entries.put_point(e, b, links.arm(b), 1.0)
    entries.put_point(e, a, links.arm(a), -1.0)
    across = e.cross(links.velocity(b) - links.velocity(a))
    turning = e.dot(_centripetal(links, b) - _centripetal(links, a)) - across * across * per_length
    return Row(driver.name, entries, turning + second, length - value, -rate)


def _knife_edge(links: Links, edge: KnifeEdge) -> Row:
    link = edge.point.link
    n = links.direction(link, float(edge.angle) + np.pi / 2)
    entries = _Entries()
    entries.put_point(n, edge.point, links.arm(edge.point), 1.0)
    speed = links.fixed(0.0, 0.0) if link == GROUND else links.centre_velocity(link)
    return Row(edge.name, entries, -(links.omega(link) * n.cross(speed)), None, links.zero)


def _centripetal(links: Links, point: Point) -> Vector:
    """r omega^2, what a point's acceleration lacks of that of its link's centre."""
    omega = links.omega(point.link)
    return links.arm(point) * (omega * omega)
