"""Parameters of a compiled program for forces whose factor is piecewise linear in time: a level and a slope for each such force.

The parameters forces.NAME.level and forces.NAME.slope are the last arguments of a program. The code that integrates the motion sets
them for the interval between two kinks of the factor, and ends a step at every kink. Therefore a table of a thousand rows costs no
more than a ramp, and the last stage of a step that ends at a jump uses the value before the jump.
"""

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import Factor
from gauss_bench.terms import Array


def list_lines(mechanism: Mechanism) -> list[tuple[str, Factor]]:
    """List name and factor of the forces whose factor is piecewise linear in time with at least one kink."""
    return [(force.name, factor) for force, factor in mechanism.factors if factor.kinks]


def line_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the parameters: level and slope of each factor in `list_lines`."""
    return tuple(f"forces.{name}.{key}" for name, _ in list_lines(mechanism) for key in ("level", "slope"))


def line_values(mechanism: Mechanism, t: float | Array) -> Array:
    """Return the values (..., l) of the parameters in `line_names` at times (...) [s]; at a kink, the values after it."""
    lines = [factor.line(t) for _, factor in list_lines(mechanism)]
    return np.concatenate([np.zeros((*np.shape(t), 0)), *lines], axis=-1)


def with_lines(mechanism: Mechanism, values: Array, t: float | Array) -> Array:
    """Return the parameters (..., p) of a program at times (...) [s]: `values` (p,), whose last l `line_values` replaces."""
    lines = line_values(mechanism, t)  # (..., l)
    others = values[: len(values) - lines.shape[-1]]  # the parameters that do not depend on time
    return np.concatenate([np.broadcast_to(others, (*lines.shape[:-1], len(others))), lines], axis=-1)
