"""Wang et al. (2010), table 1: the vectors and matrices, called units, that a link of one of three kinds adds to a loop equation.

    vector unit A(phi, s),   Jacobian unit J = dA/d(phi, s),   Jacobian-rate unit J' = dJ/dt

The vector A leads from the element (pin, block or guide) at which a loop enters the link to the element at which the loop leaves
it. phi is the angle of the link, and s is the position along a slide. J is compared with the derivatives of the printed A, J' with
the time derivative of the printed J, and A with the vector unit of `kinematics.link_units`.

The kinds of links, and of paths through them, in table 1 are:

    RRR1:           a link with three pins; the path leads from the first pin to the second (length l)
    RRR1 second:    the same link; the path leads from the first pin to the third (length l', turned by alpha)
    RP1:            a link with a pin and the block of a slide, whose axis passes the pin at the distance e
    RP2:            a link with a pin and the guide of a slide, whose axis passes the pin at the distance e; s is the place on it

For RP2, the paper prints the rate of phi in the last term of column 1 of J', where the rate of s must stand.
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
    """A link at an instant: angle phi, position s in the guide, their rates, and its lengths l, l', angle alpha and offset e."""

    phi: Any
    s: Any
    phi_rate: float
    s_rate: float
    l: float
    l2: float
    alpha: float
    e: float


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
    """Return vector A, Jacobian J and its rate J' of the path RRR1: from the first to the second pin of a link with three pins."""
    return bar(p.l, p.phi, p.phi_rate)


def second_bar(p: Pose) -> Units:
    """Return vector A, Jacobian J and its rate J' of the path "RRR1 second": from the first to the third pin of a link."""
    return bar(p.l2, p.phi + p.alpha, p.phi_rate)


def block(p: Pose) -> Units:
    """Return vector A, Jacobian J and its rate J' of the path RP1: from the pin of a link to the block of a slide on the link."""
    s, c = p.e * np.sin(p.phi), p.e * np.cos(p.phi)
    return np.array([-s, c]), np.array([[-c], [-s]]), np.array([[p.phi_rate * s], [-p.phi_rate * c]])


def guide(p: Pose) -> Units:
    """Return vector A (2,) and Jacobian J (2, 2), by phi and s, of the path RP2: from the pin of a link to a guide on the link.

    The functions `column_1` and `column_2` return the columns of its rate J'.
    """
    s, c = np.sin(p.phi), np.cos(p.phi)
    A = np.array([p.e * s + p.s * c, -p.e * c + p.s * s])
    return A, np.array([[p.e * c - p.s * s, c], [p.e * s + p.s * c, s]])


def column_1(p: Pose, last: str) -> Array:
    """Return column 1 of J', the time derivative of the Jacobian J of a link RP2 (with a pin and the guide of a slide).

    `last` names the rate in its last term: "s_rate", which is right, or "phi_rate", as the paper prints it.
    """
    s, c, rate = np.sin(p.phi), np.cos(p.phi), getattr(p, last)
    along = -p.e * p.phi_rate * s - p.s * p.phi_rate * c - rate * s
    return np.array([along, p.e * p.phi_rate * c - p.s * p.phi_rate * s + rate * c])


def column_2(p: Pose) -> Array:
    """Return column 2 of J', the time derivative of the Jacobian J of a link RP2 (with a pin and the guide of a slide)."""
    return np.array([-p.phi_rate * np.sin(p.phi), p.phi_rate * np.cos(p.phi)])


def own_vector(p: Pose, kind: str) -> Array:
    """Return the vector A (2,) as the suite computes it for a path `kind`, such as "RP2", from a pin at the link's origin."""
    ends = {  # the element at the end of the path: pair, node, kind, place in the link's frame, direction and name of a slide
        "RRR1": Element("b", "b", PIN, complex(p.l)),
        "RRR1 second": Element("b", "b", PIN, p.l2 * np.exp(1j * p.alpha)),
        "RP1": Element("b", "b", BLOCK, 1j * p.e),
        "RP2": Element("b", "b", GUIDE, -1j * p.e, 1.0 + 0j, "b"),
    }
    places, rates = ([p.s], [p.s_rate]) if kind == "RP2" else ([], [])
    return Way(0, Element("a", "a", PIN, 0j), ends[kind]).units(p.phi, p.phi_rate, places, rates).vector


def along(function: Callable[[Pose], Number], p: Pose, phi: float, s: float) -> Array:
    """Return the derivative of a function of the pose, if the angle and the place along the slide change at the rates phi and s.

    The derivative is exact to rounding (complex-step method).
    """
    return np.asarray(function(replace(p, phi=p.phi + 1j * TINY * phi, s=p.s + 1j * TINY * s)).imag / TINY)


