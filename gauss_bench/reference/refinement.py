"""Linear and nonlinear systems solved to the last digit of a type of number for which LAPACK has no factorisation.

Let A x = b be a linear system, P an approximate inverse of A in double precision, and r = b - A x the residual in extended
precision. Each correction x += P r multiplies the error by |1 - P A|, until only rounding remains. The same chord iteration solves
f(x) = 0 if P is the inverse of a Jacobian of f near the solution.

For the equations of motion [M J^T; J 0][a; lambda] = [Q; gamma], the singular value decomposition of the weighted constraint
Jacobian J M^(-1/2) = U S V^T, up to its rank r, gives

    G = M^(-1/2) V S^-1 U^T,    P = [M^-1 - G (J M^-1), G; G^T, -U S^-2 U^T]

Source: Higham, Accuracy and Stability of Numerical Algorithms (2002), chapter 12.
"""

from collections.abc import Callable

import numpy as np

from gauss_bench.mechanism.close import RANK_TOLERANCE
from gauss_bench.terms import Array

EPS = float(np.finfo(np.longdouble).eps)
CORRECTIONS = 30  # largest number of corrections; with a condition number of 1e6, each correction finds ten digits


class Unsolved(ArithmeticError):
    """The corrections of an iteration do not become small, usually because a singular position is near."""


class SaddleInverse:
    """The inverse of the matrix [M J^T; J 0] of the equations of motion in double precision, at one state or several.

    Attributes:
        inverse: (..., n + m, n + m) inverse of [M J^T; J 0]; a pseudo-inverse if constraint rows are redundant.
        lift: (..., n, m) matrix from an error of the constraints to its smallest correction of q or v, in the mass metric.
        smallest: the r-th singular value of J M^(-1/2) relative to the largest, with r the rank at regular positions.
    """

    def __init__(self, mass: Array, J: Array, rank: int):
        """Invert the matrix for the diagonal `mass` (n,) of M, and Jacobians J (..., m, n) with the given rank."""
        n, m = J.shape[-1], J.shape[-2]
        root = np.sqrt(mass.astype(float))
        U, s, Vt = np.linalg.svd(J.astype(float) / root, full_matrices=False)
        U, s, Vt = U[..., :rank], s[..., :rank], Vt[..., :rank, :] / root  # U, S and V^T M^(-1/2)
        scaled = U / s[..., None, :]  # U S^-1
        self.lift = np.swapaxes(scaled @ Vt, -1, -2)
        P = self.inverse = np.empty((*J.shape[:-2], n + m, n + m))
        P[..., :n, :n] = np.diag(1.0 / root**2) - np.swapaxes(Vt, -1, -2) @ Vt
        P[..., :n, n:], P[..., n:, :n] = self.lift, np.swapaxes(self.lift, -1, -2)
        P[..., n:, n:] = -scaled @ np.swapaxes(scaled, -1, -2)
        self.smallest = float((s[..., -1] / s[..., 0]).min()) if rank else 1.0


def saddle_residual(mass: Array, J: Array, Q: Array, gamma: Array, x: Array) -> Array:
    """Return the residual [Q - M a - J^T lambda, gamma - J a] (..., n + m) of x = [a, lambda], in the type of its arguments."""
    n = len(mass)
    a, multipliers = x[..., :n], x[..., n:]
    force = Q - mass * a - (multipliers[..., None, :] @ J)[..., 0, :]
    return np.concatenate([force, gamma - (J @ a[..., None])[..., 0]], axis=-1)


def correct(inverse: Array, residual: Array) -> Array:
    """Return the product of an approximate inverse (..., k, k) and a residual (..., k), in double precision."""
    return np.asarray((inverse @ residual.astype(float)[..., None])[..., 0])


def solve_by_chord(residual: Callable[[Array], Array], inverse: Array, x: Array, eps: float = EPS) -> Array:
    """Solve residual(x) = 0 near x by chord iteration, which uses the same inverse of the Jacobian in every step.

    `eps` is the relative precision of the number type of x.

    Raises:
        Unsolved: the corrections of x do not become as small as rounding errors.
    """
    before = np.inf
    for _ in range(CORRECTIONS):
        step = correct(inverse, residual(x))
        x = x - step
        size = float(np.abs(step).max(initial=0.0) / (1.0 + np.abs(x).astype(float).max(initial=0.0)))
        # converged to eps; or small, and no longer halved, so that rounding errors prevail
        if size <= eps or (size < np.sqrt(eps) and size > before / 2):
            return x
        before = size
    raise Unsolved(f"corrections stay at {before:.1e}")


def pseudo_inverse(A: Array) -> Array:
    """Return the pseudo-inverses (..., n, m) of matrices A (..., m, n) in double precision, with the rank by RANK_TOLERANCE."""
    A = A.astype(float)
    return np.asarray(np.linalg.pinv(A, rcond=RANK_TOLERANCE)) if A.size else np.swapaxes(A, -1, -2).copy()
