"""Compute the example of Yuan & Ge (2016), section 4, again: does the crank-slider "finally stop in an equilibrium"?

Everything is computed from the linkage file and the closed form of `crank_motion`; `reproduction.toml` explains each number. The
paper does not give inertias and gravity, which are assumed throughout.
"""

import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BPoly

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.papers import crank_motion
from gauss_bench.papers.crank_motion import EQ_16, EQS_10_11, TRUE, CrankMotion, find_bound, find_equilibria, settles, torque_range
from gauss_bench.papers.crank_slider import KEPT, linkage
from gauss_bench.trajectory import Reference

COARSE = 1e2  # factor on the tolerance of a second run, whose difference from the first bounds the error of the first
TORQUES = (-0.2, 0.2, 0.5)  # [N m] under which the crank comes to rest; the last is the printed one with the opposite sign
# relative widths at which bisections end
STATIC_WIDTH = 1e-6  # in a narrower bracket the first swing is smaller than the integrator's absolute tolerance
CORNER_WIDTH = 1e-6  # the bounds of other inertias are quoted to six digits
INERTIAS = (0.0, 1.0, 2.0, 3.0)  # factors on a uniform bar's: 0 is a point mass at the centre, 3 is half the mass at either end
CORNERS = ((0.0, 0.0), (0.0, 3.0), (3.0, 0.0), (3.0, 3.0))  # extreme factors of crank and rod
SAME = 1e-6  # relative difference of accelerations that count as equal: far above rounding, far below that of any two formulas
WATCHED = 2.0  # [s] duration of the linkage file's scenario
ROWS = 601  # rows of the table of the paper's figures
SPAN = 4.0  # [s] longest time of the figures: on a longer axis the turns would merge
COLUMNS = {"x1": 0, "y1": 1, "theta1": 2, "x3": 6}  # of the paper's seven coordinates
FORMULAS = {"true": TRUE, "eq16": EQ_16, "eqs10_11": EQS_10_11}

Values = dict[str, tuple[float, float | None]]  # key of a row -> value and its uncertainty, None if exact to rounding


def reproduction() -> dict[str, Any]:
    """Compute the example's numbers; return {"reproduction": rows} with one row for each entry of the file `reproduction.toml`.

    `value` is None for a claim of the paper or data that it omits; `bracket` is the uncertainty of the value, None if it is exact
    to rounding. The verdict of a claim is "refuted", "holds" or "not shown".
    """
    motion = crank_motion.motion_of(linkage())
    values: Values = {"torque": (motion.torque, None), "damper": (motion.c, None), "watched": (WATCHED, None)}
    values |= steady_values(motion) | static_values(motion) | settling_values(motion) | formula_values(motion)
    verdicts = {key: "holds" if holds else "refuted" for key, holds in judge_claims(motion).items()}
    rows = []
    for group, table in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")).items():
        for key, words in table.items():  # words: quantity, unit, statement and the like
            value, bracket = values.get(key, (None, None))
            empty = {"unit": "", "verdict": verdicts.get(key, ""), "statement": ""}
            rows.append({"group": group, "key": key, "value": value, "bracket": bracket, **empty, **words})
    return {"reproduction": rows}


def steady_values(motion: CrankMotion) -> Values:
    """Return the values of `steady_rotation`; their uncertainty is the change with a coarser tolerance.

    The result also has "swept", the integral of (dx3/dtheta)^2 over a turn [m^2], and "balance", the constant speed [rad/s] at
    which the damper takes as much energy as the torque gives.
    """
    fine, coarse = crank_motion.steady_rotation(motion), crank_motion.steady_rotation(motion, COARSE * crank_motion.RTOL)
    values: Values = {key: (value, abs(value - coarse[key])) for key, value in fine.items()}
    exact = {"taken": fine["taken"], "swept": crank_motion.integrate_slope(motion), "balance": crank_motion.balance_speed(motion)}
    return values | {key: (value, None) for key, value in exact.items()}


def static_values(motion: CrankMotion) -> Values:
    """Return the extreme torques [N m] of weight and spring, their crank angles, and the angles [rad] at which the crank can rest.

    Keys of angles end in "printed" under the paper's torque, in "idle" without torque.
    """
    values: Values = {}
    for key, extreme in zip(("force_least", "force_most"), torque_range(motion), strict=True):
        # the torque is flat at an extreme, so that the angle is found only to the root of rounding
        values |= {key: (extreme.torque, None), f"{key}_at": (extreme.theta, 1e-8)}
    for tag, torque in (("printed", motion.torque), ("idle", 0.0)):
        for equilibrium in find_equilibria(replace(motion, torque=torque)):
            kind = "stable" if equilibrium.stable else "unstable"
            values[f"{kind}_{tag}"] = equilibrium.theta, None
    return values


