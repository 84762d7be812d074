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
from gauss_bench.papers.line import SOLVED, YUAN_GE, Example, Line, Verdict, right
from gauss_bench.papers.method_forms import (
    AT_START,
    crank_at_start,
    pinv,
    power,
    projector,
    true_crank_at_start,
    unit_dependence,
)
from gauss_bench.papers.method_lines import BY_CONDITION, OF_ACCELERATION
from gauss_bench.papers.problems import Problem, all_problems, relative, special_problems, worst
from gauss_bench.terms import Array

Accelerations = Callable[[Problem], Array]


def regular(n: int, m: int, r: int) -> int:
    return n


def deficient(n: int, m: int, r: int) -> int:
    return n - r


def rank_off(form: Callable[[int, int, int], int]) -> float:
    """Error of a rank of N claimed from n coordinates and m rows of rank r."""
    found = []
    for p in all_problems():
        sizes = np.linalg.svd(projector(p), compute_uv=False)  # a projector's singular values are 0 or at least 1
        found.append(float(abs(form(p.n, len(p.J), p.rank) - int((sizes > 0.5).sum()))))
    return worst(found)


def reversed_order(p: Problem) -> Array:
    return pinv(projector(p)) @ power(p.M, -0.5)


def normal_inverse(p: Problem) -> Array:
    N = projector(p)
    return pinv(N @ p.M @ N) @ power(p.M, 0.5)


def inverse_off(form: Accelerations) -> float:
    """Against the Moore-Penrose inverse of A by its singular values."""
    return worst([relative(form(p), pinv(power(p.M, 0.5) @ projector(p))) for p in all_problems()])


def unconstrained(p: Problem) -> Array:
    return np.asarray(np.linalg.solve(p.M, p.Q - p.f))


def euclidean(p: Problem) -> Array:
    return yuan_ge_eq16(p.terms).a


def final_of_14(p: Problem) -> Array:
    return gauss_pinv(p.terms).a


def accelerations_off(form: Accelerations) -> float:
    return worst([relative(form(p), p.a) for p in all_problems()])


def constraints_off(form: Accelerations) -> float:
    """Residual of (6), relative to its terms."""
    terms = [(np.abs(p.J) @ np.abs(form(p)), p.J @ form(p) - p.g) for p in all_problems()]
    return worst([float(np.abs(r).max() / scale.max()) for scale, r in terms])


def nothing(p: Problem) -> Array:
    return np.zeros(p.n)


def predicted(p: Problem) -> Array:
    return -projector(p) @ np.linalg.solve(p.M, p.J.T @ p.multipliers)


def difference_off(form: Accelerations) -> float:
    """Against the measured difference, relative to the larger of the two accelerations that are subtracted."""
    found = []
    for p in all_problems():
        wrong = euclidean(p)
        scale = max(np.abs(wrong).max(), np.abs(p.a).max(), np.abs(unconstrained(p)).max())
        found.append(float(np.abs(form(p) - (p.a - wrong)).max() / scale))
    return worst(found)


def off_in(kind: str) -> Callable[[Accelerations], float]:
    return lambda form: worst([relative(form(p), p.a) for p in special_problems(kind)])


EXAMPLE = Example(AT_START, crank_at_start, true_crank_at_start)
FINAL = "a = J^- g + (I - J^- J) A^- b, as (14) leaves it"
HARMLESS = {
    "even": ("where M = mu I", "Both metrics are then the same but for a factor."),
    "full": ("where nothing is free", "With as many independent rows as coordinates N = 0, and there is nothing to minimise."),
    "idle": ("where the constraints do not act", "Without constraint forces the motion without constraints is the true one."),
    "aligned": ("where M keeps the range of J^T", "M^-1 J^T lambda then lies across the free motion."),
}


