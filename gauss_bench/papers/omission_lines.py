"""Yuan & Ge (2016), section 4: what the example leaves out, what is assumed here, and how much it matters.

The printed form of such a line is the example without the thing; its discrepancy is what leaving it out would change.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.papers import crank_slider
from gauss_bench.papers.crank_motion import CrankMotion, motion_of
from gauss_bench.papers.crank_slider import I1, I2, M1, M2, linkage
from gauss_bench.papers.line import SOLVED, YUAN_GE, Example, Line, Verdict
from gauss_bench.papers.method_forms import AT_START, true_crank_at_start
from gauss_bench.papers.problems import CRANK, Problem, crank_problems, worst
from gauss_bench.reference.build import build_reference
from gauss_bench.terms import Array

SHOWN = 0.5  # [s] of the motion, over which integrators are compared: most of the first turn
STEP = 1e-3  # [s] of the integrator that a reader might take
OF_CRANK = "largest relative change of the crank's acceleration"
BY_CONDITION = "rounding times the condition of the systems solved, up to 1e4, two decades of room"


def with_inertias(p: Problem, inertias: tuple[float, float]) -> Problem:
    M = p.M.copy()
    M[2, 2], M[5, 5] = inertias
    return replace(p, M=M)


def with_gravity(p: Problem, gravity: float) -> Problem:
    Q = p.Q.copy()
    Q[1], Q[4] = -M1 * gravity, -M2 * gravity
    return replace(p, Q=Q)


def crank_of(p: Problem) -> float:
    return float(lagrange(p.terms).a[CRANK])


def change(altered: Callable[[Problem], Problem]) -> float:
    return worst([abs(crank_of(altered(p)) / p.a[CRANK] - 1) for p in crank_problems()])


def no_inertias() -> tuple[float, float]:
    return 0.0, 0.0


def bars() -> tuple[float, float]:
    return I1, I2


def inertias_off(form: Callable[[], tuple[float, float]]) -> float:
    return change(lambda p: with_inertias(p, form()))


def no_gravity() -> float:
    return 0.0


def gravity() -> float:
    return crank_slider.GRAVITY


def gravity_off(form: Callable[[], float]) -> float:
    return change(lambda p: with_gravity(p, form()))


def at_start(altered: Callable[[Problem], Problem]) -> float:
    return crank_of(altered(crank_problems()[0]))


def euler(motion: CrankMotion) -> float:
    """Crank angle [rad] at SHOWN by explicit steps of first order."""
    theta = w = 0.0
    for _ in range(round(SHOWN / STEP)):
        theta, w = theta + STEP * w, w + STEP * float(motion.acceleration(theta, w))
    return theta


def high_order(motion: CrankMotion) -> float:
    return float(motion.run(SHOWN).theta[-1])


@cache
def true_angle() -> float:
    """From the reference of the linkage file, two other integrators of high order."""
    theta: Array = build_reference(linkage(), SHOWN).q[:, CRANK]
    return float(theta[-1])


def integrator_off(form: Callable[[CrankMotion], float]) -> float:
    return abs(form(motion_of(linkage())) - true_angle())


INERTIAS = Example(AT_START, lambda form: at_start(lambda p: with_inertias(p, form())), true_crank_at_start)
GRAVITY = Example(AT_START, lambda form: at_start(lambda p: with_gravity(p, form())), true_crank_at_start)


def lines() -> tuple[Line, ...]:
    return (
        Line(
            YUAN_GE,
            "section 4",
            "inertias of crank and rod",
            "nothing",
            "I = m l^2 / 12 about the middle: uniform bars",
            Verdict.NOT_GIVEN,
            no_inertias,
            bars,
            inertias_off,
            f"{OF_CRANK} against the linkage file",
            SOLVED,
            BY_CONDITION,
            "Without any inertia of their own the bars would turn this much more easily.",
            INERTIAS,
        ),
        Line(
            YUAN_GE,
            "section 4",
            "gravity",
            "the letter g",
            "9.81 m/s^2",
            Verdict.NOT_GIVEN,
            no_gravity,
            gravity,
            gravity_off,
            f"{OF_CRANK} against the linkage file",
            SOLVED,
            BY_CONDITION,
            "The letter is explained, its value is not.",
            GRAVITY,
        ),
        Line(
            YUAN_GE,
            "section 4",
            "integrator, step and time span",
            "nothing; here explicit Euler with a step of 1 ms stands for it",
            "DOP853 with a relative tolerance of 1e-10; the span is that of the linkage file",
            Verdict.NOT_GIVEN,
            euler,
            high_order,
            integrator_off,
            f"error of the crank's angle after {SHOWN:g} s [rad]",
            1e-8,
            "the tolerance times the growth of errors in half a second, 10 times, with a decade of room",
            "The choice shows in the figures, and without a time span nobody can tell what they showed.",
        ),
    )
