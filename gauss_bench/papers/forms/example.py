"""Yuan & Ge (2016), eqs. (17) to (24), and their discrepancies from motions of the linkage file.

All equation numbers in this file are those of the paper; `residual`, `jacobian` and others of `crank_slider` are its equations. The
argument `form` of a measure is the formula or number that is tested, as printed or as corrected.

The last measures concern data that the example leaves out: inertias, gravity and an integrator. The printed form has other values
for these data, and its discrepancy is the change that they cause.
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
    """Compare the diagonal of M with that of the linkage file."""
    true = linkage().mass[list(KEPT)]
    return float(np.abs(form() / true - 1).max())


def power_off(s: ExampleState, f: Array | float, a: Array) -> float:
    """Return the power of M a + f - Q along the motion, relative to its terms; constraint forces have no power there."""
    inertia = crank_slider.mass() * a
    return float(abs(s.v @ (inertia + f - s.Q)) / (np.abs(s.v) @ (np.abs(inertia) + np.abs(s.Q))))


def bias_off(f: float, s: ExampleState) -> float:
    """Return the relative power that eq. (20), M a + f = Q - J^T lambda, leaves unexplained if every row has the same f."""
    return power_off(s, f, s.a)


def order_off(order: list[int], s: ExampleState) -> float:
    """Return the relative power that eq. (20) leaves unexplained if the accelerations stand in this order of the coordinates."""
    return power_off(s, 0.0, s.a[order])


def forces_off(form: Callable[[Array, Array], Array], s: ExampleState) -> float:
    """Compare the applied forces of eq. (19), a function of q and v, with those of the linkage file."""
    return float(np.abs(form(s.q, s.v) - s.Q).max() / np.abs(s.Q).max())


def positions_off(form: Callable[[Number], Number], s: ExampleState) -> float:
    """Return the largest residual of eq. (21), a function of q, at a true position."""
    return float(np.abs(form(s.q)).max()) / DIMENSION


def jacobian_off(form: Callable[[Number], Number], s: ExampleState) -> float:
    """Return the largest difference of a Jacobian, a function of q, from the derivatives of eq. (21), but for entry (6, 6).

    The paper prints this entry wrongly; it is a line of its own.
    """
    difference = np.abs(form(s.q) - gradient(crank_slider.residual, s.q))
    difference[5, 5] = 0.0
    return float(difference.max())


def entry(form: dict[str, Any], q: Array) -> float:
    """Return one version of entry (6, 6) of the Jacobian (22): factor * l2/2 * of(q[angle]).

    Args:
        form: `of` is "sin" or "cos", `angle` the index of the angle (that of the rod if missing), `factor` 1 if missing.
    """
    return float(form.get("factor", 1) * L2 / 2 * getattr(np, form["of"])(q[form.get("angle", 5)]))


def entry_off(form: dict[str, Any], s: ExampleState) -> float:
    """Compare one version of entry (6, 6) of the Jacobian with the derivative of eq. (21), relative to l2/2."""
    return float(abs(entry(form, s.q) - gradient(crank_slider.residual, s.q)[5, 5]) / (L2 / 2))


def row_off(squared: list[str], s: ExampleState, rows: list[int]) -> float:
    """Return the largest residual of some rows (counted from 1) of J a = g at a reference motion, relative to its accelerations.

    J has the derivatives of eq. (21), and g of eq. (23) contains the squares of angular velocities if `squared` is ["v"]. In some
    rows the paper prints squares of accelerations, ["a"].
    """
    off = crank_slider.bias(s.q, getattr(s, *squared)) - gradient(crank_slider.residual, s.q) @ s.a
    return float(np.abs(off)[[row - 1 for row in rows]].max() / np.abs(s.a).max())


def crank_with_entry(form: dict[str, Any]) -> float:
    """Return the crank's initial acceleration [rad/s^2] if entry (6, 6) of the Jacobian is that of `form` (see `entry`)."""
    s, zero = states()[0], np.zeros(6)
    J = crank_slider.jacobian(s.q)
    J[5, 5] = entry(form, s.q)
    return float(lagrange(Terms(np.diag(crank_slider.mass()), J, s.Q, crank_slider.bias(s.q, s.v), zero, zero)).a[CRANK])


def start_off(form: list[float]) -> float:
    """Return the error of a start q (7,) at rest, divided by DIMENSION.

    It is the largest of the residual of eq. (21), of the distance from the linkage file's start, and of the velocities there.
    """
    own, start = linkage(), np.array(form)
    residual = np.abs(crank_slider.residual(start)).max()
    return float(max(residual, np.abs(start - own.q0[list(KEPT)]).max(), np.abs(own.v0).max())) / DIMENSION


def figures_off(form: list[int]) -> float:
    """Return by how many figures the range [first, last] differs from figures 2 to 5, which show the motion of the crank's centre.

    Figures in the range that do not show the centre count, and so do figures outside the range that show it. Figures 2 to 5 show
    displacement and velocity of the centre in x and y; figure 1 is the drawing.
    """
    first, last = form
    return float(len({2, 3, 4, 5} ^ set(range(first, last + 1))))


def accelerate(p: Problem, bars: Sequence[float] = (1.0, 1.0), gravity: float = GRAVITY) -> float:
    """Return the crank's acceleration [rad/s^2] in a problem with other data.

    Args:
        bars: inertias of crank and rod, as multiples of those of uniform bars.
        gravity: acceleration of gravity [m/s^2].
    """
    M, Q = p.M.copy(), p.Q.copy()
    M[2, 2], M[5, 5] = bars[0] * I1, bars[1] * I2
    Q[1], Q[4] = -M1 * gravity, -M2 * gravity
    return float(lagrange(replace(p, M=M, Q=Q).terms).a[CRANK])


def data_off(form: dict[str, Any], p: Problem) -> float:
    """Return the relative change of the crank's acceleration with the data `form`, which the paper does not give (`accelerate`)."""
    return float(abs(accelerate(p, **form) / p.a[CRANK] - 1))


def crank_with(form: dict[str, Any]) -> float:
    """Return the crank's initial acceleration [rad/s^2] with the data `form`, which the paper leaves out."""
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
    """Return the reference motion up to SHOWN: a certified one, or one by two integrators of high order."""
    return find_certified(linkage(), SHOWN) or build_reference(linkage(), SHOWN)


def integrator_off(form: Callable[[CrankMotion], float]) -> float:
    """Return the error of the crank angle [rad] at time SHOWN that an integrator computes."""
    return abs(form(motion_of(linkage())) - float(reference_motion().q[-1, CRANK]))