def inverse() -> tuple[Line, ...]:
    """Eq. (15)."""
    return (
        Line(
            YUAN_GE,
            "(15)",
            "inverse of a projector",
            "(I - J^- J)^-1 exists: rank n",
            "rank I - J^- J = n - rank J",
            Verdict.WRONG,
            regular,
            deficient,
            rank_off,
            "error of the rank",
            0.0,
            "a count",
            "I - J^- J projects on the free motion and has no inverse unless there are no constraints.",
        ),
        Line(
            YUAN_GE,
            "(15)",
            "order of the factors reversed",
            "A^- = (I - J^- J)^- M^(-1/2), both Moore-Penrose",
            "A^- = {(I - J^- J) M (I - J^- J)}^- M^(1/2)",
            Verdict.WRONG,
            reversed_order,
            normal_inverse,
            inverse_off,
            "relative difference from the Moore-Penrose inverse of A",
            SOLVED,
            BY_CONDITION,
            "The inverse of a product is the product of the inverses in reverse for regular factors, not for a projector.",
        ),
    )


def final() -> tuple[Line, ...]:
    """Eq. (16): that it is wrong, by how much, and that a residual does not show it."""
    return (
        Line(
            YUAN_GE,
            "(16)",
            "with an ordinary inverse",
            "(I - J^- J)(I - J^- J)^-1 = I, so that a = M^-1 (Q - f)",
            FINAL,
            Verdict.WRONG,
            unconstrained,
            final_of_14,
            accelerations_off,
            OF_ACCELERATION,
            SOLVED,
            BY_CONDITION,
            "Read this way it is the motion without constraints, and what a computer makes of the singular inverse is noise.",
            EXAMPLE,
        ),
        Line(
            YUAN_GE,
            "(16)",
            "with Moore-Penrose inverses",
            "a = J^- g - (I - J^- J)(I - J^- J)^- {J^- g + M^-1 (f - Q)}",
            FINAL,
            Verdict.WRONG,
            euclidean,
            final_of_14,
            accelerations_off,
            OF_ACCELERATION,
            SOLVED,
            BY_CONDITION,
            "It is the point of J a = g nearest to the motion without constraints in the Euclidean metric, not in that of M.",
            EXAMPLE,
        ),
        right(
            YUAN_GE,
            "(16)",
            "meets the constraints",
            "a = J^- g - (I - J^- J)(I - J^- J)^- {J^- g + M^-1 (f - Q)} satisfies (6)",
            euclidean,
            constraints_off,
            "residual of J a = g, relative to its terms",
            SOLVED,
            BY_CONDITION,
            "It meets every constraint to rounding although the motion is wrong: no check of residuals can detect the error.",
        ),
        Line(
            YUAN_GE,
            "(16)",
            "difference from the truth",
            "a_true - a = 0",
            "a_true - a = -(I - J^- J) M^-1 J^T lambda, where M a + f + J^T lambda = Q",
            Verdict.WRONG,
            nothing,
            predicted,
            difference_off,
            "error of the difference, relative to the accelerations subtracted",
            SOLVED,
            BY_CONDITION,
            "The whole error is what the constraint forces do along the free motion when the metric is not that of M. With the "
            "other sign of lambda (M a + f = Q + J^T lambda) the minus goes.",
        ),
        Line(
            YUAN_GE,
            "(16)",
            "unit of length in (16)",
            "a = J^- g - (I - J^- J)(I - J^- J)^- {J^- g + M^-1 (f - Q)}",
            FINAL,
            Verdict.WRONG,
            euclidean,
            final_of_14,
            unit_dependence,
            "relative change of the crank's acceleration from metres to millimetres",
            1e-8,
            "a change of unit by 1e3 worsens the condition by its square, 1e6, times rounding; two decades of room",
            "A Euclidean length of accelerations in m/s^2 and rad/s^2 depends on the unit; a motion must not.",
        ),
    )


def harmless() -> tuple[Line, ...]:
    """The cases in which (16) with Moore-Penrose inverses is right."""
    return tuple(
        right(
            YUAN_GE,
            "(16)",
            name,
            "a = J^- g - (I - J^- J)(I - J^- J)^- {J^- g + M^-1 (f - Q)}",
            euclidean,
            off_in(kind),
            OF_ACCELERATION,
            SOLVED,
            BY_CONDITION,
            sentence,
        )
        for kind, (name, sentence) in HARMLESS.items()
    )


def lines() -> tuple[Line, ...]:
    return (*inverse(), *final(), *harmless())
