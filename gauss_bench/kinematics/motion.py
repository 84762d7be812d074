"""The motion of a linkage that follows its inputs, by loop or by point equations, and the exceptions that end it early."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """The states of a linkage at k times.

    Attributes:
        q, v, a: (k, n) absolute positions, velocities, accelerations as in Mechanism; angles are continuous from q0 on.
        iterations: (k,) iterations of the solver since the previous sample.
    """

    q: Array
    v: Array
    a: Array
    iterations: Array


class MotionError(ArithmeticError):
    """The linkage cannot follow its inputs any further.

    Attributes:
        inputs: the last values that the inputs reached [rad, m], by name or in order.
        time: the first sample time that was not reached [s]; NaN if it is not known.
        reached: the motion up to the last sample time that was reached.
    """

    def __init__(self, message: str, inputs: Any, time: float = float("nan"), reached: Any = None):
        self.inputs, self.time, self.reached = inputs, time, reached
        super().__init__(message)


class LimitOfMotion(MotionError):
    """The loops of the linkage cannot be closed for values of the inputs beyond `inputs`."""


class SingularPosition(MotionError):
    """The Jacobian loses rank: the inputs do not determine how the motion continues."""


def describe_drivers(mechanism: Mechanism, values: Mapping[str, float]) -> str:
    """Return a text with the given values [rad, m] of drivers and their units, such as "crank = 0.5 rad"."""
    units = {x.name: x.coordinate.unit for x in mechanism.drivers}
    return ", ".join(f"{name} = {value:.10g} {units[name]}" for name, value in values.items())
