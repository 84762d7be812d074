"""Wang et al. (2010), table 1: the vectors and matrices, called units, that a link of one of three kinds adds to a loop equation.

    vector unit A(phi, s),   Jacobian unit J = dA/d(phi, s),   Jacobian-rate unit J' = dJ/dt

A leads from the element (pin, block or guide) at which a loop enters the link to the element at which the loop leaves. phi is the
angle of the link, s the position along a slide. The kinds of paths through links are:

    RRR1:           a link with three pins, from the first to the second (length l)
    RRR1 second:    the same link, from the first to the third (length l', turned by alpha)
    RP1:            a link with a pin and the block of a slide, whose axis passes the pin at the distance e
    RP2:            a link with a pin and the guide of a slide, whose axis passes the pin at the distance e

For RP2, the paper prints the rate of phi in the last term of column 1 of J', where the rate of s must stand. A form of this column
is a list with the name of that rate, ["s_rate"] or ["phi_rate"].
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from gauss_bench.kinematics.link_units import BLOCK, GUIDE, PIN, Element, LinkPath
from gauss_bench.linkage.load import load
from gauss_bench.papers.audit import worst
from gauss_bench.papers.crank_slider import TINY, Number
from gauss_bench.papers.forms.problems import relative
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array

SEED, POSES = 2010, 20  # seed and number of random poses


@dataclass(frozen=True)
class Pose:
    """A link at an instant: angle phi, position s in the guide, their rates, and its lengths l, l', angle alpha and offset e."""

    phi: Any
    s: Any
    phi_rate: float
    s_rate: float
    l: float = 0.0
    l2: float = 0.0
    alpha: float = 0.0
    e: float = 0.0


# A (2,), J (2, 1 or 2) with columns for phi and s, and J'; J' is missing if the audit has a line for each of its columns
Units = tuple[Number, ...]


@cache
def poses() -> tuple[Pose, ...]:
    """Return random poses of links of random dimensions."""
    rng = np.random.default_rng(SEED)
    return tuple(Pose(*rng.uniform(0.2, 2.0, size=8)) for _ in range(POSES))


def bar(length: float, phi: Any, rate: float) -> Units:
    """Return A, J and J' of a bar between two pins."""
    s, c = length * np.sin(phi), length * np.cos(phi)
    return np.array([c, s]), np.array([[-s], [c]]), np.array([[-rate * c], [-rate * s]])


def first_bar(p: Pose) -> Units:
    """Return A, J and J' of the path RRR1."""
    return bar(p.l, p.phi, p.phi_rate)


def second_bar(p: Pose) -> Units:
    """Return A, J and J' of the path RRR1 second."""
    return bar(p.l2, p.phi + p.alpha, p.phi_rate)


def block(p: Pose) -> Units:
    """Return A, J and J' of the path RP1."""
    s, c = p.e * np.sin(p.phi), p.e * np.cos(p.phi)
    return np.array([-s, c]), np.array([[-c], [-s]]), np.array([[p.phi_rate * s], [-p.phi_rate * c]])


def guide(p: Pose) -> Units:
    """Return A (2,) and J (2, 2), by phi and s, of the path RP2."""
    s, c = np.sin(p.phi), np.cos(p.phi)
    A = np.array([p.e * s + p.s * c, -p.e * c + p.s * s])
    return A, np.array([[p.e * c - p.s * s, c], [p.e * s + p.s * c, s]])


def rate_column_1(p: Pose, last: str) -> Array:
    """Return column 1 (2,) of J' of the path RP2; `last` is the name of the rate in its last term ("s_rate" or "phi_rate")."""
    s, c, rate = np.sin(p.phi), np.cos(p.phi), getattr(p, last)
    x = -p.e * p.phi_rate * s - p.s * p.phi_rate * c - rate * s
    y = p.e * p.phi_rate * c - p.s * p.phi_rate * s + rate * c
    return np.array([x, y])


def column_2(p: Pose) -> Array:
    """Return column 2 (2,) of J' of the path RP2."""
    return np.array([-p.phi_rate * np.sin(p.phi), p.phi_rate * np.cos(p.phi)])


def complex_step(function: Callable[[Pose], Number], p: Pose, phi: float, s: float) -> Array:
    """Return the time derivative of a function of the pose for the rates `phi` and `s`, exact to rounding (complex-step method)."""
    return np.asarray(function(replace(p, phi=p.phi + 1j * TINY * phi, s=p.s + 1j * TINY * s)).imag / TINY)


