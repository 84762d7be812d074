"""Compute, by calls from Python, the forces of a linkage on tree coordinates and the accelerations of the constrained tree.

Pinocchio has no springs, dampers or drives: the suite computes tau, and Pinocchio the accelerations.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from gauss_bench.engines.pinocchio.across_releases import find_algorithm, prepare
from gauss_bench.engines.pinocchio.tree import Multibody
from gauss_bench.engines.shared import driven_rows, finite_acceleration
from gauss_bench.engines.tree import Tree, turning
from gauss_bench.mechanism.evaluate import Constraints
from gauss_bench.mechanism.forces import AppliedForces
from gauss_bench.mechanism.model import Force, LengthDriver, Mechanism, factor_of
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

SOLVED = 1e-6  # largest residual of a solution relative to its accelerations: independent rows reach 1e-13, redundant rows that
#                have drifted apart exceed the limit
AFFINE = 1e-10  # largest relative deviation from an affine function of a force that counts as affine; rounding leaves 1e-14


class TreeForces:
    """A function (y, dy, t) -> tau (n,), all applied forces except gravity, as forces on the tree coordinates.

    Affine forces, a constant plus a linear function of the tree coordinates y and rates dy (torques, dampers of joints, springs
    along slides), follow from three constant arrays, as a user of Pinocchio would compute them. The others, Q_others, act on links
    with the velocities v = T dy, and are evaluated in every call:

        tau = constant + stiffness y + damping dy + T^T Q_others(q, v, t)

    Attributes:
        weightless: the mechanism without gravity; Pinocchio itself computes the weight of the links.
        others: the forces that are not affine, or that vary with time or with the direction of motion.
        motion: function y -> absolute positions q and T = dq/dy.
        inertia: (n, n) mass matrix of the tree at the start, which sets the size of trial torques.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, body: Multibody):
        """Sort the forces of a mechanism into affine ones and others."""
        self.tree, self.weightless = tree, replace(mechanism, gravity=np.zeros(2))
        self.constant, slopes = np.zeros(tree.n), np.zeros((tree.n, 2 * tree.n))
        self.others: tuple[Force, ...] = ()
        for f in mechanism.forces:
            affine = None if factor_of(f) else self._fit_affine(f)
            if affine is None:
                self.others += (f,)
            else:
                constant, slope = affine
                self.constant, slopes = self.constant + constant, slopes + slope
        self.stiffness, self.damping = slopes[:, : tree.n].copy(), slopes[:, tree.n :].copy()
        self.has_stiffness, self.has_damping = bool(self.stiffness.any()), bool(self.damping.any())
        self.applied = AppliedForces(replace(self.weightless, forces=self.others))
        self.motion = Motion(tree, body)
        self.drivers = mechanism.drivers
        y, _ = tree.relative(mechanism.q0, mechanism.v0)
        self.inertia = body.mass(y)

    def _fit_affine(self, f: Force) -> tuple[Array, Array] | None:
        """Return the constant (n,) and the slope (n, 2n) of a force as a function of y, dy (2n,); None if it is not affine."""
        n, applied = self.tree.n, AppliedForces(replace(self.weightless, forces=(f,)))
        # the state zero gives the constant, unit states give the slope, and random states show whether the force is affine
        states = np.vstack([np.zeros(2 * n), np.eye(2 * n), np.random.default_rng(0).uniform(-3.0, 3.0, (8, 2 * n))])
        q, v, _ = self.tree.absolute(states[:, :n], states[:, n:], np.zeros((len(states), n)))
        tau = self.tree.forces(q, applied.generalised(q, v))
        constant, slope = tau[0], (tau[1 : 2 * n + 1] - tau[0]).T
        error = np.abs(constant + states @ slope.T - tau).max()
        return (constant, slope) if error <= AFFINE * np.abs(tau).max() else None

    def __call__(self, y: Array, dy: Array, t: float) -> Array:
        tau = self.constant
        if self.has_damping:
            tau = tau + self.damping.dot(dy)
        if self.has_stiffness:
            tau = tau + self.stiffness.dot(y)
        if self.others:
            q, T = self.motion(y)
            tau = tau + self.applied.generalised(q, T.dot(dy), t).dot(T)
        return tau


