"""Applied forces and potential energy as expressions: laws on coordinates and forces at points, as in `mechanism/equations.py`.

Where two points coincide a spring with a rest length is not finite (the linkage's own evaluation takes no direction there).

A force that varies is a factor (`mechanism/motion_laws.py`) times the steady force that it is of. Of time that is a sine, or a line
whose level and slope are open numbers (`mechanism/lines.py`). The hyperbolic tangent of a direction is tanh(x) = u / (u + 2) with
u = exp(2 x) - 1, which is had from a short series at 2 x / 2^D and D doublings, exp(2 y) - 1 = (exp(y) - 1) (exp(y) + 1), within
|x| <= FLAT, where the tangent is 1 but for rounding.
"""

from collections.abc import Iterable, Sequence
from math import factorial
from typing import Any

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, maximum, minimum
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.model import PointForce, Torque
from gauss_bench.mechanism.motion_laws import STEADY, Factor
from gauss_bench.mechanism.spaces import Vec, angle_slot, dot, slots

FLAT = 20.0
DOUBLINGS, TERMS = 8, 11  # 2 FLAT / 2^8 is 0.16, of which the twelfth power over 12! is below a thousandth of rounding
SMALLEST = 1e-300  # [N, N m] of a force: one without a size has no direction either


def generalised_force(links: Links) -> dict[int, Node]:
    """Return Q by coordinate; missing entries are zero."""
    terms: dict[int, list[Node]] = {}
    steady, varying = (
        (equations.generalise(links, load) for load in links.loads()),
        (_vary(links, *force) for force in links.varying()),
    )
    for entries in (*_weights(links), *steady, *varying):
        for k, x in entries.items():
            terms.setdefault(k, []).append(links.graph.node(x))
    sums = {k: links.graph.total(x) for k, x in terms.items()}
    return {k: x for k, x in sums.items() if not x.zero}


def _weights(links: Links) -> Iterable[dict[int, Node]]:
    for i, link in enumerate(links.mechanism.links):
        mass = links.number(f"links.{link.name}.mass")
        yield {k: mass * links.number(f"gravity.{axis}") for k, axis in enumerate("xy", slots(i).start)}


def _vary(links: Links, force: Torque | PointForce, factor: Factor) -> dict[int, Node]:
    """Return the generalised force of a varying force; the speed along it is its power divided by its magnitude."""
    (load,) = force.to_loads()
    graph = links.graph
    entries = {k: graph.node(x) for k, x in equations.generalise(links, load).items()}
    value: Any = force.value
    square = dot(value, value) if isinstance(value, Vec) else value * value
    size = maximum(graph.sqrt(square), graph.constant(SMALLEST))
    line = tuple(links.number(f"forces.{force.name}.{key}") if factor.kinks else links.zero for key in ("level", "slope"))
    along = graph.total(x * links.rate(k) for k, x in entries.items()) / size if factor.share != 1.0 else links.zero
    share = _factor(factor, links.time, (line[0], line[1]), along)
    return {k: x * share for k, x in entries.items()}


def _factor(factor: Factor, time: Node, line: tuple[Node, Node], along: Node) -> Node:
    """Return the factor of a force at a time, from level and slope of its line there and the speed along the force."""
    graph = time.graph
    if factor.wave:
        of_time = graph.sin(time * factor.wave.turning + factor.wave.phase)
    elif factor.lines == (STEADY,):
        of_time = graph.constant(1.0)
    else:
        of_time = graph.add(line[0], line[1] * time)
    if factor.share == 1.0:
        return of_time
    return of_time * (tanh(graph, along * (1 / factor.speed)) * ((1 - factor.share) / 2) + (1 + factor.share) / 2)


def tanh(graph: ExpressionGraph, x: Node) -> Node:
    """Return the hyperbolic tangent with an absolute error at rounding level."""
    y = minimum(maximum(x, graph.constant(-FLAT)), graph.constant(FLAT)) * (2.0 / 2**DOUBLINGS)
    u = _series(graph, y, [1 / factorial(k) for k in range(1, TERMS + 1)]) * y
    for _ in range(DOUBLINGS):
        u = u * (u + 2.0)
    return graph.mul(u, graph.inverse(u + 2.0))


def _series(graph: ExpressionGraph, y: Node, coefficients: Sequence[float]) -> Node:
    total = graph.constant(coefficients[-1])
    for x in reversed(coefficients[:-1]):
        total = total * y + x
    return total


def energy(links: Links) -> Node:
    """Kinetic plus potential energy."""
    terms: list[Node] = []
    for i, link in enumerate(links.mechanism.links):
        mass, inertia = links.number(f"links.{link.name}.mass"), links.number(f"links.{link.name}.inertia")
        frame = links.frame(i)
        gravity = Vec(links.number("gravity.x"), links.number("gravity.y"))
        omega = links.rate(angle_slot(i))
        terms += [mass * 0.5 * dot(frame.u, frame.u), inertia * 0.5 * (omega * omega)]
        terms.append(-(mass * dot(gravity, frame.z)))
    held = (links.graph.node(equations.energies(links, load)[0]) for load in links.loads())
    return links.graph.total([*terms, *held])
