"""Bars in a plane, pinned to the ground or to each other: small models by which the releases of a library are told apart.

A bar's frame has its origin at its first pin, and its x axis runs along it. States are absolute: x, y of the centre of mass and the
angle of every bar, as everywhere in this package. These are the numbers of `releases/linkages`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.terms import Array

GRAVITY = -9.81  # [m/s^2] along y


@dataclass(frozen=True)
class Bar:
    """A bar.

    Attributes:
        name: of the bar; parent: index of the bar to which its first pin belongs, -1 for the ground.
        at: place of that pin [m] along the parent, or along the ground's x axis.
        length, centre: [m] from the first pin to the end, and to the centre of mass.
        mass, inertia: [kg], [kg m^2] about the centre of mass.
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
PAIR = (CRANK, Bar("rocker", -1, 2.2, 1.5, 0.75, 1.5, 0.3))
CHAIN = (Bar("first", -1, 0.0, 1.0, 0.5, 1.0, 0.1), Bar("second", 0, 1.0, 1.0, 0.5, 2.0, 0.2))
THREE_CRANKS = (  # a beam on three equal cranks, of which one is redundant, and a pendulum on the middle one
    Bar("left", -1, 0.0, 1.0, 0.5, 1.0, 0.1),
    Bar("beam", 0, 1.0, 2.0, 1.0, 1.0, 0.1),
    Bar("middle", -1, 1.0, 1.0, 0.5, 1.0, 0.1),
    Bar("pendulum", 2, 1.0, 1.0, 0.5, 1.0, 0.1),
    Bar("right", -1, 2.0, 1.0, 0.5, 1.0, 0.1),
)
RATIO, CURVE = -0.5, 0.2  # the second bar of CHAIN turns by RATIO x + CURVE x^2 against the first, at x


def accelerate_states(solve: Callable[[Array, Array], Array], q: Array, v: Array, bars: Sequence[Bar]) -> Array:
    """Return the absolute accelerations (k, n) of a linkage at absolute states q, v (k, n).

    Args:
        solve: angles and spins (bars,), each against the parent's, -> their accelerations.
    """
    answers = []
    for state, rates in zip(q, v, strict=True):
        theta, w = angles_of(state, bars), angles_of(rates, bars)
        alpha = sum_up(solve(relative(theta, bars), relative(w, bars)), bars)
        answers.append(accelerations_of(theta, w, alpha, bars)[: q.shape[1]])  # without a twin
    return np.array(answers)


def angles_of(q: Array, bars: Sequence[Bar]) -> Array:
    """Return the angles or spins (bars,) in a state q or v (n,) of a linkage; a twin turns with the rod."""
    by_name = dict(zip((bar.name for bar in bars), q[2::3], strict=False))
    return np.array([by_name["rod" if bar.name == "twin" else bar.name] for bar in bars])


def relative(absolute: Array, bars: Sequence[Bar]) -> Array:
    """Return each bar's angle or spin (bars,) against its parent's."""
    return np.array([x - (absolute[bar.parent] if bar.parent >= 0 else 0.0) for x, bar in zip(absolute, bars, strict=True)])


def sum_up(turns: Array, bars: Sequence[Bar]) -> Array:
    """Return each bar's angle, spin or acceleration (bars,) from those against its parent."""
    found: list[float] = []
    for x, bar in zip(turns, bars, strict=True):
        found.append(float(x) + (found[bar.parent] if bar.parent >= 0 else 0.0))
    return np.array(found)


def accelerations_of(theta: Array, w: Array, alpha: Array, bars: Sequence[Bar]) -> Array:
    """Return the absolute accelerations (3 bars,) at angles, spins and angular accelerations (bars,).

    A point at s along a bar has the acceleration of its pin and s (alpha e' - w^2 e), e along the bar and e' across it.
    """
    along = np.column_stack([np.cos(theta), np.sin(theta)])
    across = np.column_stack([-np.sin(theta), np.cos(theta)])
    turning = alpha[:, None] * across - w[:, None] ** 2 * along  # (bars, 2) at 1 m
    pins: list[Array] = []
    for bar in bars:
        pins.append(pins[bar.parent] + bar.at * turning[bar.parent] if bar.parent >= 0 else np.zeros(2))
    centres = np.array(pins) + np.array([bar.centre for bar in bars])[:, None] * turning
    return np.column_stack([centres, alpha]).ravel()
