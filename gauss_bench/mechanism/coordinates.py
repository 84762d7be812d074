"""Scalar coordinates of a linkage, defined once for numbers of any kind. Joints and forces are built on these alone.

    Angle       x = theta_b - theta_a
    Along       x = n . (p_b - p_a)     n a direction fixed in the body of a, or in a third one such as the ground
    Distance    x = |p_b - p_a|
    Slip        x' = n . p'             n turns with the body of p; there is no x (a knife edge holds it)

Each has a gradient and a bias. The gradient has for each body a vector (or None) and a turning; the bias is the part of the second
rate that comes from velocities:

    x' = G v,    x'' = G a + bias

A point is p = z + r on a body of angular speed w; the body that carries n has angular speed W, and w~ = w - W is the relative one.
Seen from axes that turn with n, the bias of Along is

    n . [ w~_b x (w~_b x r_b) - w~_a x (w~_a x r_a) + (w~_b x W) x r_b - (w~_a x W) x r_a
          - 2 W x (u_b - u_a) + W x (W x (z_b - z_a)) ]

Terms of the body that carries n vanish, as do terms of bodies at rest, and in the plane (w~ x W).

A force is a law on a coordinate (`Law`): it has a generalised force (`push`), a potential (`energy`) and a loss of power.

Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), sections 3.3 and 3.6. `reference/taylor` derives
all of this independently and must not import this file: a certificate is only as good as the independence of its two derivations.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple, assert_never

import numpy as np

from gauss_bench.mechanism.frames import Arithmetic, Direction, End, Frame, Placement
from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Distance, Law, Mechanism, Point, Slip, Weighted
from gauss_bench.mechanism.spaces import PLANE, Plane, Real, Turning, Vec, angle_at, angles, places, slots
from gauss_bench.mechanism.written import inverse
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory


class Entry(NamedTuple):
    """A coordinate's gradient at one body: for the velocity of its centre of mass, and for its angular speed."""

    frame: Frame
    n: Vec | None
    m: Turning


def total(terms: Sequence[Real]) -> Real:
    """Return the sum of numbers of any kind; 0.0 if there are none."""
    return sum(terms[1:], start=terms[0]) if terms else 0.0


class AlongState:
    """The component of the vector from a to b along a direction n, at a state."""

    def __init__(self, space: Plane, n: Direction, a: End, b: End):
        self.space, (self.axes, self.n), self.a, self.b = space, n, a, b
        self.gap = b.place - a.place

    @cached_property
    def value(self) -> Real:
        return self.space.dot(self.n, self.gap)

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        wedge, n, (A, ra), (B, rb) = self.space.wedge, self.n, self.a, self.b
        if self.axes.body == A.body:
            return Entry(A, -n, wedge(n, self.gap) + wedge(n, ra)), Entry(B, n, wedge(rb, n))
        own = () if self.axes.rests else (Entry(self.axes, None, wedge(n, self.gap)),)
        return Entry(A, -n, wedge(n, ra)), Entry(B, n, wedge(rb, n)), *own

    @cached_property
    def rate(self) -> Real:
        turning = [self.space.inner(e.frame.omega, e.m) for e in self.entries if not e.frame.rests]
        return total([self.space.dot(self.n, self.b.frame.u - self.a.frame.u), *turning])

    @cached_property
    def bias(self) -> Real:
        space, n, axes = self.space, self.n, self.axes
        terms = []
        for sign, (frame, r) in ((1.0, self.b), (-1.0, self.a)):
            if frame.body == axes.body:
                continue
            relative = frame.omega if axes.rests else frame.omega - axes.omega
            terms.append(space.pull(relative, n, r) if sign > 0 else -space.pull(relative, n, r))
            if not axes.rests and (across := space.twist(relative, axes.omega)) is not None:
                swung = space.inner(across, space.wedge(r, n))
                terms.append(swung if sign > 0 else -swung)
        if not axes.rests:
            a, b = self.a.frame, self.b.frame
            terms.append(space.inner(axes.omega, space.wedge(n, b.u - a.u)) * 2.0)
            terms.append(space.pull(axes.omega, n, b.z - a.z))
        return total(terms)


