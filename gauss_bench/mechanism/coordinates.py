"""Scalar coordinates of a linkage, for numbers of any kind (floats, arrays, symbols); joints and forces are defined by them.

    Angle       x = theta_b - theta_a
    Along       x = n . (p_b - p_a)     n a direction fixed in the body of a, or in another body such as the ground
    Distance    x = |p_b - p_a|
    Slip        x' = n . p'             n turns with the body of p; there is no x (a knife edge keeps x' at zero)

p = z + r is the place of a point: z is the centre of mass of its body, u = z', and r the arm from z to p. The gradient G of a
coordinate with respect to the positions and angles of the bodies is stored as one `Entry` for each body. The bias is the part of
x'' without accelerations. With v and a the velocities and accelerations (n,) of all bodies,

    x' = G v,    x'' = G a + bias

A force is a function of a coordinate and its rate (`Law`), with a generalised force (`push`), a potential `energy` and a dissipated
power (`loss`). The second half of the file evaluates coordinates and points for arrays of states.

Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), sections 3.3 and 3.6. `reference/taylor` derives
all of this independently and must not import this file: a certificate is only as good as the independence of its two derivations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple, assert_never

import numpy as np

from gauss_bench.mechanism.frames import Arithmetic, Direction, End, Frame, Placement
from gauss_bench.mechanism.generated import inverse
from gauss_bench.mechanism.model import GROUND, Along, Angle, Coordinate, Distance, Law, Mechanism, Point, Slip, Weighted
from gauss_bench.mechanism.spaces import DIMENSION, SIZE, Real, Vec, angle_at, angles, cross, dot, places, slots, wedge
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory


class Entry(NamedTuple):
    """The part n . z' + m omega of a coordinate's rate that belongs to one body; n is None if this part has no term in z'."""

    frame: Frame
    n: Vec | None
    m: Real

    def scale(self, factor: Real) -> "Entry":
        """Return the same part for `factor` times the coordinate."""
        return Entry(self.frame, None if self.n is None else self.n * factor, self.m * factor)


def total(terms: Sequence[Real]) -> Real:
    """Return the sum of numbers of any kind; 0.0 if there are none."""
    return sum(terms[1:], start=terms[0]) if terms else 0.0  # the start 0 would be one more operation on arrays


def _gap_entries(n: Vec, a: End, b: End) -> tuple[Entry, Entry]:
    """Return the gradient of n . (p_b - p_a) for a vector n that does not turn."""
    return Entry(a.frame, -n, wedge(n, a.arm)), Entry(b.frame, n, wedge(b.arm, n))


def _gap_rate(n: Vec, a: End, b: End, entries: Sequence[Entry]) -> Real:
    """Return the rate of x = n . (p_b - p_a) from the gradient `entries` of x."""
    turning = [e.frame.omega * e.m for e in entries if not e.frame.rests]
    return total([dot(n, b.frame.u - a.frame.u), *turning])


def _centripetal(omega: Real, n: Vec, arm: Vec) -> Real:
    """Return n . (omega x (omega x arm)) = -omega^2 (n . arm)."""
    return -((omega * omega) * dot(n, arm))


class AlongState:
    """The coordinate x = n . (p_b - p_a) at a state; the unit vector n is fixed in the body whose frame is `axes`."""

    def __init__(self, direction: Direction, a: End, b: End):
        self.axes, self.n = direction
        self.a, self.b = a, b
        self.gap = b.place - a.place

    @cached_property
    def value(self) -> Real:
        """The value x [m]."""
        return dot(self.n, self.gap)

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """The gradient of x; a third entry belongs to the body in which n is fixed, unless that body rests or carries a."""
        at_a, at_b = _gap_entries(self.n, self.a, self.b)
        if self.axes.rests:
            return at_a, at_b
        # n turns with its body: dn/dtheta . gap = n x gap
        turn = wedge(self.n, self.gap)
        if self.axes.body == self.a.frame.body:
            return Entry(at_a.frame, n=at_a.n, m=turn + at_a.m), at_b
        return at_a, at_b, Entry(self.axes, n=None, m=turn)

    @cached_property
    def rate(self) -> Real:
        """The rate x' [m/s]."""
        return _gap_rate(self.n, self.a, self.b, self.entries)

    @cached_property
    def bias(self) -> Real:
        """The bias of x [m/s^2], with the Coriolis and centrifugal terms of axes that turn with n.

        Let x = n . (b - a). The body that carries a has the centre of mass z_a with the velocity u_a, the angular speed w_a, and
        the arm r_a from z_a to a; likewise for b. The body in which n is fixed has the angular speed W. The bias is

            -(w_b - W)^2 n . r_b + (w_a - W)^2 n . r_a + 2 W n x (u_b - u_a) - W^2 n . (z_b - z_a)

        Terms of the body in which n is fixed vanish, and so do terms of bodies at rest.
        """
        n, axes = self.n, self.axes
        a, b = self.a.frame, self.b.frame
        terms = []
        if b.body != axes.body:
            terms.append(_centripetal(self._relative_speed(b), n, self.b.arm))
        if a.body != axes.body:
            terms.append(-_centripetal(self._relative_speed(a), n, self.a.arm))
        if not axes.rests:
            terms.append((axes.omega * wedge(n, b.u - a.u)) * 2.0)
            terms.append(_centripetal(axes.omega, n, b.z - a.z))
        return total(terms)

    def _relative_speed(self, frame: Frame) -> Real:
        """Return the angular speed of a body relative to the body in which n is fixed."""
        return frame.omega if self.axes.rests else frame.omega - self.axes.omega


