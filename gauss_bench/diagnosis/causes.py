"""What an error of an engine can come from: six parts that every error is split into, and the causes within them."""

from enum import StrEnum


class Part(StrEnum):
    """The parts of an error."""

    MODEL = "model"
    SOFTNESS = "constraint softness"
    INTEGRATOR = "integrator"
    DRIFT = "drift"
    ROUND_OFF = "round-off"
    SAMPLING = "output sampling"


class Cause(StrEnum):
    """What a diagnosis can name."""

    NONE = "no dominant cause"
    INERTIA = "inertia"
    MASS = "mass"
    LENGTH = "length"
    GRAVITY = "gravity"
    FORCE = "force"
    ACCELERATIONS = "accelerations"  # wrong in a way that no parameter explains
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
    VELOCITIES = "velocities told"  # that are not those by which positions change
    UNKNOWN = "unknown"  # an error without one of these causes: what was measured is told

    @property
    def part(self) -> Part | None:
        """The part of the error that it belongs to; None where there is no dominant one."""
        if self in (Cause.NONE, Cause.UNKNOWN):
            return None
        return OWN_PARTS.get(self, Part.MODEL)


SAMPLING = (Cause.SHIFT, Cause.STRETCH, Cause.STATIONARY, Cause.WRAPPED, Cause.VELOCITIES)
OWN_PARTS = {Cause.SOFTNESS: Part.SOFTNESS, Cause.INTEGRATOR: Part.INTEGRATOR, Cause.DRIFT: Part.DRIFT}
OWN_PARTS |= {Cause.ROUND_OFF: Part.ROUND_OFF} | dict.fromkeys(SAMPLING, Part.SAMPLING)
