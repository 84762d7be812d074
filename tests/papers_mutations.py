"""Wrong corrections for every line of the audit, which the line's own measure must detect.

A wrong correction is of the kind of the line's forms, a function or data.
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
from gauss_bench.papers.forms.loops import six_bar_blocks

Wrong = dict[str, Any]
pinv, power, N = me.pinv, me.power, me.projector


def reflexive(A, rng):
    X = me.some_inverse(A, rng)
    return X @ A @ X


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
        found = tuple(np.array(x, dtype=float) for x in six_bar_blocks(phi, rate))
        found[block][index] = 1.0 - found[block][index]
        return found

    return other


INVERSES: Wrong = {"reflexive": reflexive}
EXPONENTS: Wrong = {
    "A only": lambda p: me.acceleration(p, exponents=(0.5, -0.5)),
    "b only": lambda p: me.acceleration(p, exponents=(-0.5, 0.5)),
}
FREE: Wrong = {"ordinary inverse": me.free_motion}
NO_MASS: Wrong = {"M left out": lambda p: pinv(p.J) @ p.g + N(p) @ (p.Q - p.f)}
SQUARES: Wrong = {"accelerations": ["a"], "the coordinates": ["q"]}
RATES: Wrong = {"the angle for its rate": ["phi"], "the place for its rate": ["s"]}
LINE: Wrong = {"upside down": lambda O1, A, B: po.quotient(*(complex(x.imag, x.real) for x in (O1, A, B)))}
METHOD: dict[str, Wrong] = {
    "Gauss's function": {"sign of Q": lambda p, a: me.gauss_function(replace(p, Q=-p.Q), a)},
    "Gauss's function by the root of M": {"positive root": lambda p, a: np.sum((power(p.M, 0.5) @ (p.M @ a + p.f - p.Q)) ** 2) / 2},
    "constraint forces that do work": {"other sign": lambda p, a, extra: me.root_function(p, a, -extra)},
    "constraints in accelerations": {"other sign": lambda rate, q, v: -me.differentiate(rate, q, v)},
    "general solution": {"plus in the projector": lambda p, X, h: X @ p.g + (np.eye(p.n) + X @ p.J) @ h},
    "rows that disagree": INVERSES,
    "least-squares form": {"no half": lambda A, b, h: 2 * me.half_square(A, b, h)},
    "exponent of M in A": {"no M": 0.0},
    "exponent of M in b": {"no M": 0.0},
    "motion from A and b": EXPONENTS,
    "unit of length": EXPONENTS,
    "condition of the minimum": {"multiplied by A": lambda A, b, h: (A @ A @ h, A @ b)},
    "inverse in the minimum": INVERSES,
    "sign before the last term": {"plus": lambda p, w: me.expand(p, w) + 2 * N(p) @ pinv(me.matrix(p)) @ me.matrix(p) @ w},
    "the free vector w": {"not projected": lambda p, w: me.acceleration(p, w) + N(p) @ w},
}
PROJECTOR: dict[str, Wrong] = {
    "inverse of a projector": {"rows counted": [1, -1, 0]},
    "order of the factors reversed": {"not reversed": lambda p: power(p.M, -0.5) @ N(p)},
    "with an ordinary inverse": {"Moore-Penrose": me.euclidean},
    "with Moore-Penrose inverses": NO_MASS,
    "meets the constraints": FREE,
    "difference from the truth": {"other sign": -1.0, "half": 0.5},
    "unit of length in (16)": NO_MASS,
    "where M = mu I": FREE,
    "where nothing is free": FREE,
    "where the constraints do not act": NO_MASS,
    "where M keeps the range of J^T": FREE,
}
EXAMPLE: dict[str, Wrong] = {
    "mass matrix": {"inertia about the end": lambda: crank_slider.mass() * [1, 1, 4, 1, 1, 4, 1]},
    "velocity forces": {"something": 1.0},
    "applied forces": {"spring": changed(crank_slider.forces, 6, lambda old, q, v: 5.0 * (q[6] - L1 - L2) - v[6])},
    "order of the accelerations": {"y before x": [0, 1, 2, 4, 3, 5, 6], "angles last": [0, 1, 3, 4, 6, 2, 5]},
    "constraints": {"sign in row 4": changed(crank_slider.residual, 3, lambda old, q: old + 2 * q[4])},
    "Jacobian but for one entry": {"sign of (1, 3)": changed(crank_slider.jacobian, (0, 2), lambda old, q: -old)},
    "entry (6, 6) of the Jacobian": {"sign": {"of": "cos", "factor": -1}, "other angle": {"of": "cos", "angle": 2}},
    "rows 1, 2 and 4 of g": SQUARES,
    "row 3 of g": SQUARES,
    "row 5 of g": SQUARES,
    "row 6 of g": SQUARES,
    "start": {"rod's centre": [0.075, 0, 0, 0.28, 0, 0, 0.71], "turned": [0.075, 0, 1e-3, 0.43, 0, 0, 0.71]},
    "figures of the crank's centre": {"1 to 4": [1, 4], "3 to 6": [3, 6]},
    "inertias of crank and rod": {"crank only": {"bars": [1.0, 0.0]}},
    "gravity": {"9.8": {"gravity": 9.8}},
    "integrator, step and time span": {"long steps": lambda motion: float(motion.run(ex.SHOWN, rtol=1e-3).theta[-1])},
}
LINK_UNITS: dict[str, Wrong] = {
    "RRR1 path": {"longer": lambda p: lu.first_bar(replace(p, l=2 * p.l))},
    "RRR1 second path": {"alpha the other way": lambda p: lu.second_bar(replace(p, alpha=-p.alpha))},
    "RP1 path": {"other side": lambda p: lu.block(replace(p, e=-p.e))},
    "RP2 vector and Jacobian unit": {"other side": lambda p: lu.guide(replace(p, e=-p.e))},
    "RP2 rate unit, column 2": {"sign": lambda p: -lu.column_2(p), "exchanged": lambda p: lu.column_2(p)[::-1]},
    "RP2 rate unit, column 1": RATES,
    "RP2 rate unit, what is missing": {"other sign": -1.0, "half": 0.5},
    "RP2 rate unit in a shaper": RATES,
}
LOOPS: dict[str, Wrong] = {
    "as many unknowns as equations": {"plus the redundant": [2, 1], "one for each loop": [1, 0]},
    "velocities": {"sign": lambda m, q_rate: -lo.velocities(m, q_rate)},
    "accelerations": {"A for J'": ["J"]},
    "columns of a unit": {"blocks too": [1, 1, 1], "angle only": [1, 0, 0]},
    "one 1 in each row": {"U only": [["U"]], "K only": [["K"]]},
    "matrices of a loop": {"U and K exchanged": lambda units, U, K: lo.assemble(units, U, K)[::-1]},
    "loops one above the other": {"transposed": True},
    "six-bar example": {
        "an entry of J": blocks(0, (0, 1)),
        "an entry of B'": blocks(3, (1, 0)),
    },
    "incidence matrix": {"the diagonal": True},
    "number of independent loops": {"without the frame": [1, -1, 0], "degrees of freedom": [-2, 3, -3]},
    "loops of the examples": {"a joint left out": {"eight_bar": ["1-2-5-3", "1-2-6-7-9-4", "1-2-6-8-9-4"]}},
    "motion laws": {"sign of the sine": lambda: lo.textbook() | {"sine": lambda u: u + np.sin(2 * np.pi * u) / (2 * np.pi)}},
}
POINTS: dict[str, Wrong] = {
    "loops of the shaper": {"sense of the crank": lambda x: (po.sides(x)[0] - 2 * (x.A - x.O2), po.sides(x)[1])},
    "lengths of lever and rod": {"exchanged": lambda x: po.lengths(replace(x, lever=x.rod, rod=x.lever))},
    "which coordinate of C is known": {"X of B": ["B", "real"], "Y of B": ["B", "imag"]},
    "which points are in line": {"O2 A B": ["O2", "A", "B"], "A B C": ["A", "B", "C"]},
    "line as a quotient": LINE,
    "line as a quotient in a search": LINE,
    "insensitive to the start of the search": {"half the size": lambda: abs(po.shapers()[0].C - po.shapers()[0].O1) / 2},
}
MUTATIONS: dict[str, Wrong] = METHOD | PROJECTOR | EXAMPLE | LINK_UNITS | LOOPS | POINTS
