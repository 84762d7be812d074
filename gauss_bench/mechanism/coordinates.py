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

A force is a law on a coordinate (`Law`), which comes to a generalised force (`push`), a potential (`energy`) and a loss of power.

Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), sections 3.3 and 3.6. `reference/taylor`
derives all of this anew and in another way, and must not use what stands here: a certificate is worth what it does not share.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol, assert_never

import numpy as np
from numpy.typing import NDArray

from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Distance, Point
from gauss_bench.terms import Array

Real = Any  # an array (...), or an expression
Vector = Any  # a complex array (...), or a vector of expressions
Vectors = NDArray[np.complexfloating[Any, Any]]
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


class Turning(Protocol):
    """Angles and angular speeds of links, given by index or by whatever stands for one."""

    def angle(self, link: Any, /) -> Real: ...
    def omega(self, link: Any, /) -> Real: ...


class Placement(Turning, Protocol):
    """The links of a mechanism at a state; the ground rests at the origin."""

    @property
    def arithmetic(self) -> Arithmetic: ...
    def end(self, point: Point, /) -> End: ...
    def direction(self, link: int, angle: float, across: bool, /) -> Vector:
        """Unit vector at an angle [rad] of a link's frame in world axes, or where `across` the one a quarter turn on."""
        ...


class AngleState:
    """The angle between two links at a state, unwrapped."""

    entries: tuple[Real, ...] = (-1.0, 1.0)  # of theta_a and theta_b
    bias: Real = 0.0

    def __init__(self, at: "Turning", a: Any, b: Any):
        self.at, self.a, self.b = at, a, b

    @property
    def value(self) -> Real:
        return self.at.angle(self.b) - self.at.angle(self.a)

    @property
    def rate(self) -> Real:
        return self.at.omega(self.b) - self.at.omega(self.a)


class _Pair:
    """Two ends a, b as seen along (`real`) and across (`imag`) a direction n: their arms, the relative velocity of the centres."""

    def __init__(self, n: Vector, a: End, b: End):
        self.n, self.a, self.b = n, a, b
        self.towards = n.conj()
        self.a_arm, self.b_arm = self.towards * a.r, self.towards * b.r
        self.slip = self.towards * (b.u - a.u)


class AlongState(_Pair):
    """The way of b along an axis from a at a state; n is the axis, a unit vector that turns with a's link.

    `entries` belong to x, y, theta of a's link, then of b's.
    """

    def __init__(self, n: Vector, a: End, b: End):
        super().__init__(n, a, b)
        self.gap = self.towards * (b.z + b.r - (a.z + a.r))

    @property
    def value(self) -> Real:
        return self.gap.real

    @property
    def entries(self) -> tuple[Real, ...]:
        x, y = self.n.real, self.n.imag
        return -x, -y, (self.gap + self.a_arm).imag, x, y, -self.b_arm.imag

    @property
    def rate(self) -> Real:
        return self.slip.real + self.a.omega * (self.gap + self.a_arm).imag - self.b.omega * self.b_arm.imag

    @property
    def bias(self) -> Real:
        """In axes that turn with a: Coriolis' and the centrifugal term of b's centre, and what b's link turns relative to them."""
        omega, relative = self.a.omega, self.b.omega - self.a.omega
        ahead = self.value - (self.b_arm - self.a_arm).real
        return omega * (self.slip.imag * 2.0 - omega * ahead) - relative * relative * self.b_arm.real


class DistanceState(_Pair):
    """The distance of a and b at a state; n is the way from a to b, not of unit length.

    `entries` belong to x, y, theta of a's link, then of b's; `half_square_entries` are those of x^2 / 2, which need no root.
    Where the distance is known to be another expression, as on a constraint, it may be given.
    """

    def __init__(self, a: End, b: End, arithmetic: Arithmetic, known: Real = None):
        super().__init__(b.z + b.r - (a.z + a.r), a, b)
        self.arithmetic, self.known = arithmetic, known

    @cached_property
    def square(self) -> Real:
        return self.n.real * self.n.real + self.n.imag * self.n.imag

    @cached_property
    def value(self) -> Real:
        return self.arithmetic.sqrt(self.square)

    @cached_property
    def inverse_square(self) -> Real:
        return self.arithmetic.inverse(self.square if self.known is None else self.known * self.known)

    @cached_property
    def inverse(self) -> Real:
        return self.arithmetic.sqrt(self.inverse_square) if self.known is None else self.arithmetic.inverse(self.known)

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


class Linear(Protocol):
    """The numbers of a `Law`, of one or of many at once."""

    @property
    def k(self) -> Real: ...
    @property
    def c(self) -> Real: ...
    @property
    def rest(self) -> Real: ...
    @property
    def bias(self) -> Real: ...


def _absent(number: Real) -> bool:
    """Whether a number is zero by structure: the float zero, or an expression that says so."""
    return bool(number == 0.0) if isinstance(number, float) else getattr(number, "zero", False) is True


def _total(terms: Sequence[Real]) -> Real:
    return sum(terms[1:], start=terms[0]) if terms else 0.0


