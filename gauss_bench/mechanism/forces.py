"""Applied forces of a linkage: generalised force Q, potential energy and the power of what has no potential.

Each kind is three short functions on link-fixed points, for one state, q (n,), or a batch, q (..., n). Power that no potential
accounts for (dampers, forces that turn with a link) is what the energy balance of a trajectory integrates.

Dry friction stands apart, because it depends on the loads of the joints and with them on the accelerations. With N_k the load that
pair k carries and s its relative speed, the constraint force counts with the active forces (Yuan and Ge, 2016, eq. 3):

    M a + J^T lambda = Q + W N(lambda),    W_k = -mu_k r_k tanh(s_k / speed_k) ds_k/dv        (r_k = 1 for a slide)
    N = |(lambda_x, lambda_y)| of a pin,   N = |lambda_normal| of a slide

W is known from the state, N from lambda, and lambda from a: a fixed point, found by iteration from the motion without friction. It
contracts unless mu is so large that friction feeds the loads that cause it.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from gauss_bench.mechanism.model import (
    GROUND,
    AxisSpringDamper,
    CoulombFriction,
    Force,
    Joint,
    JointDamping,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)
from gauss_bench.terms import Array


def angle(x: Array, link: int) -> Array:
    """Angle (or, of a velocity, angular speed) of a link: (...)."""
    return np.zeros(x.shape[:-1]) if link == GROUND else x[..., 3 * link + 2]


def rotated(x: Array, theta: Array) -> Array:
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


def add_force(Q: Array, q: Array, point: Point, force: Array) -> None:
    """Add a world force (..., 2) [N] at a point to the generalised force Q."""
    if point.link != GROUND:
        r, i = arm(q, point), 3 * point.link
        Q[..., i : i + 2] += force
        Q[..., i + 2] += r[..., 0] * force[..., 1] - r[..., 1] * force[..., 0]


def add_torque(Q: Array, link: int, torque: Array | float) -> None:
    """Add a torque [N m] on a link to the generalised force Q."""
    if link != GROUND:
        Q[..., 3 * link + 2] += torque


def axis_state(q: Array, v: Array, point: Point, origin: Point, theta: float) -> tuple[Array, Array, Array]:
    """Coordinate x (...), its rate, and direction (..., 2) of a point along an axis at angle `theta` in the origin's link."""
    axis = np.array([np.cos(theta), np.sin(theta)])
    if origin.link == GROUND:  # the common case, and the cheap one
        x, rate = (position(q, point) - origin.local) @ axis, velocity(q, v, point) @ axis
        return x, rate, np.broadcast_to(axis, (*q.shape[:-1], 2))
    direction = rotated(axis, angle(q, origin.link))
    gap = position(q, point) - position(q, origin)
    gap_rate = velocity(q, v, point) - velocity(q, v, origin)
    turning = angle(v, origin.link) * (direction[..., 0] * gap[..., 1] - direction[..., 1] * gap[..., 0])
    return (direction * gap).sum(-1), (direction * gap_rate).sum(-1) + turning, direction


def add_axis_force(Q: Array, q: Array, point: Point, origin: Point, direction: Array, force: Array) -> None:
    """A force along an axis on `point`; the opposite one acts on the origin's link along the same line."""
    push = direction * force[..., None]
    add_force(Q, q, point, push)
    if origin.link != GROUND:
        add_force(Q, q, origin, -push)
        gap = position(q, point) - position(q, origin)
        add_torque(Q, origin.link, gap[..., 1] * push[..., 0] - gap[..., 0] * push[..., 1])


def stretch(q: Array, v: Array, f: SpringDamper) -> tuple[Array, Array, Array]:
    """Length (...), its rate and unit direction (..., 2) from a to b; the direction is zero where the points coincide."""
    gap = position(q, f.b) - position(q, f.a)
    length = np.sqrt((gap * gap).sum(-1))
    direction = gap / np.where(length > 0, length, 1.0)[..., None]
    rate = (direction * (velocity(q, v, f.b) - velocity(q, v, f.a))).sum(-1)
    return length, rate, direction


