"""Parameters of a compiled program for forces whose factor is piecewise linear in time: a level and a slope for each such force.

Open parameters are numbers of a mechanism that a compiled program takes as arguments instead of containing them as constants.

The parameters forces.NAME.level and forces.NAME.slope stand after all others. The code that integrates the motion sets them for the
interval between two kinks, and ends a step at every kink. Therefore a table of a thousand rows costs no more computing time than a
ramp, and the last stage of a step that ends at a jump of the factor uses the value before the jump.
"""

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import Factor
from gauss_bench.terms import Array


def list_lines(mechanism: Mechanism) -> list[tuple[str, Factor]]:
    """List name and factor of the forces whose factor is piecewise linear in time with at least one kink."""
    return [(force.name, factor) for force, factor in mechanism.factors if factor.kinks]


def line_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the open parameters of the forces in `list_lines`, in order."""
    return tuple(f"forces.{name}.{key}" for name, _ in list_lines(mechanism) for key in ("level", "slope"))


def line_values(mechanism: Mechanism, t: float | Array) -> Array:
    """Return the values (..., l) of the parameters in `line_names` at times (...) [s]; at a kink, the values after it."""
    lines = [factor.line(t) for _, factor in list_lines(mechanism)]
    return np.concatenate([np.zeros((*np.shape(t), 0)), *lines], axis=-1)


def with_lines(mechanism: Mechanism, values: Array, t: float | Array) -> Array:
    """Return the values (..., p) of all open parameters of a program at times (...) [s].

    Args:
        values: (p,) the parameters; the last l, those of piecewise linear factors, are replaced by `line_values` at these times.
    """
    lines = line_values(mechanism, t)  # (..., l)
    given = values[: len(values) - lines.shape[-1]]
    return np.concatenate([np.broadcast_to(given, (*lines.shape[:-1], len(given))), lines], axis=-1)
