"""Gauss's principle as in Yuan and Ge (2016), eqs (8)-(14), with J^- as the Moore-Penrose inverse and corrected exponents of M.

    a = J^- gamma + (I - J^- J) h                                                                                 (8)
    minimise |A h - b|,   A = M^(1/2) (I - J^- J),   b = M^(-1/2) Q - M^(1/2) J^- gamma                     (9)-(11)
    h = A^- b                                                                                               (12), (13)

The paper prints M^(-1/2) in A and in the second term of b. Substituting (8) into (2) gives M^(+1/2) in these places, which is used
here. The next step of the paper, eqs (15) and (16), is wrong; `yuan_ge_eq16.py` computes eq. (16) as it is printed.
"""

import numpy as np

from gauss_bench.terms import Array, Solution, Terms

RANK_TOLERANCE = 1e-10  # singular values below this share of the largest are zero, as in `gauss`


def gauss_pinv(terms: Terms) -> Solution:
    """Return accelerations (n,), computed by the pseudo-inverses of J and of A = M^(1/2) (I - J^- J), and the rank of J."""
    M, J, Q, gamma = terms.M, terms.J, terms.Q, terms.gamma
    root, inverse_root = square_roots(M)
    J_pinv = np.linalg.pinv(J, rcond=RANK_TOLERANCE)
    particular = J_pinv @ gamma
    N = np.eye(len(M)) - J_pinv @ J
    rank = len(M) - round(float(np.trace(N)))  # the trace of a projector is its rank
    if rank == len(M):  # the constraints leave no freedom: N is rounding, whose pseudo-inverse would be huge
        return Solution(particular, None, rank)
    A = root @ N
    b = inverse_root @ Q - root @ particular
    return Solution(particular + N @ (np.linalg.pinv(A, rcond=RANK_TOLERANCE) @ b), None, rank)


def square_roots(M: Array) -> tuple[Array, Array]:
    """Return the symmetric roots M^(1/2) and M^(-1/2)."""
    values, vectors = np.linalg.eigh(M)
    return (vectors * np.sqrt(values)) @ vectors.T, (vectors / np.sqrt(values)) @ vectors.T