@dataclass(frozen=True, eq=False)
class AngleState:
    """The coordinate theta_b - theta_a between two bodies at a state, unwrapped [rad]."""

    a: Frame
    b: Frame
    bias: ClassVar[Real] = 0.0  # the coordinate is linear

    @property
    def value(self) -> Real:
        """The value x [rad]."""
        return self.b.angle - self.a.angle

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The gradient of x."""
        return Entry(self.a, n=None, m=-1.0), Entry(self.b, n=None, m=1.0)

    @property
    def rate(self) -> Real:
        """The rate x' [rad/s]."""
        return self.b.omega - self.a.omega


class DistanceState:
    """The coordinate x = |p_b - p_a| at a state; members called half_square belong to x^2 / 2, which needs no square root.

    `prescribed` is the value of x if a constraint gives it, otherwise None.
    """

    def __init__(self, a: End, b: End, arithmetic: Arithmetic, prescribed: Real = None):
        self.a, self.b, self.gap = a, b, b.place - a.place
        self.arithmetic, self.prescribed = arithmetic, prescribed

    @cached_property
    def square(self) -> Real:
        """The square x^2 [m^2]."""
        return dot(self.gap, self.gap)

    @cached_property
    def value(self) -> Real:
        """The value x [m]."""
        return self.arithmetic.sqrt(self.square)

    @cached_property
    def inverse_square(self) -> Real:
        """1 / x^2; 0 at x = 0."""
        return self.arithmetic.inverse(self.square if self.prescribed is None else self.prescribed * self.prescribed)

    @cached_property
    def inverse(self) -> Real:
        """1 / x; 0 at x = 0."""
        return self.arithmetic.sqrt(self.inverse_square) if self.prescribed is None else self.arithmetic.inverse(self.prescribed)

    @cached_property
    def half_square_entries(self) -> tuple[Entry, ...]:
        """The gradient of x^2 / 2."""
        return _gap_entries(self.gap, self.a, self.b)

    @cached_property
    def half_square_rate(self) -> Real:
        """The rate of x^2 / 2."""
        return _gap_rate(self.gap, self.a, self.b, self.half_square_entries)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The gradient of x."""
        return tuple(entry.scale(self.inverse) for entry in self.half_square_entries)

    @property
    def rate(self) -> Real:
        """The rate x' [m/s]."""
        return self.half_square_rate * self.inverse

    @cached_property
    def bias(self) -> Real:
        """The bias of x [m/s^2].

        It is (gap . difference of the centripetal accelerations of the points + (relative speed across the gap)^2) / x.
        """
        gap, (a, arm_a), (b, arm_b) = self.gap, self.a, self.b
        # gap x (p_b' - p_a'): x times the relative speed across the gap
        turning = wedge(gap, b.u - a.u) + b.omega * dot(gap, arm_b) - a.omega * dot(gap, arm_a)
        across = turning * self.inverse
        inward = _centripetal(b.omega, gap, arm_b) - _centripetal(a.omega, gap, arm_a)
        return (inward + across * across) * self.inverse


