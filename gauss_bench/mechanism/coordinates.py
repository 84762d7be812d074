"""Scalar coordinates of a linkage, defined once: the angle between two links, the way along an axis, the distance of two points.

Forces act on them, drivers prescribe them, slides hold them. A vector of the plane is a complex number here, so that i turns it
by a quarter and conj(n) g = n . g + i n x g is the vector g as it is seen along and across a direction n. With z and u position
and velocity of a link's centre of mass, omega its angular speed, and r the arm of one of its points in world axes:

    p = z + r,    p' = u + i omega r,    p'' = z'' + i r alpha - r omega^2

    Angle       x = theta_b - theta_a
    Along       x = n . (p - o),   n a direction that turns with the link of the origin o
    Distance    x = |p_b - p_a|
    Slip        x' = n . p',       n a direction that turns with the link of p itself; there is no x (a knife edge holds it)

Every coordinate has a gradient G, given by its entries, and a bias, the acceleration's terms in the velocities:

    x' = G v,    x'' = G a + bias

Numbers may be of any kind. A real number has + - *, a vector these and `conj()`, `real`, `imag`, its products with vectors and real
numbers being those of complex numbers. Arrays of numpy are both, in double or longer, for one state or many; so are the expressions
of the compiler, whose zeros vanish by structure: what rests on the ground costs nothing. Only a distance needs a root.

Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), sections 3.3 and 3.6. `reference/taylor`
derives all of this anew and in another way, and must not use what stands here: a certificate is worth what it does not share.
"""

from functools import cached_property
from typing import Any, NamedTuple, Protocol, assert_never

import numpy as np

from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Distance, Point
from gauss_bench.terms import Array

Real = Any  # an array (...), or an expression
Vector = Any  # a complex array (...), or a vector of expressions
Column = tuple[int, int]  # link and axis (x, y, theta) of a coordinate of the state


class End(NamedTuple):
    """A link-fixed point in motion: its link's centre of mass, the velocity of that, the link's angular speed, the point's arm."""

    z: Vector
    u: Vector
    omega: Real
    r: Vector


class Arithmetic(Protocol):
    """What numbers cannot do by operators."""

    def sqrt(self, x: Real, /) -> Real: ...
    def inverse(self, x: Real, /) -> Real: ...


class Placement(Protocol):
    """The links of a mechanism at a state; the ground rests at the origin."""

    @property
    def arithmetic(self) -> Arithmetic: ...
    def angle(self, link: int, /) -> Real: ...
    def omega(self, link: int, /) -> Real: ...
    def end(self, point: Point, /) -> End: ...
    def direction(self, link: int, angle: float, /) -> Vector:
        """Unit vector at an angle [rad] of a link's frame, in world axes."""
        ...


class AngleState:
    """The angle between two links at a state, unwrapped, from the angles and angular speeds of both."""

    entries: tuple[Real, ...] = (-1.0, 1.0)  # of theta_a and theta_b
    bias: Real = 0.0

    def __init__(self, thetas: tuple[Real, Real], omegas: tuple[Real, Real]):
        self.value = thetas[1] - thetas[0]
        self.rate = omegas[1] - omegas[0]


class _Pair:
    """Two ends a, b as seen along (`real`) and across (`imag`) a direction n: their arms, the relative velocity of the centres."""

    def __init__(self, n: Vector, a: End, b: End):
        self.n, self.a, self.b = n, a, b
        self.towards = n.conj()
        self.a_arm, self.b_arm = self.towards * a.r, self.towards * b.r
        self.slip = self.towards * (b.u - a.u)


class AlongState(_Pair):
    """The way of b along an axis from a at a state; n is the axis, a unit vector that turns with a's link.

    `entries` belong to x, y, theta of a's link, then of b's. Where the value is known to be another expression, as on a
    constraint, it may be given: the bias is then written with it.
    """

    def __init__(self, n: Vector, a: End, b: End, known: Real = None):
        super().__init__(n, a, b)
        self.centres = self.towards * (b.z - a.z)
        self.known = known

    @property
    def value(self) -> Real:
        return self.centres.real + (self.b_arm - self.a_arm).real

    @property
    def entries(self) -> tuple[Real, ...]:
        x, y = self.n.real, self.n.imag
        return -x, -y, (self.centres + self.b_arm).imag, x, y, -self.b_arm.imag

    @property
    def rate(self) -> Real:
        return self.slip.real + self.a.omega * (self.centres + self.b_arm).imag - self.b.omega * self.b_arm.imag

    @property
    def bias(self) -> Real:
        """In axes that turn with a: Coriolis' and the centrifugal term of b's centre, and what b's link turns relative to them."""
        omega, relative = self.a.omega, self.b.omega - self.a.omega
        ahead = self.centres.real if self.known is None else self.known - (self.b_arm - self.a_arm).real
        return omega * (self.slip.imag * 2.0 - omega * ahead) - relative * relative * self.b_arm.real


