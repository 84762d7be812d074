"""The equation of motion of a linkage with one degree of freedom, written in a single coordinate, the crank angle.

The crank angle theta takes the place of time in the geometry: an imagined driver prescribes that the angle of the crank is theta,
and adds a row of its own to J. Let q(theta) be the position in which the loops are closed. Its derivatives d = dq/dtheta and e =
d2q/dtheta2 follow from J d = 0, d_crank = 1 and J e = gamma(q, d), e_crank = 0. With the crank's speed w = theta', the velocities
are v = d w and the accelerations a = d w' + e w^2. The virtual work of M a - Q along d vanishes, hence

    w' = d . (Q - M e w^2) / (d . M d)

Only friction in joints needs the multipliers lambda. Since R = Q - M a does no work along d, they follow from

    [J^T u] (lambda, tau) = R,    tau = 0

with the unit vector u of the crank's coordinate, and the torque tau of the imagined driver. R contains the friction forces W
N(lambda), with the directions W of friction and the loads N(lambda) of the joints. Source: Nikravesh, Computer-Aided Analysis of
Mechanical Systems (1988), section 12.6 (embedding).
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from gauss_bench.linkage.closure import CLOSED
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.forces import AppliedForces, JointFriction
from gauss_bench.mechanism.model import AngleDriver, Mechanism
from gauss_bench.mechanism.motion_laws import constant
from gauss_bench.terms import Array

LARGEST_TURN = 0.15  # [rad] between two closures; with a predictor, Newton's method keeps its branch at much larger turns
NEWTON_STEPS = 12  # largest number of Newton steps of a closure
Closed = tuple[Array, Array, Array]  # q, dq/dtheta and d2q/dtheta2 (k, n) at k crank angles
Levels = tuple[Array, Array, Array]  # q, v, a (k, n)


def _state(closed: Closed, w: Array, w_dot: Array) -> Levels:
    """Return q, v, a (k, n) at closed positions, for crank speeds w and accelerations w_dot (k,)."""
    q, d, e = closed
    return q, d * w[:, None], d * w_dot[:, None] + e * w[:, None] ** 2


class LostClosure(ArithmeticError):
    """The linkage cannot be closed at an angle: it lies beyond a limit of motion, or at a singular position."""


class MinimalCoordinate:
    """The equation of motion in the angle of the crank, or of the link that is driven.

    Attributes:
        crank: index of this angle in q.
        constraints: the constraint rows of the linkage, then the row of an imagined driver that prescribes the angle, which takes
            the place of time.
        last: the last position in which the loops were closed, with its derivatives; the next position is searched from there.
    """

    def __init__(self, mechanism: Mechanism):
        link = mechanism.driver.link if mechanism.driver else mechanism.crank
        if link is None:
            raise ValueError(f"{mechanism.name} has neither crank nor driven link")
        self.mechanism = mechanism
        self.crank = 3 * link + 2
        # the imagined driver, which replaces the linkage's drivers: its value is the independent variable itself
        driver = AngleDriver("crank", constant(0.0, 1.0), link)
        self.constraints = Constraints(replace(mechanism, drivers=(driver,), knife_edges=()))
        self.applied = AppliedForces(mechanism)
        self.friction = JointFriction(mechanism)
        self.mass = mechanism.mass
        self.redundant = mechanism.redundant > 0
        self.reset()

    def reset(self) -> None:
        """Forget the last closed position, so that the next position is searched from the assembled one."""
        still = np.zeros(self.mechanism.n)
        self.last = (self.mechanism.q0, still, still)

    def _solve(self, J: Array, rhs: Array) -> Array:
        """Solve J x = rhs for x (k, n); redundant rows are consistent, so least squares is exact."""
        if self.redundant:
            Q, J = np.linalg.qr(J)
            rhs = (np.swapaxes(Q, -1, -2) @ rhs[..., None])[..., 0]
        return np.asarray(np.linalg.solve(J, rhs[..., None])[..., 0])

    def geometry(self, theta: Array) -> Closed:
        """Return q, dq/dtheta and d2q/dtheta2 (k, n) at crank angles (k,), searched from the last closed position.

        Raises:
            LostClosure: Newton's method does not converge.
        """
        q, d, e = (np.tile(x, (len(theta), 1)) for x in self.last)
        total_turn = theta - q[:, self.crank]  # (k,) turns from the last closed position to the angles, made in equal parts
        parts = max(1, int(np.ceil(np.abs(total_turn).max(initial=0.0) / LARGEST_TURN)))
        for part in range(1, parts + 1):
            goal = theta - total_turn * (1 - part / parts)
            turn = (goal - q[:, self.crank])[:, None]
            try:  # Newton's method starts at the Taylor polynomial of second order from the position before
                q, d, e = self._close(q + turn * (d + turn / 2 * e), goal)
            except np.linalg.LinAlgError as error:
                between = "" if goal.min() == goal.max() else f" and {goal.max():.6f}"
                raise LostClosure(f"singular position near crank angles {goal.min():.6f}{between} rad") from error
        self.last = (q[-1], d[-1], e[-1])
        return q, d, e

    def _close(self, q: Array, theta: Array) -> Closed:
        """Close the linkage at crank angles (k,) by Newton's method from q (k, n); return q, dq/dtheta and d2q/dtheta2.

        The iteration is independent of `mechanism/close.py`, which closes the linkages that the reference checks.

        Raises:
            LostClosure: Newton's method does not converge.
        """
        still = np.zeros_like(q)  # velocities, on which positions do not depend
        rows = self.constraints(theta, q, still)
        for _ in range(NEWTON_STEPS):
            step = self._solve(rows.J, -rows.phi)
            q = q + step
            rows = self.constraints(theta, q, still)
            if np.abs(step).max() < 1e-9:  # convergence is quadratic, so that the next step would be below rounding
                break
        gaps = np.abs(rows.phi).max(axis=1, initial=0.0)
        if not (gaps < CLOSED).all():
            raise LostClosure(f"cannot be closed near crank angle {theta[gaps.argmax()]:.6f} rad")
        d = self._solve(rows.J, -rows.phi_t)
        # with the velocities d, gamma is the right-hand side of J e = gamma
        return q, d, self._solve(rows.J, self.constraints(theta, q, d).gamma)

    def state(self, theta: Array, w: Array, w_dot: Array) -> Levels:
        """Return q, v, a (k, n) for crank angles, speeds and accelerations (k,)."""
        return _state(self.geometry(theta), w, w_dot)

    def state_at(self, t: float) -> Levels:
        """Return q, v, a (1, n) of a driven linkage at a time [s] of the driver's law."""
        assert self.mechanism.driver is not None
        return self.state(*(np.atleast_1d(x).astype(float) for x in self.mechanism.driver.law(t)))

    def free_state(self, theta: Array, w: Array) -> Levels:
        """Return q, v, a (k, n) for crank angles and speeds (k,); the accelerations follow from the applied forces."""
        closed = self.geometry(theta)
        return _state(closed, w, self._acceleration(closed, w))

    def acceleration(self, theta: Array, w: Array) -> Array:
        """Return the crank acceleration (k,) [rad/s^2] at crank angles and speeds (k,)."""
        return self._acceleration(self.geometry(theta), w)

    def _acceleration(self, closed: Closed, w: Array) -> Array:
        """Return the crank acceleration (k,) at closed positions and crank speeds w (k,): w' = d . (Q - M e w^2) / (d . M d)."""
        q, d, e = closed
        Q = self.applied.generalised(q, d * w[:, None])
        force = Q - self.mass * e * w[:, None] ** 2
        if self.friction:
            force = force + self._friction(q, d, d * w[:, None], force)
        return np.asarray((d * force).sum(-1) / (d * d * self.mass).sum(-1))

    def _friction(self, q: Array, d: Array, v: Array, force: Array) -> Array:
        """Return the generalised friction forces W N(lambda) (k, n) at states q, v, with d = dq/dtheta.

        `force` (k, n) is Q - M e w^2 without friction. Friction changes lambda, and lambda changes friction; `solve_multipliers`
        finds the multipliers lambda that satisfy both relations.
        """
        W = self.friction.directions(q, v)
        columns = np.concatenate([force[..., None], W], axis=-1)  # all forces but friction, and friction of unit load in each joint
        inertia = d * self.mass / (d * d * self.mass).sum(-1, keepdims=True)  # M d / (d . M d)
        balanced = columns - inertia[..., None] * (d[:, None, :] @ columns)  # Q - M a for each column, balanced by constraints
        J = self.constraints(q[:, self.crank], q, v).J
        # J^T lambda = balanced; the last multiplier is that of the crank's row, which is zero
        solution = np.linalg.solve(np.swapaxes(J, -1, -2), balanced)[:, :-1]
        multipliers = self.friction.solve_multipliers(solution[..., 0], solution[..., 1:])
        return np.asarray((W @ self.friction.loads(multipliers)[..., None])[..., 0])

    def angles_reached(self) -> tuple[float, float]:
        """Return the lowest and the highest crank angle [rad], to one degree, between which the loops can be closed.

        The search begins at the assembled position and goes at most one turn in each direction.
        """
        start = float(self.mechanism.q0[self.crank])
        ends = []
        for sign in (-1.0, 1.0):
            self.reset()
            reached = 0  # [degrees] from the start
            for stride in (8, 1):  # [degrees] first long strides until one fails, then short ones from the last closed angle
                with suppress(LostClosure):
                    for degree in range(reached + stride, 361, stride):
                        self.geometry(np.array([start + sign * np.radians(degree)]))
                        reached = degree
            ends.append(start + sign * np.radians(reached))
        self.reset()
        return ends[0], ends[1]