class AngleState:
    """The angle between two bodies at a state, unwrapped."""

    bias: Real = 0.0

    def __init__(self, space: Plane, a: Frame, b: Frame):
        self.space, self.a, self.b = space, a, b

    @property
    def value(self) -> Real:
        return self.b.angle - self.a.angle

    @property
    def entries(self) -> tuple[Entry, ...]:
        return Entry(self.a, None, -self.space.axis), Entry(self.b, None, self.space.axis)

    @property
    def rate(self) -> Real:
        return self.space.inner(self.b.omega - self.a.omega, self.space.axis)


class DistanceState:
    """The distance x of a and b at a state; names with half_square concern x^2 / 2, which needs no square root.

    `known` is the value of the distance if another number already holds it, as on a length constraint.
    """

    def __init__(self, space: Plane, a: End, b: End, arithmetic: Arithmetic, known: Real = None):
        self.space, self.a, self.b, self.n = space, a, b, b.place - a.place
        self.arithmetic, self.known = arithmetic, known

    @cached_property
    def square(self) -> Real:
        return self.space.dot(self.n, self.n)

    @cached_property
    def value(self) -> Real:
        return self.arithmetic.sqrt(self.square)

    @cached_property
    def inverse_square(self) -> Real:
        return self.arithmetic.inverse(self.square if self.known is None else self.known * self.known)

    @cached_property
    def inverse(self) -> Real:
        return self.arithmetic.sqrt(self.inverse_square) if self.known is None else self.arithmetic.inverse(self.known)

    @cached_property
    def half_square_entries(self) -> tuple[Entry, ...]:
        wedge, n, (A, ra), (B, rb) = self.space.wedge, self.n, self.a, self.b
        return Entry(A, -n, wedge(n, ra)), Entry(B, n, wedge(rb, n))

    @cached_property
    def half_square_rate(self) -> Real:
        turning = [self.space.inner(e.frame.omega, e.m) for e in self.half_square_entries if not e.frame.rests]
        return total([self.space.dot(self.n, self.b.frame.u - self.a.frame.u), *turning])

    @property
    def entries(self) -> tuple[Entry, ...]:
        return tuple(Entry(e.frame, e.n * self.inverse, e.m * self.inverse) for e in self.half_square_entries if e.n is not None)

    @property
    def rate(self) -> Real:
        return self.half_square_rate * self.inverse

    @cached_property
    def bias(self) -> Real:
        space, n, (A, ra), (B, rb) = self.space, self.n, self.a, self.b
        across = (space.wedge(n, B.u - A.u) + space.swing(B.omega, n, rb) - space.swing(A.omega, n, ra)) * self.inverse
        return (space.pull(B.omega, n, rb) - space.pull(A.omega, n, ra) + space.inner(across, across)) * self.inverse


class SlipState:
    """The speed of a point along a direction that turns with its own body."""

    def __init__(self, space: Plane, n: Direction, end: End):
        self.space, self.n, self.end = space, n.n, end

    @property
    def entries(self) -> tuple[Entry, ...]:
        return (Entry(self.end.frame, self.n, self.space.wedge(self.end.arm, self.n)),)

    @property
    def rate(self) -> Real:
        frame = self.end.frame
        return self.space.dot(self.n, frame.u) + self.space.inner(frame.omega, self.entries[0].m)

    @property
    def bias(self) -> Real:
        return self.space.inner(self.end.frame.omega, self.space.wedge(self.n, self.end.frame.u))


class WeightedState:
    """The sum of coordinates at a state, each times a number."""

    def __init__(self, terms: Sequence[tuple["State", float]]):
        self.terms = terms

    @property
    def value(self) -> Real:
        return total([x.value * weight for x, weight in self.terms])

    @property
    def entries(self) -> tuple[Entry, ...]:
        every = [(e, weight) for x, weight in self.terms for e in x.entries]
        return tuple(Entry(e.frame, None if e.n is None else e.n * weight, e.m * weight) for e, weight in every)

    @property
    def rate(self) -> Real:
        return total([x.rate * weight for x, weight in self.terms])

    @property
    def bias(self) -> Real:
        return total([x.bias * weight for x, weight in self.terms])


State = AngleState | AlongState | DistanceState | WeightedState