def strength(x: State, law: Linear) -> Real:
    """What pulls along a coordinate by a law: F, of which `entries` are the lever; of a distance F / x, by `half_square_entries`.

    With F grad x = (F / x) grad h and h = x^2 / 2 it is along a distance

        F / x = -k + (k rest + bias) / x - c h' / x^2

    so that a spring without rest length has no root, and one that is undamped besides no division. Through zero length such a
    spring goes on as it should; any other pulls from a direction that flips there, and at zero itself from none.
    """
    sprung, damped, biased = not _absent(law.k), not _absent(law.c), not _absent(law.bias)
    terms: list[Real] = []
    match x:
        case AngleState() | AlongState():
            if biased:
                terms.append(law.bias)
            if sprung:
                terms.append(-(law.k * x.value) if _absent(law.rest) else law.k * (law.rest - x.value))
            if damped:
                terms.append(-(law.c * x.rate))
        case DistanceState():
            if sprung:
                terms.append(-law.k)
            if sprung and not _absent(law.rest):
                terms.append(law.k * law.rest * x.inverse)
            if biased:
                terms.append(law.bias * x.inverse)
            if damped:
                terms.append(-(law.c * x.half_square_rate * x.inverse_square))
        case _:
            assert_never(x)
    return _total(terms)


def push(x: State, law: Linear) -> tuple[Real, ...]:
    """The generalised force of a law along a coordinate, by the coordinate's entries."""
    force = strength(x, law)
    return tuple(force * entry for entry in (x.half_square_entries if isinstance(x, DistanceState) else x.entries))


def energy(x: State, law: Linear) -> Real:
    """Potential energy of a law [J]."""
    terms: list[Real] = []
    if not _absent(law.k):
        if isinstance(x, DistanceState) and _absent(law.rest):
            terms.append(law.k * 0.5 * x.square)
        else:
            stretch = x.value if _absent(law.rest) else x.value - law.rest
            terms.append(law.k * 0.5 * (stretch * stretch))
    if not _absent(law.bias):
        terms.append(-(law.bias * x.value))
    return _total(terms)


def loss(x: State, law: Linear) -> Real:
    """Power that the damping of a law takes [W]."""
    return 0.0 if _absent(law.c) else law.c * (x.rate * x.rate)


def state(coordinate: Coordinate, at: Placement, known: Real = None) -> State:
    """A coordinate at a state of the linkage; `known` is what a distance is known to be, if anything."""
    match coordinate:
        case Angle(a, b):
            return AngleState(at, a, b)
        case Along(origin, point, angle, across):
            return AlongState(at.direction(origin.link, angle, across), at.end(origin), at.end(point))
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


