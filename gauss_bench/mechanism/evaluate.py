"""A mechanism at a state: its constraint rows, the terms of its equations of motion, and its energy, as generated functions.

Constraint rows take one state, q (n,), or a batch, q (..., n), in double or in the longer type the linkage was built in.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gauss_bench.mechanism import equations
from gauss_bench.mechanism.close import project
from gauss_bench.mechanism.equations import Symbols
from gauss_bench.mechanism.forces import AppliedForces, JointFriction
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.written import Symbol
from gauss_bench.terms import Array, Terms

CORRECTIONS = 6  # a step of 1e-3 s needs one, one of 1e-2 s three: convergence is quadratic
ROUNDING = 1e-15
RANK_TOLERANCE = 1e-9  # of the largest singular value, as where a linkage is assembled


@dataclass(frozen=True)
class Rows:
    """All constraint rows at a state (or batch): joints two each, then driver, then knife edges."""

    phi: Array
    J: Array
    gamma: Array
    phi_t: Array


class Constraints:
    """The constraint rows of one mechanism; the sparsity pattern of J is computed once.

    Attributes:
        m: rows; joint_rows: of joints, which stand first; holonomic: those that have a position level.
        laws: of drivers.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism, self.n = mechanism, mechanism.n
        at = Symbols(mechanism.n)
        every = list(equations.rows(mechanism, at))
        self.m, self.laws = len(every), at.laws
        self.holonomic = self.m - len(mechanism.knife_edges)
        self.joint_rows = self.holonomic - len(mechanism.drivers)
        self.template = np.zeros((self.m, self.n), dtype=mechanism.gravity.dtype)
        places = []
        for place, x in _entries(every, at):
            if x.number is None:
                places.append(place[0] * self.n + place[1])
            else:
                self.template[place] = x.number
        self.places = np.array(places, dtype=int)

    @cached_property
    def _written(self) -> Callable[..., list[Array]]:
        at = Symbols(self.n)
        return at.written(*self.asked(at))

    def asked(self, at: Symbols) -> tuple[list[Symbol], ...]:
        """Return the varying entries of J, gamma, phi and phi_t as symbols, so that they can share operations with others."""
        return _groups(list(equations.rows(self.mechanism, at)), at)

    def __call__(self, t: float | Array, q: Array, v: Array) -> Rows:
        """Residual, Jacobian, bias and explicit rate of all rows at state(s) q, v (..., n) and time(s) t [s]."""
        entries, gamma, phi, phi_t = self._written(t, q, v)
        return Rows(phi, self.filled(entries), gamma, phi_t)

    def filled(self, entries: Array) -> Array:
        """Return J (..., m, n): the constant entries, and the varying ones (..., k) put in place."""
        J = np.empty((*entries.shape[:-1], self.m * self.n), dtype=np.result_type(entries, self.template))
        J[...] = self.template.ravel()
        J[..., self.places] = entries
        return J.reshape(*entries.shape[:-1], self.m, self.n)


def _entries(every: list[equations.Row], at: Symbols) -> Iterator[tuple[tuple[int, int], Symbol]]:
    """Row, column and symbol of every entry of J."""
    return (((i, k), at.program.symbol(x)) for i, row in enumerate(every) for k, x in row.entries.items())


def _groups(every: list[equations.Row], at: Symbols) -> tuple[list[Symbol], ...]:
    symbol = at.program.symbol
    phi = [symbol(0.0 if row.phi is None else row.phi) for row in every]
    varying = [x for _, x in _entries(every, at) if x.number is None]
    return varying, [symbol(row.gamma) for row in every], phi, [symbol(row.phi_t) for row in every]


class UndeterminedLoads(ArithmeticError):
    """Friction in the joints of a linkage whose constraint rows are redundant: their loads, and so the motion, are not unique."""


class Evaluator:
    """Evaluates one mechanism at any number of states."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.constraints = Constraints(mechanism)
        self.applied = AppliedForces(mechanism)
        self.friction = JointFriction(mechanism)
        self.mass = mechanism.mass
        self.M = np.diag(self.mass)

    @cached_property
    def _terms(self) -> Callable[..., list[Array]]:
        """Generate one function for the varying entries of J, Q of steady forces, gamma, phi and phi_t."""
        at = Symbols(self.mechanism.n)
        entries, *others = self.constraints.asked(at)
        return at.written(entries, self.applied.steady(at), *others)

    def terms(self, t: float, q: Array, v: Array) -> Terms:
        """M, J, Q, gamma and the residuals at one state q, v (n,); Q without friction, which needs the multipliers."""
        entries, Q, gamma, phi, phi_t = self._terms(t, q, v)
        J = self.constraints.filled(entries)
        for force in self.applied.varying:
            Q = Q + force(q, v, t)
        return Terms(self.M, J, Q, gamma, phi, J @ v + phi_t)

    def check_loads(self) -> None:
        """Refuse friction where rows are redundant at the start.

        Raises:
            UndeterminedLoads: with the number of redundant rows.
        """
        if self.friction:
            J = self.constraints(0.0, self.mechanism.q0, self.mechanism.v0).J
            spare = len(J) - int(np.linalg.matrix_rank(J, rtol=RANK_TOLERANCE))
            if spare:
                raise UndeterminedLoads(
                    f"redundant constraint rows ({spare}) leave the loads of the joints undetermined, and with them their friction"
                )

    def energy(self, q: Array, v: Array) -> Array:
        """Kinetic plus potential energy (...) [J] of state(s) (..., n)."""
        return 0.5 * (v * v) @ self.mass + self.applied.potential(q)

    def project(self, t: float, q: Array, v: Array, rank_tolerance: float = 1e-4) -> tuple[Array, Array]:
        """The nearest consistent state: Gauss-Newton corrections of q down to rounding, then the shortest correction of v.

        Singular values below `rank_tolerance` of the largest are left alone: next to a singular position, or where redundant
        rows disagree by their own drift, following them would throw the state far along the free motion. A state that is not
        finite is returned as it is.
        """
        h = self.constraints.holonomic
        rows: Rows  # at the latest position

        def residual(x: Array) -> tuple[Array, Array]:
            nonlocal rows
            rows = self.constraints(t, x, v)
            return rows.phi[:h], rows.J[:h]

        def shortest(J: Array, F: Array) -> Array:
            return _shortest(J, F, rank_tolerance)

        q = project(q, residual, shortest, CORRECTIONS, _is_closed)
        return q, v - shortest(rows.J, rows.J @ v + rows.phi_t)


def _is_closed(q: Array, F: Array, _: Array) -> bool:
    return bool(np.abs(F).max(initial=0.0) <= ROUNDING * (1.0 + np.abs(q).max()))


def _shortest(J: Array, r: Array, rank_tolerance: float) -> Array:
    """Return the minimum-norm least-squares x (n,) of J x = r; NaN if J or r is not finite (LAPACK would print to stderr)."""
    if not (np.isfinite(J).all() and np.isfinite(r).all()):
        return np.full(J.shape[1], np.nan)
    return np.asarray(np.linalg.lstsq(J, r, rcond=rank_tolerance)[0])
