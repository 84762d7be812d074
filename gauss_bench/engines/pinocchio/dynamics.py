"""Accelerations of a constrained tree in Pinocchio, called from Python: the suite computes tau, and Pinocchio the accelerations."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gauss_bench.engines.pinocchio.across_releases import find_algorithm, prepare
from gauss_bench.engines.pinocchio.forces import DrivingTorques, TreeForces
from gauss_bench.engines.pinocchio.tree import Multibody
from gauss_bench.engines.shared import finite_acceleration
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

SOLVED = 1e-6  # largest residual relative to accelerations: independent rows reach 1e-13, redundant rows that drift exceed it


class ConstrainedDynamics:
    """A function (t, y, dy) -> tree accelerations (n,), for the suite's integrators.

    Pinocchio's proximal iterations solve M y'' + h = tau + J^T f and J y'' + mu (f - f_before) = gamma, where f_before are the
    constraint forces of the previous iteration. So mu times the last change of f is the residual of the constraints.

    Attributes:
        solve: Pinocchio's algorithm for constrained dynamics.
        rows, row_data: Pinocchio's constraint models, which close the loops, and their work space.
        prox: Pinocchio's settings of the proximal iterations, which also hold the result of the last solution.
        residual_limit: largest last change of the constraint forces at which a solution is accepted without a closer check.
        drive: the driving torques of prescribed motions.
        evaluations: number of calls.
    """

    def __init__(self, body: Multibody, forces: TreeForces, options: Mapping[str, Any], gains: tuple[float, float]):
        """Prepare the solver for a model, with Baumgarte's gains Kp [1/s^2], Kd [1/s]."""
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
        self.residual_limit = SOLVED / options["mu"]  # of the last change of forces f; mu times it is the residual [m/s^2]
        self.drive = DrivingTorques(forces, gains)
        self.evaluations = 0

    def __call__(self, t: float, y: Array, dy: Array) -> Array:
        """Return the accelerations (n,) at time t [s] and a tree state y, dy (n,), with all forces and drivers."""
        self.evaluations += 1
        tau = self.forces(y, dy, t)
        return self.drive(self._solve, t, y, dy, tau) if self.drive.laws else self._solve(t, y, dy, tau)

    def bare(self, y: Array, dy: Array) -> Callable[[], Array]:
        """Return a function that calls only Pinocchio's solver at a tree state y, dy (n,), without any check of the result."""
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

        Pinocchio's `relative_residual` is the last change of the constraint forces f in the proximal iteration, whose equation J a
        + mu (f - f_before) = gamma makes mu times this change the residual. Two other fields of `prox` cannot be used.
        `absolute_residual` is as large as the accelerations even if they are exact (Pinocchio 4.1). `iter` can reach its limit:
        with redundant rows f keeps changing in directions that have no effect.

        Raises:
            RunFailure: the accelerations are not finite, or violate the constraints.
        """
        finite_acceleration(t, a, "Pinocchio")
        missed, size = self.prox.mu * self.prox.relative_residual, max(1.0, float(np.abs(a).max()))  # [m/s^2]
        if not missed <= SOLVED * size:
            raise RunFailure(
                Status.NOT_CONVERGED,
                f"t = {t:.6g} s: proximal iteration {self.prox.iter} still misses the constraints by {missed:.1e} m/s^2 where "
                f"accelerations are {size:.1e}; redundant rows that have drifted apart do this: try projection or a smaller step",
            )