def joint_speed(q: Array, v: Array, pair: Joint) -> Array:
    """Relative turning [rad/s] or sliding [m/s] speed of a pair (...)."""
    if isinstance(pair, Prismatic):
        return axis_state(q, v, pair.block, pair.guide, pair.angle)[1]
    return angle(v, pair.b.link) - angle(v, pair.a.link)


def apply(Q: Array, f: Force, q: Array, v: Array) -> None:
    """Add one force to the generalised force Q (..., n)."""
    match f:
        case Torque():
            add_torque(Q, f.link, f.value)
            add_torque(Q, f.reaction, -f.value)
        case PointForce():
            add_force(Q, q, f.point, rotated(f.value, angle(q, f.frame)))
        case SpringDamper():
            length, rate, direction = stretch(q, v, f)
            tension = direction * (f.k * (length - f.rest) + f.c * rate)[..., None]
            add_force(Q, q, f.a, tension)
            add_force(Q, q, f.b, -tension)
        case AxisSpringDamper():
            x, rate, direction = axis_state(q, v, f.point, f.origin, f.angle)
            add_axis_force(Q, q, f.point, f.origin, direction, f.k * (f.rest - x) - f.c * rate)
        case RotationalSpringDamper():
            turn, speed = angle(q, f.b) - angle(q, f.a), angle(v, f.b) - angle(v, f.a)
            torque = -f.k * (turn - f.rest) - f.c * speed
            add_torque(Q, f.b, torque)
            add_torque(Q, f.a, -torque)
        case JointDamping():
            for pair in f.pairs:
                _resist(Q, pair, q, v, lambda speed: -f.c * speed)


def _resist(Q: Array, pair: Joint, q: Array, v: Array, law: Callable[[Array], Array]) -> None:
    """Add what a pair does against its relative speed: a torque `law(speed)` on the second link, or a force on the block."""
    if isinstance(pair, Prismatic):
        _, rate, direction = axis_state(q, v, pair.block, pair.guide, pair.angle)
        add_axis_force(Q, q, pair.block, pair.guide, direction, law(rate))
    else:
        torque = law(joint_speed(q, v, pair))
        add_torque(Q, pair.b.link, torque)
        add_torque(Q, pair.a.link, -torque)


def potential(f: Force, q: Array) -> Array:
    """Potential energy (...) [J]; constant torques and world-fixed forces have one too, in unwrapped angles."""
    still = np.zeros_like(q)
    match f:
        case Torque():
            return -f.value * (angle(q, f.link) - angle(q, f.reaction))
        case PointForce() if f.frame == GROUND:
            return np.asarray(-np.sum(f.value * position(q, f.point), axis=-1))
        case SpringDamper():
            return 0.5 * f.k * (stretch(q, still, f)[0] - f.rest) ** 2
        case AxisSpringDamper():
            return 0.5 * f.k * (axis_state(q, still, f.point, f.origin, f.angle)[0] - f.rest) ** 2
        case RotationalSpringDamper():
            return 0.5 * f.k * (angle(q, f.b) - angle(q, f.a) - f.rest) ** 2
    return np.zeros(q.shape[:-1])


def power(f: Force, q: Array, v: Array) -> Array:
    """Power (...) [W] of the part of a force that has no potential."""
    match f:
        case PointForce() if f.frame != GROUND:
            return np.asarray(np.sum(rotated(f.value, angle(q, f.frame)) * velocity(q, v, f.point), axis=-1))
        case SpringDamper():
            return -f.c * stretch(q, v, f)[1] ** 2
        case AxisSpringDamper():
            return -f.c * axis_state(q, v, f.point, f.origin, f.angle)[1] ** 2
        case RotationalSpringDamper():
            return -f.c * (angle(v, f.b) - angle(v, f.a)) ** 2
        case JointDamping():
            speeds = [joint_speed(q, v, pair) for pair in f.pairs]
            return np.asarray(-f.c * np.sum(np.square(speeds), axis=0))
    return np.zeros(q.shape[:-1])


JAMMED = "the friction does not settle in {} iterations: mu is too large for these joints, or they jam"