class WeightedState(NamedTuple):
    """A weighted sum of coordinates at a state, from pairs of coordinate and weight."""

    terms: Sequence[tuple["State", float]]

    @property
    def value(self) -> Real:
        """The value of the sum."""
        return total([x.value * weight for x, weight in self.terms])

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The gradient of the sum; a body may occur several times."""
        return tuple(entry.scale(weight) for x, weight in self.terms for entry in x.entries)

    @property
    def rate(self) -> Real:
        """The rate of the sum."""
        return total([x.rate * weight for x, weight in self.terms])

    @property
    def bias(self) -> Real:
        """The bias of the sum."""
        return total([x.bias * weight for x, weight in self.terms])


State = AngleState | AlongState | DistanceState | WeightedState


def state(coordinate: Coordinate, placement: Placement, prescribed: Real = None) -> State:
    """Return a coordinate at a state; `prescribed`, the value that a constraint gives to a distance, saves a square root."""
    match coordinate:
        case Angle(a, b):
            return AngleState(placement.frame(a), placement.frame(b))
        case Along(origin, point, angle, across):
            return AlongState(placement.direction(coordinate.axes, angle, across), placement.end(origin), placement.end(point))
        case Distance(a, b):
            return DistanceState(placement.end(a), placement.end(b), placement.arithmetic, prescribed)
        case Weighted(terms):
            return WeightedState([(state(x, placement), weight) for x, weight in terms])
        case _:
            assert_never(coordinate)


def slip(coordinate: Slip, placement: Placement) -> tuple[Entry, Real]:
    """Return the gradient and the bias of a slip s = n . p' at a state.

    With n' = omega x n and p' = u + omega x r, the bias is n' . u: the terms of the arm r, which turns with n, cancel.
    """
    point = coordinate.point
    _, n = placement.direction(point.link, coordinate.angle, across=True)
    frame, arm = placement.end(point)
    return Entry(frame, n, m=wedge(arm, n)), frame.omega * wedge(n, frame.u)


def columns(entries: Sequence[Entry]) -> dict[int, Real]:
    """Convert a gradient to a dict: index in a state (n,) -> number, the sum of all entries; bodies at rest are left out."""
    sums: dict[int, Real] = {}
    for frame, n, m in entries:
        if frame.rests:
            continue
        first = SIZE * frame.body
        parts = {} if n is None else {first + axis: x for axis, x in enumerate(n.parts)}
        parts[first + DIMENSION] = m
        for k, x in parts.items():
            sums[k] = sums[k] + x if k in sums else x
    return sums


def is_zero(number: Real) -> bool:
    """Tell whether a number is certainly zero: the float 0, or a symbol whose attribute `zero` is True."""
    return bool(number == 0.0) if isinstance(number, float) else getattr(number, "zero", False) is True


def strength(x: State, law: Law, arithmetic: Arithmetic) -> Real:
    """Return the force F of a law along its coordinate x; for a distance F / x, which multiplies the gradient of x^2 / 2.

    With the law's stiffness k, damping c, and s for `inverse_square`,

        F / x = -k + (k rest + bias) / x - c h' / x^2 + s / x^3,    h = x^2 / 2

    A spring without rest length and bias therefore needs no square root and, if undamped, no division, and passes through zero
    length smoothly. Any other spring reverses its force at zero length, and has no force at exactly zero length.
    """
    sprung, damped, biased = not is_zero(law.k), not is_zero(law.c), not is_zero(law.bias)
    terms: list[Real] = []
    if isinstance(x, DistanceState):
        if sprung:
            terms.append(-law.k)
        if sprung and not is_zero(law.rest):
            terms.append(law.k * law.rest * x.inverse)
        if biased:
            terms.append(law.bias * x.inverse)
        if damped:
            terms.append(-(law.c * x.half_square_rate * x.inverse_square))
        if not is_zero(law.inverse_square):
            terms.append(law.inverse_square * x.inverse * x.inverse_square)
        return total(terms)
    if biased:
        terms.append(law.bias)
    if sprung:
        terms.append(-(law.k * x.value) if is_zero(law.rest) else law.k * (law.rest - x.value))
    if damped:
        terms.append(-(law.c * x.rate))
    if not is_zero(law.inverse_square):
        terms.append(law.inverse_square * arithmetic.inverse(x.value * x.value))
    return total(terms)


def push(x: State, law: Law, arithmetic: Arithmetic) -> tuple[Entry, ...]:
    """Return the generalised force of a law along its coordinate x, by body: `strength` times the gradient."""
    force = strength(x, law, arithmetic)
    entries = x.half_square_entries if isinstance(x, DistanceState) else x.entries
    return tuple(entry.scale(force) for entry in entries)


def energy(x: State, law: Law, arithmetic: Arithmetic) -> Real:
    """Return the potential energy [J] of a law at its coordinate x: k (x - rest)^2 / 2 - bias x + inverse_square / x."""
    terms: list[Real] = []
    if not is_zero(law.k):
        if isinstance(x, DistanceState) and is_zero(law.rest):
            terms.append(law.k * 0.5 * x.square)
        else:
            stretch = x.value if is_zero(law.rest) else x.value - law.rest
            terms.append(law.k * 0.5 * (stretch * stretch))
    if not is_zero(law.bias):
        terms.append(-(law.bias * x.value))
    if not is_zero(law.inverse_square):
        terms.append(law.inverse_square * (x.inverse if isinstance(x, DistanceState) else arithmetic.inverse(x.value)))
    return total(terms)


def loss(x: State, law: Law) -> Real:
    """Return the power c x'^2 [W] that the damping of a law dissipates at its coordinate x."""
    return 0.0 if is_zero(law.c) else law.c * (x.rate * x.rate)


