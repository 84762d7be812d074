"""Add the right number of whole turns to link angles, which equations give only up to whole turns."""

from collections.abc import Callable

import numpy as np

from gauss_bench.terms import Array

TURN = 2 * np.pi
PIECES = 720  # grid intervals in a turn: away from dead centres, no link turns by half a turn between two grid points


def follow(angles_of: Callable[[Array], Array], start: float, at: Array, angles: Array, length: float | None = None) -> Array:
    """Return approximate, unwrapped link angles (k, links) [rad] at the values `at` (k,) of the independent coordinate.

    The angles are continuous in the coordinate, and interpolated in a table that is accurate enough for counting whole turns
    (`wind`).

    Args:
        angles_of: function of values (j,) of the coordinate; it returns the exact angles (j, links), up to whole turns.
        start: value of the coordinate at which the angles are `angles` (links,).
        length: typical length [m] if the coordinate is a length; None if it is an angle.
    """
    low, high = min(start, at.min()), max(start, at.max())
    # If the coordinate is an angle that goes beyond one turn, the motion repeats. Then the table covers one turn from `start`, and
    # in every further turn each link angle advances by as much as in the turn of the table.
    turning = length is None and high - low > TURN
    if turning:
        low, high = start, start + TURN
    fine = TURN / PIECES * (length or 1.0)
    # numbers of grid points below and above `start`; one more at each end where the table is not exactly a turn
    below, above = (int(np.ceil(x / fine)) + (not turning) for x in (start - low, high - start))
    grid = start + fine * np.arange(-below, above + 1)  # grid[below] is `start`
    # (grid, links) continuous angles at the grid points; `angles_of` returns NaN where the linkage cannot close
    table = np.unwrap(np.nan_to_num(angles_of(grid)), axis=0)
    table += angles - table[below]
    turns = np.floor((at - start) / TURN) * turning  # (k,) whole turns beyond the table
    in_table = np.stack([np.interp(at - TURN * turns, grid, x) for x in table.T], axis=-1)
    return np.asarray(in_table + np.outer(turns, table[-1] - table[0]))


def wind(angles: Array, near: Array) -> Array:
    """Add to each angle the whole turns that bring it nearest to the angle in `near`, an array of the same shape [rad]."""
    return np.asarray(angles + TURN * np.round((near - angles) / TURN))
