"""Wang et al. (2010), table 1: the units of three kinds of link, against exact derivatives and against the suite's own units.

    vector unit A(phi, s),   Jacobian unit J = dA/d(phi, s),   Jacobian-rate unit J' = dJ/dt

J is held against the derivatives of the printed A, J' against that of the printed J in time, A against `kinematics.link_units`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from gauss_bench.kinematics.link_units import BLOCK, GUIDE, PIN, Element, Way
from gauss_bench.linkage.load import load
from gauss_bench.papers.crank_slider import TINY, Number
from gauss_bench.papers.forms.problems import relative, worst
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array

SEED, POSES = 2010, 20


@dataclass(frozen=True)
class Pose:
    """A link at an instant: angle phi, place s, their rates, and its shape: l, l', alpha, e."""

    phi: Any
    s: Any
    phi_rate: float
    s_rate: float
    l: float
    l2: float
    alpha: float
    e: float


Units = tuple[Number, Number, Number]
Unit = Callable[[Pose], Units]


@cache
def poses() -> tuple[Pose, ...]:
    rng = np.random.default_rng(SEED)
    return tuple(Pose(*rng.uniform(0.2, 2.0, size=8)) for _ in range(POSES))


def bar(length: float, phi: Any, rate: float) -> Units:
    s, c = length * np.sin(phi), length * np.cos(phi)
    return np.array([c, s]), np.array([[-s], [c]]), np.array([[-rate * c], [-rate * s]])


def first_bar(p: Pose) -> Units:
    return bar(p.l, p.phi, p.phi_rate)


def second_bar(p: Pose) -> Units:
    return bar(p.l2, p.phi + p.alpha, p.phi_rate)


def block(p: Pose) -> Units:
    s, c = p.e * np.sin(p.phi), p.e * np.cos(p.phi)
    return np.array([-s, c]), np.array([[-c], [-s]]), np.array([[p.phi_rate * s], [-p.phi_rate * c]])


def guide(p: Pose) -> tuple[Number, Number]:
    """A and J of RP2, whose J' is judged by columns."""
    s, c = np.sin(p.phi), np.cos(p.phi)
    A = np.array([p.e * s + p.s * c, -p.e * c + p.s * s])
    return A, np.array([[p.e * c - p.s * s, c], [p.e * s + p.s * c, s]])


def rate_of_guide(p: Pose, last: float) -> Array:
    """Column 1 of J' of RP2, `last` being the rate in its last term."""
    s, c = np.sin(p.phi), np.cos(p.phi)
    return np.array(
        [
            -p.e * p.phi_rate * s - p.s * p.phi_rate * c - last * s,
            p.e * p.phi_rate * c - p.s * p.phi_rate * s + last * c,
        ]
    )


def column_1_as_printed(p: Pose) -> Array:
    return rate_of_guide(p, p.phi_rate)


def column_1(p: Pose) -> Array:
    return rate_of_guide(p, p.s_rate)


def column_2(p: Pose) -> Array:
    return np.array([-p.phi_rate * np.sin(p.phi), p.phi_rate * np.cos(p.phi)])


def no_difference(p: Pose) -> Array:
    return np.zeros(2)


def difference(p: Pose) -> Array:
    """The error of column 1 as printed: the true one minus it."""
    return (p.phi_rate - p.s_rate) * np.array([np.sin(p.phi), -np.cos(p.phi)])


def pin_to(leave: Element) -> Way:
    return Way(0, Element("a", "a", PIN, 0j), leave)


def own_vector(p: Pose, kind: str) -> Array:
    """The suite's own vector unit of a path from a pin at the link's origin."""
    ends = {
        "RRR1": Element("b", "b", PIN, complex(p.l)),
        "RRR1 second": Element("b", "b", PIN, p.l2 * np.exp(1j * p.alpha)),
        "RP1": Element("b", "b", BLOCK, 1j * p.e),
        "RP2": Element("b", "b", GUIDE, -1j * p.e, 1.0 + 0j, "b"),
    }
    places, rates = ([p.s], [p.s_rate]) if kind == "RP2" else ([], [])
    return pin_to(ends[kind]).units(p.phi, p.phi_rate, places, rates).vector


