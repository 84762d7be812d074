"""Trajectories, which engines return and metrics read, the status of a run, and curves over time."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]


class Status(StrEnum):
    """The ways in which a run ends. Only OK and INVALID runs have all samples; all but OK have a message with the reason."""

    OK = "ok"
    INVALID = "invalid"  # the run ended, but the judge objects to it
    SKIP = "skip"  # the engine cannot model the linkage
    DIVERGED = "diverged"  # finite, but far off the constraints
    NOT_CONVERGED = "not_converged"  # an inner solver gave up
    NAN = "nan"
    RANK_LOST = "rank_lost"  # the formulation cannot handle redundant rows
    WARNING = "warning"  # the engine reported a warning or reset itself
    CRASHED = "crashed"
    TIMEOUT = "timeout"
    INCOMPLETE = "incomplete"  # samples are missing
    ERROR = "error"  # an exception of any other kind


LONGEST = 500  # characters of a library's message that are kept


def in_a_sentence(text: object) -> str:
    """Put a library's message on one line, printable and at most LONGEST characters long."""
    message = "".join(c if c.isprintable() else " " for c in " ".join(str(text).split())).strip()
    return message if len(message) <= LONGEST else f"{message[:LONGEST]} ..."


@dataclass(frozen=True, eq=False)
class States:
    """States of one linkage: times t (k,) [s], positions q and velocities v (k, n)."""

    t: Array
    q: Array
    v: Array

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, chosen: NDArray[Any] | slice) -> "States":
        return States(self.t[chosen], self.q[chosen], self.v[chosen])


@dataclass(frozen=True, eq=False)
class Samples:
    """States with their accelerations, in absolute coordinates: times t (k,) [s], and q, v, a (k, n); angles unwrapped."""

    t: Array
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True, eq=False)
class Trajectory(Samples):
    """The samples of a run.

    Attributes:
        steps, evaluations: number of integration steps and of evaluations of the accelerations; None if not counted.
        note: a remark on a run that is sound nevertheless, such as that the integrator chose its own steps.
    """

    steps: int | None
    evaluations: int | None = None
    note: str = ""

    def __getitem__(self, chosen: NDArray[Any] | slice) -> "Trajectory":
        """Return the same run with only the chosen samples."""
        return replace(self, t=self.t[chosen], q=self.q[chosen], v=self.v[chosen], a=self.a[chosen])


class Failure(RuntimeError):
    """The exception for work that gave no result: its status, and the reason as a sentence."""

    def __init__(self, status: Status, message: str):
        self.status = status
        super().__init__(message)

    @property
    def columns(self) -> dict[str, str]:
        """The columns `status` and `message` of a row."""
        return {"status": str(self.status), "message": str(self)}


class RunFailure(Failure):
    """The exception for a run without a usable trajectory; `reached` has the samples before its end, if there are any."""

    def __init__(self, status: Status, message: str, reached: Trajectory | None = None):
        self.reached = reached
        super().__init__(status, message)


@dataclass(frozen=True, eq=False)
class Reference(Samples):
    """A trajectory more exact than the runs that it judges, with its own error bar.

    Attributes:
        error_q, error_v, error_a: (k,) error bars: the largest disagreement of two integrations at each time.
        floor_q, floor_v, floor_a: (k,) largest change up to each time if the linkage's numbers are rounded to doubles; 0 if it was
            not computed.
        method: one line that names both integrations.
        certified: whether two independent derivations of the equations of motion agree on it.
    """

    error_q: Array
    error_v: Array
    error_a: Array
    floor_q: Array
    floor_v: Array
    floor_a: Array
    method: str
    certified: bool = False

    @classmethod
    def with_one_bar(cls, samples: Trajectory, method: str, bar: float = 0.0) -> "Reference":
        """Return the samples of a run as a reference with the same error bar [m, rad] at every time, and zeros as floors."""
        bars, floors = np.full(len(samples.t), bar), np.zeros(len(samples.t))
        return cls(samples.t, samples.q, samples.v, samples.a, bars, bars, bars, floors, floors, floors, method)

    @property
    def samples(self) -> Trajectory:
        """The motion as a trajectory, without a count of steps."""
        return Trajectory(self.t, self.q, self.v, self.a, None)


class Group(StrEnum):
    """The kinds of objects that curves over time describe, in the order in which tables and plots show them."""

    LINK = "link"  # angle, angular speed and angular acceleration of an observed link
    POINT = "point"  # position, velocity and acceleration of an observed point
    ENERGY = "energy"
    JOINT = "joint"  # force on the second link of a joint
    MOTOR = "motor"  # force or torque of drivers and constant torques
    TRANSMISSION = "transmission"  # transmission angle of a pair of links


@dataclass(frozen=True, eq=False)
class Curve:
    """One quantity over time, with its values (k,).

    Attributes:
        of: name of the link, point, joint, driver or pair of links.
        key: name of the quantity, such as "fx".
        unit: such as "m/s^2" or "N m".
    """

    group: Group
    of: str
    key: str
    unit: str
    values: Array

    @property
    def name(self) -> str:
        """The names of object and quantity, such as "crank.angle"."""
        return f"{self.of}.{self.key}"


@dataclass(frozen=True, eq=False)
class History:
    """The curves of a run at the times t (k,) [s], sorted by group, then by the order of the linkage file, then by key."""

    t: Array
    curves: tuple[Curve, ...]

    def of(self, group: Group) -> tuple[Curve, ...]:
        """Return the curves of a group."""
        return tuple(x for x in self.curves if x.group is group)


@dataclass(frozen=True)
class Caption:
    """The texts that are shown beside the curves of a run.

    Attributes:
        title, how: linkage and scenario; engine, integrator and step.
        verdict: the judge's objections, or the failure of the run; empty for a valid run.
        until: end of the run that the user asked for [s].
        trusted: time [s] up to which the judge has no objection; None if that is the whole run.
    """

    title: str
    how: str
    verdict: str
    until: float
    trusted: float | None


def spread_evenly(count: int, most: int) -> NDArray[np.intp]:
    """Return the indices (k,) of at most `most` of `count` samples, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.intp))


def finite(*samples: Array, below: float = np.inf) -> int:
    """Return how many samples precede the first with a number x that is NaN or has |x| >= `below`, in any of the arrays (k, n)."""
    is_finite = np.asarray((np.abs(np.hstack(samples)) < below).all(axis=1))
    return len(is_finite) if is_finite.all() else int(is_finite.argmin())  # argmin: the first False


def with_accelerations(
    times: Array,
    q: Array,
    v: Array,
    acceleration: Callable[[int], Array],
    steps: int | None,
    evaluations: int | None = None,
    note: str = "",
) -> Trajectory:
    """Return the trajectory of q, v (k, n) with acceleration(i) (n,) at sample i, or NaN from the first state that is not finite.

    Raises:
        RunFailure: `acceleration` raised it; its `reached` becomes the trajectory, with NaN from the failed sample on.
    """
    a = np.full_like(q, np.nan)
    trajectory = Trajectory(times, q, v, a, steps, evaluations, note)
    for k in range(finite(q, v)):
        try:
            a[k] = acceleration(k)
        except RunFailure as failure:
            failure.reached = trajectory
            raise
    return trajectory