def unit(angle: float, across: bool = False) -> Array:
    """Unit vector (2,) at an angle [rad], or where `across` the one a quarter turn on."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([-s, c] if across else [c, s])


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

    def direction(self, link: int, angle: float, across: bool = False) -> Vector:
        return self.rotated(link, unit(angle, across))


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


class Stack:
    """Link-fixed points and directions of one mechanism in one list, so that one rotation serves them all.

    The ground is one more link, which rests; a state of n coordinates has n + 3 columns with it.
    """

    def __init__(self, links: int):
        self.ground = links
        self._links: list[int] = []
        self._local: list[Array] = []

    def index(self, link: int) -> int:
        return self.ground if link == GROUND else link

    def points(self, points: Sequence[Point]) -> slice:
        return self.vectors([p.link for p in points], [p.local for p in points])

    def directions(self, lines: Sequence[tuple[int, float, bool]]) -> slice:
        """Directions given by link, angle [rad] and `across`, as in `unit`."""
        return self.vectors([link for link, _, _ in lines], [unit(angle, across) for _, angle, across in lines])

    def vectors(self, links: Sequence[int], local: Sequence[Array]) -> slice:
        """Any vectors (2,) fixed in links."""
        first = len(self._links)
        self._links += [self.index(link) for link in links]
        self._local += local
        return slice(first, len(self._links))

    def close(self) -> None:
        """Nothing is added any more."""
        self.links = np.array(self._links, dtype=int)
        self.arms = np.array(self._local).reshape(-1, 2) @ [1.0, 1.0j]

    def at(self, q: Array, v: Array) -> "Stacked":
        return Stacked(self, q, v)


class Stacked:
    """A stack at state(s) q, v (..., n), numbers of type `dtype`."""

    def __init__(self, stack: Stack, q: Array, v: Array):
        z, self.thetas = _unpacked(q)
        u, self.omegas = _unpacked(v)
        links = stack.links
        r = np.exp(1j * self.thetas)[..., links] * stack.arms
        self.dtype = r.real.dtype
        self.all = End(z[..., links], u[..., links], self.omegas[..., links], r)

    def angle(self, links: NDArray[np.intp]) -> Array:
        return self.thetas[..., links]

    def omega(self, links: NDArray[np.intp]) -> Array:
        return self.omegas[..., links]

    def ends(self, which: slice) -> End:
        z, u, omega, r = self.all
        return End(z[..., which], u[..., which], omega[..., which], r[..., which])

    def directions(self, which: slice) -> Vector:
        return self.all.r[..., which]


def _unpacked(x: Array) -> tuple[Vectors, Array]:
    """Vector and angle (..., links + 1) of a state (..., n), with a resting ground appended."""
    links = x.shape[-1] // 3
    out = np.zeros((*x.shape[:-1], links + 1, 3), dtype=x.dtype)
    out[..., :-1, :] = x.reshape(*x.shape[:-1], links, 3)
    return out[..., 0] + 1j * out[..., 1], out[..., 2]


class Group(NamedTuple):
    """The coordinates of one kind among many.

    Attributes:
        which: (k,) their places among the many.
        constant: whether their gradients never change; the entries are those of an AngleState.
        columns: for each entry the columns (k,) it belongs to, the ground's being the last three.
        at: all of them at a state, with values (..., k).
    """

    which: NDArray[np.intp]
    constant: bool
    columns: tuple[NDArray[np.intp], ...]
    at: Callable[[Stacked], Any]


def groups(stack: Stack, coordinates: Sequence[Coordinate]) -> list[Group]:
    """Many coordinates by kinds, to be evaluated at once: angles, ways along axes, distances. Empty groups are left out."""
    kinds: dict[type, list[int]] = {}
    for i, coordinate in enumerate(coordinates):
        kinds.setdefault(type(coordinate), []).append(i)
    made = []
    for kind, which in kinds.items():
        some = [coordinates[i] for i in which]
        entries = np.array([[3 * stack.index(link) + axis for link, axis in columns(c)] for c in some])
        made.append(Group(np.array(which), kind is Angle, tuple(entries.T), _evaluation(stack, some)))
    return made


def _evaluation(stack: Stack, some: Sequence[Coordinate]) -> Callable[["Stacked"], State]:
    """What evaluates coordinates of one kind at once."""
    match some[0]:
        case Angle():
            return _angles(stack, some)  # type: ignore[arg-type]
        case Along():
            return _alongs(stack, some)  # type: ignore[arg-type]
        case Distance():
            return _distances(stack, some)  # type: ignore[arg-type]
        case _:
            assert_never(some[0])


def _angles(stack: Stack, some: Sequence[Angle]) -> Callable[[Stacked], AngleState]:
    a, b = np.array([stack.index(c.a) for c in some]), np.array([stack.index(c.b) for c in some])
    return lambda x: AngleState(x, a, b)


def _alongs(stack: Stack, some: Sequence[Along]) -> Callable[[Stacked], AlongState]:
    n = stack.directions([(c.origin.link, c.angle, c.across) for c in some])
    a, b = stack.points([c.origin for c in some]), stack.points([c.point for c in some])
    return lambda x: AlongState(x.directions(n), x.ends(a), x.ends(b))


def _distances(stack: Stack, some: Sequence[Distance]) -> Callable[[Stacked], DistanceState]:
    a, b = stack.points([c.a for c in some]), stack.points([c.b for c in some])
    return lambda x: DistanceState(x.ends(a), x.ends(b), ARRAYS)


def angle(x: Array, link: int) -> Array:
    """Angle (or, of a velocity, angular speed) of a link: (...)."""
    return np.zeros(x.shape[:-1]) if link == GROUND else x[..., 3 * link + 2]


def rotated(x: Array, theta: Array) -> Array:
    """A vector (2,) turned by angle(s) [rad] (...): (..., 2)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.stack((c * x[0] - s * x[1], s * x[0] + c * x[1]), axis=-1)


def arm(q: Array, point: Point) -> Array:
    """Arm from the centre of mass to the point in world axes (..., 2); zero for the ground, which carries no coordinates."""
    return np.zeros((*q.shape[:-1], 2)) if point.link == GROUND else rotated(point.local, angle(q, point.link))


def position(q: Array, point: Point) -> Array:
    """World position (..., 2) [m]."""
    if point.link == GROUND:
        return np.broadcast_to(point.local, (*q.shape[:-1], 2))
    return q[..., 3 * point.link : 3 * point.link + 2] + arm(q, point)


def velocity(q: Array, v: Array, point: Point) -> Array:
    """World velocity (..., 2) [m/s]."""
    if point.link == GROUND:
        return np.zeros((*q.shape[:-1], 2))
    r, w = arm(q, point), angle(v, point.link)
    return v[..., 3 * point.link : 3 * point.link + 2] + np.stack((-w * r[..., 1], w * r[..., 0]), axis=-1)


def acceleration(q: Array, v: Array, a: Array, point: Point) -> Array:
    """World acceleration (..., 2) [m/s^2]."""
    if point.link == GROUND:
        return np.zeros((*q.shape[:-1], 2))
    r = arm(q, point)
    w, alpha = angle(v, point.link)[..., None], angle(a, point.link)
    return a[..., 3 * point.link : 3 * point.link + 2] + np.stack((-alpha * r[..., 1], alpha * r[..., 0]), axis=-1) - r * w**2