def along(function: Callable[[Pose], Number], p: Pose, phi: float, s: float) -> Array:
    """Derivative of a function of the pose in the direction (phi, s), to rounding."""
    return np.asarray(function(replace(p, phi=p.phi + 1j * TINY * phi, s=p.s + 1j * TINY * s)).imag / TINY)


def unit_off(kind: str) -> Callable[[Unit], float]:
    def off(form: Unit, p: Pose) -> float:
        A, J, J_rate = form(p)
        slope = along(lambda x: form(x)[0], p, 1.0, 0.0)
        rate = along(lambda x: form(x)[1], p, p.phi_rate, p.s_rate)
        gaps = (A - own_vector(p, kind), J[:, 0] - slope, J_rate - rate)
        return max(float(np.abs(gap).max()) for gap in gaps)

    return lambda form: worst([off(form, p) for p in poses()])


first_bar_off, second_bar_off, block_off = (unit_off(kind) for kind in ("RRR1", "RRR1 second", "RP1"))


def guide_off(form: Callable[[Pose], tuple[Number, Number]]) -> float:
    def off(p: Pose) -> float:
        A, J = form(p)
        slopes = [along(lambda x: form(x)[0], p, *direction) for direction in ((1.0, 0.0), (0.0, 1.0))]
        return max(float(np.abs(A - own_vector(p, "RP2")).max()), float(np.abs(J - np.stack(slopes, axis=1)).max()))

    return worst([off(p) for p in poses()])


def true_rate(p: Pose) -> Array:
    return along(lambda x: guide(x)[1], p, p.phi_rate, p.s_rate)


def column_off(column: int) -> Callable[[Callable[[Pose], Array]], float]:
    return lambda form: worst([float(np.abs(form(p) - true_rate(p)[:, column - 1]).max()) for p in poses()])


column_1_off, column_2_off = (column_off(column) for column in (1, 2))


def difference_off(form: Callable[[Pose], Array]) -> float:
    gaps = [form(p) - (true_rate(p)[:, 0] - column_1_as_printed(p)) for p in poses()]
    return worst([float(np.abs(gap).max()) for gap in gaps])


@cache
def shaper_turn() -> tuple[tuple[Pose, Array, Array], ...]:
    """The lever of the suite's shaper (RP2 with e = 0) over a driven turn.

    Pose, acceleration of the block, and the true phi'' and s''.
    """
    mechanism = load("shaper", "driven")
    links = {link.name: 3 * i for i, link in enumerate(mechanism.links)}
    assert mechanism.driver is not None
    motion, turn = MinimalCoordinate(mechanism), []
    for t in np.linspace(0.0, 1.0, 24, endpoint=False):
        q, v, a = (x[0] for x in motion.state(*(np.atleast_1d(x).astype(float) for x in mechanism.driver.law(t))))
        at, lever = links["block"], links["lever"] + 2
        arm, speed, push = q[at : at + 2] - mechanism.ground_points["O1"], v[at : at + 2], a[at : at + 2]
        s = float(np.hypot(*arm))
        s_rate = float(arm @ speed / s)
        s_second = float((arm @ push + speed @ speed - s_rate**2) / s)
        pose = Pose(q[lever], s, v[lever], s_rate, 0.0, 0.0, 0.0, 0.0)
        turn.append((pose, push, np.array([a[lever], s_second])))
    return tuple(turn)


def lever(form: Callable[[Pose], Array], pose: Pose, acceleration: Array) -> Array:
    """[phi'', s''] from J [phi'', s''] = a - J' [phi', s'] with this column 1 of J'."""
    J_rate = np.stack([form(pose), column_2(pose)], axis=1)
    return np.asarray(np.linalg.solve(guide(pose)[1], acceleration - J_rate @ [pose.phi_rate, pose.s_rate]))


def lever_off(form: Callable[[Pose], Array]) -> float:
    """Largest error of phi'' or of s'' over the turn, relative to the largest of each."""
    computed = np.array([lever(form, pose, push) for pose, push, _ in shaper_turn()])
    true = np.array([x for *_, x in shaper_turn()])
    return worst([relative(computed[:, k], true[:, k]) for k in (0, 1)])


def lever_at_start(form: Callable[[Pose], Array]) -> float:
    pose, push, _ = shaper_turn()[0]
    return float(lever(form, pose, push)[0])


def true_lever_at_start() -> float:
    return float(shaper_turn()[0][2][0])
