"""Udwadia and Kalaba's explicit equation: the free acceleration plus the smallest correction in the metric of M.

    a = a0 + L^-T (J L^-T)^+ (gamma - J a0),        a0 = M^-1 Q,   M = L L^T

Any factor L gives the same a; the source uses the symmetric root M^(-1/2). Rows may be redundant.
Source: Udwadia and Kalaba, A new perspective on constrained motion, Proc. R. Soc. Lond. A 439 (1992), eq. (2.5).
"""

import numpy as np

from gauss_bench.terms import Array, Solution, Terms

RANK_TOLERANCE = 1e-10  # singular values below this share of the largest are zero, as in `gauss`


def udwadia_kalaba(terms: Terms) -> Solution:
    """Return accelerations (n,) by Udwadia and Kalaba's equation, and the rank of J L^-T, where M = L L^T; no multipliers."""
    L = np.linalg.cholesky(terms.M)
    free = np.linalg.solve(terms.M, terms.Q)
    weighted = np.linalg.solve(L, terms.J.T).T  # J L^-T
    correction: Array  # (J L^-T)^+ (gamma - J a0): the least-squares solution of smallest norm
    correction, _, rank, _ = np.linalg.lstsq(weighted, terms.gamma - terms.J @ free, rcond=RANK_TOLERANCE)
    return Solution(free + np.linalg.solve(L.T, correction), None, int(rank))
