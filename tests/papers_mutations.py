"""For every line of the audit, wrong corrections that a careless reader might make: each must be found out by the line itself."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.papers import crank_slider
from gauss_bench.papers.crank_slider import I1, I2, L1, L2
from gauss_bench.papers.forms import example as ex
from gauss_bench.papers.forms import least_squares as me
from gauss_bench.papers.forms import link_units as lu
from gauss_bench.papers.forms import loops as lo
from gauss_bench.papers.forms import points as po
from gauss_bench.papers.forms import projector as pr
from gauss_bench.papers.forms.loops import six_bar_blocks

Wrong = dict[str, Callable[..., Any]]
pinv, power, N = me.pinv, me.power, me.projector


def reflexive(A, rng):
    X = me.some_inverse(A, rng)
    return X @ A @ X


def shortest(A, rng):
    """An inverse with X A symmetric only: it gives short solutions, not nearest ones."""
    X = pinv(A)
    return X + rng.normal(size=X.shape) @ (np.eye(len(A)) - A @ X)


def transposed(A, rng):
    return A.T


METHOD: dict[str, Wrong] = {
    "Gauss's function": {
        "M for its inverse": lambda p, a: (p.M @ a + p.f - p.Q) @ p.M @ (p.M @ a + p.f - p.Q),
        "sign of Q": lambda p, a: me.gauss_function(replace(p, Q=-p.Q), a),
        "sign of f": lambda p, a: me.gauss_function(replace(p, f=-p.f), a),
    },
    "Gauss's function by the root of M": {
        "positive root": lambda p, a: np.sum((power(p.M, 0.5) @ (p.M @ a + p.f - p.Q)) ** 2) / 2,
        "no root": lambda p, a: np.sum((power(p.M, -1.0) @ (p.M @ a + p.f - p.Q)) ** 2) / 2,
    },
    "constraint forces that do work": {
        "other sign": lambda p, extra, a: me.function_with(p, -extra, a),
        "left out": lambda p, extra, a: me.root_function(p, a),
    },
    "constraints in accelerations": {
        "other sign": lambda rate, q, v: -me.differentiate(rate, q, v),
        "half": lambda rate, q, v: me.differentiate(rate, q, v) / 2,
        "twice": lambda rate, q, v: 2 * me.differentiate(rate, q, v),
    },
    "general solution": {
        "plus in the projector": lambda p, X, h: X @ p.g + (np.eye(p.n) + X @ p.J) @ h,
        "transpose for inverse": lambda p, X, h: me.general_solution(p, p.J.T, h),
        "no projector": lambda p, X, h: X @ p.g + h,
        "the other projector": lambda p, X, h: X @ p.g + X @ p.J @ h,
    },
    "rows that disagree": {"reflexive": reflexive, "shortest": shortest, "transpose": transposed},
    "least-squares form": {
        "no half": lambda A, b, h: 2 * me.half_square(A, b, h),
        "sign of b": lambda A, b, h: me.half_square(A, -b, h),
    },
    "exponent of M in A": {
        "no M": N,
        "whole M": lambda p: p.M @ N(p),
        "inverse M": lambda p: power(p.M, -1.0) @ N(p),
        "order": lambda p: N(p) @ power(p.M, 0.5),
        "the other projector": lambda p: power(p.M, 0.5) @ pinv(p.J) @ p.J,
    },
    "exponent of M in b": {
        "the other term": lambda p: -(power(p.M, -0.5) @ pinv(p.J) @ p.g + power(p.M, 0.5) @ (p.f - p.Q)),
        "both positive": lambda p: -(power(p.M, 0.5) @ (pinv(p.J) @ p.g + p.f - p.Q)),
        "no M": lambda p: -(pinv(p.J) @ p.g + power(p.M, -0.5) @ (p.f - p.Q)),
        "sign": lambda p: -me.vector(p),
    },
    "motion from A and b": {
        "A only": lambda p: (me.matrix(p), me.vector_as_printed(p)),
        "b only": lambda p: (me.matrix_as_printed(p), me.vector(p)),
        "sign of b": lambda p: (me.matrix(p), -me.vector(p)),
    },
    "unit of length": {
        "A only": lambda p: (me.matrix(p), me.vector_as_printed(p)),
        "b only": lambda p: (me.matrix_as_printed(p), me.vector(p)),
    },
    "condition of the minimum": {
        "multiplied by A": lambda A, b, h: (A @ A @ h, A @ b),
        "one side only": lambda A, b, h: (A.T @ A @ h, b),
    },
    "inverse in the minimum": {"shortest": shortest, "reflexive": reflexive, "transpose": transposed},
    "sign before the last term": {
        "plus": lambda p, w: me.expand(p, w) + 2 * N(p) @ pinv(me.matrix(p)) @ me.matrix(p) @ w,
        "left out": lambda p, w: me.expand(p, w) + N(p) @ pinv(me.matrix(p)) @ me.matrix(p) @ w,
    },
    "the free vector w": {
        "outside the projector": lambda p, w: (
            me.bracket(p, w) + (np.eye(p.n) - N(p)) @ (np.eye(p.n) - pinv(me.matrix(p)) @ me.matrix(p)) @ w
        ),
        "not projected": lambda p, w: me.bracket(p, w) + N(p) @ w,
    },
}


def without_mass(p):
    return pinv(p.J) @ p.g + N(p) @ (p.Q - p.f)


def shortest_acceleration(p):
    return pinv(p.J) @ p.g


PROJECTOR: dict[str, Wrong] = {
    "inverse of a projector": {
        "rows counted": lambda n, m, r: n - m,
        "rank of J": lambda n, m, r: r,
        "one more": lambda n, m, r: n - r + 1,
    },
    "order of the factors reversed": {
        "not reversed": lambda p: power(p.M, -0.5) @ N(p),
        "positive exponent": lambda p: N(p) @ power(p.M, 0.5),
        "no projector": lambda p: power(p.M, -0.5),
    },
    "with an ordinary inverse": {"Moore-Penrose": pr.euclidean, "constraints alone": shortest_acceleration},
    "with Moore-Penrose inverses": {
        "ordinary inverse": pr.free_motion,
        "M left out": without_mass,
        "constraints alone": shortest_acceleration,
        "sign": lambda p: 2 * shortest_acceleration(p) - pr.euclidean(p),
    },
    "meets the constraints": {
        "ordinary inverse": pr.free_motion,
        "free part alone": lambda p: N(p) @ pr.free_motion(p),
    },
    "difference from the truth": {
        "other sign": lambda p: -pr.predict(p),
        "no projector": lambda p: -np.linalg.solve(p.M, p.J.T @ p.multipliers),
        "no M": lambda p: -N(p) @ p.J.T @ p.multipliers,
        "other projector": lambda p: -(np.eye(p.n) - N(p)) @ np.linalg.solve(p.M, p.J.T @ p.multipliers),
    },
    "unit of length in (16)": {"M left out": without_mass, "constraints alone": shortest_acceleration},
    "where M = mu I": {"ordinary inverse": pr.free_motion, "M left out": without_mass},
    "where nothing is free": {"ordinary inverse": pr.free_motion},
    "where the constraints do not act": {"M left out": without_mass, "constraints alone": shortest_acceleration},
    "where M keeps the range of J^T": {"ordinary inverse": pr.free_motion, "M left out": without_mass},
}


def changed(function: Callable[..., Any], index: Any, value: Callable[..., Any]) -> Callable[..., Any]:
    """The function with one entry of its result replaced by value(old entry, *arguments)."""

    def other(*arguments: Any) -> Any:
        found = function(*arguments).copy()
        found[index] = value(found[index], *arguments)
        return found

    return other


def flipped(function: Callable[..., Any], index: Any) -> Callable[..., Any]:
    return changed(function, index, lambda old, *_: -old)


def entry(a: float, b: float) -> Callable[..., Any]:
    """One row of g with a cos th1 th1'^2 + b cos th2 th2'^2."""
    return lambda q, v, a_: np.array([a * np.cos(q[2]) * v[2] ** 2 + b * np.cos(q[5]) * v[5] ** 2])


EXAMPLE: dict[str, Wrong] = {
    "mass matrix": {
        "masses exchanged": lambda: crank_slider.mass()[[3, 4, 2, 0, 1, 5, 6]],
        "inertia about the end": lambda: crank_slider.mass() * [1, 1, 4, 1, 1, 4, 1],
    },
    "velocity forces": {
        "centrifugal": lambda q, v: (
            crank_slider.mass() * [-q[0], -q[1], 0, 0, 0, 0, 0] * v[2] ** 2
            + crank_slider.mass() * [0, 0, 0, q[3], q[4], 0, 0] * v[5] ** 2
        ),
        "damper again": lambda q, v: np.array([0, 0, 0, 0, 0, 0, v[6]]),
    },
    "applied forces": {
        "spring": changed(crank_slider.forces, 6, lambda old, q, v: 5.0 * (q[6] - L1 - L2) - v[6]),
        "damper": changed(crank_slider.forces, 6, lambda old, q, v: old + 2 * v[6]),
        "torque": flipped(crank_slider.forces, 2),
        "gravity": flipped(crank_slider.forces, 4),
        "gravity along x": lambda q, v: crank_slider.forces(q, v)[[1, 0, 2, 3, 4, 5, 6]],
    },
    "order of the accelerations": {
        "y before x": lambda a: a[[0, 1, 2, 4, 3, 5, 6]],
        "angles last": lambda a: a[[0, 1, 3, 4, 6, 2, 5]],
    },
    "constraints": {
        "sign in row 4": changed(crank_slider.residual, 3, lambda old, q: old + 2 * q[4]),
        "whole rod in row 6": changed(crank_slider.residual, 5, lambda old, q: old + L2 / 2 * np.sin(q[5])),
        "sine for cosine in row 1": changed(crank_slider.residual, 0, lambda old, q: q[0] - L1 / 2 * np.sin(q[2])),
        "cosine for sine in row 6": changed(crank_slider.residual, 5, lambda old, q: q[4] + L2 / 2 * np.cos(q[5])),
    },
    "Jacobian but for one entry": {
        "sign of (1, 3)": flipped(crank_slider.jacobian, (0, 2)),
        "cosine in (5, 6)": changed(crank_slider.jacobian, (4, 5), lambda old, q: -L2 / 2 * np.cos(q[5])),
        "sign of (5, 7)": flipped(crank_slider.jacobian, (4, 6)),
    },
    "entry (6, 6) of the Jacobian": {
        "sign": lambda q: -L2 / 2 * np.cos(q[5]),
        "other angle": lambda q: L2 / 2 * np.cos(q[2]),
        "whole rod": lambda q: L2 * np.cos(q[5]),
        "minus sine, as in row 5": lambda q: -L2 / 2 * np.sin(q[5]),
    },
    "rows 1, 2 and 4 of g": {
        "signs": lambda q, v, a: -ex.rows_1_2_4(q, v, a),
        "rows exchanged": lambda q, v, a: ex.rows_1_2_4(q, v, a)[[1, 0, 2]],
        "accelerations in row 4": lambda q, v, a: np.array(
            [*ex.rows_1_2_4(q, v, a)[:2], L1 * np.sin(q[2]) * a[2] ** 2 + L2 / 2 * np.sin(q[5]) * a[5] ** 2]
        ),
    },
    "row 3 of g": {
        "first term only": lambda q, v, a: np.array([L1 * np.cos(q[2]) * v[2] ** 2 + L2 / 2 * np.cos(q[5]) * a[5] ** 2]),
        "second term only": lambda q, v, a: np.array([L1 * np.cos(q[2]) * a[2] ** 2 + L2 / 2 * np.cos(q[5]) * v[5] ** 2]),
        "sign": entry(-L1, -L2 / 2),
        "sign of the second term": entry(L1, -L2 / 2),
        "row 4 instead": ex.correct(4),
        "acceleration without a square": lambda q, v, a: np.array([L1 * np.cos(q[2]) * a[2] + L2 / 2 * np.cos(q[5]) * a[5]]),
    },
    "row 5 of g": {
        "sign": entry(0.0, -L2 / 2),
        "row 6 instead": ex.correct(6),
        "the crank's speed": lambda q, v, a: np.array([L2 / 2 * np.cos(q[5]) * v[2] ** 2]),
    },
    "row 6 of g": {
        "sign": lambda q, v, a: -ex.correct(6)(q, v, a),
        "row 5 instead": ex.correct(5),
        "the product of both speeds": lambda q, v, a: np.array([L2 / 2 * np.sin(q[5]) * v[2] * v[5]]),
    },
    "start": {
        "rod's centre": lambda: np.array([0.075, 0, 0, 0.28, 0, 0, 0.71]),
        "stretched further": lambda: np.array([0.075, 0, 0, 0.43, 0, 0, 0.72]),
        "turned": lambda: np.array([0.075, 0, 1e-3, 0.43, 0, 0, 0.71]),
    },
    "figures of the crank's centre": {
        "1 to 4": lambda: range(1, 5),
        "2 to 9": lambda: range(2, 10),
        "3 to 6": lambda: range(3, 7),
    },
    "inertias of crank and rod": {
        "about the end": lambda: (4 * I1, 4 * I2),
        "exchanged": lambda: (I2, I1),
        "crank only": lambda: (I1, 0.0),
    },
    "gravity": {"9.8": lambda: 9.8, "upwards": lambda: -9.81, "in feet": lambda: 32.2},
    "integrator, step and time span": {
        "long steps": lambda motion: float(motion.run(ex.SHOWN, rtol=1e-3).theta[-1]),
        "other start": lambda motion: float(motion.run(ex.SHOWN, (1e-6, 0.0)).theta[-1]),
    },
}


def unit(bar: Callable[..., Any], level: int, factor: float = -1.0) -> Callable[..., Any]:
    """A unit with its A, J or J' multiplied."""
    return lambda p: tuple(x * (factor if k == level else 1.0) for k, x in enumerate(bar(p)))


