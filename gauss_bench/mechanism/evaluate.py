"""Evaluate a mechanism at a state: constraint rows, the terms of its equations of motion, and its energy.

Constraint rows are evaluated at one state q (n,) or a batch q (..., n), in the type of number with which the linkage was built.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from threading import Lock

import numpy as np

from gauss_bench.mechanism import equations
from gauss_bench.mechanism.close import RANK_TOLERANCE, minimum_norm, project
from gauss_bench.mechanism.equations import Symbols
from gauss_bench.mechanism.forces import AppliedForces, JointFriction
from gauss_bench.mechanism.generated import Symbol
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, Terms, largest

CORRECTIONS = 6  # largest number of Gauss-Newton corrections: one is needed after an integration step of 1e-3 s, three after 1e-2 s
ROUNDING = 1e-15  # relative residual of a closed position
RECORDING = Lock()  # a program is recorded by one thread at a time


@dataclass(frozen=True)
class Rows:
    """All m constraint rows at a state or a batch of states: two of each joint, then couplings, drivers, knife edges.

    Attributes:
        phi, phi_t: (..., m) residuals, and their partial derivatives by time.
        J, gamma: (..., m, n) and (..., m) of J a = gamma.
    """

    phi: Array
    J: Array
    gamma: Array
    phi_t: Array


class Constraints:
    """The constraint rows of one mechanism; entries of J that are constant are computed once.

    Attributes:
        m, joint_rows, holonomic: numbers of all rows, of rows of joints and couplings (which stand first), and of rows that
            constrain positions; the rows of knife edges follow these.
        laws: motion laws of the drivers.
        constant: (m n,) the constant entries of J, row by row; 0 for an entry that varies.
        varying: (k,) indices of the varying entries in `constant`.
        symbols: the recorded equations; other equations can be added to them and share their operations.
        outputs: four lists of symbols: the varying entries of J, gamma, phi and phi_t.
    """

    def __init__(self, mechanism: Mechanism):
        """Record all rows with symbols, and store constant entries of J; the function for all others is generated at first use."""
        self.mechanism, self.n = mechanism, mechanism.n
        symbols = self.symbols = Symbols(mechanism.n)  # recording the row of a driver adds its law to `symbols.laws`
        rows, symbol = list(equations.rows(mechanism, symbols)), symbols.program.symbol
        self.m, self.laws = mechanism.m, symbols.laws
        self.holonomic = self.m - len(mechanism.knife_edges)
        self.joint_rows = self.holonomic - len(mechanism.drivers)
        self.constant = np.zeros(self.m * self.n, dtype=mechanism.gravity.dtype)  # the type of all numbers of the mechanism
        flat_indices: list[int] = []  # of the varying entries in J, counted row by row
        entries: list[Symbol] = []
        for i, row in enumerate(rows):
            for k, value in row.entries.items():
                entry = symbol(value)
                if entry.number is None:  # the entry varies with the state
                    flat_indices.append(i * self.n + k)
                    entries.append(entry)
                else:
                    self.constant[i * self.n + k] = entry.number
        self.varying = np.array(flat_indices, dtype=int)
        phi = [symbol(0.0 if row.phi is None else row.phi) for row in rows]
        self.outputs = entries, [symbol(row.gamma) for row in rows], phi, [symbol(row.phi_t) for row in rows]

    @cached_property
    def _function(self) -> Callable[..., list[Array]]:
        """The generated function of t, q and v that returns an array (..., k) for each list in `outputs`."""
        with RECORDING:
            return self.symbols.generate(*self.outputs)

    def __call__(self, t: float | Array, q: Array, v: Array) -> Rows:
        """Return the values of all constraint rows at state(s) q, v (..., n) and time(s) t (...) [s]."""
        entries, gamma, phi, phi_t = self._function(t, q, v)
        return Rows(phi, self.fill_jacobian(entries), gamma, phi_t)

    def residual(self, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return phi (holonomic,) and J (holonomic, n) of the rows that constrain positions, at q (n,) and time t [s]."""
        rows = self(t, q, np.zeros_like(q))
        return rows.phi[: self.holonomic], rows.J[: self.holonomic]

    def fill_jacobian(self, entries: Array) -> Array:
        """Return J (..., m, n) from its varying entries (..., k)."""
        J = np.empty((*entries.shape[:-1], self.m * self.n), dtype=np.result_type(entries, self.constant))
        J[...] = self.constant
        J[..., self.varying] = entries
        return J.reshape(*entries.shape[:-1], self.m, self.n)