def state(coordinate: Coordinate, at: Placement, known: Real = None) -> State:
    """Evaluate a coordinate at a state of the linkage; `known` is the value of a distance if another number already holds it."""
    match coordinate:
        case Angle(a, b):
            return AngleState(at.space, at.frame(a), at.frame(b))
        case Along(origin, point, angle, across):
            return AlongState(at.space, at.direction(coordinate.axes, angle, across), at.end(origin), at.end(point))
        case Distance(a, b):
            return DistanceState(at.space, at.end(a), at.end(b), at.arithmetic, known)
        case Weighted(terms):
            return WeightedState([(state(x, at), weight) for x, weight in terms])
        case _:
            assert_never(coordinate)


def slip(coordinate: Slip, at: Placement) -> SlipState:
    """Evaluate a slip at a state of the linkage."""
    point = coordinate.point
    return SlipState(at.space, at.direction(point.link, coordinate.angle, True), at.end(point))


def columns(space: Plane, entries: Sequence[Entry]) -> dict[int, Real]:
    """Sum the entries of a gradient by generalised speed (index -> number); the ground contributes nothing."""
    size, found = space.dimension + space.turns, dict[int, Real]()
    for frame, n, m in entries:
        if not frame.rests:
            first = size * frame.body
            straight = [] if n is None else list(enumerate(n.parts, first))
            for k, x in (*straight, *enumerate(space.levers(m), first + space.dimension)):
                found[k] = found[k] + x if k in found else x
    return found


def absent(number: Real) -> bool:
    """Tell whether a number is zero by structure: the float zero, or an expression that says so."""
    return bool(number == 0.0) if isinstance(number, float) else getattr(number, "zero", False) is True


def strength(x: State, law: Law) -> Real:
    """Return the force F of a law along its coordinate x; the generalised force is F times the gradient in `entries`.

    For a distance x the result is F / x and multiplies `half_square_entries`: with h = x^2 / 2, F grad x = (F / x) grad h, and

        F / x = -k + (k rest + bias) / x - c h' / x^2 + s / x^3

    so that a spring without rest length needs no square root and, if undamped, no division: it passes through zero length
    smoothly. Any other spring reverses its direction there and exerts no force at exactly zero length.
    """
    sprung, damped, biased = not absent(law.k), not absent(law.c), not absent(law.bias)
    terms: list[Real] = []
    if isinstance(x, DistanceState):
        if sprung:
            terms.append(-law.k)
        if sprung and not absent(law.rest):
            terms.append(law.k * law.rest * x.inverse)
        if biased:
            terms.append(law.bias * x.inverse)
        if damped:
            terms.append(-(law.c * x.half_square_rate * x.inverse_square))
        if not absent(law.inverse_square):
            terms.append(law.inverse_square * x.inverse * x.inverse_square)
        return total(terms)
    if biased:
        terms.append(law.bias)
    if sprung:
        terms.append(-(law.k * x.value) if absent(law.rest) else law.k * (law.rest - x.value))
    if damped:
        terms.append(-(law.c * x.rate))
    if not absent(law.inverse_square):
        terms.append(law.inverse_square / (x.value * x.value))
    return total(terms)


def push(x: State, law: Law) -> tuple[Entry, ...]:
    """Return the generalised force of a law along a coordinate, by body."""
    force = strength(x, law)
    entries = x.half_square_entries if isinstance(x, DistanceState) else x.entries
    return tuple(Entry(e.frame, None if e.n is None else e.n * force, e.m * force) for e in entries)


def energy(x: State, law: Law) -> Real:
    """Potential energy of a law [J]."""
    terms: list[Real] = []
    if not absent(law.k):
        if isinstance(x, DistanceState) and absent(law.rest):
            terms.append(law.k * 0.5 * x.square)
        else:
            stretch = x.value if absent(law.rest) else x.value - law.rest
            terms.append(law.k * 0.5 * (stretch * stretch))
    if not absent(law.bias):
        terms.append(-(law.bias * x.value))
    if not absent(law.inverse_square):
        terms.append(law.inverse_square * x.inverse if isinstance(x, DistanceState) else law.inverse_square / x.value)
    return total(terms)


def loss(x: State, law: Law) -> Real:
    """Return the power dissipated by the damping of a law [W]."""
    return 0.0 if absent(law.c) else law.c * (x.rate * x.rate)


