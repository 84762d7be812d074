"""Unwrapping of link angles that are known only up to whole turns, as functions of one coordinate of the linkage."""

from collections.abc import Callable

import numpy as np

from gauss_bench.terms import Array

TURN = 2 * np.pi
PIECES = 720  # grid points in a turn: away from dead centres a link turns by far less than half a turn between two of them


def follow(lines: Callable[[Array], Array], start: float, at: Array, angles: Array, length: float | None = None) -> Array:
    """Return approximate, unwrapped angles (k, links) [rad] at the values `at` (k,) of the coordinate.

    The angles are continuous in the coordinate and equal `angles` at `start`. They are interpolated in a table, and only accurate
    enough for `wind`, which adds the right number of whole turns to exact angles.

    Args:
        lines: values (j,) of the coordinate -> the angles (j, links), up to whole turns.
        start: value of the coordinate at which the angles are known.
        angles: (links,) at the start.
        length: typical length [m] if the coordinate is a length; None if it is an angle.
    """
    low, high = min(start, at.min()), max(start, at.max())
    # If the coordinate is an angle and goes beyond a turn, the motion repeats: one turn is tabulated, and for every further turn
    # each angle advances by as much as in the first.
    turning = length is None and high - low > TURN
    if turning:
        low, high = start, start + TURN
    fine = TURN / PIECES * (length or 1.0)
    below, above = (int(np.ceil(x / fine)) + (not turning) for x in (start - low, high - start))
    grid = start + fine * np.arange(-below, above + 1)
    followed = np.unwrap(np.nan_to_num(lines(grid)), axis=0)  # NaN where the linkage cannot close
    followed += angles - followed[below]  # grid[below] is the start
    turns = np.floor((at - start) / TURN) * turning
    inside = np.stack([np.interp(at - TURN * turns, grid, x) for x in followed.T], axis=-1)
    return np.asarray(inside + np.outer(turns, followed[-1] - followed[0]))


def wind(angles: Array, near: Array) -> Array:
    """Add to each angle the whole turns that bring it nearest to `near`; both in rad, of the same shape."""
    return np.asarray(angles + TURN * np.round((near - angles) / TURN))