class DistanceState(_Pair):
    """The distance of a and b at a state; n is the way from a to b, not of unit length.

    `entries` belong to x, y, theta of a's link, then of b's; `half_square_entries` are those of x^2 / 2, which need no root.
    Where the distance is known to be another expression, as on a constraint, it may be given.
    """

    def __init__(self, a: End, b: End, arithmetic: Arithmetic, known: Real = None):
        super().__init__(b.z + b.r - a.z - a.r, a, b)
        self.arithmetic, self.known = arithmetic, known

    @cached_property
    def square(self) -> Real:
        return self.n.real * self.n.real + self.n.imag * self.n.imag

    @cached_property
    def value(self) -> Real:
        return self.arithmetic.sqrt(self.square)

    @cached_property
    def inverse(self) -> Real:
        return self.arithmetic.inverse(self.value if self.known is None else self.known)

    @property
    def half_square_entries(self) -> tuple[Real, ...]:
        x, y = self.n.real, self.n.imag
        return -x, -y, self.a_arm.imag, x, y, -self.b_arm.imag

    @property
    def half_square_rate(self) -> Real:
        return self.slip.real + self.a.omega * self.a_arm.imag - self.b.omega * self.b_arm.imag

    @property
    def entries(self) -> tuple[Real, ...]:
        return tuple(x * self.inverse for x in self.half_square_entries)

    @property
    def rate(self) -> Real:
        return self.half_square_rate * self.inverse

    @property
    def bias(self) -> Real:
        a, b = self.a.omega, self.b.omega
        across = (self.slip.imag + b * self.b_arm.real - a * self.a_arm.real) * self.inverse
        return (a * a * self.a_arm.real - b * b * self.b_arm.real + across * across) * self.inverse


class SlipState:
    """The speed of a point along a direction n that turns with its own link; `entries` belong to x, y, theta of the link."""

    def __init__(self, n: Vector, end: End):
        self.n, self.end, self.towards = n, end, n.conj()
        self.arm, self.speed = self.towards * end.r, self.towards * end.u

    @property
    def entries(self) -> tuple[Real, ...]:
        return self.n.real, self.n.imag, -self.arm.imag

    @property
    def rate(self) -> Real:
        return self.speed.real - self.end.omega * self.arm.imag

    @property
    def bias(self) -> Real:
        return self.end.omega * self.speed.imag


State = AngleState | AlongState | DistanceState


def state(coordinate: Coordinate, at: Placement, known: Real = None) -> State:
    """A coordinate at a state of the linkage; `known` is what its value is known to be, if anything."""
    match coordinate:
        case Angle(a, b):
            return AngleState((at.angle(a), at.angle(b)), (at.omega(a), at.omega(b)))
        case Along(origin, point, angle):
            return AlongState(at.direction(origin.link, angle), at.end(origin), at.end(point), known)
        case Distance(a, b):
            return DistanceState(at.end(a), at.end(b), at.arithmetic, known)
        case _:
            assert_never(coordinate)


def columns(coordinate: Coordinate) -> tuple[Column, ...]:
    """What the entries of a coordinate belong to; those of the ground are to be left out."""
    match coordinate:
        case Angle(a, b):
            return (a, 2), (b, 2)
        case Along(a, b) | Distance(a, b):
            return tuple((end.link, axis) for end in (a, b) for axis in range(3))
        case _:
            assert_never(coordinate)


class _ArrayArithmetic:
    """Of arrays. The inverse of zero is zero: two points that coincide have a distance without a direction."""

    sqrt = staticmethod(np.sqrt)

    @staticmethod
    def inverse(x: Array) -> Array:
        zero = np.equal(x, 0.0)
        return np.where(zero, 0.0, 1.0 / np.where(zero, 1.0, x)) if zero.any() else 1.0 / x


ARRAYS = _ArrayArithmetic()


class Placed:
    """The links of a mechanism at state(s) q, v (..., n), as arrays; at rest where v is not given."""

    arithmetic = ARRAYS

    def __init__(self, q: Array, v: Array | None = None):
        self.q, self.v = q, np.zeros_like(q) if v is None else v
        self.still = np.zeros(q.shape[:-1], dtype=q.dtype)

    def angle(self, link: int) -> Array:
        return self.still if link == GROUND else self.q[..., 3 * link + 2]

    def omega(self, link: int) -> Array:
        return self.still if link == GROUND else self.v[..., 3 * link + 2]

    def _centre(self, x: Array, link: int) -> Vector:
        return self.still + 0j if link == GROUND else x[..., 3 * link] + 1j * x[..., 3 * link + 1]

    def rotated(self, link: int, local: Array) -> Vector:
        fixed = local[0] + 1j * local[1]
        return fixed + 0j * self.still if link == GROUND else np.exp(1j * self.angle(link)) * fixed

    def end(self, point: Point) -> End:
        link = point.link
        return End(self._centre(self.q, link), self._centre(self.v, link), self.omega(link), self.rotated(link, point.local))

    def direction(self, link: int, angle: float) -> Vector:
        return self.rotated(link, np.array([np.cos(angle), np.sin(angle)]))


def value(coordinate: Coordinate, q: Array) -> Array:
    """Value (...) [rad or m] at state(s) q (..., n)."""
    return np.asarray(state(coordinate, Placed(q)).value)


def rate(coordinate: Coordinate, q: Array, v: Array) -> Array:
    """Rate (...) [rad/s or m/s] at state(s) q, v (..., n)."""
    return np.asarray(state(coordinate, Placed(q, v)).rate)


def gradient(coordinate: Coordinate, q: Array) -> Array:
    """G (..., n) at state(s) q (..., n)."""
    G = np.zeros_like(q)
    for (link, axis), entry in zip(columns(coordinate), state(coordinate, Placed(q)).entries, strict=True):
        if link != GROUND:
            G[..., 3 * link + axis] += entry
    return G


def bias(coordinate: Coordinate, q: Array, v: Array) -> Array:
    """What the velocities add to the second rate (...) [rad/s^2 or m/s^2] at state(s) q, v (..., n)."""
    return np.asarray(state(coordinate, Placed(q, v)).bias) + np.zeros(q.shape[:-1], dtype=q.dtype)
