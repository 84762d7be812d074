"""Gauss's principle of least constraint as a least-squares problem in n - r unknowns.

    minimise |L^T (a - M^-1 Q)|   subject to   J a = gamma,        M = L L^T

Column-pivoted QR of J^T decides the rank r and gives both subspaces at once:

    J^T P = [Y N] [R; 0]          Y (n, r) spans range(J^T),  N (n, n - r) spans null(J)
    a = Y y + N h                 R^T y = P^T gamma           (least squares where rows are redundant)
    h = argmin |L^T N h - (L^-1 Q - L^T Y y)|

Any factor L of M serves, because |L^T x| depends on M alone. No multipliers appear; rows may be redundant.
Source: Yuan and Ge (2016), eqs (1)-(9) with the exponents of (10), (11) corrected; null-space method as in Golub and Van Loan,
Matrix Computations (4th ed.), section 6.2.3.
"""

import numpy as np
from scipy.linalg import qr

from gauss_bench.terms import Array, Solution, Terms

RANK_TOLERANCE = 1e-10  # of the largest diagonal entry of R: rounding leaves about 1e-15, a usable linkage keeps about 1e-2


def gauss(terms: Terms) -> Solution:
    """Accelerations (n,) by Gauss's principle; rank is that of J."""
    M, J, Q, gamma = terms.M, terms.J, terms.Q, terms.gamma
    basis, R, order = qr(J.T, pivoting=True, check_finite=False)
    diagonal = np.abs(np.diagonal(R))
    rank = int((diagonal > RANK_TOLERANCE * diagonal.max(initial=0.0)).sum())
    Y, N = basis[:, :rank], basis[:, rank:]
    a: Array = Y @ solve_range(R[:rank], gamma[order])
    if N.shape[1]:
        L = np.linalg.cholesky(M)
        target = np.linalg.solve(L, Q) - L.T @ a
        a = a + N @ np.linalg.lstsq(L.T @ N, target, rcond=None)[0]
    return Solution(a, None, rank)


def solve_range(R: Array, gamma: Array) -> Array:
    """y (r,) of R^T y = gamma: triangular where the rows are independent, least squares where they are redundant."""
    if R.shape[0] == R.shape[1]:
        y: Array = np.linalg.solve(R.T, gamma)
        return y
    return np.asarray(np.linalg.lstsq(R.T, gamma, rcond=None)[0])
