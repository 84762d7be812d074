"""Lagrange multipliers: the symmetric indefinite KKT system in n + m unknowns.

    [ M  J^T ] [   a    ]   [   Q   ]
    [ J   0  ] [ lambda ] = [ gamma ]

Solved by LU with partial pivoting. Redundant rows make the matrix singular, which its reciprocal condition number tells. But so do
masses that differ by 1e8 and more, where no row is redundant: where the number is small, rows and columns are scaled first, masses
to 1 and then rows of J to 1, and the number of the scaled matrix decides. Powers of two round nothing.
Sources: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), eq. (6.3.18); Golub and Van Loan, Matrix
Computations (4th ed.), section 3.5.2 (scaling).
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
    K = np.zeros((n + m, n + m), order="F")
    K[:n, :n], K[:n, n:], K[n:, :n] = terms.M, terms.J.T, terms.J
    b = np.concatenate([terms.Q, terms.gamma])
    x, rcond = solved(K, b)
    if not rcond > SINGULAR:
        scale = even(terms)
        x, rcond = solved(K * np.outer(scale, scale), b * scale)
        x = x * scale
    if not rcond > SINGULAR:
        raise SingularSystem(f"the KKT matrix is singular (reciprocal condition {rcond:.1e}): constraint rows are redundant")
    return Solution(x[:n], x[n:], m)


def solved(K: Array, b: Array) -> tuple[Array, float]:
    """Return K^-1 b and the reciprocal condition number of K; if that is zero the solution is meaningless."""
    norm = float(np.abs(K).sum(axis=0).max())
    lu, pivots, info = dgetrf(K)
    if info:
        return b, 0.0
    return dgetrs(lu, pivots, b)[0], float(dgecon(lu, norm)[0])


def even(terms: Terms) -> Array:
    """Return scale factors (n + m,) of rows and columns, powers of two: masses and the largest entries of J's rows come near 1."""
    light = near_one(np.sqrt(np.diagonal(terms.M)))
    return np.concatenate([light, near_one(np.abs(terms.J * light).max(axis=1))])


def near_one(sizes: Array) -> Array:
    """Return the powers of two that scale each size to between 1/2 and 1."""
    scaled: Array = np.ldexp(1.0, -np.frexp(sizes)[1])
    return scaled
