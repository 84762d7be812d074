"""Gauss's principle of least constraint as a least-squares problem in n - r unknowns.

    minimise |L^T (a - M^-1 Q)|   subject to   J a = gamma,        M = L L^T

A QR factorisation of J^T with column pivoting determines the rank r of J. It also gives orthonormal bases of two subspaces: the
columns of Y (n, r) span range(J^T), and the columns of N (n, n - r) span null(J). The permutation P orders the rows of J:

    J^T P = [Y N] [R; 0]

The solution is a sum of two parts, of which the first satisfies the constraints, and the second makes the norm least:

    a = Y y + N h
    R^T y = P^T gamma           (least squares where rows of J are redundant)
    h = argmin |L^T N h - (L^-1 Q - L^T Y y)|

Any factor L with M = L L^T gives the same solution, because |L^T x| depends on M alone. The solution needs no multipliers, and rows
of J may be redundant.

The entries of the basis N have rounding errors relative to its largest entry, and the mass matrix M weighs these errors. If a heavy
link stands still while a light one moves, the computed accelerations have a relative error of 1e-16 times the ratio of the masses.
If this ratio exceeds UNEVEN, the same factors are used a second time, with the residuals of M a + J^T lambda = Q and J a = gamma as
right-hand sides (iterative refinement).
Sources: Yuan and Ge (2016), eqs (1)-(9) with the exponents of (10), (11) corrected; null-space method as in Golub and Van Loan,
Matrix Computations (4th ed.), section 6.2.3; refinement of constrained least squares as in Bjorck, Numerical Methods for Least
Squares Problems (1996), section 2.9.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgels, dgeqp3, dorgqr, dpotrf, dtrtrs

from gauss_bench.terms import Array, Solution, Terms

RANK_TOLERANCE = 1e-10  # smaller shares of R's largest diagonal entry are zero: rounding leaves 1e-15, usable linkages 1e-2
UNEVEN = 1e6  # ratio of masses at which the error of a solution without refinement reaches 1e-10


def gauss(terms: Terms) -> Solution:
    """Return accelerations (n,) by Gauss's principle, and the rank of J.

    Raises:
        numpy.linalg.LinAlgError: the mass matrix is not positive definite.
    """
    M, J, Q, gamma = terms.M, terms.J, terms.Q, terms.gamma
    Y, N, R, order = subspaces(J)
    L, indefinite = dpotrf(M, lower=True)
    if indefinite:
        raise np.linalg.LinAlgError("the mass matrix is not positive definite")

    def least_constraint(load: Array, rhs: Array) -> Array:
        """Return the accelerations a (n,) that satisfy J a = rhs and minimise |L^T (a - M^-1 load)|."""
        a: Array = Y @ least_squares(R.T, rhs[order])  # J^T[:, order] = Y R
        if N.shape[1]:  # the columns of N are a basis of the null space of J
            a = a + N @ least_squares(L.T @ N, dtrtrs(L, load, lower=True)[0] - L.T @ a)
        return a

    a = least_constraint(Q, gamma)
    masses = np.diagonal(L) ** 2  # the pivots of M
    if masses.max() > UNEVEN * masses.min():
        # one step of iterative refinement with the same factors
        r = Y.shape[1]
        multipliers = np.zeros(0)  # LAPACK refuses a system without unknowns
        if r:
            # multipliers of the first r rows in the order `order`; those of the other rows are zero
            multipliers = dtrtrs(R[:, :r], Y.T @ (Q - M @ a))[0]
        a = a + least_constraint(Q - M @ a - J[order[:r]].T @ multipliers, gamma - J @ a)
    return Solution(a, None, Y.shape[1])


def subspaces(J: Array) -> tuple[Array, Array, Array, Array]:
    """Return Y (n, r), N (n, n - r), R (r, m) and the order (m,) of the rows of J, with J^T[:, order] = Y R and Y^T N = 0."""
    m, n = J.shape
    factors, pivots, tau, _, _ = dgeqp3(J.T)
    R = np.where(_below(min(m, n), m), 0.0, factors[: min(m, n)])
    diagonal = np.abs(np.diagonal(R))
    rank = int((diagonal > RANK_TOLERANCE * diagonal.max(initial=0.0)).sum())
    # LAPACK returns Q as reflectors in the columns of `factors`; with n columns they give the full Q = [Y N]
    reflectors = np.zeros((n, n), order="F")
    reflectors[:, : min(m, n)] = factors[:, : min(m, n)]
    basis = dorgqr(reflectors, tau, overwrite_a=True)[0]
    return basis[:, :rank], basis[:, rank:], R[:rank], pivots - 1  # LAPACK counts from 1


@cache
def _below(rows: int, columns: int) -> NDArray[np.bool_]:
    """Return the mask (rows, columns) of the entries below the diagonal."""
    return np.tri(rows, columns, -1, dtype=bool)


def least_squares(A: Array, b: Array) -> Array:
    """Return the x (l,) that minimises |A x - b| for A (k, l) of full column rank, k >= l; it solves A x = b if A is square."""
    x: Array = dgels(A, b)[1][: A.shape[1]] if A.shape[1] else np.zeros(0)  # LAPACK refuses a system without unknowns
    return x
