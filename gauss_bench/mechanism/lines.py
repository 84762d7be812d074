"""Forces whose factor of time is a line between kinks, as numbers that change with time: a level and a slope each.

Whoever computes with open numbers has such forces for two of them, forces.NAME.level and forces.NAME.slope, behind all others; who
steps gives those of the stretch between two kinks, and ends a step at each. So a table of a thousand rows costs what a ramp costs,
one operation, and stages at the end of a step see what is before a jump, as they should.
"""

import numpy as np

from gauss_bench.mechanism.model import Mechanism, factor_of
from gauss_bench.mechanism.motion_laws import Factor
from gauss_bench.terms import Array


def line_up(mechanism: Mechanism) -> list[tuple[str, Factor]]:
    """The forces whose factors of time are lines with kinks, by name."""
    return [(f.name, factor) for f in mechanism.varying if (factor := factor_of(f)) and factor.kinks]


def line_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The open numbers that stand for them, in order."""
    return tuple(f"forces.{name}.{key}" for name, _ in line_up(mechanism) for key in ("level", "slope"))


def line_values(mechanism: Mechanism, t: float | Array) -> Array:
    """Their values (..., n) at times (...) [s]; at a kink those after it."""
    lines = [factor.line(t) for _, factor in line_up(mechanism)]
    return np.concatenate([np.zeros((*np.shape(t), 0)), *lines], axis=-1)


def with_lines(mechanism: Mechanism, values: Array, t: float | Array) -> Array:
    """All open numbers (..., n_p) of a program at times (...): `values` (n_p,) whose last ones are those of the lines there."""
    lines = line_values(mechanism, t)
    given = values[: len(values) - lines.shape[-1]]
    return np.concatenate([np.broadcast_to(given, (*lines.shape[:-1], len(given))), lines], axis=-1)
