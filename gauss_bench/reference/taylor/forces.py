"""Applied forces on links as forces of the world: for each link a force through its centre of mass and a moment about it.

A force F at a link-fixed point with arm r counts as F and r x F. What acts along an axis of another link acts on that link with the
opposite force on the same line. The derivation shares nothing with `mechanism/coordinates.py` and the lowering of forces to it, on
purpose: each kind is derived here a second time, or not certified. It works for symbols too.

    spring        on the second point: F = -(k (L - rest) + c L') d / L,    d from the first to the second,  L L' = d . d'
    axis spring   x = u . d,  x' = u . d' + omega u x d,                    F = (k (rest - x) - c x') u
    slide         F = -c s' u on the block
"""

from collections.abc import Callable, Mapping
from typing import Any

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
from gauss_bench.mechanism.numbers import direction
from gauss_bench.reference.taylor.arithmetic import Value, Vector, add, cross, div, dot, mul, neg, plus, scale_by, sub
from gauss_bench.reference.taylor.moving_vectors import Instant
from gauss_bench.reference.taylor.vector_sums import NONE, LoopCoordinates, Sum, merge

KNOWN = (Torque, PointForce, SpringDamper, AxisSpringDamper, RotationalSpringDamper, JointDamping)


class Loads:
    """Forces (vector) and moments (value) on all links at an instant with rates v."""

    def __init__(self, coordinates: LoopCoordinates, at: Instant, v: Mapping[int, Value]):
        self.coordinates = coordinates
        self.at, self.v = at, v
        self.rate = at.variation(v)
        self.of = at.arithmetic.of
        links = coordinates.mechanism.links
        g = coordinates.mechanism.gravity
        self.force: list[Vector] = [(self.of(link.mass * g[0]), self.of(link.mass * g[1])) for link in links]
        self.moment: list[Value] = [0] * len(links)
        for f in coordinates.mechanism.forces:
            self._apply(f)

    def _speed(self, link: int) -> Value:
        """Angular speed of a link."""
        return 0 if link == GROUND else self.v.get(self.coordinates.angle[link], 0)

    def _turn(self, a: int, b: int) -> Value:
        """Angle of link b less that of link a, unwrapped."""
        parts = []
        for link in (b, a):
            if link == GROUND:
                parts.append(0)
                continue
            index = self.coordinates.angle[link]
            turn = self.of(self.coordinates.turn[link])
            parts.append(turn if index == NONE else add(self.at.x[index], turn))
        return sub(*parts)

    def _value(self, terms: Sum) -> Vector:
        return self.at.combined(terms, self.at)

    def _twist(self, link: int, torque: Value) -> None:
        if link != GROUND:
            self.moment[link] = add(self.moment[link], torque)

    def _push(self, link: int, arm: Sum, force: Vector) -> None:
        """A force on a link, with its arm from the centre of mass."""
        if link != GROUND:
            self.force[link] = plus(self.force[link], force)
            self._twist(link, cross(self._value(arm), force))

    def _at(self, point: Point, force: Vector) -> None:
        self._push(point.link, self.coordinates.turned(point.local, point.link), force)

    def _from(self, a: Point, b: Point) -> Sum:
        return merge(self.coordinates.point(b), self.coordinates.point(a))

    def _apply(self, f: Force) -> None:
        match f:
            case Torque():
                self._twist(f.link, self.of(f.value))
                self._twist(f.reaction, self.of(-f.value))
            case PointForce():
                self._at(f.point, self._value(self.coordinates.turned(f.value, f.frame)))
            case SpringDamper():
                self._spring(f)
            case AxisSpringDamper():
                self._along(f.point, f.origin, f.angle, lambda x, rate: self._linear(f.k, f.c, f.rest, x, rate))
            case RotationalSpringDamper():
                speed = sub(self._speed(f.b), self._speed(f.a))
                torque = self._linear(f.k, f.c, f.rest, self._turn(f.a, f.b), speed)
                self._twist(f.b, torque)
                self._twist(f.a, neg(torque))
            case JointDamping():
                for pair in f.pairs:
                    self._damp(pair, f.c)
            case _:
                raise TypeError(f"force {f.name}: the kind {type(f).__name__} has no derivation here")

    def _linear(self, k: Any, c: Any, rest: Any, x: Value, rate: Value) -> Value:
        return sub(mul(self.of(k), sub(self.of(rest), x)), mul(self.of(c), rate))

    def _spring(self, f: SpringDamper) -> None:
        gap = self._from(f.a, f.b)
        d = self._value(gap)
        square = dot(d, d)
        pull = self.of(f.k)
        if f.rest != 0 and f.k != 0:
            pull = sub(pull, div(self.of(f.k * f.rest), self.at.arithmetic.sqrt(square)))
        if f.c != 0:
            pull = add(pull, div(mul(self.of(f.c), dot(d, self.at.combined(gap, self.rate))), square))
        force = scale_by(pull, d)
        self._at(f.a, force)
        self._at(f.b, (neg(force[0]), neg(force[1])))

    def _along(self, point: Point, origin: Point, angle: Any, law: Callable[[Value, Value], Value]) -> None:
        """A force `law(x, x')` on a point along an axis of the origin's link, the opposite one on that link in the same line."""
        gap = self._from(origin, point)
        u = self._value(self.coordinates.turned(direction(angle), origin.link))
        d, rate = self._value(gap), self.at.combined(gap, self.rate)
        turning = mul(self._speed(origin.link), cross(u, d))
        force = scale_by(law(dot(u, d), add(dot(u, rate), turning)), u)
        self._at(point, force)
        if origin.link != GROUND:
            arm = merge(self.coordinates.point(point), self.coordinates.centres[origin.link])
            self._push(origin.link, arm, (neg(force[0]), neg(force[1])))

    def _damp(self, pair: Joint, c: Any) -> None:
        if isinstance(pair, Prismatic):
            speed = self.v.get(self.coordinates.slides[pair.name], 0)
            self._along(pair.block, pair.guide, pair.angle, lambda x, rate: neg(mul(self.of(c), speed)))
            return
        torque = neg(mul(self.of(c), sub(self._speed(pair.b.link), self._speed(pair.a.link))))
        self._twist(pair.b.link, torque)
        self._twist(pair.a.link, neg(torque))
