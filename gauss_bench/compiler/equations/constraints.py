"""Constraint rows of a linkage as expressions, entry by entry; conventions and order of rows as in `mechanism/constraints.py`.

With arms r, centres z and Haug's bias gamma, J a = gamma, a pin is

    z_b + r_b - z_a - r_a = 0,    gamma = r_b omega_b^2 - r_a omega_a^2

and what slides, drivers and knife edges hold are the scalar coordinates of `mechanism/coordinates.py`. On the constraints a driven
L(t) stands for the distance it is equal to, which saves a root and several products; off the constraints this changes the
acceleration by as little as the state is off, and no row's zero. Slides do without: stages of a step are off by its second power,
and an offset in the place of the true distance would save three operations a stage and make steps err otherwise than they should.

Motion laws are the formulas of `mechanism/motion_laws.py`, with switches that are numbers 0 and 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, maximum, minimum
from gauss_bench.mechanism.coordinates import SlipState, columns, state
from gauss_bench.mechanism.model import Coordinate, KnifeEdge, Prismatic, Revolute
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
    rows += [_held(links, x.name, x.coordinate, law_of_time(x.law, links.graph, links.time)) for x in links.mechanism.drivers]
    return rows + [_knife_edge(links, edge) for edge in links.mechanism.knife_edges]


def combined(graph: ExpressionGraph, parts: Sequence[tuple[Row, float]]) -> Row:
    """The sum of some rows, each times a factor, under the name of the first; all have a position level."""
    entries: dict[int, list[Node]] = {}
    for row, factor in parts:
        for c, e in row.entries.items():
            entries.setdefault(c, []).append(e * factor)
    sums = {c: graph.total(x) for c, x in entries.items()}
    gamma, phi_t = (graph.total([getattr(row, x) * factor for row, factor in parts]) for x in ("gamma", "phi_t"))
    phi = graph.total([row.phi * factor for row, factor in parts if row.phi is not None])
    return Row(parts[0][0].name, {c: x for c, x in sums.items() if not x.zero}, gamma, phi, phi_t)


def rate_of(links: Links, row: Row) -> Node:
    """Rate of the residual, J v + dphi/dt."""
    return links.graph.total([*(e * links.rate(k) for k, e in row.entries.items()), row.phi_t])


def _pin(links: Links, joint: Revolute) -> list[Row]:
    a, b = links.end(joint.a), links.end(joint.b)
    gap = links.position(joint.b) - links.position(joint.a)
    bias = b.r * (b.omega * b.omega) - a.r * (a.omega * a.omega)
    columns = [(end.link, axis) for end in (joint.a, joint.b) for axis in range(3)]
    x = links.entries(columns, (-1.0, 0.0, a.r.imag, 1.0, 0.0, -b.r.imag))
    y = links.entries(columns, (0.0, -1.0, -a.r.real, 0.0, 1.0, b.r.real))
    return [
        Row(f"{joint.name}.x", x, bias.real, gap.real, links.zero),
        Row(f"{joint.name}.y", y, bias.imag, gap.imag, links.zero),
    ]


def _slide(links: Links, joint: Prismatic) -> list[Row]:
    (beside, _), (turning, turn) = joint.held
    offset = links.number(f"joints.{joint.name}.offset")
    return [
        _held(links, f"{joint.name}.normal", beside, (offset, links.zero, links.zero)),
        _held(links, f"{joint.name}.turn", turning, (links.graph.constant(float(turn)), links.zero, links.zero)),
    ]


def _held(links: Links, name: str, coordinate: Coordinate, law: Law) -> Row:
    """A coordinate that is what a law of time says: on the constraint a distance is known to be that of the law."""
    value, rate, second = law
    x = state(coordinate, links, None if links.exact else value)
    return Row(name, links.entries(columns(coordinate), x.entries), second - x.bias, x.value - value, -rate)


def _knife_edge(links: Links, edge: KnifeEdge) -> Row:
    link = edge.point.link
    slip = SlipState(links.direction(link, float(edge.angle), across=True), links.end(edge.point))
    entries = links.entries([(link, axis) for axis in range(3)], slip.entries)
    return Row(edge.name, entries, -slip.bias, None, links.zero)