def guide_rate(first: str, last: str, sine: float = -1.0) -> Callable[..., Any]:
    """Column 1 of J' of RP2 with these rates in its middle and its last term, and a sign of the last term of the first row."""

    def column(p):
        s, c, middle, end = np.sin(p.phi), np.cos(p.phi), getattr(p, first), getattr(p, last)
        return np.array(
            [-p.e * p.phi_rate * s - p.s * middle * c + sine * end * s, p.e * p.phi_rate * c - p.s * middle * s + end * c]
        )

    return column


COLUMN_1: Wrong = {
    "s' in the middle term": guide_rate("s_rate", "phi_rate"),
    "s' in both": guide_rate("s_rate", "s_rate"),
    "sign": guide_rate("phi_rate", "s_rate", 1.0),
    "sine and cosine exchanged": lambda p: lu.rate_of_guide(replace(p, e=0.0, s=0.0), p.s_rate)[::-1] + lu.rate_of_guide(p, 0.0),
    "last term left out": lambda p: lu.rate_of_guide(p, 0.0),
}
LINK_UNITS: dict[str, Wrong] = {
    "RRR1 path": {
        "sine and cosine exchanged": lambda p: tuple(x[::-1] for x in lu.first_bar(p)),
        "sign of J": unit(lu.first_bar, 1),
        "sign of J'": unit(lu.first_bar, 2),
    },
    "RRR1 second path": {
        "alpha left out": lambda p: lu.second_bar(replace(p, alpha=0.0)),
        "alpha the other way": lambda p: lu.second_bar(replace(p, alpha=-p.alpha)),
        "l for l'": lambda p: lu.second_bar(replace(p, l2=p.l)),
    },
    "RP1 path": {"other side": lambda p: lu.block(replace(p, e=-p.e)), "sign of J'": unit(lu.block, 2)},
    "RP2 vector and Jacobian unit": {
        "other side": lambda p: lu.guide(replace(p, e=-p.e)),
        "columns exchanged": lambda p: (lu.guide(p)[0], lu.guide(p)[1][:, ::-1]),
        "sign of e in J": lambda p: (lu.guide(p)[0], lu.guide(replace(p, e=-p.e))[1]),
    },
    "RP2 rate unit, column 2": {
        "s' in this column": lambda p: lu.column_2(p) / p.phi_rate * p.s_rate,
        "sign": lambda p: -lu.column_2(p),
        "sine and cosine exchanged": lambda p: lu.column_2(p)[::-1],
    },
    "RP2 rate unit, column 1": COLUMN_1,
    "RP2 rate unit, what is missing": {
        "other sign": lambda p: -lu.difference(p),
        "sine and cosine exchanged": lambda p: lu.difference(p)[::-1],
        "s' alone": lambda p: -p.s_rate * np.array([np.sin(p.phi), -np.cos(p.phi)]),
    },
    "RP2 rate unit in a shaper": COLUMN_1,
}