class DrivingTorques:
    """The driving torques and forces that give driven angles, slides and lengths their prescribed accelerations.

    Let y be the tree coordinates, and x (k,) the driven coordinates of the k drivers, with rates x' = R y'. Without any driving
    torque the accelerations are a0. With a trial torque on driver j alone they are a_j; the trial torques are about as large as the
    needed ones, so that few digits are lost by cancellation. The factors s_j of the trial torques follow from

        y'' = a0 + sum s_j (a_j - a0),    R y'' + R' y' = law''(t) - Kd (x' - law'(t)) - Kp (x - law(t))

    where Kp and Kd are Baumgarte's gains. The rows of R of driven angles and slides are constant. For a driven length L, with G =
    dL/dq and T = dq/dy, the row is G T. The rest of L'', G dT/dt y' + dG/dt v, follows from the linkage's own constraint row.
    """

    def __init__(self, forces: TreeForces, gains: tuple[float, float]):
        self.forces, self.gains = forces, gains
        self.laws = [driver.law for driver in forces.drivers]
        # (k, n) and (k,) for the k drivers: x = rows . y + origin for driven angles and slides; a length's row stays zero
        self.rows, self.origin = np.zeros((len(self.laws), forces.tree.n)), np.zeros(len(self.laws))
        self.lengths = [k for k, driver in enumerate(forces.drivers) if isinstance(driver, LengthDriver)]
        others = [k for k in range(len(self.laws)) if k not in self.lengths]  # drivers of angles and slides
        self.rows[others], self.origin[others] = driven_rows(forces.weightless, forces.tree)
        y, dy = forces.tree.relative(forces.weightless.q0, forces.weightless.v0)
        R, _, _ = self._rows_at(0.0, y, dy)
        # (k,) R M R^T of each driver: the inertia of the tree at the start, along the driver's coordinate
        self.driver_inertias = np.einsum("ij,jk,ik->i", R, forces.inertia, R)

    @cached_property
    def constraints(self) -> Constraints:
        """The constraint rows of the linkage itself; driven lengths need the derivatives in these rows."""
        return Constraints(self.forces.weightless)

    def _rows_at(self, t: float, y: Array, dy: Array) -> tuple[Array, Array, Array]:
        """Return R (k, n), x (k,) and R' y' (k,) for the k drivers at time t [s] and a tree state y, dy (n,)."""
        x, bias = self.origin + self.rows @ y, np.zeros(len(self.laws))
        if not self.lengths:
            return self.rows, x, bias
        R = self.rows.copy()
        q, T = self.forces.motion(y)
        at_rest = self.forces.tree.absolute(y, dy, np.zeros_like(dy)).a  # accelerations if y'' = 0
        terms = self.constraints(t, q, T @ dy)
        # A driver's constraint row has phi = x - law, and J a = gamma means x'' = law''; so x'' = J a - gamma + law''.
        for k in self.lengths:
            row, law = self.constraints.joint_rows + k, self.laws[k](t)
            R[k] = terms.J[row] @ T
            x[k] = float(terms.phi[row]) + float(law[0])
            bias[k] = float(terms.J[row] @ at_rest) + float(law[2]) - float(terms.gamma[row])
        return R, x, bias

    def __call__(self, solve: Callable[..., Array], t: float, y: Array, dy: Array, tau: Array) -> Array:
        """Return the accelerations (n,) at t, y, dy under the forces tau (n,) and the driving torques.

        Args:
            solve: function (t, y, dy, tau) -> accelerations (n,) under the forces tau (n,) alone.
        """
        value, rate, second = np.array([law(t) for law in self.laws], dtype=float).T
        kp, kd = self.gains
        R, x, bias = self._rows_at(t, y, dy)
        wanted = second - bias - kd * (R @ dy - rate) - kp * (x - value)  # (k,) value that R y'' must have
        free = solve(t, y, dy, tau)  # (n,) a0
        missing = wanted - R @ free  # (k,) part that the driving torques supply
        probes = self.driver_inertias * np.maximum(1.0, np.abs(missing))  # (k,) trial torques of about the size that is needed
        effects = np.array([solve(t, y, dy, tau + probe) - free for probe in probes[:, None] * R])  # (k, n) a_j - a0
        try:
            accelerations: Array = free + np.linalg.solve(R @ effects.T, missing) @ effects
        except np.linalg.LinAlgError as error:
            raise RunFailure(Status.RANK_LOST, f"t = {t:.6g} s: no driving torque gives the prescribed acceleration") from error
        return accelerations


