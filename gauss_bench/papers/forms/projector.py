"""Yuan & Ge (2016), eqs. (15) and (16): the inverse of a projector, and the accelerations that follow from it.

    A^- = N^-1 M^(-1/2)                                                                                          (15)
    a = J^- g - N N^-1 {J^- g + M^-1 (f - Q)},    N = I - J^- J                                                  (16)

The equations of motion are M a + f = Q - J^T lambda, and the constraints are J a = g. The projector N has the rank n - rank J, and
so has no inverse if there are constraints. If N^-1 was a true inverse, N N^-1 = I, eq. (16) would give M^-1 (Q - f), the
accelerations without constraints. With Moore-Penrose inverses, N N^- = N, so that eq. (16) projects M^-1 (Q - f) on J a = g in the
Euclidean metric instead of the metric of M. The accelerations a_(16) by eq. (16) differ from the true ones by

    a_true - a_(16) = N (a_true - M^-1 (Q - f)) = -N M^-1 J^T lambda
"""

from collections.abc import Callable

import numpy as np

from gauss_bench.formulations.gauss_pinv import gauss_pinv
from gauss_bench.formulations.yuan_ge_eq16 import yuan_ge_eq16
from gauss_bench.papers.audit import worst
from gauss_bench.papers.forms.least_squares import pinv, power, projector
from gauss_bench.papers.forms.problems import Problem, all_problems, count_off, relative, special_problems
from gauss_bench.terms import Array

Accelerations = Callable[[Problem], Array]


def rank_off(form: list[int], p: Problem) -> float:
    """Return the error of a claimed rank of N = I - J^- J.

    The claimed rank is form[0] * n + form[1] * m + form[2] * r, with the numbers n of coordinates, m of rows of J, and r of
    independent rows.
    """
    sizes = np.linalg.svd(projector(p), compute_uv=False)  # a projector's singular values are 0 or at least 1
    return count_off(form, (p.n, len(p.J), p.rank), int((sizes > 0.5).sum()))


def reverse_order(p: Problem) -> Array:
    """Return the inverse of A = M^(1/2) N by eq. (15) as printed, N^+ M^(-1/2) with the Moore-Penrose inverse of N."""
    return pinv(projector(p)) @ power(p.M, -0.5)


def normal_inverse(p: Problem) -> Array:
    """Return the Moore-Penrose inverse of A = M^(1/2) N from the normal equations: (N M N)^+ M^(1/2)."""
    N = projector(p)
    return pinv(N @ p.M @ N) @ power(p.M, 0.5)


def inverse_off(form: Accelerations, p: Problem) -> float:
    """Compare a formula for the inverse of A = M^(1/2) N with the Moore-Penrose inverse, which is computed by singular values."""
    return relative(form(p), pinv(power(p.M, 0.5) @ projector(p)))


def free_motion(p: Problem) -> Array:
    """Return the accelerations M^-1 (Q - f) of the system without its constraints: eq. (16) if N N^-1 was the unit matrix."""
    return np.asarray(np.linalg.solve(p.M, p.Q - p.f))


def euclidean(p: Problem) -> Array:
    """Return the accelerations by eq. (16) of Yuan & Ge (2016), with Moore-Penrose inverses in place of J^- and N^-1."""
    return yuan_ge_eq16(p.terms).a


def final_of_14(p: Problem) -> Array:
    """Return the accelerations by eq. (14) of Yuan & Ge (2016), made right by corrected exponents of M."""
    return gauss_pinv(p.terms).a


def accelerations_off(form: Accelerations, on: str = "") -> float:
    """Return the largest relative error of the accelerations form(p) on all problems, or only on those of the kind `on`.

    The kinds are listed in `special_problems`.
    """
    return worst([relative(form(p), p.a) for p in (special_problems(on) if on else all_problems())])


def constraints_off(form: Accelerations, p: Problem) -> float:
    """Return the residual of the constraints J a = g, eq. (6), for the accelerations a = form(p), relative to the terms of J a."""
    return float(np.abs(p.J @ form(p) - p.g).max() / (np.abs(p.J) @ np.abs(form(p))).max())


def predict(p: Problem) -> Array:
    """Return -N M^-1 J^T lambda: the predicted difference of the true accelerations from those of eq. (16)."""
    return -projector(p) @ np.linalg.solve(p.M, p.J.T @ p.multipliers)


def difference_off(factor: float, p: Problem) -> float:
    """Return the error of `factor` times -N M^-1 J^T lambda as a prediction of a_true - a_(16), the error of eq. (16).

    The error of the prediction is divided by the largest of three accelerations: the true one, that of eq. (16), and that of the
    system without constraints.
    """
    wrong = euclidean(p)  # a_(16)
    scale = max(np.abs(wrong).max(), np.abs(p.a).max(), np.abs(free_motion(p)).max())
    return float(np.abs(factor * predict(p) - (p.a - wrong)).max() / scale)
