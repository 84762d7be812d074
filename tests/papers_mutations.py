"""Wrong forms for every line of the audit, which the line's own measure must detect.

Of a line that is not right as printed, the printed form is one, and a wrong correction another. A wrong form is of the kind of the
line's form, a function or data.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.papers import crank_slider
from gauss_bench.papers.crank_slider import L1, L2
from gauss_bench.papers.forms import example as ex
from gauss_bench.papers.forms import least_squares as me
from gauss_bench.papers.forms import link_units as lu
from gauss_bench.papers.forms import loops as lo
from gauss_bench.papers.forms import points as po

Wrong = dict[str, Any]
pinv, power, N = me.pinv, me.power, me.projector


def changed(function: Callable[..., Any], index: Any, value: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function with one entry of its result replaced by value(old entry, *arguments)."""

    def other(*arguments: Any) -> Any:
        found = function(*arguments).copy()
        found[index] = value(found[index], *arguments)
        return found

    return other


def blocks(block: int, index: tuple[int, int]) -> Callable[..., Any]:
    """Return the six-bar's matrices with one entry changed."""

    def other(phi: Any, rate: Any) -> Any:
        found = tuple(np.array(x, dtype=float) for x in lo.six_bar_blocks(phi, rate))
        found[block][index] = 1.0 - found[block][index]
        return found

    return other


def reflexive(A: Any, rng: Any) -> Any:
    """Return an inverse X of A with X A X = X, which need not be the one of Moore and Penrose."""
    X = me.some_inverse(A, rng)
    return X @ A @ X


def without_mass(p: Any) -> Any:
    return pinv(p.J) @ p.g + N(p) @ (p.Q - p.f)


def upside_down(*points: complex) -> Any:
    return po.quotient(*(complex(x.imag, x.real) for x in points))


FREE: Wrong = {"ordinary inverse": me.free_motion}
MUTATIONS: dict[str, Wrong] = {
    "Gauss's function": {"sign of Q": lambda p, a: me.gauss_function(replace(p, Q=-p.Q), a)},
    "Gauss's function by the root of M": {"positive root": lambda p, a: np.sum((power(p.M, 0.5) @ (p.M @ a + p.f - p.Q)) ** 2) / 2},
    "constraint forces that do work": {"other sign": lambda p, a, extra: me.root_function(p, a, -extra)},
    "constraints in accelerations": {"other sign": lambda rate, q, v: -me.differentiate(rate, q, v)},
    "general solution": {"plus in the projector": lambda p, X, h: X @ p.g + (np.eye(p.n) + X @ p.J) @ h},
    "least-squares form": {"no half": lambda A, b, h: 2 * me.half_square(A, b, h)},
    "the free vector w": {"not projected": lambda p, w: me.acceleration(p, w) + N(p) @ w},
    "meets the constraints": FREE,
    "where M = mu I": FREE,
    "where nothing is free": FREE,
    "where the constraints do not act": {"M left out": without_mass},
    "where M keeps the range of J^T": FREE,
    "mass matrix": {"inertia about the end": lambda: crank_slider.mass() * [1, 1, 4, 1, 1, 4, 1]},
    "velocity forces": {"something": 1.0},
    "applied forces": {"spring": changed(crank_slider.forces, 6, lambda old, q, v: 5.0 * (q[6] - L1 - L2) - v[6])},
    "order of the accelerations": {"y before x": [0, 1, 2, 4, 3, 5, 6], "angles last": [0, 1, 3, 4, 6, 2, 5]},
    "constraints": {"sign in row 4": changed(crank_slider.residual, 3, lambda old, q: old + 2 * q[4])},
    "Jacobian but for one entry": {"sign of (1, 3)": changed(crank_slider.jacobian, (0, 2), lambda old, q: -old)},
    "rows 1, 2 and 4 of g": {"accelerations": ["a"], "the coordinates": ["q"]},
    "start": {"rod's centre": [0.075, 0, 0, 0.28, 0, 0, 0.71], "turned": [0.075, 0, 1e-3, 0.43, 0, 0, 0.71]},
    "RRR1 path": {"longer": lambda p: lu.first_bar(replace(p, l=2 * p.l))},
    "RRR1 second path": {"alpha the other way": lambda p: lu.second_bar(replace(p, alpha=-p.alpha))},
    "RP1 path": {"other side": lambda p: lu.block(replace(p, e=-p.e))},
    "RP2 vector and Jacobian unit": {"other side": lambda p: lu.guide(replace(p, e=-p.e))},
    "RP2 rate unit, column 2": {"sign": lambda p: -lu.column_2(p), "exchanged": lambda p: lu.column_2(p)[::-1]},
    "velocities": {"sign": lambda m, q_rate: -lo.velocities(m, q_rate)},
    "columns of a unit": {"blocks too": [1, 1, 1], "angle only": [1, 0, 0]},
    "matrices of a loop": {"U and K exchanged": lambda units, U, K: lo.assemble(units, U, K)[::-1]},
    "six-bar example": {"an entry of J": blocks(0, (0, 1)), "an entry of B'": blocks(3, (1, 0))},
    "number of independent loops": {"without the frame": [1, -1, 0], "degrees of freedom": [-2, 3, -3]},
    "loops of the examples": {"a joint left out": {"eight_bar": ["1-2-5-3", "1-2-6-7-9-4", "1-2-6-8-9-4"]}},
    "loops of the shaper": {"sense of the crank": lambda x: (po.sides(x)[0] - 2 * (x.A - x.O2), po.sides(x)[1])},
    "lengths of lever and rod": {"exchanged": lambda x: po.lengths(replace(x, lever=x.rod, rod=x.lever))},
    "insensitive to the start of the search": {"half the size": lambda: abs(po.shapers()[0].C - po.shapers()[0].O1) / 2},
}

