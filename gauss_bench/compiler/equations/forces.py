"""Applied forces and potential energy as expressions: laws on scalar coordinates and forces at points, as in `mechanism/forces.py`.

Where two points coincide a spring with a rest length is not finite (the linkage's own evaluation takes no direction there).
"""

from collections.abc import Iterable
from typing import assert_never

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.expressions.node import Node, Vector
from gauss_bench.mechanism import coordinates
from gauss_bench.mechanism.model import GROUND, Law, Load, PointForce


def generalised_force(links: Links) -> dict[int, Node]:
    """Q by coordinate; what is missing is zero."""
    terms: dict[int, list[Node]] = {}
    for entries in (*_weights(links), *(_entries(links, load) for load in links.loads())):
        for k, x in entries.items():
            terms.setdefault(k, []).append(x)
    sums = {k: links.graph.total(x) for k, x in terms.items()}
    return {k: x for k, x in sums.items() if not x.zero}


def _weights(links: Links) -> Iterable[dict[int, Node]]:
    for i, link in enumerate(links.mechanism.links):
        mass = links.number(f"links.{link.name}.mass")
        yield links.entries([(i, 0), (i, 1)], [mass * links.number(f"gravity.{axis}") for axis in "xy"])


def _entries(links: Links, load: Load) -> dict[int, Node]:
    """The generalised force of one load."""
    match load:
        case Law():
            x = coordinates.state(load.coordinate, links)
            return links.entries(coordinates.columns(load.coordinate), coordinates.push(x, load))
        case PointForce():
            force, arm = _world(links, load), links.end(load.point).r
            return links.entries([(load.point.link, axis) for axis in range(3)], (force.x, force.y, arm.cross(force)))
        case _:
            assert_never(load)


def _world(links: Links, force: PointForce) -> Vector:
    """A force at a point in world axes; its numbers are nodes."""
    return links.rotated(force.frame, force.value)  # type: ignore[arg-type]


def energy(links: Links) -> Node:
    """Kinetic plus potential energy."""
    terms: list[Node] = []
    for i, link in enumerate(links.mechanism.links):
        mass, inertia = links.number(f"links.{link.name}.mass"), links.number(f"links.{link.name}.inertia")
        u, omega = links.centre_velocity(i), links.rate(3 * i + 2)
        gravity = Vector(links.number("gravity.x"), links.number("gravity.y"))
        terms += [mass * 0.5 * u.dot(u), inertia * 0.5 * (omega * omega), -(mass * gravity.dot(links.centre(i)))]
    return links.graph.total([*terms, *(_potential(links, load) for load in links.loads())])


def _potential(links: Links, load: Load) -> Node:
    match load:
        case Law():
            return links.graph.node(coordinates.energy(coordinates.state(load.coordinate, links), load))
        case PointForce():
            return -_world(links, load).dot(links.position(load.point)) if load.frame == GROUND else links.zero
        case _:
            assert_never(load)
