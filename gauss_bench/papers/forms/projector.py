"""Yuan & Ge (2016), eqs. (15) and (16): the inverse of a projector, and the accelerations that follow from it.

    A^- = N^-1 M^(-1/2)                                                                                          (15)
    a = J^- g - N N^-1 {J^- g + M^-1 (f - Q)},    N = I - J^- J                                                  (16)

N has rank n - rank J and no inverse. With N N^-1 = I, (16) is M^-1 (Q - f), the motion without constraints; with Moore-Penrose
inverses N N^- = N, and (16) projects M^-1 (Q - f) on J a = g in the Euclidean metric instead of that of M:

    a_true - a_(16) = N (a_true - M^-1 (Q - f)) = -N M^-1 J^T lambda        (M a + f + J^T lambda = Q)
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
    """Return the error of a claimed rank of N, given by factors on the number of coordinates, that of rows, and the rows' rank."""
    sizes = np.linalg.svd(projector(p), compute_uv=False)  # a projector's singular values are 0 or at least 1
    return count_off(form, (p.n, len(p.J), p.rank), int((sizes > 0.5).sum()))


def reverse_order(p: Problem) -> Array:
    return pinv(projector(p)) @ power(p.M, -0.5)


def normal_inverse(p: Problem) -> Array:
    N = projector(p)
    return pinv(N @ p.M @ N) @ power(p.M, 0.5)


def inverse_off(form: Accelerations, p: Problem) -> float:
    """Compare a form with the Moore-Penrose inverse of A by its singular values."""
    return relative(form(p), pinv(power(p.M, 0.5) @ projector(p)))


def free_motion(p: Problem) -> Array:
    return np.asarray(np.linalg.solve(p.M, p.Q - p.f))


def euclidean(p: Problem) -> Array:
    return yuan_ge_eq16(p.terms).a


def final_of_14(p: Problem) -> Array:
    return gauss_pinv(p.terms).a


def accelerations_off(form: Accelerations, on: str = "") -> float:
    """Compare a form's accelerations with the reference on all problems, or on those of a special kind."""
    return worst([relative(form(p), p.a) for p in (special_problems(on) if on else all_problems())])


def constraints_off(form: Accelerations, p: Problem) -> float:
    """Return the residual of (6) for a form's accelerations, relative to its terms."""
    return float(np.abs(p.J @ form(p) - p.g).max() / (np.abs(p.J) @ np.abs(form(p))).max())


def predict(p: Problem) -> Array:
    """Return a_true - a_(16) as predicted above: -N M^-1 J^T lambda."""
    return -projector(p) @ np.linalg.solve(p.M, p.J.T @ p.multipliers)


def difference_off(factor: float, p: Problem) -> float:
    """Compare `factor` times the predicted a_true - a_(16) with the true one, relative to the largest acceleration involved."""
    wrong = euclidean(p)
    scale = max(np.abs(wrong).max(), np.abs(p.a).max(), np.abs(free_motion(p)).max())
    return float(np.abs(factor * predict(p) - (p.a - wrong)).max() / scale)