CORRECTIONS: Wrong = {
    **dict.fromkeys(["rows that disagree", "inverse in the minimum"], reflexive),
    **dict.fromkeys(["exponent of M in A", "exponent of M in b"], 0.0),
    **dict.fromkeys(["motion from A and b", "unit of length"], lambda p: me.acceleration(p, exponents=(0.5, -0.5))),
    "condition of the minimum": lambda A, b, h: (A @ A @ h, A @ b),
    "sign before the last term": lambda p, w: me.expand(p, w) + 2 * N(p) @ pinv(me.matrix(p)) @ me.matrix(p) @ w,
    "inverse of a projector": [1, -1, 0],
    "order of the factors reversed": lambda p: power(p.M, -0.5) @ N(p),
    "with an ordinary inverse": me.euclidean,
    **dict.fromkeys(["with Moore-Penrose inverses", "unit of length in (16)"], without_mass),
    **dict.fromkeys(["difference from the truth", "RP2 rate unit, what is missing"], 0.5),
    "entry (6, 6) of the Jacobian": {"of": "cos", "angle": 2},
    "row 3 of g": ["q"],
    "row 5 of g": ["q"],
    "row 6 of g": ["q"],
    "figures of the crank's centre": [3, 6],
    "inertias of crank and rod": {"bars": [1.0, 0.0]},
    "gravity": {"gravity": 9.8},
    "integrator, step and time span": lambda motion: float(motion.run(ex.SHOWN, rtol=1e-3).theta[-1]),
    "RP2 rate unit, column 1": ["phi"],
    "RP2 rate unit in a shaper": ["phi"],
    "as many unknowns as equations": [2, 1],
    "accelerations": ["J"],
    "one 1 in each row": [["U"]],
    **dict.fromkeys(["loops one above the other", "incidence matrix"], True),
    "motion laws": lambda: lo.textbook() | {"sine": lambda u: u + np.sin(2 * np.pi * u) / (2 * np.pi)},
    "which coordinate of C is known": ["B", "real"],
    "which points are in line": ["A", "B", "C"],
    **dict.fromkeys(["line as a quotient", "line as a quotient in a search"], upside_down),
}
