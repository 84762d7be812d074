"""Wang et al. (2010), table 1: the units of three kinds of link, compared with exact derivatives and with the suite's own units.

    vector unit A(phi, s),   Jacobian unit J = dA/d(phi, s),   Jacobian-rate unit J' = dJ/dt

J is compared with the derivatives of the printed A, J' with that of the printed J in time, and A with `kinematics.link_units`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from gauss_bench.kinematics.link_units import BLOCK, GUIDE, PIN, Element, Way
from gauss_bench.linkage.load import load
from gauss_bench.papers.audit import worst
from gauss_bench.papers.crank_slider import TINY, Number
from gauss_bench.papers.forms.problems import relative
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.terms import Array

SEED, POSES = 2010, 20


@dataclass(frozen=True)
class Pose:
    """A link at an instant: angle phi, position s in the guide, rates of both, and the link's dimensions l, l', alpha, e."""

    phi: Any
    s: Any
    phi_rate: float
    s_rate: float
    l: float
    l2: float
    alpha: float
    e: float


Units = tuple[Number, ...]  # A (2,), J (2, 1 or 2), and J' unless it is measured by columns


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


def guide(p: Pose) -> Units:
    """Return A and J of the unit RP2; its J' is measured by columns."""
    s, c = np.sin(p.phi), np.cos(p.phi)
    A = np.array([p.e * s + p.s * c, -p.e * c + p.s * s])
    return A, np.array([[p.e * c - p.s * s, c], [p.e * s + p.s * c, s]])


def column_1(p: Pose, last: str) -> Array:
    """Return column 1 of J' of RP2; `last` names the rate of a Pose in its last term."""
    s, c, rate = np.sin(p.phi), np.cos(p.phi), getattr(p, last)
    along = -p.e * p.phi_rate * s - p.s * p.phi_rate * c - rate * s
    return np.array([along, p.e * p.phi_rate * c - p.s * p.phi_rate * s + rate * c])


def column_2(p: Pose) -> Array:
    return np.array([-p.phi_rate * np.sin(p.phi), p.phi_rate * np.cos(p.phi)])


def own_vector(p: Pose, kind: str) -> Array:
    """Return the suite's own vector unit of a path from a pin at the link's origin."""
    ends = {
        "RRR1": Element("b", "b", PIN, complex(p.l)),
        "RRR1 second": Element("b", "b", PIN, p.l2 * np.exp(1j * p.alpha)),
        "RP1": Element("b", "b", BLOCK, 1j * p.e),
        "RP2": Element("b", "b", GUIDE, -1j * p.e, 1.0 + 0j, "b"),
    }
    places, rates = ([p.s], [p.s_rate]) if kind == "RP2" else ([], [])
    return Way(0, Element("a", "a", PIN, 0j), ends[kind]).units(p.phi, p.phi_rate, places, rates).vector


def along(function: Callable[[Pose], Number], p: Pose, phi: float, s: float) -> Array:
    """Return the derivative of a function of the pose in the direction (phi, s), exact to rounding."""
    return np.asarray(function(replace(p, phi=p.phi + 1j * TINY * phi, s=p.s + 1j * TINY * s)).imag / TINY)


def unit_off(form: Callable[[Pose], Units], p: Pose, kind: str) -> float:
    """Compare A of a form with the suite's own, and J and J' (if the form has it) with exact derivatives."""
    A, J, *J_rate = form(p)
    slopes = [along(lambda x: form(x)[0], p, *way) for way in ((1.0, 0.0), (0.0, 1.0))[: J.shape[1]]]
    rate = along(lambda x: form(x)[1], p, p.phi_rate, p.s_rate)
    gaps = [A - own_vector(p, kind), J - np.stack(slopes, axis=1), *(x - rate for x in J_rate)]
    return worst([float(np.abs(gap).max()) for gap in gaps])


def true_rate(p: Pose) -> Array:
    return along(lambda x: guide(x)[1], p, p.phi_rate, p.s_rate)


def column_1_off(last: list[str], p: Pose) -> float:
    return float(np.abs(column_1(p, *last) - true_rate(p)[:, 0]).max())


def column_2_off(form: Callable[[Pose], Array], p: Pose) -> float:
    return float(np.abs(form(p) - true_rate(p)[:, 1]).max())


def difference_off(factor: float, p: Pose) -> float:
    """Compare `factor` (phi' - s') [sin phi; -cos phi] with the error of column 1 as printed."""
    claimed = factor * (p.phi_rate - p.s_rate) * np.array([np.sin(p.phi), -np.cos(p.phi)])
    return float(np.abs(claimed - (true_rate(p)[:, 0] - column_1(p, "phi_rate"))).max())


@cache
def shaper_turn() -> tuple[tuple[Pose, Array, Array], ...]:
    """Return for 24 instants of a driven turn of the shaper, whose lever is RP2 with e = 0, three things.

    They are the pose of the lever, the acceleration (2,) of the block, and the true phi'' and s'' (2,).
    """
    mechanism = load("shaper", "driven")
    links = {link.name: 3 * i for i, link in enumerate(mechanism.links)}
    motion, turn = MinimalCoordinate(mechanism), []
    for t in np.linspace(0.0, 1.0, 24, endpoint=False):
        q, v, a = (x[0] for x in motion.state_at(t))
        at, lever = links["block"], links["lever"] + 2
        arm, speed, push = q[at : at + 2] - mechanism.ground_points["O1"], v[at : at + 2], a[at : at + 2]
        s = float(np.hypot(*arm))
        s_rate = float(arm @ speed / s)
        s_second = float((arm @ push + speed @ speed - s_rate**2) / s)
        turn.append((Pose(q[lever], s, v[lever], s_rate, 0.0, 0.0, 0.0, 0.0), push, np.array([a[lever], s_second])))
    return tuple(turn)


def lever(last: list[str], pose: Pose, acceleration: Array) -> Array:
    """Return [phi'', s''] of J [phi'', s''] = a - J' [phi', s']; `last` is that of `column_1`."""
    J_rate = np.stack([column_1(pose, *last), column_2(pose)], axis=1)
    return np.asarray(np.linalg.solve(guide(pose)[1], acceleration - J_rate @ [pose.phi_rate, pose.s_rate]))


def lever_off(last: list[str]) -> float:
    """Return the largest error of phi'' or of s'' over the turn, relative to the largest of each."""
    computed = np.array([lever(last, pose, push) for pose, push, _ in shaper_turn()])
    true = np.array([x for *_, x in shaper_turn()])
    return worst([relative(computed[:, k], true[:, k]) for k in (0, 1)])


def lever_at_start(last: list[str]) -> float:
    pose, push, _ = shaper_turn()[0]
    return float(lever(last, pose, push)[0])


def true_lever_at_start() -> float:
    return float(shaper_turn()[0][2][0])
