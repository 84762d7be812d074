"""Linear and nonlinear systems solved to the last digit of a type of number for which LAPACK has no factorisation.

An inverse P in double precision is exact enough to find the next dozen digits. With residuals r in the longer type, each correction
x += P r multiplies the error by |1 - P A|, about double rounding times the condition number, until the residual is rounding alone.
The same chord iteration solves f(x) = 0, with P the inverse of a Jacobian near the solution.

The inverse of the equations of motion, [M J^T; J 0][a; lambda] = [Q; gamma], is written in the singular values of the constraints
in weighted coordinates, J M^(-1/2) = U S V^T. They are cut off at the rank of the linkage, so that rows may be redundant:

    G = M^(-1/2) V S^-1 U^T,    P = [M^-1 - G (J M^-1), G; G^T, -U S^-2 U^T]

Source: Higham, Accuracy and Stability of Numerical Algorithms (2002), chapter 12.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gauss_bench.linkage.closure import RANK_TOLERANCE
from gauss_bench.terms import Array

EPS = float(np.finfo(np.longdouble).eps)
CORRECTIONS = 30  # largest number of corrections; with a condition of 1e6 each finds ten digits


class Unsolved(ArithmeticError):
    """The corrections do not become small: the inverse in double precision is too inaccurate, as it is at singular positions."""


@dataclass(frozen=True, eq=False)
class SaddleInverse:
    """The inverse of the equations of motion in double precision, at one state or several.

    Attributes:
        inverse: (..., n + m, n + m) the matrix P of the equations above.
        lift: (..., n, m) the matrix G above, which gives the shortest correction of a constraint error, in the mass metric.
        smallest: smallest singular value within the rank, relative to the largest: the distance from a singular position.
    """

    inverse: Array
    lift: Array
    smallest: float


def invert_saddle(mass: Array, J: Array, rank: int) -> SaddleInverse:
    """Return the inverse of [M J^T; J 0] for masses (n,) and rows J (..., m, n), by the singular values of J M^(-1/2).

    Only the `rank` largest singular values count; if rows are redundant, the inverse is a pseudo-inverse.
    """
    n, m = J.shape[-1], J.shape[-2]
    root = np.sqrt(mass.astype(float))
    U, s, Vt = np.linalg.svd(J.astype(float) / root, full_matrices=False)
    U, s, Vt = U[..., :rank], s[..., :rank], Vt[..., :rank, :] / root  # U, S and V^T M^(-1/2)
    scaled = U / s[..., None, :]  # U S^-1
    lift = np.swapaxes(scaled @ Vt, -1, -2)
    P = np.empty((*J.shape[:-2], n + m, n + m))
    P[..., :n, :n] = np.diag(1.0 / root**2) - np.swapaxes(Vt, -1, -2) @ Vt
    P[..., :n, n:], P[..., n:, :n] = lift, np.swapaxes(lift, -1, -2)
    P[..., n:, n:] = -scaled @ np.swapaxes(scaled, -1, -2)
    return SaddleInverse(P, lift, float((s[..., -1] / s[..., 0]).min()) if rank else 1.0)


def saddle_residual(mass: Array, J: Array, Q: Array, gamma: Array, x: Array) -> Array:
    """Return the residual [Q - M a - J^T lambda, gamma - J a] (..., n + m) of x = [a, lambda], in the type of its arguments."""
    n = len(mass)
    a, multipliers = x[..., :n], x[..., n:]
    force = Q - mass * a - (multipliers[..., None, :] @ J)[..., 0, :]
    return np.concatenate([force, gamma - (J @ a[..., None])[..., 0]], axis=-1)


def correct(inverse: Array, residual: Array) -> Array:
    """Return P r in double precision for a residual r (..., k) in long double; a correction needs no more digits."""
    return np.asarray((inverse @ residual.astype(float)[..., None])[..., 0])


def solve_by_chord(residual: Callable[[Array], Array], inverse: Array, x: Array, eps: float = EPS) -> Array:
    """Solve residual(x) = 0 near x by chord iteration with one inverse; `eps` is the precision of the type of x.

    Raises:
        Unsolved: the corrections do not become small.
    """
    before = np.inf
    for _ in range(CORRECTIONS):
        step = correct(inverse, residual(x))
        x = x - step
        size = float(np.abs(step).max(initial=0.0) / (1.0 + np.abs(x).astype(float).max(initial=0.0)))
        if size <= eps or (size < np.sqrt(eps) and size > before / 2):
            return x
        before = size
    raise Unsolved(f"corrections stay at {before:.1e}")


def pseudo_inverse(A: Array) -> Array:
    """Return the pseudo-inverses (..., n, m) of matrices (..., m, n) in double precision, cut off at the rank of a linkage."""
    A = A.astype(float)
    return np.asarray(np.linalg.pinv(A, rcond=RANK_TOLERANCE)) if A.size else np.swapaxes(A, -1, -2).copy()
