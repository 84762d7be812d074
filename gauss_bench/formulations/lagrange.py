"""Lagrange multipliers: the symmetric indefinite KKT system in n + m unknowns.

    [ M  J^T ] [   a    ]   [   Q   ]
    [ J   0  ] [ lambda ] = [ gamma ]

Solved by LU with partial pivoting. Redundant rows make the matrix singular; the reciprocal condition number tells, once rows and
columns are scaled so that neither masses nor units count: masses to 1, then rows of J to 1. Otherwise a light link beside one
1e8 times as heavy would look like a redundant row. Powers of two round nothing.
Sources: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), eq. (6.3.18); Golub and Van Loan, Matrix
Computations (4th ed.), section 3.5.2 (equilibration).
"""

import numpy as np
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from gauss_bench.terms import Array, SingularSystem, Solution, Terms

SINGULAR = 1e-15  # a few rounding units: LU of an exactly singular KKT matrix leaves 1e-17, usable linkages 1e-7 or more


def lagrange(terms: Terms) -> Solution:
    """Accelerations (n,) and multipliers (m,).

    Raises:
        SingularSystem: redundant constraint rows.
    """
    n, m = len(terms.M), len(terms.J)
    light = near_one(np.sqrt(np.diagonal(terms.M)))
    J = terms.J * light
    short = near_one(np.abs(J).max(axis=1))
    J *= short[:, None]
    K = np.zeros((n + m, n + m), order="F")
    K[:n, :n], K[:n, n:], K[n:, :n] = terms.M * np.outer(light, light), J.T, J
    norm = float(np.abs(K).sum(axis=0).max())
    lu, pivots, info = dgetrf(K, overwrite_a=True)
    rcond = 0.0 if info else float(dgecon(lu, norm)[0])
    if not rcond > SINGULAR:
        raise SingularSystem(f"the KKT matrix is singular (reciprocal condition {rcond:.1e}): constraint rows are redundant")
    x, _ = dgetrs(lu, pivots, np.concatenate([terms.Q * light, terms.gamma * short]))
    return Solution(x[:n] * light, x[n:] * short, m)


def near_one(sizes: Array) -> Array:
    """Powers of two that bring each size between 1/2 and 1."""
    scaled: Array = np.ldexp(1.0, -np.frexp(sizes)[1])
    return scaled
