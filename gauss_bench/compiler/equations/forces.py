"""Applied forces and potential energy as expressions; laws and signs as in `mechanism/forces.py`.

A spring's pull along the line d of two points, |d| = L, needs its direction and length only together:

    d (k (L - rest) + c L') / L = d (k - k rest / L + c (d . d') / L^2)

so that a spring without rest length has no root, and one that is undamped besides has no division. Where the points coincide a
spring with a root is not finite (the linkage's own evaluation takes no direction there).
"""

from dataclasses import dataclass, field
from typing import assert_never

from gauss_bench.compiler.equations.links import Links
from gauss_bench.compiler.expressions.node import Node, Vector
from gauss_bench.mechanism.model import (
    GROUND,
    AxisSpringDamper,
    Force,
    Joint,
    JointDamping,
    Point,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)


@dataclass(frozen=True, eq=False)
class Loads:
    """Summands of the generalised force by coordinate."""

    links: Links
    terms: dict[int, list[Node]] = field(default_factory=dict)

    def add(self, link: int, axis: int, value: Node) -> None:
        if link != GROUND and not value.zero:
            self.terms.setdefault(3 * link + axis, []).append(value)

    def force(self, point: Point, force: Vector) -> None:
        self.add(point.link, 0, force.x)
        self.add(point.link, 1, force.y)
        self.add(point.link, 2, self.links.arm(point).cross(force))

    def torque(self, link: int, torque: Node) -> None:
        self.add(link, 2, torque)

    def along(self, point: Point, origin: Point, axis: Vector, force: Node) -> None:
        """A force along an axis on `point`, the opposite one on the origin's link along the same line."""
        push = axis * force
        self.force(point, push)
        if origin.link != GROUND:
            self.force(origin, -push)
            gap = self.links.position(point) - self.links.position(origin)
            self.torque(origin.link, -gap.cross(push))

    def sums(self) -> dict[int, Node]:
        sums = {k: self.links.graph.total(terms) for k, terms in self.terms.items()}
        return {k: x for k, x in sums.items() if not x.zero}


def generalised_force(links: Links) -> dict[int, Node]:
    """Q by coordinate; what is missing is zero."""
    loads = Loads(links)
    for i, link in enumerate(links.mechanism.links):
        mass = links.number(f"links.{link.name}.mass")
        for axis, name in enumerate("xy"):
            loads.add(i, axis, mass * links.number(f"gravity.{name}"))
    for force in links.mechanism.forces:
        _apply(loads, links, force)
    return loads.sums()


def _apply(loads: Loads, links: Links, force: Force) -> None:
    def number(key: str) -> Node:
        return links.number(f"forces.{force.name}.{key}")

    match force:
        case Torque():
            loads.torque(force.link, number("value"))
            loads.torque(force.reaction, -number("value"))
        case PointForce():
            loads.force(force.point, links.rotated(force.frame, Vector(number("value.x"), number("value.y"))))
        case SpringDamper():
            pull = _pull(links, force.a, force.b, number("k"), number("c"), number("rest"))
            loads.force(force.a, pull)
            loads.force(force.b, -pull)
        case AxisSpringDamper():
            x, rate, axis = axis_state(links, force.point, force.origin, float(force.angle))
            loads.along(force.point, force.origin, axis, number("k") * (number("rest") - x) - number("c") * rate)
        case RotationalSpringDamper():
            turn = links.angle(force.b) - links.angle(force.a) - number("rest")
            torque = number("k") * turn + number("c") * (links.omega(force.b) - links.omega(force.a))
            loads.torque(force.b, -torque)
            loads.torque(force.a, torque)
        case JointDamping():
            for pair in force.pairs:
                _damp(loads, links, pair, number("c"))
        case _:
            assert_never(force)


def _pull(links: Links, a: Point, b: Point, k: Node, c: Node, rest: Node) -> Vector:
    """Force of a spring-damper on a; b gets the opposite one."""
    gap = links.position(b) - links.position(a)
    per_square = links.graph.inverse(gap.dot(gap))
    factors = [k]
    if not rest.zero:
        factors.append(-(k * rest * links.graph.sqrt(per_square)))
    if not c.zero:
        factors.append(c * gap.dot(links.velocity(b) - links.velocity(a)) * per_square)
    return gap * links.graph.total(factors)


def axis_state(links: Links, point: Point, origin: Point, theta: float) -> tuple[Node, Node, Vector]:
    """Coordinate, rate and direction of a point along an axis fixed in the origin's link."""
    axis = links.direction(origin.link, theta)
    gap = links.position(point) - links.position(origin)
    gap_rate = links.velocity(point) - links.velocity(origin)
    return axis.dot(gap), axis.dot(gap_rate) + links.omega(origin.link) * axis.cross(gap), axis


def _damp(loads: Loads, links: Links, pair: Joint, c: Node) -> None:
    if isinstance(pair, Prismatic):
        _, rate, axis = axis_state(links, pair.block, pair.guide, float(pair.angle))
        loads.along(pair.block, pair.guide, axis, -(c * rate))
    else:
        torque = c * (links.omega(pair.b.link) - links.omega(pair.a.link))
        loads.torque(pair.b.link, -torque)
        loads.torque(pair.a.link, torque)


def energy(links: Links) -> Node:
    """Kinetic plus potential energy."""
    terms: list[Node] = []
    for i, link in enumerate(links.mechanism.links):
        mass, inertia = links.number(f"links.{link.name}.mass"), links.number(f"links.{link.name}.inertia")
        u, omega = links.centre_velocity(i), links.rate(3 * i + 2)
        gravity = Vector(links.number("gravity.x"), links.number("gravity.y"))
        terms += [mass * 0.5 * u.dot(u), inertia * 0.5 * (omega * omega), -(mass * gravity.dot(links.centre(i)))]
    return links.graph.total([*terms, *(_potential(links, force) for force in links.mechanism.forces)])


def _potential(links: Links, force: Force) -> Node:
    def number(key: str) -> Node:
        return links.number(f"forces.{force.name}.{key}")

    match force:
        case Torque():
            return -(number("value") * (links.angle(force.link) - links.angle(force.reaction)))
        case PointForce() if force.frame == GROUND:
            return -Vector(number("value.x"), number("value.y")).dot(links.position(force.point))
        case SpringDamper():
            gap = links.position(force.b) - links.position(force.a)
            return _spring_energy(number("k"), links.graph.sqrt(gap.dot(gap)) - number("rest"))
        case AxisSpringDamper():
            x, _, _ = axis_state(links, force.point, force.origin, float(force.angle))
            return _spring_energy(number("k"), x - number("rest"))
        case RotationalSpringDamper():
            return _spring_energy(number("k"), links.angle(force.b) - links.angle(force.a) - number("rest"))
        case PointForce() | JointDamping():
            return links.zero
        case _:
            assert_never(force)


def _spring_energy(k: Node, stretch: Node) -> Node:
    return k * 0.5 * (stretch * stretch)