class Motion:
    """A function y -> absolute positions q (3 links,) and T (3 links, n) with v = T dy; it is ten times faster than `Tree`.

    If a single joint moves, at unit rate, the links beyond it form one rigid body. The joint's column of Pinocchio's world Jacobian
    holds this body's velocity at the world's origin, [u, w], and its angular speed omega. The centre of mass of a link of the body,
    at [x, y], has the velocity

        [u - omega y, w + omega x]

    Attributes:
        centres: for each link Pinocchio's joint that carries it, and the centre of mass (3,) [m] in this joint's frame.
        theta0, turns: (links,) and (links, n) angles of the links theta = theta0 + turns . y.
        carried: (links, n) 1 where a joint moves a link, and 0 elsewhere.
    """

    def __init__(self, tree: Tree, body: Multibody):
        self.model, self.data, self.jacobians = body.model, body.model.createData(), body.pin.computeJointJacobians
        carriers = [body.carriers[i] for i in range(tree.links)]
        self.centres = [(joint, np.array(placement.translation)) for joint, placement in carriers]
        # in `angles` and in `carried` the last row, with the index GROUND = -1, is the ground's, and is removed
        angles = turning(tree)
        self.theta0, self.turns = angles.constants[:-1], angles.rows[:-1]
        self.carried = np.zeros((tree.links + 1, tree.n))
        for b in tree.branches:
            self.carried[b.link] = self.carried[b.parent]
            self.carried[b.link, b.at : b.at + len(b.coordinates)] = 1.0
        self.carried = self.carried[:-1]

    def __call__(self, y: Array) -> tuple[Array, Array]:
        J = self.jacobians(self.model, self.data, y)
        placements = self.data.oMi  # of the joints' frames in the world
        centres = np.array([placements[joint].act(centre) for joint, centre in self.centres])
        q, T = np.empty(3 * len(centres)), np.empty((3 * len(centres), len(y)))
        # rows of J: 0 and 1 are the velocity at the origin, 5 the angular speed about z
        q[0::3], q[1::3], q[2::3] = centres[:, 0], centres[:, 1], self.theta0 + self.turns.dot(y)
        T[0::3] = self.carried * (J[0] - centres[:, 1, None] * J[5])
        T[1::3] = self.carried * (J[1] + centres[:, 0, None] * J[5])
        T[2::3] = self.turns
        return q, T


class ConstrainedDynamics:
    """A function (t, y, dy) -> tree accelerations (n,), for the suite's integrators.

    Pinocchio's proximal iterations solve M y'' + h = tau + J^T f and J y'' + mu (f - f_before) = gamma, where f_before are the
    constraint forces of the previous iteration. So mu times the last change of f is the residual of the constraints, whatever the
    sign and frame of f.

    Attributes:
        solve: Pinocchio's algorithm for constrained dynamics.
        rows, row_data: Pinocchio's constraint models, which close the loops, and their work space.
        prox: Pinocchio's settings of the proximal iterations, which also hold the result of the last solution.
        residual_limit: largest last change of the constraint forces at which a solution is accepted without a closer check.
        evaluations: number of calls.
    """

    def __init__(self, body: Multibody, forces: TreeForces, options: Mapping[str, Any], gains: tuple[float, float]):
        pin = body.pin
        self.model, self.forces, self.solve = body.model, forces, find_algorithm(pin, options["algorithm"])
        self.data: Any = body.model.createData()
        self.rows: Any = body.constraints(gains)
        self.row_data: Any = pin.StdVec_RigidConstraintData()
        for row in self.rows:
            self.row_data.append(row.createData())
        prepare(pin, options["algorithm"], self.model, self.data, self.rows, self.row_data)
        accuracies = options["absolute_accuracy"], options["relative_accuracy"]
        self.prox: Any = pin.ProximalSettings(*accuracies, options["mu"], int(options["max_iter"]))
        self.residual_limit = SOLVED / options["mu"]  # mu times the last change of the forces f is the residual [m/s^2]
        self.drive = DrivingTorques(forces, gains)
        self.evaluations = 0

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        self.evaluations += 1
        tau = self.forces(y, dy, t)
        return self.drive(self._solve, t, y, dy, tau) if self.drive.laws else self._solve(t, y, dy, tau)

    def bare(self, y: Array, dy: Array) -> Callable[[], Array]:
        """Return a call of Pinocchio's solver alone at a tree state y, dy (n,), without any check of the result."""
        tau = np.ascontiguousarray(self.forces(y, dy, 0.0))
        return lambda: self.solve(self.model, self.data, y, dy, tau, self.rows, self.row_data, self.prox)

    def _solve(self, t: float, y: Array, dy: Array, tau: Array) -> Array:
        """Return the accelerations (n,) at time t [s] and a tree state y, dy (n,) under forces tau (n,).

        Raises:
            RunFailure: the accelerations are not finite, or violate the constraints.
        """
        a: Array = self.solve(self.model, self.data, y, dy, tau, self.rows, self.row_data, self.prox)
        if not self.prox.relative_residual <= self.residual_limit:  # NaN fails too
            self._check_residual(t, a)
        return a

    def _check_residual(self, t: float, a: Array) -> None:
        """Check the residual of a solution relative to its accelerations a (n,).

        `relative_residual` is the last change of the constraint forces f. Two other fields of `prox` cannot be used.
        `absolute_residual` is as large as the accelerations even if they are exact (Pinocchio 4.1). `iter` can reach its limit:
        with redundant rows f keeps changing in directions that have no effect.
        """
        finite_acceleration(t, a, "Pinocchio")
        missed, size = self.prox.mu * self.prox.relative_residual, max(1.0, float(np.abs(a).max()))  # [m/s^2]
        if not missed <= SOLVED * size:
            raise RunFailure(
                Status.NOT_CONVERGED,
                f"t = {t:.6g} s: proximal iteration {self.prox.iter} still misses the constraints by {missed:.1e} m/s^2 where "
                f"accelerations are {size:.1e}; redundant rows that have drifted apart do this: try projection or a smaller step",
            )
