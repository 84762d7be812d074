"""Yuan & Ge (2016), eqs. (17) to (24), as functions, and their discrepancies from motions of the linkage file.

The last functions are about what the example leaves out. There the printed form is the example without the thing, and its
discrepancy is what leaving it out would change.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.papers import crank_slider
from gauss_bench.papers.crank_motion import CrankMotion, motion_of
from gauss_bench.papers.crank_slider import I1, I2, KEPT, L1, L2, M1, M2, ExampleState, Number, gradient, linkage, states
from gauss_bench.papers.forms.problems import CRANK, Problem, crank_problems, worst
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.store import find_certified
from gauss_bench.terms import Array, Terms
from gauss_bench.trajectory import Reference

DIMENSION = L1 + L2  # [m] size of the linkage, to which residuals of positions are compared
SHOWN = 0.5  # [s] of the motion, over which integrators are compared: most of the first turn
STEP = 1e-3  # [s] of the integrator that a reader might take


def everywhere(off: Callable[[ExampleState], float]) -> float:
    return worst([off(s) for s in states()])


def moving(off: Callable[[ExampleState], float]) -> float:
    """All but the start, which is at rest."""
    return worst([off(s) for s in states()[1:]])


def no_bias(q: Array, v: Array) -> Array:
    return np.zeros(7)


def in_order(a: Array) -> Array:
    """Accelerations of the linkage file (9,) in the paper's order (7,)."""
    return a[list(KEPT)]


def mass_off(form: Callable[[], Array]) -> float:
    true = linkage().mass[list(KEPT)]
    return float(np.abs(form() / true - 1).max())


def power_off(s: ExampleState, f: Array, Q: Array, a: Array) -> float:
    """Virtual power of M a + f - Q along the motion, in which no constraint force takes part, relative to its terms."""
    inertia = crank_slider.mass() * a
    return float(abs(s.v @ (inertia + f - Q)) / (np.abs(s.v) @ (np.abs(inertia) + np.abs(Q))))


def bias_off(form: Callable[[Array, Array], Array]) -> float:
    return moving(lambda s: power_off(s, form(s.q, s.v), s.Q, s.a))


def forces_off(form: Callable[[Array, Array], Array]) -> float:
    return everywhere(lambda s: float(np.abs(form(s.q, s.v) - s.Q).max() / np.abs(s.Q).max()))


def order_off(form: Callable[[Array], Array]) -> float:
    def off(s: ExampleState) -> float:
        whole = np.zeros(linkage().n)
        whole[list(KEPT)] = s.a
        return power_off(s, np.zeros(7), s.Q, form(whole))

    return moving(off)


def positions_off(form: Callable[[Number], Number]) -> float:
    return everywhere(lambda s: float(np.abs(form(s.q)).max()) / DIMENSION)


def jacobian_off(form: Callable[[Number], Number]) -> float:
    """All entries but (6, 6) against the derivatives of (21)."""

    def off(s: ExampleState) -> float:
        difference = np.abs(form(s.q) - gradient(crank_slider.residual, s.q))
        difference[5, 5] = 0.0
        return float(difference.max())

    return everywhere(off)


def entry_off(form: Callable[[Array], float]) -> float:
    """Entry (6, 6) against the derivative of (21), relative to l2/2."""
    return everywhere(lambda s: abs(form(s.q) - gradient(crank_slider.residual, s.q)[5, 5]) / (L2 / 2))


Rows = Callable[[Array, Array, Array], Array]


def row_off(*rows: int) -> Callable[[Rows], float]:
    """Rows of J a = g (counted from 1) at true motions, J by the derivatives of (21)."""

    def measure(form: Rows) -> float:
        chosen = [row - 1 for row in rows]

        def off(s: ExampleState) -> float:
            true = (gradient(crank_slider.residual, s.q) @ s.a)[chosen]
            return float(np.abs(form(s.q, s.v, s.a) - true).max() / np.abs(s.a).max())

        return everywhere(off)

    return measure


def rows_1_2_4(q: Array, v: Array, a: Array) -> Array:
    return crank_slider.bias(q, v)[[0, 1, 3]]


def correct(row: int) -> Rows:
    return lambda q, v, a: crank_slider.bias(q, v)[[row - 1]]


def row_3_as_printed(q: Array, v: Array, a: Array) -> Array:
    return np.array([L1 * np.cos(q[2]) * a[2] ** 2 + L2 / 2 * np.cos(q[5]) * a[5] ** 2])


def row_5_as_printed(q: Array, v: Array, a: Array) -> Array:
    return np.array([L2 / 2 * np.cos(q[5]) * a[5] ** 2])


def row_6_as_printed(q: Array, v: Array, a: Array) -> Array:
    return np.array([L2 / 2 * np.sin(q[5]) * a[5] ** 2])


row_3, row_5, row_6 = (correct(row) for row in (3, 5, 6))
row_3_off, row_5_off, row_6_off = (row_off(row) for row in (3, 5, 6))
rows_1_2_4_off = row_off(1, 2, 4)


def entry_as_printed(q: Array) -> float:
    return float(L2 / 2 * np.sin(q[5]))


def entry(q: Array) -> float:
    return float(L2 / 2 * np.cos(q[5]))


def crank_with_entry(form: Callable[[Array], float]) -> float:
    """The crank's acceleration at the start from the equations with this entry (6, 6)."""
    s, zero = states()[0], np.zeros(6)
    J = crank_slider.jacobian(s.q)
    J[5, 5] = form(s.q)
    return float(lagrange(Terms(np.diag(crank_slider.mass()), J, s.Q, crank_slider.bias(s.q, s.v), zero, zero)).a[CRANK])


def start() -> Array:
    return np.array(crank_slider.START)


def start_off(form: Callable[[], Array]) -> float:
    """Residual of (21) at the start, and distance from the start of the linkage file at rest."""
    own = linkage()
    residual = np.abs(crank_slider.residual(form())).max()
    return float(max(residual, np.abs(form() - own.q0[list(KEPT)]).max(), np.abs(own.v0).max())) / DIMENSION


def figures_as_printed() -> range:
    return range(1, 6)


def figures() -> range:
    return range(2, 6)


def figures_off(form: Callable[[], range]) -> float:
    """Figures too many or too few for displacement and velocity of one point in x and y, after figure 1, the drawing."""
    wanted = set(range(2, 2 + 2 * 2))
    return float(len(wanted ^ set(form())))


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
    """Crank angle [rad] at time SHOWN by explicit Euler steps."""
    theta = w = 0.0
    for _ in range(round(SHOWN / STEP)):
        theta, w = theta + STEP * w, w + STEP * float(motion.acceleration(theta, w))
    return theta


def high_order(motion: CrankMotion) -> float:
    return float(motion.run(SHOWN).theta[-1])


@cache
def show() -> Reference:
    """The motion as far as SHOWN from the linkage file: certified, or by two other integrators of high order."""
    return find_certified(linkage(), SHOWN) or build_reference(linkage(), SHOWN)


def integrator_off(form: Callable[[CrankMotion], float]) -> float:
    return abs(form(motion_of(linkage())) - float(show().q[-1, CRANK]))


def crank_with_inertias(form: Callable[[], tuple[float, float]]) -> float:
    return at_start(lambda p: with_inertias(p, form()))


def crank_with_gravity(form: Callable[[], float]) -> float:
    return at_start(lambda p: with_gravity(p, form()))
