"""Terms and solution of a formulation: plain arrays at one state, independent of linkages."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
Vectors = NDArray[np.complexfloating[Any, Any]]  # vectors of the plane, x + i y


class SingularSystem(ArithmeticError):
    """A formulation met a system without a unique solution, such as redundant constraint rows in a KKT matrix."""


@dataclass(frozen=True)
class Terms:
    """The equations of motion at one state: M a + J^T lambda = Q subject to J a = gamma (SI units).

    Attributes:
        M: (n, n) mass matrix [kg, kg m^2], symmetric positive definite; not assumed diagonal.
        J: (m, n) constraint Jacobian; rows may be redundant.
        Q: (n,) applied generalised forces minus velocity-dependent inertia forces [N, N m].
        gamma: (m,) acceleration bias [m/s^2, rad/s^2], the right-hand side of J a = gamma.
        phi: (m,) constraint residual [m, rad]; zero for nonholonomic rows, which have no position level.
        phi_dot: (m,) rate of the residual, J v + dphi/dt [m/s, rad/s].
    """

    M: Array
    J: Array
    Q: Array
    gamma: Array
    phi: Array
    phi_dot: Array


@dataclass(frozen=True)
class Solution:
    """Accelerations at one state.

    Attributes:
        a: (n,) accelerations [m/s^2, rad/s^2].
        multipliers: (m,) lambda of M a + J^T lambda = Q, or None if the formulation has none.
        rank: numerical rank of J as the formulation decided it.
    """

    a: Array
    multipliers: Array | None
    rank: int


def largest(x: NDArray[np.inexact[Any]]) -> float:
    """Return the largest |x|; 0 for an empty array."""
    return float(np.abs(x).max(initial=0.0))


def constraint_force(terms: Terms, a: Array) -> Array:
    """Return the generalised constraint force M a - Q = -J^T lambda, (n,) [N, N m]; it needs no multipliers."""
    return terms.M @ a - terms.Q


def recover_multipliers(terms: Terms, a: Array) -> Array:
    """Return the multipliers (m,) for given accelerations: the least-norm solution of J^T lambda = Q - M a.

    With redundant rows only J^T lambda is determined.
    """
    multipliers: Array = np.linalg.lstsq(terms.J.T, -constraint_force(terms, a), rcond=1e-10)[0]
    return multipliers


def baumgarte(terms: Terms, alpha: float, beta: float) -> Terms:
    """Return the terms with Baumgarte's stabilisation: 2 alpha phi' + beta^2 phi subtracted from gamma.

    The equation phi'' = 0 then becomes phi'' + 2 alpha phi' + beta^2 phi = 0. Source: Baumgarte, Stabilization of constraints and
    integrals of motion in dynamical systems, Comput. Methods Appl. Mech. Eng. 1 (1972), eq. (12).
    """
    return replace(terms, gamma=terms.gamma - 2 * alpha * terms.phi_dot - beta**2 * terms.phi)
