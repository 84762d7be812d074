"""Add whole turns to link angles that are known only up to whole turns, so that they are continuous in a motion."""

from collections.abc import Callable

import numpy as np

from gauss_bench.terms import Array

TURN = 2 * np.pi
PIECES = 720  # grid intervals in a turn: away from dead centres, every link turns by less than half a turn in an interval


def follow(angles_of: Callable[[Array], Array], start: float, x: Array, angles: Array, length: float | None = None) -> Array:
    """Return approximate, unwrapped link angles (k, links) [rad] at the values x (k,) of the independent coordinate.

    They are interpolated in a table of continuous angles. This is accurate enough to count whole turns, which `wind` then adds to
    exact angles.

    Args:
        angles_of: function of values (j,) of the coordinate; it returns the exact angles (j, links), up to whole turns.
        start: value of the coordinate at which the angles are `angles` (links,).
        length: typical length [m] if the coordinate is a length; None if it is an angle.
    """
    low, high = min(start, x.min()), max(start, x.max())
    # If the coordinate is an angle that goes beyond one turn, the motion repeats. Then the table covers one turn from `start`, and
    # in every further turn each link angle advances by as much as in the turn of the table.
    repeats = length is None and high - low > TURN
    if repeats:
        low, high = start, start + TURN
    margin = 0 if repeats else 1  # grid points beyond `low` and beyond `high`
    interval = TURN / PIECES * (length or 1.0)
    below, above = (int(np.ceil(span / interval)) + margin for span in (start - low, high - start))  # grid points on each side
    grid = start + interval * np.arange(-below, above + 1)  # grid[below] is `start`
    # (grid, links) continuous angles at the grid points; `angles_of` returns NaN where the linkage cannot close
    table = np.unwrap(np.nan_to_num(angles_of(grid)), axis=0)
    table += angles - table[below]
    turns = np.floor((x - start) / TURN) if repeats else np.zeros_like(x)  # (k,) whole turns beyond the table
    in_table = np.stack([np.interp(x - TURN * turns, grid, column) for column in table.T], axis=-1)
    return np.asarray(in_table + np.outer(turns, table[-1] - table[0]))


def wind(angles: Array, near: Array) -> Array:
    """Add to each angle the whole turns that bring it nearest to the angle in `near`, an array of the same shape [rad]."""
    return np.asarray(angles + TURN * np.round((near - angles) / TURN))
