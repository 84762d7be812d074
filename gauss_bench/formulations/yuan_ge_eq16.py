"""Eq. (16) of Yuan and Ge (2016), with its inverses taken as Moore-Penrose inverses: a wrong formula, kept as a negative control.

    a = J^+ gamma + N M^-1 Q,        N = I - J^+ J                                                                (16)

The formula projects the acceleration M^-1 Q of the system without constraints onto J a = gamma in the Euclidean metric, instead of
the metric of M. Its error in the accelerations is N M^-1 J^T lambda, where lambda are the multipliers of the true motion. The error
is zero if M is proportional to the unit matrix; otherwise it depends on the unit of length. The wrong accelerations satisfy J a =
gamma exactly, so that no residual of the constraints can detect the error. Only a comparison of motions can detect it.
"""

import numpy as np

from gauss_bench.terms import Solution, Terms

RANK_TOLERANCE = 1e-10  # singular values below this share of the largest are zero, as in `gauss`


def yuan_ge_eq16(terms: Terms) -> Solution:
    """Return accelerations (n,) by eq. (16) of Yuan and Ge (2016), which are wrong although they satisfy every constraint."""
    J_pinv = np.linalg.pinv(terms.J, rcond=RANK_TOLERANCE)
    free = np.linalg.solve(terms.M, terms.Q)
    a = J_pinv @ terms.gamma + free - J_pinv @ (terms.J @ free)
    return Solution(a, None, round(float(np.trace(J_pinv @ terms.J))))
