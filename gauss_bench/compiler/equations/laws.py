"""Motion laws as expressions of time: the formulas of `mechanism/motion_laws.py`, with switches in place of branches.

A switch is 1 where a condition holds, else 0. The functions in `RISE_LAWS` work on nodes, because numpy's sine and cosine call a
node's methods `sin` and `cos`.
"""

from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, maximum, minimum
from gauss_bench.mechanism.motion_laws import RISE_LAWS, MotionLaw
from gauss_bench.terms import Array

Law = tuple[Node, Node, Node]  # value, first and second time derivative


def law_of_time(law: MotionLaw, graph: ExpressionGraph, t: Node) -> Law:
    """Return the value and the first and second time derivative of a motion law at the time t, as nodes.

    Raises:
        ValueError: a law of an unknown kind.
    """
    numbers = law.numbers
    match law.name:
        case "constant":
            speed = float(numbers["speed"])
            return t * speed + float(numbers["start"]), graph.constant(speed), graph.constant(0.0)
        case "table":
            knots = (numbers[key].astype(float) for key in ("times", "angles", "curvatures"))
            return _table(graph, t, float(numbers["start"]), *knots)
        case name if name in RISE_LAWS:
            return _rise(graph, t, law.name, *(float(numbers[key]) for key in ("start", "travel", "time")))
    raise ValueError(f"no kernel for the motion law {law.name}")


def _rise(graph: ExpressionGraph, t: Node, name: str, start: float, travel: float, time: float) -> Law:
    """Return value, first and second time derivative of a rise from `start` by `travel`, which lasts from t = 0 to t = `time` [s].

    Before and after the rise, the value is constant, and both derivatives are zero.
    """
    zero, one = graph.constant(0.0), graph.constant(1.0)
    s = minimum(maximum(t * (1.0 / time), zero), one)
    moving = at_most(zero, t) * at_most(t, graph.constant(time))  # switch of the interval
    x, rate, second = RISE_LAWS[name](s)
    return x * travel + start, rate * moving * (travel / time), second * moving * (travel / time**2)


def _table(graph: ExpressionGraph, t: Node, start: float, knots: Array, values: Array, curvatures: Array) -> Law:
    """Return value, first and second time derivative of a cubic spline at the time t; outside the knots its value is constant.

    On the piece from knot k, with s = t - knot_k, the value is c0 + c1 s + c2 s^2 + c3 s^3.

    Args:
        knots, values, curvatures: times [s] of the knots, and the spline's value and second derivative there.
    """
    h = knots[1:] - knots[:-1]
    bend = (curvatures[1:] - curvatures[:-1]) / h
    slope = (values[1:] - values[:-1]) / h - h * (2 * curvatures[:-1] + curvatures[1:]) / 6
    inside = minimum(maximum(t, graph.constant(knots[0])), graph.constant(knots[-1]))
    passed = [at_most(graph.constant(x), inside) for x in knots[1:-1]]
    # the switch of a piece is 1 if t has passed the left knot of the piece, and not its right one
    left = [graph.constant(1.0), *passed]
    switches = [a - b for a, b in zip(left, [*passed, graph.constant(0.0)], strict=True)]
    s = inside - _pick(switches, knots[:-1])
    c3, c2, c1, c0 = (_pick(switches, x) for x in (bend / 6, curvatures[:-1] / 2, slope, values[:-1]))
    moving = at_most(graph.constant(knots[0]), t) * at_most(t, graph.constant(knots[-1]))
    value = ((c3 * s + c2) * s + c1) * s + c0
    rate = (c3 * s * 3.0 + c2 * 2.0) * s + c1
    return value + start, rate * moving, (c3 * s * 6.0 + c2 * 2.0) * moving


def _pick(switches: list[Node], values: Array) -> Node:
    """Return sum_k switch_k value_k: the value whose switch is 1, as all other switches are 0."""
    return switches[0].graph.total(s * float(x) for s, x in zip(switches, values, strict=True))


def at_most(a: Node, b: Node) -> Node:
    """Return 1 where a <= b, else 0."""
    return a.graph.opaque("LE", a, b)
