"""The open parameters of a compiled program for forces whose factor is piecewise linear in time: a level and a slope each.

The parameters forces.NAME.level and forces.NAME.slope stand after all others. The stepping code sets them for the interval between
two kinks, and ends a step at every kink. A table of a thousand rows therefore costs no more than a ramp, and the last stage of a
step that ends at a jump uses the value before the jump.
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
    """Return all open parameters (..., p) of a program at times (...) [s].

    Args:
        values: (p,) the parameters, of which the last l, those of the straight lines, are replaced by `line_values` at these times.
    """
    lines = line_values(mechanism, t)  # (..., l)
    given = values[: len(values) - lines.shape[-1]]
    return np.concatenate([np.broadcast_to(given, (*lines.shape[:-1], len(given))), lines], axis=-1)
