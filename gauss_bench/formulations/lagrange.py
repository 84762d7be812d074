"""Lagrange multipliers: the symmetric indefinite KKT system in n + m unknowns.

    [ M  J^T ] [   a    ]   [   Q   ]
    [ J   0  ] [ lambda ] = [ gamma ]

Solved by LU with partial pivoting. Redundant rows make the matrix singular; the reciprocal condition number tells.
Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), eq. (6.3.18).
"""

import numpy as np
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from gauss_bench.terms import SingularSystem, Solution, Terms

SINGULAR = 1e-15  # a few rounding units: LU of an exactly singular KKT matrix leaves 1e-17, usable linkages 1e-7 or more


def lagrange(terms: Terms) -> Solution:
    """Accelerations (n,) and multipliers (m,).

    Raises:
        SingularSystem: redundant constraint rows.
    """
    n, m = len(terms.M), len(terms.J)
    K = np.zeros((n + m, n + m), order="F")
    K[:n, :n], K[:n, n:], K[n:, :n] = terms.M, terms.J.T, terms.J
    norm = float(np.abs(K).sum(axis=0).max())
    lu, pivots, info = dgetrf(K, overwrite_a=True)
    rcond = 0.0 if info else float(dgecon(lu, norm)[0])
    if not rcond > SINGULAR:
        raise SingularSystem(f"the KKT matrix is singular (reciprocal condition {rcond:.1e}): constraint rows are redundant")
    x, _ = dgetrs(lu, pivots, np.concatenate([terms.Q, terms.gamma]))
    return Solution(x[:n], x[n:], m)
