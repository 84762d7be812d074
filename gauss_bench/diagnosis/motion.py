"""Compute the suite's own motion of a linkage for many states at once: accelerations, flow, and the reference at any time.

In weighted coordinates b = M^(1/2) a, with the singular values of K = J M^(-1/2) = U S V^T above the tolerance (index 1),

    b = V1 S1^-1 U1^T gamma + V2 V2^T M^(-1/2) Q

Each term can be replaced, to predict the effect of a fault. Redundant rows of loops that an engine leaves open by some micrometres
contradict each other slightly; within RANK_TOLERANCE they still count as redundant.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from gauss_bench.integrate.fixed_step import dop853_fixed
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, States

RANK_TOLERANCE = 1e-4  # relative to the largest singular value, as for the projection of states
DEPENDENT = 1e-12  # the tolerance for linkages without redundant rows
SUBSTEP = 2.5e-3  # [s] for a method of order 8: an eighth of a radian at 50 rad/s, with an error of about 1e-11


@dataclass(frozen=True, eq=False)
class Parts:
    """The terms of the equations of motion at k states.

    Attributes:
        mass: (n,) diagonal of the mass matrix M.
        J, gamma: constraint Jacobian (k, m, n) and right-hand side (k, m) of J a = gamma; Q: applied forces (k, n).
        tolerance: singular values below this tolerance, relative to the largest, count as zero.
    """

    mass: Array
    J: Array
    gamma: Array
    Q: Array
    tolerance: float

    def accelerations(self) -> Array:
        """Return the accelerations a (k, n) that solve M a + J^T lambda = Q, J a = gamma, by the formula above."""
        root = np.sqrt(self.mass)
        free = self.Q / root  # M^(-1/2) Q
        if not self.J.shape[1]:
            return np.asarray(free / root)
        U, s, Vt = np.linalg.svd(self.J / root, full_matrices=False)
        keep = s > self.tolerance * s.max(axis=-1, keepdims=True, initial=0.0)
        inverse = np.where(keep, 1.0 / np.where(keep, s, 1.0), 0.0)
        prescribed = inverse * (np.swapaxes(U, -1, -2) @ self.gamma[..., None])[..., 0]  # S1^-1 U1^T gamma
        blocked = keep * (Vt @ free[..., None])[..., 0]  # V1^T M^(-1/2) Q, since V2 V2^T = I - V1 V1^T
        b = free + (np.swapaxes(Vt, -1, -2) @ (prescribed - blocked)[..., None])[..., 0]
        return np.asarray(b / root)

    @cached_property
    def unaltered(self) -> Array:
        """The accelerations (k, n) that follow from these terms, computed once."""
        return self.accelerations()

    def effect(self, **terms: Any) -> Array:
        """Return the change (k, n) of the accelerations if some of the terms mass, J, gamma and Q are replaced."""
        return replace(self, **terms).accelerations() - self.unaltered

    def multipliers(self, a: Array) -> Array:
        """Return the shortest lambda (k, m) of M a + J^T lambda = Q for given accelerations a (k, n)."""
        inverse = np.linalg.pinv(np.swapaxes(self.J, -1, -2), rcond=RANK_TOLERANCE)
        return np.asarray((inverse @ (self.Q - self.mass * a)[..., None])[..., 0])

    def without(self, rows: list[int]) -> "Parts":
        """Return the terms without the constraint rows that have these indices."""
        kept = [k for k in range(self.J.shape[1]) if k not in rows]
        return replace(self, J=self.J[:, kept], gamma=self.gamma[:, kept])


class OwnMotion:
    """The equations of motion of a linkage, solved by the suite itself.

    Attributes:
        absolute: a second solver of these equations, which also finds dry friction in joints.
        tolerance: singular values below this tolerance, relative to the largest, count as zero.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism, self.evaluator = mechanism, Evaluator(mechanism)
        self.absolute = AbsoluteCoordinates(mechanism)
        # singular values of redundant rows are as large as the gaps of loops, and must count as zero; without redundant rows, only
        # rounding counts as zero
        self.tolerance = RANK_TOLERANCE if mechanism.redundant else DEPENDENT

    def parts(self, x: States) -> Parts:
        """Return the terms of the equations of motion at states x; dry friction, which depends on the multipliers, is left out."""
        rows = self.evaluator.constraints(x.t, x.q, x.v)
        Q = self.evaluator.applied.generalised(x.q, x.v, x.t)
        return Parts(self.evaluator.mass, rows.J, rows.gamma, Q, self.tolerance)

    def second_rates(self, x: States) -> Array:
        """Return gamma (k, m) without velocity terms: the second time derivatives of the drivers' laws."""
        rows = self.evaluator.constraints
        second = np.zeros((len(x), rows.m))
        for row, law in enumerate(rows.laws, rows.joint_rows):
            second[:, row] = law(x.t)[2]
        return second

    def gaps(self, x: States) -> Array:
        """Return phi (k, h) [m, rad] of the holonomic constraints."""
        rows = self.evaluator.constraints(x.t, x.q, x.v)
        return rows.phi[:, : self.evaluator.constraints.holonomic]

    def accelerations(self, x: States) -> Array:
        """Return the accelerations (k, n) at states x."""
        if self.evaluator.friction:  # which `parts` leaves out
            return self.absolute.acceleration(x.t, x.q, x.v)
        return self.parts(x).accelerations()

    def flow(self, x: States, by: Array) -> States:
        """Return the states that the linkage reaches from states x after times `by` (k,) [s], which may be negative or zero.

        All states move at once, each with its own substep h (k, 1) [s]; s runs from 0 to 1 in every substep.
        """
        steps = max(1, int(np.ceil(np.abs(by).max(initial=0.0) / SUBSTEP)))
        k, n = x.q.shape
        h = (by / steps)[:, None]
        dt_ds = np.where(h == 0, 1.0, h)  # states with h = 0 do not move; 1 avoids division by zero

        def rate(number: int, s: float, q: Array, dq_ds: Array) -> Array:
            """Return d2q/ds2 (k n,) in the substep with this number."""
            here = States(x.t + (number + s) * h[:, 0], q.reshape(k, n), dq_ds.reshape(k, n) / dt_ds)
            return np.asarray((self.accelerations(here) * h**2).reshape(-1))

        q: Array = x.q.reshape(-1)
        dq_ds: Array = (x.v * h).reshape(-1)
        for number in range(steps):
            q, dq_ds = dop853_fixed(partial(rate, number), 0.0, q, dq_ds, 1.0)
        v = np.where(h == 0, x.v, dq_ds.reshape(k, n) / dt_ds)
        return States(x.t + by, q.reshape(k, n), v)

    def project(self, x: States) -> States:
        """Return the states x, with positions and velocities projected on the constraints."""
        pairs = [self.evaluator.project(float(t), q, v) for t, q, v in zip(x.t, x.q, x.v, strict=True)]
        return States(x.t, np.array([q for q, _ in pairs]), np.array([v for _, v in pairs]))