def blocks(block: int, index: tuple[int, int], value: Callable[[float], float]) -> Callable[..., Any]:
    """The six-bar's matrices with one entry changed."""

    def other(phi: Any, rate: Any) -> Any:
        found = tuple(np.array(x, dtype=float) for x in six_bar_blocks(phi, rate))
        found[block][index] = value(found[block][index])
        return found

    return other


LOOPS: dict[str, Wrong] = {
    "as many unknowns as equations": {
        "plus the redundant": lambda L, r: 2 * L + r,
        "one for each loop": lambda L, r: L,
        "spatial": lambda L, r: 6 * L - r,
    },
    "velocities": {
        "sign": lambda m, q_rate: -lo.velocities(m, q_rate),
        "transposed": lambda m, q_rate: np.linalg.solve(m.J.T, -m.B @ q_rate),
        "by the rate matrix": lambda m, q_rate: np.linalg.lstsq(m.J, -m.B_rate @ q_rate, rcond=None)[0],
    },
    "accelerations": {
        "B' left out": lambda m, rate, q_rate, q_second: np.linalg.solve(m.J, -m.B @ q_second - m.J_rate @ rate),
        "J' left out": lambda m, rate, q_rate, q_second: np.linalg.solve(m.J, -m.B @ q_second - m.B_rate @ q_rate),
        "J' twice": lambda m, rate, q_rate, q_second: (
            lo.accelerations(m, rate, q_rate, q_second) - np.linalg.solve(m.J, m.J_rate @ rate)
        ),
        "sign of B'": lambda m, rate, q_rate, q_second: (
            lo.accelerations(m, rate, q_rate, q_second) + 2 * np.linalg.solve(m.J, m.B_rate @ q_rate)
        ),
    },
    "columns of a unit": {
        "blocks too": lambda r, guides, others: r + guides + others,
        "always turning": lambda r, guides, others: 1 + guides,
        "angle only": lambda r, guides, others: r,
    },
    "one 1 in each row": {
        "U only": lambda U, K: [U],
        "K only": lambda U, K: [K],
        "columns": lambda U, K: [np.hstack([U, K]).T],
    },
    "matrices of a loop": {
        "U and K exchanged": lambda units, U, K: lo.assemble(units, U, K)[::-1],
        "last way left out": lambda units, U, K: lo.assemble(units[:-1], U[:-1], K[:-1]),
        "signs alternate": lambda units, U, K: lo.assemble([(-1) ** i * J for i, J in enumerate(units)], U, K),
    },
    "loops one above the other": {
        "blocks transposed": lambda blocks: np.vstack([block.T for block in blocks]),
        "side by side": np.hstack,
        "added": sum,
        "rows of the loops in turn, for J only": lambda blocks: (
            np.vstack(blocks).reshape(len(blocks), 2, -1).swapaxes(0, 1).reshape(2 * len(blocks), -1)
            if blocks[0].shape[1] > 1
            else np.vstack(blocks)
        ),
    },
    "six-bar example": {
        "sign of an entry of J": blocks(0, (0, 1), lambda x: -x),
        "rate of the guide": blocks(1, (2, 3), lambda x: x + 1.0),
        "sign of an entry of J'": blocks(1, (3, 2), lambda x: -x),
        "sign of an entry of B'": blocks(3, (1, 0), lambda x: -x),
        "alpha left out": lambda phi, rate: tuple(
            np.where(np.arange(x.shape[1]) == 1, y, x)
            for x, y in zip(six_bar_blocks(phi, rate), six_bar_blocks(phi - [0, 0, np.radians(50), 0], rate), strict=True)
        ),
    },
    "incidence matrix": {
        "all": np.ones_like,
        "none": np.zeros_like,
        "j-th with i-th of the next": lambda belongs: np.roll(belongs, 1, axis=1),
    },
    "number of independent loops": {
        "without the frame": lambda p, n: p - n,
        "frame counted twice": lambda p, n: p - n + 2,
        "degrees of freedom": lambda p, n: 3 * (n - 1) - 2 * p,
    },
    "loops of the examples": {
        "a joint left out": lambda: lo.loops_as_printed() | {"eight_bar": ("1-2-5-3", "1-2-6-7-9-4", "1-2-6-8-9-4")},
        "a loop left out": lambda: lo.loops_as_printed() | {"eight_bar": ("1-2-5-3", "1-2-6-7-9-4")},
        "other order": lambda: lo.loops_as_printed() | {"six_bar": ("a-c-b-d", "d-e-f-g")},
    },
    "motion laws": {
        "sign of the sine": lambda: lo.textbook() | {"sine": lambda u: u + np.sin(2 * np.pi * u) / (2 * np.pi)},
        "whole wave of cosine": lambda: lo.textbook() | {"cosine": lambda u: (1 - np.cos(2 * np.pi * u)) / 2},
        "names exchanged": lambda: lo.textbook() | {"sine": lo.textbook()["cosine"], "cosine": lo.textbook()["sine"]},
        "of the sum": lambda: lo.textbook() | {"poly345": lambda u: 10 * u**3 + 15 * u**4 + 6 * u**5},
        "third order": lambda: lo.textbook() | {"poly345": lambda u: 3 * u**2 - 2 * u**3},
    },
}


