"""Yuan and Ge (2016), eq. (16), read with Moore-Penrose inverses: wrong, and kept as a negative control.

    a = J^+ gamma + N M^-1 Q,        N = I - J^+ J                                                                (16)

It projects the free acceleration on J a = gamma in the Euclidean metric instead of that of M. The error is N M^-1 J^T lambda: it
vanishes if M is proportional to the unit matrix, and depends on the unit of length otherwise. J a = gamma holds exactly, so that
no residual of the constraints can detect the error. Only a comparison of motions can.
"""

import numpy as np

from gauss_bench.terms import Solution, Terms

RANK_TOLERANCE = 1e-10  # of the largest singular value, as in `gauss`


def yuan_ge_eq16(terms: Terms) -> Solution:
    """Return accelerations (n,) by eq. (16) as printed, which are wrong, although they satisfy every constraint.

    The formula projects the free acceleration M^-1 Q without regard to the mass, so that the equations of motion are violated. It
    is kept as an error that tests of the constraints cannot detect.
    """
    J_pinv = np.linalg.pinv(terms.J, rcond=RANK_TOLERANCE)
    free = np.linalg.solve(terms.M, terms.Q)
    a = J_pinv @ terms.gamma + free - J_pinv @ (terms.J @ free)
    return Solution(a, None, round(float(np.trace(J_pinv @ terms.J))))
