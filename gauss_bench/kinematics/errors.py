"""The exceptions that end a motion before its last time, raised by loop closure and by point equations alike."""

from collections.abc import Mapping
from typing import Any

from gauss_bench.mechanism.model import Mechanism


class MotionError(ArithmeticError):
    """The linkage cannot follow its inputs any further.

    Attributes:
        inputs: the last values that the inputs reached [rad, m], by name or in order.
        time: the first sample time that was not reached [s]; NaN if the function that raises the exception does not know the time.
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