# Arrays of states


class _ArrayArithmetic:
    """The functions of arrays."""

    sqrt, sin, cos, inverse = staticmethod(np.sqrt), staticmethod(np.sin), staticmethod(np.cos), staticmethod(inverse)


class Placed(Placement):
    """The bodies of a mechanism at state(s) q, v (..., n), as arrays; at rest where v is not given."""

    arithmetic = _ArrayArithmetic()

    def __init__(self, q: Array, v: Array | None = None):
        self.q, self.v = q, np.zeros_like(q) if v is None else v

    def body(self, body: int) -> tuple[list[Array], list[Array]]:
        q, v = ([*np.moveaxis(x[..., slots(body)], -1, 0)] for x in (self.q, self.v))
        return q, v


def value(coordinate: Coordinate, q: Array) -> Array:
    """Value (...) [rad or m] at state(s) q (..., n)."""
    return np.asarray(state(coordinate, Placed(q)).value)


def rate(coordinate: Coordinate, q: Array, v: Array) -> Array:
    """Rate (...) [rad/s or m/s] at state(s) q, v (..., n)."""
    return np.asarray(state(coordinate, Placed(q, v)).rate)


def gradient(coordinate: Coordinate, q: Array) -> Array:
    """G (..., n) at state(s) q (..., n)."""
    G = np.zeros_like(q)
    for k, entry in columns(PLANE, state(coordinate, Placed(q)).entries).items():
        G[..., k] = entry
    return G


def bias(coordinate: Coordinate, q: Array, v: Array) -> Array:
    """The part of the second rate that velocities alone give, (...) [rad/s^2 or m/s^2], at state(s) q, v (..., n)."""
    return np.asarray(state(coordinate, Placed(q, v)).bias) + np.zeros(q.shape[:-1], dtype=q.dtype)


def rotate(x: Array, theta: Array) -> Array:
    """A vector (2,) turned by angle(s) [rad] (...): (..., 2)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.stack((c * x[0] - s * x[1], s * x[0] + c * x[1]), axis=-1)


def arm(q: Array, point: Point) -> Array:
    """Arm from the centre of mass to the point in world axes (..., 2); zero for the ground, which carries no coordinates."""
    return np.zeros((*q.shape[:-1], 2)) if point.link == GROUND else rotate(point.local, angle_at(q, point.link))


def position(q: Array, point: Point) -> Array:
    """World position (..., 2) [m]."""
    return _stacked(Placed(q).end(point).place, q)


def velocity(q: Array, v: Array, point: Point) -> Array:
    """World velocity (..., 2) [m/s]."""
    frame, r = Placed(q, v).end(point)
    return _stacked(frame.u + PLANE.cross(frame.omega, r), q)


def acceleration(q: Array, v: Array, a: Array, point: Point) -> Array:
    """World acceleration (..., 2) [m/s^2]."""
    (now, r), then = Placed(q, v).end(point), Placed(q, a).frame(point.link)
    return _stacked(then.u + PLANE.cross(then.omega, r) - r * (now.omega * now.omega), q)


def _stacked(x: Vec, q: Array) -> Array:
    """Stack the two components of a vector as (..., 2), broadcast to the shape of the states q (..., n)."""
    return np.stack([np.broadcast_to(part, q.shape[:-1]) for part in x.parts], axis=-1)


def spread(mechanism: Mechanism, motion: Trajectory) -> Trajectory:
    """Return the states of every link of the file, by its own centre of mass, from the states (k, n) of the welded bodies."""
    if not mechanism.parts:
        return motion
    q, v, a = (np.empty((len(motion.t), PLANE.size * len(mechanism.parts))) for _ in range(3))
    for k, part in enumerate(mechanism.parts):
        centre = Point(part.body, part.at, part.name)
        places(q)[:, k], angles(q)[:, k] = position(motion.q, centre), angle_at(motion.q, part.body) + part.turn
        places(v)[:, k], angles(v)[:, k] = velocity(motion.q, motion.v, centre), angle_at(motion.v, part.body)
        places(a)[:, k], angles(a)[:, k] = acceleration(motion.q, motion.v, motion.a, centre), angle_at(motion.a, part.body)
    return Trajectory(motion.t, q, v, a, motion.steps)
