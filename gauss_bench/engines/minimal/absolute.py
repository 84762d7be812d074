"""A stretch of the motion in one coordinate, in the linkage's absolute coordinates.

The equation knows directions of links; their angles are followed along the stretch, over as many turns as there are.
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.compiler.equations.sampling import typical_length
from gauss_bench.engines.minimal.equation import Equation
from gauss_bench.mechanism.model import Mechanism, Prismatic
from gauss_bench.terms import Array

TURN = 2 * np.pi
FINE = TURN / 720  # [rad, lengths of the linkage] of the coordinate: away from dead centres links turn by far less than half a turn


@dataclass(frozen=True, eq=False)
class Stretch:
    """States of one equation.

    Attributes:
        rows: of the samples that the states are, one after the other from here on.
        start: (2n,) where it begins, which is the end of the stretch before; states: (k, 2n); end: (2n,) where it ends.
    """

    equation: Equation
    rows: int
    start: Array
    states: Array
    end: Array


def absolute(mechanism: Mechanism, stretch: Stretch, angles: Array) -> tuple[Array, Array, Array, Array]:
    """q, v, a (k, n) at the samples of a stretch, given the angles (links,) at its start; and the angles at its end."""
    states = np.vstack([stretch.states, stretch.end])
    n, equation = states.shape[1] // 2, stretch.equation
    given = np.zeros((len(states), 1)), states[:, :n], states[:, n:], np.zeros((len(states), 0))
    place, slope, bend, turning = equation.told(*given)
    w, w_dot = states[:, n], turning[:, 0]
    q = np.empty((len(states), mechanism.n))
    directions = place.reshape(len(states), -1, 4)
    q[:, 0::3], q[:, 1::3] = directions[..., 0], directions[..., 1]
    exact = np.arctan2(directions[..., 3], directions[..., 2])
    roughly = _follow(mechanism, equation, float(stretch.start[0]), states[:, 0], angles)
    q[:, 2::3] = exact + TURN * np.round((roughly - exact) / TURN)
    v, a = slope * w[:, None], slope * w_dot[:, None] + bend * (w * w)[:, None]
    return q[:-1], v[:-1], a[:-1], q[-1, 2::3]


def _follow(mechanism: Mechanism, equation: Equation, start: float, at: Array, angles: Array) -> Array:
    """Roughly the angles (k, links) at values (k,) of the coordinate, from those at its start; over turns by those of one turn."""
    slides = isinstance(equation.way.joint, Prismatic)
    fine = FINE * typical_length(mechanism) if slides else FINE
    low, high = min(start, at.min()), max(start, at.max())
    turning = not slides and high - low > TURN
    if turning:
        low, high = start, start + TURN
    below, above = (int(np.ceil(x / fine)) + 1 for x in (start - low, high - start))
    fine = TURN / above if turning else fine
    grid = start + fine * np.arange(0 if turning else -below, above + 1)
    states = np.zeros((len(grid), equation.program.n))
    states[:, 0] = grid
    with np.errstate(invalid="ignore"):
        place = equation.told(np.zeros((len(grid), 1)), states, 0 * states, np.zeros((len(grid), 0)))[0].reshape(len(grid), -1, 4)
    lines = np.unwrap(np.nan_to_num(np.arctan2(place[..., 3], place[..., 2])), axis=0)
    lines += angles - lines[0 if turning else below]
    turns = np.floor((at - start) / TURN) if turning else np.zeros(len(at))
    winding = lines[-1] - lines[0]
    interpolated = np.array([np.interp(at - TURN * turns, grid, line) for line in lines.T]).T
    return np.asarray(interpolated + turns[:, None] * winding)
