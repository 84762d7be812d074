"""Applied forces of a linkage: generalised force Q, potential energy and the power of what has no potential.

A force comes to loads (`lowered` in model.py): laws on scalar coordinates, whose formulas stand in `coordinates.py`, and constant
forces at points. All are evaluated together, for one state, q (n,), or a batch, q (..., n). Power that no potential accounts for
(dampers, forces that turn with a link) is what the energy balance of a trajectory integrates.

Dry friction stands apart, because it depends on the loads of the joints and with them on the accelerations. With N_k the load that
pair k carries and s its relative speed, the constraint force counts with the active forces (Yuan and Ge, 2016, eq. 3):

    M a + J^T lambda = Q + W N(lambda),    W_k = -mu_k r_k tanh(s_k / speed_k) ds_k/dv        (r_k = 1 for a slide)
    N = |(lambda_x, lambda_y)| of a pin,   N = |lambda_normal| of a slide

W is known from the state, N from lambda, and lambda from a: a fixed point, found by iteration from the motion without friction. It
contracts unless mu is so large that friction feeds the loads that cause it.
"""

from dataclasses import replace
from typing import NamedTuple, assert_never

import numpy as np

from gauss_bench.mechanism.coordinates import Real, Stack, Stacked, energy, gradient, groups, loss, push
from gauss_bench.mechanism.model import GROUND, Angle, Force, Law, Mechanism, PointForce, Prismatic, Torque, factor_of, loads
from gauss_bench.terms import Array


class _Numbers(NamedTuple):
    """Those of many laws (k,); where all are zero, the float zero."""

    k: Real
    c: Real
    rest: Real
    bias: Real


def _numbers(laws: list[Law]) -> _Numbers:
    many = (np.array([getattr(law, key) for law in laws]) for key in _Numbers._fields)
    return _Numbers(*(x if x.any() else 0.0 for x in many))


class AppliedForces:
    """Gravity and the active forces of one mechanism.

    Raises:
        TypeError: a force of a kind that does not say what it comes to.
    """

    def __init__(self, mechanism: Mechanism):
        self.n = mechanism.n
        self.gravity = np.zeros(mechanism.n, dtype=mechanism.gravity.dtype)
        for i, link in enumerate(mechanism.links):
            self.gravity[3 * i : 3 * i + 2] = link.mass * mechanism.gravity
        laws: list[Law] = []
        self.pushes: list[PointForce] = []
        self.varying = [_Varying(mechanism, f) for f in mechanism.varying]
        for load in loads(f for f in mechanism.forces if not factor_of(f)):
            match load:
                case Law():
                    laws.append(load)
                case PointForce():
                    self.pushes.append(load)
                case _:
                    assert_never(load)
        self.stack = Stack(len(mechanism.links))
        kinds = groups(self.stack, [law.coordinate for law in laws])
        self.groups = [(group, _numbers([laws[i] for i in group.which])) for group in kinds]
        self.moving = [(group, law) for group, law in self.groups if not group.constant]
        self.points = self.stack.points([f.point for f in self.pushes])
        self.vectors = self.stack.vectors([f.frame for f in self.pushes], [f.value for f in self.pushes])
        self.stack.close()
        self.in_world = np.array([f.frame == GROUND for f in self.pushes], dtype=bool)
        self._turning([law for law in laws if isinstance(law.coordinate, Angle)])
        columns = [column for group, _ in self.moving for column in group.columns]
        pushed = 3 * self.stack.links[self.points]
        self.columns = np.concatenate([np.zeros(0, dtype=int), *columns, pushed, pushed + 1, pushed + 2])
        self.scatter = np.zeros((len(self.columns), self.n + 3))
        self.scatter[np.arange(len(self.columns)), self.columns] = 1.0

    def _turning(self, laws: list[Law]) -> None:
        """Laws on angles are affine in the state: Q = steady - stiffness q - damping v on the angles that have any."""
        rows = np.array([gradient(law.coordinate, np.zeros_like(self.gravity)) for law in laws]).reshape(-1, self.n)
        k, c, steady = (np.array(x) for x in ([x.k for x in laws], [x.c for x in laws], [x.bias + x.k * x.rest for x in laws]))
        self.steady = self.gravity + steady @ rows
        self.turned = np.flatnonzero(rows[(k != 0) | (c != 0)].any(axis=0))
        part = rows[:, self.turned]
        self.stiffness, self.damping = (part.T * k) @ part, (part.T * c) @ part
        self.stiff, self.damped = bool(self.stiffness.any()), bool(self.damping.any())

    def generalised(self, q: Array, v: Array, t: float | Array | None = None) -> Array:
        """Q (..., n) [N, N m] at states q, v (..., n) and times t (...) [s], which only forces that vary need.

        Raises:
            TypeError: a force varies with time, and none is given.
        """
        Q = self._steady(q, v)
        for force in self.varying:
            Q = Q + force(q, v, t)
        return Q

    def _steady(self, q: Array, v: Array) -> Array:
        Q = np.empty_like(q)
        Q[...] = self.steady
        if self.stiff:
            Q[..., self.turned] -= q[..., self.turned] @ self.stiffness
        if self.damped:
            Q[..., self.turned] -= v[..., self.turned] @ self.damping
        if not len(self.columns):
            return Q
        x = self.stack.at(q, v)
        values = [entry for group, law in self.moving for entry in push(group.at(x), law)]
        if self.pushes:
            values += self._push(x)
        Q += (np.concatenate(values, axis=-1) @ self.scatter)[..., : self.n]
        return Q

    def _push(self, x: Stacked) -> tuple[Array, Array, Array]:
        """Forces at points as entries of x, y, theta of their links."""
        force, arm = x.directions(self.vectors), x.directions(self.points)
        return force.real, force.imag, (arm.conj() * force).imag

    def potential(self, q: Array) -> Array:
        """Potential energy (...) [J]; constant torques and world-fixed forces have one too, in unwrapped angles."""
        x = self.stack.at(q, np.zeros_like(q))
        at = x.ends(self.points)
        held = -(x.directions(self.vectors).conj() * (at.z + at.r)).real[..., self.in_world].sum(-1)
        return np.asarray(-q @ self.gravity + held + sum(_sum(energy(group.at(x), law)) for group, law in self.groups))

    def power(self, q: Array, v: Array, t: float | Array | None = None) -> Array:
        """Power (...) [W] of everything that has no potential."""
        x = self.stack.at(q, v)
        at = x.ends(self.points)
        moved = (x.directions(self.vectors).conj() * (at.u + 1j * at.omega * at.r)).real[..., ~self.in_world].sum(-1)
        gained = sum((force(q, v, t) * v).sum(-1) for force in self.varying)
        return np.asarray(moved + gained - sum(_sum(loss(group.at(x), law)) for group, law in self.groups))


