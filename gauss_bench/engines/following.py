"""Angles of links that are known to whole turns only, followed along a coordinate of which they are functions."""

from collections.abc import Callable

import numpy as np

from gauss_bench.terms import Array

TURN = 2 * np.pi
PIECES = 720  # of a turn: away from dead centres links turn by far less than half a turn from one to the next


def follow(lines: Callable[[Array], Array], start: float, at: Array, angles: Array, length: float | None = None) -> Array:
    """Roughly the angles (k, links) at values `at` (k,) of the coordinate, by those at its start over as many turns as there are.

    Args:
        lines: values (j,) -> the angles (j, links), but for whole turns.
        angles: (links,) at the start.
        length: typical length of a coordinate that is one [m]; None for an angle.
    """
    low, high = min(start, at.min()), max(start, at.max())
    turning = length is None and high - low > TURN  # then a turn from the start on tells of all
    if turning:
        low, high = start, start + TURN
    fine = TURN / PIECES * (length or 1.0)
    below, above = (int(np.ceil(x / fine)) + (not turning) for x in (start - low, high - start))
    grid = start + fine * np.arange(-below, above + 1)
    followed = np.unwrap(np.nan_to_num(lines(grid)), axis=0)
    followed += angles - followed[below]
    turns = np.floor((at - start) / TURN) * turning
    inside = np.stack([np.interp(at - TURN * turns, grid, x) for x in followed.T], axis=-1)
    return np.asarray(inside + np.outer(turns, followed[-1] - followed[0]))


def wind(angles: Array, near: Array) -> Array:
    """Angles by those whole turns that bring them nearest to others."""
    return np.asarray(angles + TURN * np.round((near - angles) / TURN))