# Arrays of states


class _ArrayArithmetic:
    """The protocol `Arithmetic` for numpy arrays."""

    sqrt, sin, cos, inverse = np.sqrt, np.sin, np.cos, staticmethod(inverse)


class Placed(Placement):
    """The bodies of a mechanism at state(s) q, v (..., n) as arrays; without v they are at rest."""

    arithmetic = _ArrayArithmetic()

    def __init__(self, q: Array, v: Array | None = None):
        self.q, self.v = q, np.zeros_like(q) if v is None else v

    def body(self, body: int) -> tuple[list[Array], list[Array]]:
        """Return x, y, angle of a body and their rates, each an array (...)."""
        q, v = ([*np.moveaxis(x[..., slots(body)], -1, 0)] for x in (self.q, self.v))
        return q, v


def value(coordinate: Coordinate, q: Array) -> Array:
    """Return the value (...) [rad or m] of a coordinate at one or several states q (..., n)."""
    return np.asarray(state(coordinate, Placed(q)).value)


def rate(coordinate: Coordinate, q: Array, v: Array) -> Array:
    """Return the rate (...) [rad/s or m/s] of a coordinate at one or several states q, v (..., n)."""
    return np.asarray(state(coordinate, Placed(q, v)).rate)


def gradient(coordinate: Coordinate, q: Array) -> Array:
    """Return the gradient G (..., n) of a coordinate at state(s) q (..., n)."""
    G = np.zeros_like(q)
    for k, entry in columns(state(coordinate, Placed(q)).entries).items():
        G[..., k] = entry
    return G


def bias(coordinate: Coordinate, q: Array, v: Array) -> Array:
    """Return the bias (...) of a coordinate at states q, v (..., n) [rad/s^2, m/s^2]."""
    return np.asarray(state(coordinate, Placed(q, v)).bias) + np.zeros(q.shape[:-1], dtype=q.dtype)  # one for each state


def rotate(x: Array, theta: Array) -> Array:
    """Return the vector x (2,) rotated by angle(s) theta (...) [rad], as (..., 2)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.stack((c * x[0] - s * x[1], s * x[0] + c * x[1]), axis=-1)


def arm(q: Array, point: Point) -> Array:
    """Return the arm (..., 2) [m] from the centre of mass to the point, in world axes; zero for the ground."""
    return np.zeros((*q.shape[:-1], 2)) if point.link == GROUND else rotate(point.local, angle_at(q, point.link))


def position(q: Array, point: Point) -> Array:
    """Return the world position (..., 2) [m] of a point at state(s) q (..., n)."""
    return _stack(Placed(q).end(point).place, q)


def velocity(q: Array, v: Array, point: Point) -> Array:
    """Return the world velocity (..., 2) [m/s] of a point at state(s) q, v (..., n)."""
    frame, r = Placed(q, v).end(point)
    return _stack(frame.u + cross(frame.omega, r), q)


def acceleration(q: Array, v: Array, a: Array, point: Point) -> Array:
    """Return the world acceleration (..., 2) [m/s^2] of a point at state(s) q, v with accelerations a (..., n)."""
    frame, r = Placed(q, v).end(point)
    rates = Placed(q, a).frame(point.link)  # its u and omega are accelerations
    return _stack(rates.u + cross(rates.omega, r) - r * (frame.omega * frame.omega), q)


def _stack(x: Vec, q: Array) -> Array:
    """Return the components of a vector as (..., 2), for the states q (..., n)."""
    return np.stack([np.broadcast_to(part, q.shape[:-1]) for part in x.parts], axis=-1)


def motion_of_links(mechanism: Mechanism, motion: Trajectory) -> Trajectory:
    """Return the motion of every link of the file, at its own centre of mass, from the motion (k, n) of the bodies.

    A body is a group of links that are welded to each other.
    """
    if not mechanism.parts:
        return motion
    q, v, a = (np.empty((len(motion.t), SIZE * len(mechanism.parts))) for _ in range(3))
    for k, part in enumerate(mechanism.parts):
        centre = Point(part.body, part.at, part.name)
        places(q)[:, k], angles(q)[:, k] = position(motion.q, centre), angle_at(motion.q, part.body) + part.turn
        places(v)[:, k], angles(v)[:, k] = velocity(motion.q, motion.v, centre), angle_at(motion.v, part.body)
        places(a)[:, k], angles(a)[:, k] = acceleration(motion.q, motion.v, motion.a, centre), angle_at(motion.a, part.body)
    return Trajectory(motion.t, q, v, a, motion.steps)
