"""Lagrange multipliers: the symmetric indefinite KKT system in n + m unknowns.

    [ M  J^T ] [   a    ]   [   Q   ]
    [ J   0  ] [ lambda ] = [ gamma ]

The system is solved by LU with partial pivoting. Redundant constraint rows make the KKT matrix singular, so that its reciprocal
condition number is at most SINGULAR. Masses that differ by a factor of 1e8 can have the same effect. In both cases, rows and
columns of the matrix are scaled so that first the masses and then the rows of J are about 1. If the reciprocal condition number of
the scaled matrix is also at most SINGULAR, constraint rows are redundant. The scaling factors are powers of two, which cause no
rounding.
Sources: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), eq. (6.3.18); Golub and Van Loan, Matrix
Computations (4th ed.), section 3.5.2 (scaling).
"""

import numpy as np
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from gauss_bench.terms import Array, SingularSystem, Solution, Terms

SINGULAR = 1e-15  # largest reciprocal condition number of a singular KKT matrix: LU leaves 1e-17, usable linkages 1e-7 or more


def lagrange(terms: Terms) -> Solution:
    """Return accelerations (n,) and multipliers (m,) by Lagrange's method.

    Raises:
        SingularSystem: constraint rows are redundant.
    """
    n, m = len(terms.M), len(terms.J)
    K = np.zeros((n + m, n + m), order="F")
    K[:n, :n], K[:n, n:], K[n:, :n] = terms.M, terms.J.T, terms.J
    b = np.concatenate([terms.Q, terms.gamma])
    x, rcond = solve(K, b)
    if not rcond > SINGULAR:
        scale = scale_evenly(terms)
        x, rcond = solve(K * np.outer(scale, scale), b * scale)
        x = x * scale
    if not rcond > SINGULAR:
        raise SingularSystem(f"the KKT matrix is singular (reciprocal condition {rcond:.1e}): constraint rows are redundant")
    return Solution(x[:n], x[n:], m)


def solve(K: Array, b: Array) -> tuple[Array, float]:
    """Return K^-1 b and the reciprocal condition number of K; if a pivot of K is zero, return b and 0.0 instead."""
    norm = float(np.abs(K).sum(axis=0).max())  # the 1-norm
    lu, pivots, info = dgetrf(K)
    if info:
        return b, 0.0
    return dgetrs(lu, pivots, b)[0], float(dgecon(lu, norm)[0])


def scale_evenly(terms: Terms) -> Array:
    """Return powers of two (n + m,): n that scale the masses to about 1, and m that then scale the rows of J to about 1."""
    masses = power_of_two(np.sqrt(np.diagonal(terms.M)))
    return np.concatenate([masses, power_of_two(np.abs(terms.J * masses).max(axis=1))])


def power_of_two(sizes: Array) -> Array:
    """Return the powers of two that scale each size to between 1/2 and 1."""
    scaled: Array = np.ldexp(1.0, -np.frexp(sizes)[1])
    return scaled
