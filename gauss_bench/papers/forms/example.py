"""Yuan & Ge (2016), eqs. (17) to (24), compared with motions that are computed from the linkage file `crank_slider`.

All equation numbers in this file are those of the paper. The paper's equations are the functions of the module `crank_slider`, such
as `residual` and `jacobian`. The argument `form` of a measure (a function NAME_off) is the formula or number that is tested, either
as printed or as corrected.

The last measures concern data that the paper leaves out: inertias, gravity and an integrator. In place of a printed form they have
other values of these data that a reader might assume, and the discrepancy is the change that these values cause.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from gauss_bench.formulations.lagrange import lagrange
from gauss_bench.papers import crank_slider
from gauss_bench.papers.crank_motion import CrankMotion, motion_of
from gauss_bench.papers.crank_slider import GRAVITY, I1, I2, KEPT, L1, L2, M1, M2, ExampleState, Number, gradient, linkage, states
from gauss_bench.papers.forms.problems import CRANK, Problem, crank_problems
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.certificate import find_certified
from gauss_bench.terms import Array, Terms
from gauss_bench.trajectory import Reference

DIMENSION = L1 + L2  # [m] size of the linkage, by which residuals of positions are divided
SHOWN = 0.5  # [s] time over which integrators are compared, most of the first turn
STEP = 1e-3  # [s] step size of the integrator that a reader might take


def moving_states() -> tuple[ExampleState, ...]:
    """Return all states except the start, which is at rest."""
    return states()[1:]


def mass_off(form: Callable[[], Array]) -> float:
    """Return the largest relative difference between the diagonal of M, eq. (17), and that of the linkage file."""
    true = linkage().mass[list(KEPT)]
    return float(np.abs(form() / true - 1).max())


def power_off(s: ExampleState, f: Array | float, a: Array) -> float:
    """Return the power v . (M a + f - Q) at the state s, divided by |v| . (|M a| + |Q|).

    The equation of motion, eq. (20), is M a + f = Q - J^T lambda, with forces f besides the applied forces Q; the true f is zero.
    For the true a and f, M a + f - Q is the constraint force, which has no power.
    """
    inertia = crank_slider.mass() * a
    return float(abs(s.v @ (inertia + f - s.Q)) / (np.abs(s.v) @ (np.abs(inertia) + np.abs(s.Q))))


def bias_off(f: float, s: ExampleState) -> float:
    """Return the relative error of the power balance of eq. (20), M a + f = Q - J^T lambda, if each entry of f is the number f."""
    return power_off(s, f, s.a)


def order_off(order: list[int], s: ExampleState) -> float:
    """Return the relative error of the power balance of eq. (20) if the accelerations are listed in this order of coordinates."""
    return power_off(s, 0.0, s.a[order])


def forces_off(form: Callable[[Array, Array], Array], s: ExampleState) -> float:
    """Compare the applied forces of eq. (19), a function of q and v, with those of the linkage file."""
    return float(np.abs(form(s.q, s.v) - s.Q).max() / np.abs(s.Q).max())


def positions_off(form: Callable[[Number], Number], s: ExampleState) -> float:
    """Return the largest residual of eq. (21), a function of q, at a true position."""
    return float(np.abs(form(s.q)).max()) / DIMENSION


def jacobian_off(form: Callable[[Number], Number], s: ExampleState) -> float:
    """Return the largest difference of a Jacobian, a function of q, from the derivatives of eq. (21), except for entry (6, 6).

    The paper prints entry (6, 6) wrongly; `entry_off` measures this entry, as a separate statement.
    """
    difference = np.abs(form(s.q) - gradient(crank_slider.residual, s.q))
    difference[5, 5] = 0.0
    return float(difference.max())


def entry(form: dict[str, Any], q: Array) -> float:
    """Return entry (6, 6) of the Jacobian, eq. (22) of the paper, printed or corrected: factor * l2/2 * sin or cos of an angle.

    Args:
        form: a table with the function `of` ("sin" or "cos"). The table may have `angle`, the index of the angle in q (by default
            5, the rod's), and `factor` (by default 1).
        q: (7,) positions in the paper's coordinates.
    """
    return float(form.get("factor", 1) * L2 / 2 * getattr(np, form["of"])(q[form.get("angle", 5)]))


def entry_off(form: dict[str, Any], s: ExampleState) -> float:
    """Return the error of entry (6, 6) of the Jacobian against the derivative of eq. (21), divided by half the rod's length."""
    return float(abs(entry(form, s.q) - gradient(crank_slider.residual, s.q)[5, 5]) / (L2 / 2))


def row_off(squared: list[str], s: ExampleState, rows: list[int]) -> float:
    """Return the largest residual of some rows of J a = g at a reference motion, relative to its largest acceleration.

    J has the derivatives of eq. (21).

    Args:
        squared: list with the name of the rates that are squared in g, eq. (23): ["v"] for velocities, which is right, or ["a"] for
            accelerations, which the paper prints in some rows.
        s: state of the reference motion.
        rows: numbers of the rows of J a = g that are tested, counted from 1.
    """
    off = crank_slider.bias(s.q, getattr(s, squared[0])) - gradient(crank_slider.residual, s.q) @ s.a
    return float(np.abs(off)[[row - 1 for row in rows]].max() / np.abs(s.a).max())


def crank_with_entry(form: dict[str, Any]) -> float:
    """Return the crank's initial acceleration [rad/s^2] if entry (6, 6) of the Jacobian is as `form` describes it (see `entry`)."""
    s, zero = states()[0], np.zeros(6)  # the initial state; the constraints are satisfied: their residuals and rates are zero
    J = crank_slider.jacobian(s.q)
    J[5, 5] = entry(form, s.q)
    return float(lagrange(Terms(np.diag(crank_slider.mass()), J, s.Q, crank_slider.bias(s.q, s.v), zero, zero)).a[CRANK])


def start_off(form: list[float]) -> float:
    """Return the error of the paper's initial position q (7,) and of its statement that the linkage starts at rest.

    The error is the largest of three numbers, divided by DIMENSION [m], the size of the linkage: the residual of the constraints,
    eq. (21), at q; the largest difference between q and the initial position in the linkage file; and the largest initial velocity
    in the linkage file.
    """
    own, start = linkage(), np.array(form)
    residual = np.abs(crank_slider.residual(start)).max()
    return float(max(residual, np.abs(start - own.q0[list(KEPT)]).max(), np.abs(own.v0).max())) / DIMENSION


def figures_off(form: list[int]) -> float:
    """Return the error of a claim that the figures with the numbers form = [first, last] show the motion of the crank's centre.

    In fact the paper's figures 2 to 5 show displacement and velocity of the crank's centre in x and y; figure 1 is the drawing of
    the linkage. The error is the number of figures in the claimed range that do not show the centre, plus the number of figures
    outside the range that show it.
    """
    first, last = form
    return float(len({2, 3, 4, 5} ^ set(range(first, last + 1))))


def accelerate(p: Problem, bars: Sequence[float] = (1.0, 1.0), gravity: float = GRAVITY) -> float:
    """Return the crank's acceleration [rad/s^2] in a problem of the crank-slider with other inertias or another gravity.

    Args:
        bars: inertias of crank and rod, as multiples of those of uniform bars.
        gravity: acceleration of gravity [m/s^2].
    """
    M, Q = p.M.copy(), p.Q.copy()
    M[2, 2], M[5, 5] = bars[0] * I1, bars[1] * I2
    Q[1], Q[4] = -M1 * gravity, -M2 * gravity
    return float(lagrange(replace(p, M=M, Q=Q).terms).a[CRANK])


def data_off(form: dict[str, Any], p: Problem) -> float:
    """Return the relative error of the crank's acceleration if the values in `form` are assumed for data missing in the paper.

    `form` has keyword arguments of `accelerate`. The error is the difference from the true acceleration of the problem p.
    """
    return float(abs(accelerate(p, **form) / p.a[CRANK] - 1))


def crank_with(form: dict[str, Any]) -> float:
    """Return the crank's initial acceleration [rad/s^2] if the values in `form` are assumed for data missing in the paper.

    `form` has keyword arguments of `accelerate`.
    """
    return accelerate(crank_problems()[0], **form)


def euler(motion: CrankMotion) -> float:
    """Return the crank angle [rad] at time SHOWN by explicit Euler steps."""
    theta = w = 0.0
    for _ in range(round(SHOWN / STEP)):
        theta, w = theta + STEP * w, w + STEP * float(motion.acceleration(theta, w))
    return theta


def high_order(motion: CrankMotion) -> float:
    """Return the crank angle [rad] at time SHOWN by an integrator of order 8."""
    return float(motion.run(SHOWN).theta[-1])


@cache
def reference_motion() -> Reference:
    """Return the reference motion up to the time SHOWN [s].

    This is a certified motion if there is one, else a motion that is computed now by two integrators of high order.
    """
    return find_certified(linkage(), SHOWN) or build_reference(linkage(), SHOWN)


def integrator_off(form: Callable[[CrankMotion], float]) -> float:
    """Return the error of the crank angle [rad] at time SHOWN that an integrator computes."""
    return abs(form(motion_of(linkage())) - float(reference_motion().q[-1, CRANK]))
