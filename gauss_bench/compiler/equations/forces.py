"""Applied forces and their energy as expressions: force laws on coordinates, and forces at points, as in `mechanism/equations.py`.

The force of a spring with a rest length is not finite where its two points coincide; the evaluation in numpy returns zero there.

A force that varies is a steady force times a time factor and a direction factor (`mechanism/motion_laws.py`). The time factor is a
sine, or a straight line level + slope t, whose level and slope are parameters that are set at run time (`mechanism/lines.py`). The
direction factor differs between motion along the force and motion against it, with a smooth transition by the hyperbolic tangent of
x, the speed along the force divided by the width of the transition:

    tanh(x) = u / (u + 2),    u = exp(2 x) - 1

A short series gives u = exp(y) - 1 at y = 2 x / 2^D, with D = DOUBLINGS. Then the identity exp(2 y) - 1 = u (u + 2) doubles the
argument y; after D doublings y = 2 x. Beyond |x| = FLAT the hyperbolic tangent equals 1 or -1 to rounding, and x is limited to that
range.
"""

from collections.abc import Iterable
from math import factorial
from typing import Any

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.expressions.node import ExpressionGraph, Node, maximum, minimum
from gauss_bench.mechanism import equations
from gauss_bench.mechanism.model import PointForce, Torque
from gauss_bench.mechanism.motion_laws import STEADY, Factor
from gauss_bench.mechanism.spaces import Vec, angle_slot, dot, slots

FLAT = 20.0  # |x| from which on |tanh(x)| is 1 to rounding
DOUBLINGS, TERMS = 8, 11  # |y| <= 2 FLAT / 2^8 = 0.16: the next term y^12 / 12! is 4e-19, far below rounding
SMALLEST = 1e-300  # [N, N m] smallest divisor, used in place of a force of size zero


def generalised_force(links: Links) -> dict[int, Node]:
    """Return the generalised force Q of weights and forces: index of a coordinate -> node; entries that are zero are left out."""
    terms: dict[int, list[Node]] = {}
    steady = (equations.generalise(links, load) for load in links.loads())
    varying = (_generalise_varying(links, *force) for force in links.varying())
    for entries in (*_weights(links), *steady, *varying):
        for k, x in entries.items():
            terms.setdefault(k, []).append(links.graph.node(x))
    sums = {k: links.graph.total(x) for k, x in terms.items()}
    return {k: x for k, x in sums.items() if not x.is_zero}


def _weights(links: Links) -> Iterable[dict[int, Node]]:
    """Yield the generalised force of every link's weight: index of a coordinate -> node."""
    for i, link in enumerate(links.mechanism.links):
        mass = links.number(f"links.{link.name}.mass")
        x = slots(i).start  # index of the link's coordinate x; that of y is the next
        yield {x: mass * links.number("gravity.x"), x + 1: mass * links.number("gravity.y")}


def _generalise_varying(links: Links, force: Torque | PointForce, factor: Factor) -> dict[int, Node]:
    """Return the generalised force of a force that varies: index of a coordinate -> node.

    The result is Q f(t) d(w): Q belongs to the steady force, f is the time factor, w the speed along the force. d is 1 for motion
    along the force and `factor.share` for motion against it, with a smooth transition of the width `factor.speed`.
    """
    (load,) = force.to_loads()
    graph = links.graph
    entries = {k: graph.node(x) for k, x in equations.generalise(links, load).items()}
    value: Any = force.value
    square = dot(value, value) if isinstance(value, Vec) else value * value
    size = maximum(graph.sqrt(square), graph.constant(SMALLEST))  # magnitude of the steady force
    # only piecewise linear factors with kinks have level and slope as parameters of the program
    level, slope = (links.number(f"forces.{force.name}.{key}") if factor.kinks else links.zero for key in ("level", "slope"))
    depends_on_direction = factor.share != 1.0
    speed = links.zero
    if depends_on_direction:  # the speed along a force is the power of the force divided by its magnitude
        speed = graph.total(x * links.rate(k) for k, x in entries.items()) / size
    if factor.wave:
        scale = graph.sin(links.time * factor.wave.turning + factor.wave.phase)
    elif factor.lines == (STEADY,):
        scale = graph.constant(1.0)
    else:
        scale = level + slope * links.time
    # d = (1 + share) / 2 + (1 - share) / 2 tanh(w / speed): 1 where tanh is 1 (motion along the force), `share` where it is -1
    if depends_on_direction:
        scale = scale * (tanh(graph, speed * (1 / factor.speed)) * ((1 - factor.share) / 2) + (1 + factor.share) / 2)
    return {k: x * scale for k, x in entries.items()}


def tanh(graph: ExpressionGraph, x: Node) -> Node:
    """Return the hyperbolic tangent of x by the formulas in the module's docstring, with an absolute error at rounding level."""
    y = minimum(maximum(x, graph.constant(-FLAT)), graph.constant(FLAT)) * (2.0 / 2**DOUBLINGS)
    series = graph.constant(1 / factorial(TERMS))  # of (exp(y) - 1) / y, by Horner's scheme
    for k in range(TERMS - 1, 0, -1):
        series = series * y + 1 / factorial(k)
    u: Node = series * y  # exp(y) - 1
    for _ in range(DOUBLINGS):
        u = u * (u + 2.0)  # exp(2 y) - 1 from u = exp(y) - 1
    return u / (u + 2.0)


def energy(links: Links) -> Node:
    """Return kinetic plus potential energy [J]; forces that vary with time or direction have no potential and are left out."""
    terms: list[Node] = []
    for i, link in enumerate(links.mechanism.links):
        mass, inertia = links.number(f"links.{link.name}.mass"), links.number(f"links.{link.name}.inertia")
        frame = links.frame(i)  # position z and velocity u of the centre of mass
        gravity = Vec(links.number("gravity.x"), links.number("gravity.y"))
        omega = links.rate(angle_slot(i))
        terms += [mass * 0.5 * dot(frame.u, frame.u), inertia * 0.5 * (omega * omega)]
        terms.append(-(mass * dot(gravity, frame.z)))
    # `energies` returns the potential energy, and the power of forces without a potential
    potentials = (links.graph.node(equations.energies(links, load)[0]) for load in links.loads())
    return links.graph.total([*terms, *potentials])