class _Varying:
    """A force that varies: a factor times the steady force that it is of."""

    def __init__(self, mechanism: Mechanism, force: Force):
        factor = factor_of(force)
        assert factor is not None
        assert isinstance(force, (Torque, PointForce))
        self.name, self.factor = force.name, factor
        self.size = float(np.linalg.norm(np.atleast_1d(force.value).astype(float))) or 1.0
        steady = replace(force, factor=None)
        self.steady = AppliedForces(replace(mechanism, forces=(steady,), gravity=0.0 * mechanism.gravity))

    def __call__(self, q: Array, v: Array, t: float | Array | None) -> Array:
        """Its share of Q (..., n)."""
        if t is None:
            raise TypeError(f"force {self.name} varies with time, and no time is given")
        Q = self.steady.generalised(q, v)
        along = (Q * v).sum(-1) / self.size
        return np.asarray(Q * self.factor(t, along)[..., None])


def _sum(x: Real) -> Real:
    """Of many laws (..., k)."""
    return x if isinstance(x, float) else x.sum(-1)


JAMMED = "the friction does not settle in {} iterations: mu is too large for these joints, or they jam"


class Jammed(ArithmeticError):
    """The loads of joints with friction do not settle: each increases the other, as in a slide that jams."""


class JointFriction:
    """Dry friction in the joints of one mechanism; pairs (p) with mu = 0 are left out, so that nothing is done for them.

    Attributes:
        acting: (p,) friction and pair.
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
        self.lever = np.array([f.mu * f.radius for f, _ in self.acting])
        self.speed = np.array([f.speed for f, _ in self.acting])
        self.stack = Stack(len(mechanism.links))
        self.groups = groups(self.stack, [pair.motion for _, pair in self.acting])
        self.stack.close()

    def __bool__(self) -> bool:
        return len(self.rows) > 0

    def directions(self, q: Array, v: Array) -> Array:
        """W (..., n, p): generalised friction for unit loads at state(s) (..., n)."""
        W = np.zeros((*q.shape[:-1], q.shape[-1] + 3, len(self.rows)), dtype=q.dtype)
        x = self.stack.at(q, v)
        for group in self.groups:
            motion = group.at(x)
            law = -self.lever[group.which] * np.tanh(motion.rate / self.speed[group.which])
            for column, entry in zip(group.columns, motion.entries, strict=True):
                W[..., column, group.which] += entry * law
        return W[..., : q.shape[-1], :]

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
        multipliers = base
        with np.errstate(over="ignore", invalid="ignore"):  # what grows beyond bounds has not settled
            for _ in range(self.ITERATIONS):
                before, multipliers = multipliers, base + (gain @ self.loads(multipliers)[..., None])[..., 0]
                change, scale = np.abs(multipliers - before).max(-1, initial=0.0), np.abs(multipliers).max(-1, initial=0.0)
                if (change <= self.TOLERANCE * scale).all():
                    return np.asarray(multipliers)
        raise Jammed(JAMMED.format(self.ITERATIONS))
