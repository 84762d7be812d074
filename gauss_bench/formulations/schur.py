"""Schur complement method: solve for the m multipliers first, then for the accelerations.

    (J M^-1 J^T) lambda = J M^-1 Q - gamma,        a = M^-1 (Q - J^T lambda)

The Schur complement J M^-1 J^T is symmetric, and positive definite if and only if the rows of J are independent. If rows are
dependent, the Cholesky factorisation of the Schur complement fails, or its reciprocal condition number is tiny.
Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 8.4.
"""

import numpy as np
from scipy.linalg.lapack import dpocon, dpotrf, dpotrs

from gauss_bench.terms import SingularSystem, Solution, Terms

SINGULAR = 1e-15  # largest reciprocal condition number of a singular complement: the square of that of J M^(-1/2)


def schur(terms: Terms) -> Solution:
    """Return accelerations (n,) and multipliers (m,) by the Schur complement.

    Raises:
        SingularSystem: constraint rows are redundant.
    """
    M, J, Q, gamma = terms.M, terms.J, terms.Q, terms.gamma
    if not len(J):
        return Solution(np.linalg.solve(M, Q), np.zeros(0), 0)  # LAPACK refuses a system without unknowns
    weighted = np.linalg.solve(M, np.column_stack([J.T, Q]))  # M^-1 [J^T Q]
    S = J @ weighted
    complement, rhs = S[:, :-1], S[:, -1] - gamma
    factor, info = dpotrf(complement, lower=True)
    norm = float(np.abs(complement).sum(axis=0).max(initial=0.0))
    rcond = 0.0 if info else float(dpocon(factor, norm, uplo="L")[0])
    if not rcond > SINGULAR:
        raise SingularSystem(f"J M^-1 J^T is singular (reciprocal condition {rcond:.1e}): constraint rows are redundant")
    multipliers, _ = dpotrs(factor, rhs, lower=True)
    return Solution(weighted[:, -1] - weighted[:, :-1] @ multipliers, multipliers, len(J))
