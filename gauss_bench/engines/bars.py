"""Bars in a plane, pinned to the ground or to each other: small models whose results are compared between releases of a library.

A bar's frame has its origin at its first pin, and its x axis runs along the bar. A state q (n,) holds x, y of the centre of mass
and the angle of every bar, as everywhere in this package. The linkages in `releases/linkages` have the same numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.terms import Array

GRAVITY = -9.81  # [m/s^2] along y


@dataclass(frozen=True)
class Bar:
    """A bar that hangs on a parent by its first pin.

    Attributes:
        name: name of the bar; "twin" for the second of the two equal bars that make up a rod.
        parent: index of the parent in the list of bars, where it stands before its children; -1 for the ground.
        at: place of the first pin [m] along the parent, or along the ground's x axis.
        length, centre: distances [m] from the first pin to the end and to the centre of mass.
        mass: [kg]; inertia: [kg m^2] about the centre of mass.
    """

    name: str
    parent: int
    at: float
    length: float
    centre: float
    mass: float
    inertia: float


CRANK, ROD = Bar("crank", -1, 0.0, 1.0, 0.5, 1.0, 0.1), Bar("rod", 0, 1.0, 2.0, 1.0, 2.0, 0.6)
ROCKER = Bar("rocker", -1, 2.2, 1.5, 0.75, 1.5, 0.3)
FOUR_BAR = (CRANK, ROD, ROCKER)
HALVES = (  # the rod as two bodies in one place: one hangs on the crank, one on the rocker, and they are fixed to each other
    CRANK,
    Bar("rod", 0, 1.0, 2.0, 1.0, 1.0, 0.3),
    ROCKER,
    Bar("twin", 2, 1.5, -2.0, -1.0, 1.0, 0.3),
)
PAIR = (CRANK, ROCKER)
CHAIN = (Bar("first", -1, 0.0, 1.0, 0.5, 1.0, 0.1), Bar("second", 0, 1.0, 1.0, 0.5, 2.0, 0.2))
THREE_CRANKS = (  # a beam on three equal cranks, of which one is redundant, and a pendulum on the middle one
    Bar("left", -1, 0.0, 1.0, 0.5, 1.0, 0.1),
    Bar("beam", 0, 1.0, 2.0, 1.0, 1.0, 0.1),
    Bar("middle", -1, 1.0, 1.0, 0.5, 1.0, 0.1),
    Bar("pendulum", 2, 1.0, 1.0, 0.5, 1.0, 0.1),
    Bar("right", -1, 2.0, 1.0, 0.5, 1.0, 0.1),
)
RATIO, CURVE = -0.5, 0.2  # if the first bar of CHAIN is at the angle x, the second is at RATIO x + CURVE x^2 against the first


def accelerate_states(solve: Callable[[Array, Array], Array], q: Array, v: Array, bars: Sequence[Bar]) -> Array:
    """Return the absolute accelerations (k, n) of bars at k absolute states q, v (k, n).

    If the last bar is a "twin" (see HALVES), q, v and the result have no columns for it.


    Args:
        solve: function of the bars' angles and angular speeds (bars,), each relative to the parent's; it returns the angular
            accelerations (bars,), also relative to the parent's.
    """
    answers = []
    for state, rates in zip(q, v, strict=True):
        theta, w = angles_of(state, bars), angles_of(rates, bars)
        alpha = np.append(solve(relative(theta, bars), relative(w, bars)), 0.0)  # the last entry is the ground's, with index -1
        for k, bar in enumerate(bars):
            alpha[k] += alpha[bar.parent]
        answers.append(accelerations_of(theta, w, alpha[:-1], bars)[: q.shape[1]])  # without a twin
    return np.array(answers)


def angles_of(q: Array, bars: Sequence[Bar]) -> Array:
    """Return the angles (bars,) from q (n,), or the angular speeds from v (n,); the bar "twin" has those of the bar "rod"."""
    by_name = dict(zip((bar.name for bar in bars), q[2::3], strict=False))
    return np.array([by_name["rod" if bar.name == "twin" else bar.name] for bar in bars])


def relative(absolute: Array, bars: Sequence[Bar]) -> Array:
    """Return each bar's angle or angular speed (bars,) minus that of its parent, which is zero for the ground."""
    with_ground = np.append(absolute, 0.0)  # the index -1 of the ground is the last entry
    return np.asarray(absolute - with_ground[[bar.parent for bar in bars]])


def accelerations_of(theta: Array, w: Array, alpha: Array, bars: Sequence[Bar]) -> Array:
    """Return the absolute accelerations (3 bars,) at angles, angular speeds and angular accelerations (bars,).

    A point at a distance s along a bar has the acceleration of the bar's first pin plus s (alpha e' - w^2 e), where e is the unit
    vector along the bar and e' the one across it.
    """
    along = np.column_stack([np.cos(theta), np.sin(theta)])
    across = np.column_stack([-np.sin(theta), np.cos(theta)])
    turning = alpha[:, None] * across - w[:, None] ** 2 * along  # (bars, 2) at s = 1 m
    pins = np.zeros((len(bars), 2))  # of the first pins; a pin on the ground keeps the acceleration zero
    for k, bar in enumerate(bars):
        if bar.parent >= 0:
            pins[k] = pins[bar.parent] + bar.at * turning[bar.parent]
    centres = pins + np.array([bar.centre for bar in bars])[:, None] * turning
    return np.column_stack([centres, alpha]).ravel()