def list_determined(mechanism: Mechanism) -> list[str]:
    """List the names of the joints whose forces follow from the motion at the start, because no redundant row involves them.

    The multipliers are determined up to the null space of J^T: all entries of a joint's rows must be zero there.
    """
    U, sizes, _ = np.linalg.svd(Constraints(mechanism)(0.0, mechanism.q0, mechanism.v0).J)
    rank = np.count_nonzero(sizes > RANK_TOLERANCE * sizes.max(initial=0.0))
    null = np.abs(U[:, rank:])  # (m, m - rank) basis of the null space of J^T
    named_rows = zip(mechanism.held_names, null, strict=False)  # not strict: rows of drivers and knife edges follow
    undetermined = {name for name, row in named_rows if row.max(initial=0.0) > RANK_TOLERANCE}
    return [joint.name for joint in mechanism.joints if joint.name not in undetermined]


class UndeterminedLoads(ArithmeticError):
    """A linkage has friction and redundant constraint rows: the loads of its joints, and so its motion, are not unique."""


class Evaluator:
    """The equations of motion of one mechanism, with the mass matrix M (n, n) and its diagonal `mass`."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.constraints = Constraints(mechanism)
        self.applied = AppliedForces(mechanism)
        self.friction = JointFriction(mechanism)
        self.mass = mechanism.mass
        self.M = np.diag(self.mass)

    @cached_property
    def _terms(self) -> Callable[..., list[Array]]:
        """The generated function of t, q, v for varying entries of J, Q of steady forces (no factor), gamma, phi, phi_t."""
        symbols = self.constraints.symbols
        entries, *others = self.constraints.outputs
        with RECORDING:
            return symbols.generate(entries, self.applied.add_steady(symbols), *others)

    def terms(self, t: float, q: Array, v: Array) -> Terms:
        """Return the terms of the equations of motion at one state q, v (n,) and time t [s].

        Q does not contain dry friction, which depends on the multipliers.
        """
        entries, Q, gamma, phi, phi_t = self._terms(t, q, v)
        J = self.constraints.fill_jacobian(entries)
        for force in self.applied.varying:
            Q = Q + force(q, v, t)
        return Terms(self.M, J, Q, gamma, phi, J @ v + phi_t)

    def check_loads(self) -> None:
        """Check that no constraint rows are redundant at the start if joints have friction.

        Raises:
            UndeterminedLoads: constraint rows are redundant; the message has their number.
        """
        if self.friction:
            J = self.constraints(0.0, self.mechanism.q0, self.mechanism.v0).J
            redundant = len(J) - int(np.linalg.matrix_rank(J, rtol=RANK_TOLERANCE))
            if redundant:
                rows = f"redundant constraint rows ({redundant})"
                raise UndeterminedLoads(f"{rows} leave the loads of the joints undetermined, and with them their friction")

    def energy(self, q: Array, v: Array) -> Array:
        """Return kinetic plus potential energy (...) [J] of state(s) (..., n)."""
        return 0.5 * (v * v) @ self.mass + self.applied.potential(q)

    def project(self, t: float, q: Array, v: Array, rank_tolerance: float = 1e-4) -> tuple[Array, Array]:
        """Return the state that satisfies the constraints at time t [s] and is nearest to the given state q, v (n,).

        Gauss-Newton iteration corrects q, then one linear system corrects v. A state that is not finite becomes NaN.

        Singular values below `rank_tolerance` times the largest count as zero, because a correction is divided by them: near a
        singular position, or if drift makes redundant rows contradict each other, it would move the state far in directions in
        which the linkage is free to move.
        """
        holonomic = self.constraints.holonomic
        rows: Rows  # at the latest position; the correction of v uses them

        def residual(x: Array) -> tuple[Array, Array]:
            nonlocal rows
            rows = self.constraints(t, x, v)
            return rows.phi[:holonomic], rows.J[:holonomic]

        def shortest(J: Array, F: Array) -> Array:
            """Return the shortest least-squares x (n,) of J x = F; NaN if J or F is not finite (LAPACK would print an error)."""
            if not (np.isfinite(J).all() and np.isfinite(F).all()):
                return np.full(J.shape[1], np.nan)
            return minimum_norm(J, F, rank_tolerance)

        q = project(q, residual, shortest, CORRECTIONS, lambda q, F, J: largest(F) <= ROUNDING * (1.0 + largest(q)))
        return q, v - shortest(rows.J, rows.J @ v + rows.phi_t)


@lru_cache(maxsize=16)
def evaluator_of(mechanism: Mechanism) -> Evaluator:
    """Return the evaluator of a mechanism; the 16 used last are cached, because recording the equations takes milliseconds."""
    return Evaluator(mechanism)
