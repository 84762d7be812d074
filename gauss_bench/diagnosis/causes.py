"""The six parts into which every error is split, and the causes that a diagnosis can name."""

from enum import StrEnum


class Part(StrEnum):
    """A part of an error."""

    MODEL = "model"
    SOFTNESS = "constraint softness"
    INTEGRATOR = "integrator"
    DRIFT = "drift"
    ROUND_OFF = "round-off"
    SAMPLING = "output sampling"


class Cause(StrEnum):
    """A cause that a diagnosis can name."""

    NONE = "no dominant cause"
    INERTIA = "inertia"
    MASS = "mass"
    LENGTH = "length"
    GRAVITY = "gravity"
    FORCE = "force"
    ACCELERATIONS = "accelerations"  # wrong accelerations that no parameter explains
    SECOND_RATE = "second time derivative of a driver"
    VELOCITY_TERMS = "velocity terms of the constraints"
    JACOBIAN = "constraint Jacobian"
    IGNORED = "constraints ignored"
    STALE = "stale constraint data"
    ORDER = "order of links or joints"
    START = "start"
    RESET = "reset"
    SOFTNESS = "constraint softness"
    INTEGRATOR = "integrator"
    DRIFT = "drift"
    ROUND_OFF = "round-off"
    SHIFT = "time shift"
    STRETCH = "stretched time"
    STATIONARY = "stationary output"
    WRAPPED = "wrapped angles"
    VELOCITIES = "velocities told"  # reported velocities that disagree with the change of positions
    UNKNOWN = "unknown"  # an error without one of these causes; the measured figures are reported

    @property
    def part(self) -> Part | None:
        """The part of the error to which the cause belongs; None if no cause dominates or the cause is unknown."""
        if self in (Cause.NONE, Cause.UNKNOWN):
            return None
        return OWN_PARTS.get(self, Part.MODEL)


# causes that belong to another part than the model
SAMPLING = (Cause.SHIFT, Cause.STRETCH, Cause.STATIONARY, Cause.WRAPPED, Cause.VELOCITIES)
OWN_PARTS = {Cause.SOFTNESS: Part.SOFTNESS, Cause.INTEGRATOR: Part.INTEGRATOR, Cause.DRIFT: Part.DRIFT}
OWN_PARTS |= {Cause.ROUND_OFF: Part.ROUND_OFF} | dict.fromkeys(SAMPLING, Part.SAMPLING)
