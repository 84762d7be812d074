"""Yuan & Ge (2016), eqs. (17) to (24), compared with motions that are computed from the linkage file `crank_slider`.

The paper's equations are the functions of the module `crank_slider`. The argument `form` of a measure (a function NAME_off) is the
formula or number that is tested. The last measures concern data that the paper leaves out (inertias, gravity, integrator): in place
of a printed form they have other values that a reader might assume.
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
STEP = 1e-3  # [s] step size of explicit Euler, which a reader might assume


def mass_off(form: Callable[[], Array]) -> float:
    """Return the largest relative difference between the diagonal of M, eq. (17), and that of the linkage file."""
    true = linkage().mass[list(KEPT)]
    return float(np.abs(form() / true - 1).max())


def power_off(s: ExampleState, f: float, a: Array) -> float:
    """Return the power v . (M a + f - Q) at the state s, divided by |v| . (|M a| + |Q|).

    By eq. (20), M a + f = Q - J^T lambda, this is the power of the constraint force, which is zero for the true a and f = 0.
    """
    inertia = crank_slider.mass() * a
    return float(abs(s.v @ (inertia + f - s.Q)) / (np.abs(s.v) @ (np.abs(inertia) + np.abs(s.Q))))


def bias_off(f: float, s: ExampleState) -> float:
    """Return the error of the power balance (`power_off`) at true accelerations if each entry of f, eq. (18), is the number f."""
    return power_off(s, f, s.a)


def order_off(order: list[int], s: ExampleState) -> float:
    """Return the error of the power balance (`power_off`) if the accelerations of eq. (20) are listed in this order of indices."""
    return power_off(s, 0.0, s.a[order])


def forces_off(form: Callable[[Array, Array], Array], s: ExampleState) -> float:
    """Return the largest error of form(q, v), the applied forces of eq. (19), relative to the largest force of the linkage file."""
    return float(np.abs(form(s.q, s.v) - s.Q).max() / np.abs(s.Q).max())


def positions_off(form: Callable[[Number], Number], s: ExampleState) -> float:
    """Return the largest residual of form(q), the constraints of eq. (21), at a true position, divided by DIMENSION."""
    return float(np.abs(form(s.q)).max()) / DIMENSION


def jacobian_off(form: Callable[[Number], Number], s: ExampleState) -> float:
    """Return the largest difference of form(q) from the derivatives of eq. (21), except for entry (6, 6), see `entry_off`."""
    difference = np.abs(form(s.q) - gradient(crank_slider.residual, s.q))
    difference[5, 5] = 0.0
    return float(difference.max())


def entry(form: dict[str, Any], q: Array) -> float:
    """Return entry (6, 6) of the Jacobian, eq. (22), at q (7,): factor * l2/2 * sin or cos (`of`) of the entry `angle` of q.

    By default the factor is 1 and the angle is that of the rod.
    """
    return float(form.get("factor", 1) * L2 / 2 * getattr(np, form["of"])(q[form.get("angle", 5)]))


def entry_off(form: dict[str, Any], s: ExampleState) -> float:
    """Return the error of `entry` against the derivative of eq. (21), divided by half the rod's length."""
    return float(abs(entry(form, s.q) - gradient(crank_slider.residual, s.q)[5, 5]) / (L2 / 2))


def row_off(squared: list[str], s: ExampleState, rows: list[int]) -> float:
    """Return the largest residual of `rows` of J a = g, counted from 1, relative to the largest acceleration.

    `squared` names the rates that are squared in g, eq. (23): ["v"], which is right, or ["a"], as the paper prints in some rows.
    """
    residual = crank_slider.bias(s.q, getattr(s, squared[0])) - gradient(crank_slider.residual, s.q) @ s.a  # (6,)
    return float(np.abs(residual)[np.array(rows) - 1].max() / np.abs(s.a).max())


def crank_with_entry(form: dict[str, Any]) -> float:
    """Return the crank's initial acceleration [rad/s^2] if entry (6, 6) of the Jacobian is as in `entry`."""
    s, zero = states()[0], np.zeros(6)  # residuals and rates of the constraints are zero at the start
    J = crank_slider.jacobian(s.q)
    J[5, 5] = entry(form, s.q)
    return float(lagrange(Terms(np.diag(crank_slider.mass()), J, s.Q, crank_slider.bias(s.q, s.v), zero, zero)).a[CRANK])


def start_off(form: list[float]) -> float:
    """Return the error of the initial position q (7,) and of the statement that the linkage starts at rest.

    The error is the largest residual of eq. (21) at q, difference of q from the start of the linkage file, or velocity of that
    start, divided by DIMENSION.
    """
    own, start = linkage(), np.array(form)
    residual = np.abs(crank_slider.residual(start)).max()
    return float(max(residual, np.abs(start - own.q0[list(KEPT)]).max(), np.abs(own.v0).max())) / DIMENSION


def figures_off(form: list[int]) -> float:
    """Return the number of figures that are wrong or missing in the range form = [first, last].

    The right figures are 2 to 5, which show the crank's centre.
    """
    first, last = form
    return float(len({2, 3, 4, 5} ^ set(range(first, last + 1))))


def accelerate(p: Problem, bars: Sequence[float] = (1.0, 1.0), gravity: float = GRAVITY) -> float:
    """Return the crank's acceleration [rad/s^2] in a problem of the example with other inertias and gravity.

    Args:
        bars: inertias of crank and rod, divided by those of uniform bars.
        gravity: acceleration of gravity [m/s^2].
    """
    M, Q = p.M.copy(), p.Q.copy()
    M[2, 2], M[5, 5] = bars[0] * I1, bars[1] * I2
    Q[1], Q[4] = -M1 * gravity, -M2 * gravity
    return float(lagrange(replace(p, M=M, Q=Q).terms).a[CRANK])


def data_off(form: dict[str, Any], p: Problem) -> float:
    """Return the relative error of the crank's acceleration if the data `form`, keyword arguments of `accelerate`, are assumed."""
    return float(abs(accelerate(p, **form) / p.a[CRANK] - 1))


def crank_with(form: dict[str, Any]) -> float:
    """Return the crank's initial acceleration [rad/s^2] with the data `form`, keyword arguments of `accelerate`."""
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
    """Return the certified motion up to the time SHOWN if there is one, else a reference that is computed now."""
    return find_certified(linkage(), SHOWN) or build_reference(linkage(), SHOWN)


def integrator_off(form: Callable[[CrankMotion], float]) -> float:
    """Return the error of the crank angle [rad] at time SHOWN that the integrator `form` computes."""
    return abs(form(motion_of(linkage())) - float(reference_motion().q[-1, CRANK]))