def settling_values(motion: CrankMotion) -> Values:
    """Return the bounds of torque [N m] and damping [N s/m] within which the crank comes to rest from the paper's start.

    `settles_above_lowest` and `settles_above_highest` are the extremes of `settles_above` for the inertias in CORNERS. `rest_at_X`
    is the angle [rad] at which the crank rests under the torque X.
    """
    low, high = torque_range(motion)  # of weight and spring; a torque of -high.torque balances the largest
    with_torque = partial(with_inertias, motion, 1.0, 1.0)
    # brackets: no torque and twice the torque that overcomes weight and spring at every angle; 32 N s/m and the paper's damping
    extremes = [find_bound(partial(with_inertias, motion, *corner), 0.0, 2 * -high.torque, CORNER_WIDTH) for corner in CORNERS]
    values: Values = {
        "settles_above": find_bound(with_torque, 0.0, 2 * -high.torque),
        "settles_below": find_bound(with_torque, 0.0, 2 * -low.torque, STATIC_WIDTH),
        "damping": find_bound(lambda c: replace(motion, c=c), 32.0, motion.c),
        "settles_above_lowest": min(extremes),
        "settles_above_highest": max(extremes),
    }
    return values | {f"rest_at_{torque:g}": (find_rest(with_torque(torque)), None) for torque in TORQUES}


def with_inertias(motion: CrankMotion, crank: float, rod: float, torque: float) -> CrankMotion:
    """Return the motion with another torque [N m], and with `crank` and `rod` times the inertias of uniform bars."""
    factors = (1.0, 1.0, crank, 1.0, 1.0, rod, 1.0)  # of x, y, angle of the crank, x, y, angle of the rod, x of the slider
    return replace(motion, mass=tuple(m * k for m, k in zip(motion.mass, factors, strict=True)), torque=torque)


def find_rest(motion: CrankMotion) -> float:
    """Return the angle [rad] of the crank's only stable equilibrium, at which it comes to rest.

    Raises:
        ArithmeticError: the crank does not come to rest, or there are several stable equilibria.
    """
    angles = [equilibrium.theta for equilibrium in find_equilibria(motion) if equilibrium.stable]
    if not settles(motion) or len(angles) != 1:
        raise ArithmeticError(f"at {motion.torque:g} N m the crank does not come to rest at a single angle")
    return angles[0]


def formula_values(motion: CrankMotion) -> Values:
    """Return the crank's acceleration [rad/s^2] at the start, and its speed [rad/s] after WATCHED seconds, by each of FORMULAS."""
    values: Values = {}
    for key, formula in FORMULAS.items():
        changed = replace(motion, formula=formula)
        fine, coarse = (float(changed.run(WATCHED, rtol=rtol).w[-1]) for rtol in (crank_motion.RTOL, COARSE * crank_motion.RTOL))
        values |= {f"start_{key}": (float(changed.acceleration(0.0, 0.0)), None), f"speed_{key}": (fine, abs(fine - coarse))}
    return values


def judge_claims(motion: CrankMotion) -> dict[str, bool]:
    """Return key of a claim in `reproduction.toml` -> whether the claim is true.

    The paper makes all these claims except `any_inertia`, which this suite adds. `decreases` is true if `stops` is: amplitude and
    speed of the slider decrease if and only if the mechanism stops.
    """
    stops = settles(motion)
    wrong, true = (replace(motion, formula=formula).acceleration(0.0, 0.0) for formula in (EQ_16, TRUE))
    return {
        "stops": stops,
        "decreases": stops,
        "formula": bool(abs(wrong / true - 1) < SAME),
        "dissipative": settles(replace(motion, torque=0.0)),
        "rests": any(equilibrium.stable for equilibrium in find_equilibria(motion)),
        "any_inertia": not any(settles(with_inertias(motion, i, k, motion.torque)) for i in INERTIAS for k in INERTIAS),
    }


def paper_motion(mechanism: Mechanism, reference: Reference) -> dict[str, Any]:
    """Return {"paper_motion": rows}, the data of the paper's figures 2 to 9: t, x1, y1, theta1, x3 and their rates [m, rad, s].

    Between two samples of the reference, the motion is the polynomial with the positions, velocities and accelerations of both.
    """
    t = np.linspace(0.0, min(SPAN, float(reference.t[-1])), ROWS)
    columns = np.array(KEPT)[list(COLUMNS.values())]  # indices of x1, y1, theta1, x3 in the linkage file's coordinates
    levels = np.stack([reference.q[:, columns], reference.v[:, columns], reference.a[:, columns]], axis=1)  # (k, 3, 4)
    curve = BPoly.from_derivatives(reference.t, levels)
    names = ["t", *(f"{name}{rate}" for rate in ("", "_rate") for name in COLUMNS)]
    table = np.column_stack([t, curve(t), curve.derivative()(t)])
    return {"paper_motion": [dict(zip(names, row, strict=True)) for row in table.tolist()]}