class TrueMotion:
    """The reference motion at any time up to `until` [s]: integrated from the nearest sample of the reference."""

    def __init__(self, motion: OwnMotion, reference: Reference):
        self.motion, self.reference, self.until = motion, reference, float(reference.t[-1])

    def at(self, t: Array) -> States:
        """Return the reference states at times t (k,); t may lie a little before the first sample or after the last."""
        r = self.reference
        after = np.clip(np.searchsorted(r.t, t), 1, len(r.t) - 1)
        nearest = after - (t - r.t[after - 1] < r.t[after] - t)  # index of the sample before t if that is nearer (True is 1)
        x = States(r.t[nearest], r.q[nearest], r.v[nearest])
        remaining = np.where(np.abs(t - x.t) < 1e-9, 0.0, t - x.t)  # [s]; times that differ by rounding count as equal
        return self.motion.flow(x, remaining) if remaining.any() else x

    def bar(self, t: Array) -> Array:
        """Return the error bars (k,) [m, rad] of the reference's samples at the times t (k,), or of the next samples after them.

        The bar is at least the floor that the rounding of parameters causes.
        """
        r = self.reference
        k = np.clip(np.searchsorted(r.t, t - 1e-9), 0, len(r.t) - 1)
        return np.fmax(r.error_q, r.floor_q)[k]  # fmax ignores NaN