class Jammed(ArithmeticError):
    """The loads of joints with friction do not settle: each increases the other, as in a slide that jams."""


class JointFriction:
    """Dry friction in the joints of one mechanism; pairs (p) with mu = 0 are left out, so that nothing is done for them.

    Attributes:
        rows: (p,) first multiplier of each pair.
        pins: (p,) 1 where the second multiplier is a force too, 0 for a slide, where it is a moment.
    """

    ITERATIONS = 200  # settles wherever each iteration takes off a sixth of the error; usual joints take off nine tenths
    TOLERANCE = 1e-13  # of the largest multiplier
    STALLED = 1e-11  # the same, where solving for lambda anew each time leaves rounding times the condition of J

    def __init__(self, mechanism: Mechanism):
        at = {joint.name: 2 * k for k, joint in enumerate(mechanism.joints)}
        self.acting = [(f, pair) for f in mechanism.frictions if f.mu > 0 for pair in f.pairs]
        self.rows = np.array([at[pair.name] for _, pair in self.acting], dtype=int)
        self.pins = np.array([not isinstance(pair, Prismatic) for _, pair in self.acting], dtype=float)

    def __bool__(self) -> bool:
        return bool(self.acting)

    def directions(self, q: Array, v: Array) -> Array:
        """W (..., n, p): generalised friction for unit loads at state(s) (..., n)."""
        W = np.zeros((*q.shape, len(self.acting)), dtype=q.dtype)
        for k, (f, pair) in enumerate(self.acting):
            _resist(W[..., k], pair, q, v, partial(_unit_friction, f))
        return W

    def loads(self, multipliers: Array) -> Array:
        """N (..., p) [N] of multipliers (..., m)."""
        return np.hypot(multipliers[..., self.rows], self.pins * multipliers[..., self.rows + 1])

    def generalised(self, q: Array, v: Array, multipliers: Array) -> Array:
        """Friction W N(lambda), (..., n) [N, N m]."""
        return np.asarray((self.directions(q, v) @ self.loads(multipliers)[..., None])[..., 0])

    def consistent(self, base: Array, gain: Array) -> Array:
        """The multipliers (..., m) of lambda = base + gain N(lambda), with base (..., m) and gain (..., m, p).

        Raises:
            Jammed: the iteration does not settle.
        """
        found = base
        with np.errstate(over="ignore", invalid="ignore"):  # what grows beyond bounds has not settled
            for _ in range(self.ITERATIONS):
                before, found = found, base + (gain @ self.loads(found)[..., None])[..., 0]
                change, scale = np.abs(found - before).max(-1, initial=0.0), np.abs(found).max(-1, initial=0.0)
                if (change <= self.TOLERANCE * scale).all():
                    return np.asarray(found)
        raise Jammed(JAMMED.format(self.ITERATIONS))


def _unit_friction(f: CoulombFriction, speed: Array) -> Array:
    return np.asarray(-f.mu * f.radius * np.tanh(speed / f.speed))


class AppliedForces:
    """Gravity and the active forces of one mechanism."""

    def __init__(self, mechanism: Mechanism):
        self.forces = mechanism.forces
        self.gravity = np.zeros(mechanism.n, dtype=mechanism.gravity.dtype)
        for i, link in enumerate(mechanism.links):
            self.gravity[3 * i : 3 * i + 2] = link.mass * mechanism.gravity

    def generalised(self, q: Array, v: Array) -> Array:
        """Q (..., n) [N, N m]."""
        Q = np.empty_like(q)
        Q[...] = self.gravity
        for f in self.forces:
            apply(Q, f, q, v)
        return Q

    def potential(self, q: Array) -> Array:
        """Potential energy (...) [J]."""
        return -q @ self.gravity + sum((potential(f, q) for f in self.forces), start=np.zeros(q.shape[:-1]))

    def power(self, q: Array, v: Array) -> Array:
        """Power (...) [W] of everything that has no potential."""
        return sum((power(f, q, v) for f in self.forces), start=np.zeros(q.shape[:-1]))
