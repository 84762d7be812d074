"""Accelerations of an Exudyn system at a given state, and the comparison of this system with its linkage.

Exudyn itself (`BuiltIn`) differentiates C_q v by one-sided differences, which limits the accuracy of accelerations to about 1e-7,
and ignores the second derivatives of motion laws. `Readout` reads the mass matrix, the forces and the Jacobian C_q of the
constraints, and `solve_kkt` solves the equations.
"""

from typing import Any

import numpy as np

from gauss_bench.engines.exudyn.across_releases import compute_gaps, write_nothing
from gauss_bench.engines.exudyn.items import System
from gauss_bench.engines.shared import require_agreement, size
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.terms import Array, Terms
from gauss_bench.trajectory import RunFailure, Status

DIFFERENCE = 1e-3  # = d [rad, m] between points of the differences: truncation d^4/30 and rounding 1e-16/d are both near 1e-13
AGREEMENT = 1e-9  # relative: far above the rounding of stiff springs, far below an error of the model
REDUNDANT = 1e-12  # singular values of the KKT matrix below this share of the largest one count as zero: rounding leaves 1e-17,
#                    and independent rows of usable linkages 1e-7 or more
CLOSED = 1e-12  # [m, rad] largest residual of a closed state: only at closed states are forces along slides exact


class BuiltIn:
    """A function (q, v) -> the accelerations (n,) that Exudyn computes when a run starts from the state q, v (n,)."""

    def __init__(self, system: System, settings: Any):
        """Prepare a solver of Exudyn that never runs, but computes initial accelerations with the settings of runs."""
        self.system, self.settings, self.initial = system, settings, system.exu.ConfigurationType.Initial
        self.solver = system.exu.MainSolverImplicitSecondOrder()
        self.solver.InitializeSolver(system.mbs, settings)

    def __call__(self, q: Array, v: Array) -> Array:
        data = self.system.mbs.systemData
        data.SetODE2Coordinates(q - self.system.mechanism.q0, self.initial)  # Exudyn's coordinates are displacements from q0
        data.SetODE2Coordinates_t(v, self.initial)
        alpha = self.settings.timeIntegration.generalizedAlpha
        # Exudyn computes accelerations only at the start of a run, and only with this option; the value for runs is set again
        value_for_runs = alpha.computeInitialAccelerations
        alpha.computeInitialAccelerations = True
        self.solver.InitializeSolverInitialConditions(self.system.mbs, self.settings)
        alpha.computeInitialAccelerations = value_for_runs
        return np.array(data.GetODE2Coordinates_tt())


class Readout:
    """A function (q, v, t) -> Terms with Exudyn's M, f, C_q and C at a state q, v (n,), and gamma = law'' - (C_q)' v."""

    def __init__(self, system: System):
        self.system, self.current = system, system.exu.ConfigurationType.Current
        self.solver = system.exu.MainSolverImplicitSecondOrder()
        self.settings = system.exu.SimulationSettings()  # with dense matrices, which Python can read and set
        write_nothing(self.settings)
        self.solver.InitializeSolver(system.mbs, self.settings)
        self.n, self.m = self.solver.GetODE2size(), self.solver.GetAEsize()
        self.laws = [driver.law for driver in system.mechanism.drivers]  # in the order of the last constraint rows

    def jacobian(self, q: Array) -> Array:
        """Return Exudyn's constraint Jacobian C_q (m, n) at q (n,)."""
        self.system.mbs.systemData.SetODE2Coordinates(q - self.system.mechanism.q0, self.current)
        self.solver.SetSystemJacobian(np.zeros((self.n + self.m,) * 2))  # Exudyn adds to the matrix that is set
        # the factors 1, 0, 1 weight the derivatives with respect to positions, velocities and first-order coordinates, of which
        # there are none here; False: the constraints are those on positions
        self.solver.ComputeJacobianAE(self.system.mbs, 1.0, 0.0, 1.0, False)
        return np.array(self.solver.GetSystemJacobian())[self.n :, : self.n]

    def bias(self, q: Array, v: Array) -> Array:
        """Return -(C_q)' v (m,), with the derivative of C_q along v by fourth-order central differences."""
        speed = float(np.abs(v).max(initial=0.0))
        if speed == 0 or self.m == 0:
            return np.zeros(self.m)
        h = DIFFERENCE / speed
        narrow, wide = (self.jacobian(q + k * h * v) - self.jacobian(q - k * h * v) for k in (1, 2))
        return np.asarray(-((8 * narrow - wide) / (12 * h) @ v))

    def __call__(self, q: Array, v: Array, t: float) -> Terms:
        mbs, solver = self.system.mbs, self.solver
        bias, J = self.bias(q, v), self.jacobian(q)  # `jacobian` also puts q into Exudyn's current state
        bias[self.m - len(self.laws) :] += [float(law(t)[2]) for law in self.laws]
        mbs.systemData.SetTime(t, self.current)
        mbs.systemData.SetODE2Coordinates_t(v, self.current)
        solver.ComputeMassMatrix(mbs, 1.0)
        M = np.array(solver.GetSystemMassMatrix())
        solver.ComputeODE2RHS(mbs)
        Q = np.array(solver.GetSystemResidual())[: self.n]
        compute_gaps(solver, mbs, self.settings)  # from here on, the residual's last rows are those of the constraints
        phi = np.array(solver.GetSystemResidual())[self.n : self.n + self.m]
        return Terms(M, J, Q, bias, phi, J @ v)  # J v lacks the rates of motion laws: the adapter does not use it


