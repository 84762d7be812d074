"""Parameters of a compiled program for forces whose factor is piecewise linear in time: a level and a slope for each such force.

A compiled program takes some numbers of a mechanism as arguments (parameters) instead of containing them as constants. The
parameters forces.NAME.level and forces.NAME.slope are the last in the list. The code that integrates the motion sets them for the
interval between two kinks of the factor, and ends a step at every kink. Therefore a table of a thousand rows costs no more
computing time than a ramp, and the last stage of a step that ends at a jump of the factor uses the value before the jump.
"""

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import Factor
from gauss_bench.terms import Array


def list_lines(mechanism: Mechanism) -> list[tuple[str, Factor]]:
    """List name and factor of the forces whose factor is piecewise linear in time with at least one kink."""
    return [(force.name, factor) for force, factor in mechanism.factors if factor.kinks]


def line_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the parameters for the forces in `list_lines`, in order: level and slope of each factor."""
    return tuple(f"forces.{name}.{key}" for name, _ in list_lines(mechanism) for key in ("level", "slope"))


def line_values(mechanism: Mechanism, t: float | Array) -> Array:
    """Return the values (..., l) of the parameters in `line_names` at times (...) [s]; at a kink, the values after it."""
    lines = [factor.line(t) for _, factor in list_lines(mechanism)]
    return np.concatenate([np.zeros((*np.shape(t), 0)), *lines], axis=-1)


def with_lines(mechanism: Mechanism, values: Array, t: float | Array) -> Array:
    """Return the values (..., p) of all parameters of a compiled program at times (...) [s].

    Args:
        values: (p,) parameters as given; the last l, those of piecewise linear factors, are replaced by `line_values` at the times.
    """
    lines = line_values(mechanism, t)  # (..., l)
    given = values[: len(values) - lines.shape[-1]]
    return np.concatenate([np.broadcast_to(given, (*lines.shape[:-1], len(given))), lines], axis=-1)
