"""Bars in a plane, pinned to the ground or to each other: small models whose results are compared between releases of a library.

The frame of a bar has the origin at the first pin, and the x axis along the bar. A state q (n,) holds x, y of the centre of mass
and the angle of every bar, as everywhere in this package. The linkages in `releases/linkages` have the same lengths and masses.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.mechanism.model import GROUND
from gauss_bench.terms import Array

GRAVITY = -9.81  # [m/s^2] along y


@dataclass(frozen=True)
class Bar:
    """A bar whose first pin joins it to a parent.

    Attributes:
        name: name of the bar; "twin" for the second of the two equal bars that make up a rod.
        parent: index of the parent, which precedes its children in the list of bars; -1 for the ground.
        at: position of the first pin [m] along the parent, or along the ground's x axis.
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
HALVES = (  # the rod as two bodies in the same place: the first hangs on the crank, the second on the rocker; a weld joins both
    CRANK,
    Bar("rod", 0, 1.0, 2.0, 1.0, 1.0, 0.3),
    ROCKER,
    Bar("twin", 2, 1.5, -2.0, -1.0, 1.0, 0.3),
)
PAIR = (CRANK, ROCKER)
CHAIN = (Bar("first", -1, 0.0, 1.0, 0.5, 1.0, 0.1), Bar("second", 0, 1.0, 1.0, 0.5, 2.0, 0.2))
THREE_CRANKS = (  # a beam on three equal cranks, of which one is redundant, and a pendulum on the middle crank
    Bar("left", -1, 0.0, 1.0, 0.5, 1.0, 0.1),
    Bar("beam", 0, 1.0, 2.0, 1.0, 1.0, 0.1),
    Bar("middle", -1, 1.0, 1.0, 0.5, 1.0, 0.1),
    Bar("pendulum", 2, 1.0, 1.0, 0.5, 1.0, 0.1),
    Bar("right", -1, 2.0, 1.0, 0.5, 1.0, 0.1),
)
RATIO, CURVE = -0.5, 0.2  # in a coupled CHAIN, the angle between the bars is RATIO x + CURVE x^2, with x the first bar's angle


def accelerate_states(solve: Callable[[Array, Array], Array], q: Array, v: Array, bars: Sequence[Bar]) -> Array:
    """Return the absolute accelerations (k, n) of bars at k absolute states q, v (k, n).

    If the last bar is a "twin" (see HALVES), q, v and the result have no columns for it.

    Args:
        solve: function of the bars' angles and angular speeds (bars,), each relative to the parent's; it returns the angular
            accelerations (bars,), also relative to the parent's.
    """
    tree, n = tree_of(bars), q.shape[1]
    if bars[-1].name == "twin":  # it has the state of the rod, which is the second bar
        q, v = (np.hstack([x, x[:, 3:6]]) for x in (q, v))
    y, dy = tree.relative(q, v)
    ddy = np.array([solve(*state) for state in zip(y, dy, strict=True)])
    return tree.absolute(y, dy, ddy).a[:, :n]


def tree_of(bars: Sequence[Bar]) -> Tree:
    """Return bars as a tree of pins, whose coordinates are the bars' angles, each relative to the parent's."""
    branches, zero = [], np.zeros(2)
    for k, bar in enumerate(bars):
        centre = bars[bar.parent].centre if bar.parent != GROUND else 0.0
        # the first pin relative to the parent's centre of mass, and to the bar's own
        near, far = np.array([bar.at - centre, 0.0]), np.array([-bar.centre, 0.0])
        branches.append(Branch(k, bar.parent, "revolute", None, k, near, far, base=zero, axis=zero, turn=0.0))
    return Tree(tuple(branches), (), len(bars), len(bars))


def relative(absolute: Array, bars: Sequence[Bar]) -> Array:
    """Return each bar's angle or angular speed (bars,) minus that of its parent, which is zero for the ground."""
    with_ground = np.append(absolute, 0.0)  # the index -1 of the ground is the last entry
    return np.asarray(absolute - with_ground[[bar.parent for bar in bars]])