def solve_kkt(terms: Terms, redundant: bool) -> Array:
    """Return the accelerations a (n,) that solve M a + J^T lambda = Q, J a = gamma, without the suite's own formulations.

    If constraint rows are redundant, the multipliers lambda are not unique, but a is the same in all solutions; the least-squares
    solution of least norm is taken.
    """
    n, m = len(terms.M), len(terms.J)
    K = np.block([[terms.M, terms.J.T], [terms.J, np.zeros((m, m))]])
    rhs = np.concatenate([terms.Q, terms.gamma])
    x: Array = np.linalg.lstsq(K, rhs, rcond=REDUNDANT)[0] if redundant else np.linalg.solve(K, rhs)
    return x[:n]


def verify(system: System, readout: Readout, evaluator: Evaluator) -> None:
    """Compare an Exudyn system with its linkage; constraint rows may have the opposite sign.

    Raises:
        RunFailure: the degrees of freedom, the number of redundant rows, or a term of the equations of motion differs.
    """
    mechanism = evaluator.mechanism
    counts = system.mbs.ComputeSystemDegreeOfFreedom()
    dof, redundant = int(counts["degreeOfFreedom"]), int(counts["redundantConstraints"])
    expected_dof = mechanism.dof - len(mechanism.drivers)
    if (dof, redundant) != (expected_dof, mechanism.redundant):
        counted = f"Exudyn counts {dof} degrees of freedom and {redundant} redundant rows"
        raise RunFailure(Status.ERROR, f"{counted}, the linkage has {expected_dof} and {mechanism.redundant}")
    for q, v in draw_states_near_start(evaluator):
        own, expected = readout(q, v, 0.0), evaluator.terms(0.0, q, v)
        # (m,) largest difference of each row, with its own sign and with the opposite one
        same, opposite = (np.abs(own.J - x).max(axis=1, initial=0.0) for x in (expected.J, -expected.J))
        sign = np.where(same <= opposite, 1.0, -1.0)
        pairs = {
            "mass matrix": (own.M, expected.M, float(expected.M.max(initial=0.0))),
            "applied forces": (own.Q, expected.Q, size(expected.Q)),
            "constraint Jacobian": (sign[:, None] * own.J, expected.J, size(expected.J)),
            "constraint residual": (np.abs(own.phi), np.abs(expected.phi), size(expected.phi)),
        }
        for t in mechanism.kinks:  # times at which forces jump
            own_forces, expected_forces = readout(q, v, t).Q, evaluator.terms(t, q, v).Q
            pairs[f"applied forces at t = {t:.6g} s"] = own_forces, expected_forces, size(expected_forces)
        require_agreement(pairs, AGREEMENT)


def draw_states_near_start(evaluator: Evaluator) -> list[tuple[Array, Array]]:
    """Return the start, and at most two random states q, v (n,) near it that satisfy the constraints, with speeds of order one."""
    mechanism = evaluator.mechanism
    states: list[tuple[Array, Array]] = [(mechanism.q0, mechanism.v0)]
    spread = 0.01 * np.tile([mechanism.size, mechanism.size, 1.0], len(mechanism.links))
    rng = np.random.default_rng(0)
    for _ in range(2):
        q: Array = mechanism.q0 + spread * rng.standard_normal(mechanism.n)
        q, v = evaluator.project(0.0, q, rng.standard_normal(mechanism.n))
        if np.abs(evaluator.terms(0.0, q, v).phi).max(initial=0.0) < CLOSED:
            states.append((q, v))
    return states