def upside_down(O1: complex, A: complex, B: complex) -> float:
    return (A.imag - B.imag) / (A.real - B.real) - (O1.imag - B.imag) / (O1.real - B.real)


def size_of_the_shaper() -> float:
    return abs(po.shapers()[0].C - po.shapers()[0].O1)


LINE: Wrong = {
    "upside down": upside_down,
    "sign in the product": lambda O1, A, B: (A.real - B.real) * (O1.imag - B.imag) + (A.imag - B.imag) * (O1.real - B.real),
    "numerators and denominators mixed": lambda O1, A, B: (
        (A.real - B.real) * (O1.real - B.real) - (A.imag - B.imag) * (O1.imag - B.imag)
    ),
}
POINTS: dict[str, Wrong] = {
    "loops of the shaper": {
        "sense of the crank": lambda x: (po.sides(x)[0] - 2 * (x.A - x.O2), po.sides(x)[1]),
        "th4 = th2": lambda x: (
            po.sides(x)[0],
            x.lever * (x.A - x.O2) / abs(x.A - x.O2) + (x.C - x.B) - (x.C - x.O1),
        ),
        "sense of the rod": lambda x: (po.sides(x)[0], po.sides(x)[1] - 2 * (x.C - x.B)),
    },
    "lengths of lever and rod": {
        "exchanged": lambda x: po.lengths(replace(x, lever=x.rod, rod=x.lever)),
        "difference of squares": lambda x: (po.lengths(x)[0], po.lengths(x)[1] - 2 * (x.C.imag - x.B.imag) ** 2),
        "rod from O1": lambda x: (po.lengths(x)[0], abs(x.C - x.O1) ** 2 - x.rod**2),
    },
    "which coordinate of C is known": {"X of B": lambda: ("B", "real"), "Y of B": lambda: ("B", "imag")},
    "which points are in line": {
        "O2 A B": lambda: "O2 A B",
        "O1 O2 A": lambda: "O1 O2 A",
        "A B C": lambda: "A B C",
        "O2 B C": lambda: "O2 B C",
    },
    "line as a quotient": LINE,
    "line as a quotient in a search": LINE,
    "insensitive to the start of the search": {
        "half the size": lambda: size_of_the_shaper() / 2,
        "twice the size": lambda: 2 * size_of_the_shaper(),
    },
}
MUTATIONS: dict[str, Wrong] = METHOD | PROJECTOR | EXAMPLE | LINK_UNITS | LOOPS | POINTS