def unit_off(form: Callable[[Pose], Units], p: Pose, kind: str) -> float:
    """Return the largest error of the vector A through a link, its Jacobian J and the rate J' that `form` computes.

    A is compared with the vector that the suite computes for a path of this kind (such as "RP2"), J with the exact derivatives of A
    by phi and s, and J' (if `form` returns it) with the exact time derivative of J.
    """
    A, J, *J_rate = form(p)
    # derivatives of A by phi and, if J has two columns, by s
    slopes = [along(lambda x: form(x)[0], p, *direction) for direction in ((1.0, 0.0), (0.0, 1.0))[: J.shape[1]]]
    rate = along(lambda x: form(x)[1], p, p.phi_rate, p.s_rate)
    gaps = [A - own_vector(p, kind), J - np.stack(slopes, axis=1), *(x - rate for x in J_rate)]
    return worst([float(np.abs(gap).max()) for gap in gaps])


def true_rate(p: Pose) -> Array:
    """Return the exact time derivative J' (2, 2) of the Jacobian J of a link RP2 (with a pin and the guide of a slide)."""
    return along(lambda x: guide(x)[1], p, p.phi_rate, p.s_rate)


def column_1_off(last: list[str], p: Pose) -> float:
    """Return the error of column 1 of J', the time derivative of the Jacobian J of a link RP2.

    `last` is a list of one name: the rate in the last term of the column (see `column_1`).
    """
    return float(np.abs(column_1(p, *last) - true_rate(p)[:, 0]).max())


def column_2_off(form: Callable[[Pose], Array], p: Pose) -> float:
    """Return the error of a formula for column 2 of J', the time derivative of the Jacobian J of a link RP2."""
    return float(np.abs(form(p) - true_rate(p)[:, 1]).max())


def difference_off(factor: float, p: Pose) -> float:
    """Compare `factor` (phi' - s') [sin phi; -cos phi] with the true minus the printed column 1 of J' of RP2."""
    claimed = factor * (p.phi_rate - p.s_rate) * np.array([np.sin(p.phi), -np.cos(p.phi)])
    return float(np.abs(claimed - (true_rate(p)[:, 0] - column_1(p, "phi_rate"))).max())


@cache
def shaper_turn() -> tuple[tuple[Pose, Array, Array], ...]:
    """Return pose, block acceleration and true second derivatives for each of 24 instants of a driven turn of the shaper.

    The three items of an instant are: the pose of the lever; the acceleration (2,) of the block that slides in the lever's guide;
    and the true phi'' and s'' (2,), the second derivatives of the lever's angle and of the block's place along the lever. The lever
    is a link RP2 of the paper (with a pin and the guide of a slide), whose axis passes through the pin: e = 0.
    """
    mechanism = load("shaper", "driven")
    links = {link.name: 3 * i for i, link in enumerate(mechanism.links)}
    motion, turn = MinimalCoordinate(mechanism), []
    for t in np.linspace(0.0, 1.0, 24, endpoint=False):
        q, v, a = (x[0] for x in motion.state_at(t))
        at, angle = links["block"], links["lever"] + 2  # indices of the block's x and of the lever's angle
        # of the block, relative to the lever's pin on the ground
        arm, speed, acceleration = q[at : at + 2] - mechanism.ground_points["O1"], v[at : at + 2], a[at : at + 2]
        s = float(np.hypot(*arm))
        s_rate = float(arm @ speed / s)
        s_second = float((arm @ acceleration + speed @ speed - s_rate**2) / s)
        pose = Pose(q[angle], s, v[angle], s_rate, l=0.0, l2=0.0, alpha=0.0, e=0.0)
        turn.append((pose, acceleration, np.array([a[angle], s_second])))
    return tuple(turn)


def lever(last: list[str], pose: Pose, acceleration: Array) -> Array:
    """Solve J [phi'', s''] = a - dJ/dt [phi', s'] for [phi'', s''] of the lever, where a is the acceleration of the block.

    `last` is a list of one name: the rate in the last term of column 1 of dJ/dt (see `column_1`).
    """
    J_rate = np.stack([column_1(pose, *last), column_2(pose)], axis=1)
    # guide(pose)[1] is J
    return np.asarray(np.linalg.solve(guide(pose)[1], acceleration - J_rate @ [pose.phi_rate, pose.s_rate]))


def lever_off(last: list[str]) -> float:
    """Return the larger of the relative errors of phi'' and s'' of the shaper's lever over one turn.

    Each error is divided by the largest true value. `last` is a list of one name: the rate in the last term of column 1 of dJ/dt.
    """
    computed = np.array([lever(last, pose, acceleration) for pose, acceleration, _ in shaper_turn()])
    true = np.array([x for *_, x in shaper_turn()])
    return worst([relative(computed[:, k], true[:, k]) for k in (0, 1)])


def lever_at_start(last: list[str]) -> float:
    """Return the angular acceleration phi'' [rad/s^2] of the shaper's lever at the start of the turn.

    `last` is a list of one name: the rate in the last term of column 1 of dJ/dt (see `column_1`).
    """
    pose, acceleration, _ = shaper_turn()[0]
    return float(lever(last, pose, acceleration)[0])


def true_lever_at_start() -> float:
    """Return the true angular acceleration phi'' [rad/s^2] of the shaper's lever at the first instant of the turn."""
    return float(shaper_turn()[0][2][0])