def unit_off(form: Callable[[Pose], Units], p: Pose, kind: str) -> float:
    """Return the largest error of the units form(p) of a path of this kind, such as "RP2".

    A is compared with the vector of `kinematics.link_units`, J and J' with exact derivatives of A and J.
    """
    A, J, *J_rate = form(p)
    ends = {  # the element at the end of the path, which begins at a pin at the link's origin
        "RRR1": Element("b", "b", PIN, complex(p.l)),
        "RRR1 second": Element("b", "b", PIN, p.l2 * np.exp(1j * p.alpha)),
        "RP1": Element("b", "b", BLOCK, 1j * p.e),
        "RP2": Element("b", "b", GUIDE, -1j * p.e, 1.0 + 0j, "b"),
    }
    slides, slide_rates = ([p.s], [p.s_rate]) if kind == "RP2" else ([], [])
    own = LinkPath(0, Element("a", "a", PIN, 0j), ends[kind]).link_unit(p.phi, p.phi_rate, slides, slide_rates).vector
    directions = ((1.0, 0.0), (0.0, 1.0))[: J.shape[1]]  # of phi and, if J has two columns, of s
    slopes = [complex_step(lambda x: form(x)[0], p, *direction) for direction in directions]
    rate = complex_step(lambda x: form(x)[1], p, p.phi_rate, p.s_rate)
    errors = [A - own, J - np.stack(slopes, axis=1), *(x - rate for x in J_rate)]
    return worst([float(np.abs(error).max()) for error in errors])


def true_rate(p: Pose) -> Array:
    """Return the exact J' (2, 2) of the path RP2."""
    return complex_step(lambda x: guide(x)[1], p, p.phi_rate, p.s_rate)


def column_1_off(last: list[str], p: Pose) -> float:
    """Return the largest error of column 1 of J' of the path RP2 with the rate named in `last` in its last term."""
    return float(np.abs(rate_column_1(p, *last) - true_rate(p)[:, 0]).max())


def column_2_off(form: Callable[[Pose], Array], p: Pose) -> float:
    """Return the largest error of form(p), a formula for column 2 of J' of the path RP2."""
    return float(np.abs(form(p) - true_rate(p)[:, 1]).max())


def difference_off(factor: float, p: Pose) -> float:
    """Return the difference of `factor` (phi' - s') [sin phi; -cos phi] from the true minus the printed column 1 of J' of RP2."""
    claimed = factor * (p.phi_rate - p.s_rate) * np.array([np.sin(p.phi), -np.cos(p.phi)])
    return float(np.abs(claimed - (true_rate(p)[:, 0] - rate_column_1(p, "phi_rate"))).max())


@cache
def shaper_turn() -> tuple[tuple[Pose, Array, Array], ...]:
    """Return 24 instants of a driven turn of the shaper, whose lever is a link RP2 with e = 0.

    Each instant has the pose of the lever, the acceleration (2,) of the block in its guide, and the true phi'' and s'' (2,).
    """
    mechanism = load("shaper", "driven")
    links = {link.name: 3 * i for i, link in enumerate(mechanism.links)}
    motion, turn = MinimalCoordinate(mechanism), []
    for t in np.linspace(0.0, 1.0, 24, endpoint=False):
        q, v, a = (x[0] for x in motion.state_at(t))
        block, angle = links["block"], links["lever"] + 2  # indices of the block's x and of the lever's angle
        # (2,) each, of the block relative to the lever's pin on the ground
        arm, speed, acceleration = q[block : block + 2] - mechanism.ground_points["O1"], v[block : block + 2], a[block : block + 2]
        s = float(np.hypot(*arm))  # the position along the lever; from s^2 = arm . arm follow its derivatives
        s_rate = float(arm @ speed / s)
        s_second = float((arm @ acceleration + speed @ speed - s_rate**2) / s)
        turn.append((Pose(q[angle], s, v[angle], s_rate), acceleration, np.array([a[angle], s_second])))
    return tuple(turn)


def lever(last: list[str], pose: Pose, acceleration: Array) -> Array:
    """Return [phi'', s''] (2,) of the lever from J [phi'', s''] = a - J' [phi', s'], where a is the acceleration of the block.

    `last` has the name of the rate in the last term of column 1 of J'.
    """
    J_rate = np.stack([rate_column_1(pose, *last), column_2(pose)], axis=1)
    J = guide(pose)[1]
    return np.asarray(np.linalg.solve(J, acceleration - J_rate @ [pose.phi_rate, pose.s_rate]))


def lever_off(last: list[str]) -> float:
    """Return the larger of the relative errors of phi'' and s'' of the shaper's lever over one turn."""
    computed = np.array([lever(last, pose, acceleration) for pose, acceleration, _ in shaper_turn()])
    true = np.array([x for *_, x in shaper_turn()])
    return worst([relative(computed[:, k], true[:, k]) for k in (0, 1)])


def lever_at_start(last: list[str]) -> float:
    """Return the angular acceleration phi'' [rad/s^2] of the shaper's lever at the start of the turn."""
    pose, acceleration, _ = shaper_turn()[0]
    return float(lever(last, pose, acceleration)[0])


def true_lever_at_start() -> float:
    """Return the true phi'' [rad/s^2] of the shaper's lever at the start of the turn."""
    return float(shaper_turn()[0][2][0])
