"""What a steady force is multiplied by: a factor of the time, and one of the direction in which its point or link moves.

    table    straight lines between rows (t, factor), the first and last value outside
    ramp     from 0 at `start` to 1 after `time`
    step     0 before `start`, 1 from then on
    sine     sin(2 pi frequency t + phase)

Against its own direction a force may have a share of its value only. With w the speed along the force (its power over its size) and
a speed of regularisation, the share goes over smoothly, as in dry friction:

    (1 + share) / 2 + (1 - share) / 2 tanh(w / speed)

Where a factor of time has a kink or jumps stands with it, so that who integrates can start anew there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import angle_of
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Factor:
    """A factor of time t (...) [s] and of the speed (...) along the force.

    Attributes:
        of_time: t -> factor.
        made_of: the table that it was read from, as text, for those who tell one factor from another.
        kinks: times [s] at which that has no derivative.
        share, speed: against the direction of the force, and the speed over which it goes over [m/s or rad/s].
    """

    of_time: Callable[[Array], Array]
    made_of: str
    kinks: tuple[float, ...] = ()
    share: float = 1.0
    speed: float = 1.0

    def __call__(self, t: Any, w: Array) -> Array:
        """The factor at times and speeds (...)."""
        way = 1.0 if self.share == 1.0 else (1 + self.share) / 2 + (1 - self.share) / 2 * np.tanh(w / self.speed)
        return np.asarray(self.of_time(np.asarray(t, dtype=float)) * way + 0.0 * w)


def read_factor(table: Mapping[str, Any]) -> Factor | None:
    """The factor that a force's table names, or None: `over_time`, `against`."""
    if "over_time" not in table and "against" not in table:
        return None
    of_time, kinks = _of_time(table.get("over_time"))
    against = table.get("against", {})
    return Factor(of_time, repr(table.get("over_time")), kinks, float(against.get("share", 1.0)), float(against.get("speed", 1.0)))


def _of_time(table: Mapping[str, Any] | None) -> tuple[Callable[[Array], Array], tuple[float, ...]]:
    if table is None:
        return np.ones_like, ()
    match table["law"]:
        case "table":
            times, factors = np.array(table["rows"], dtype=float).T
            return lambda t: np.interp(t, times, factors), tuple(times.tolist())
        case "ramp":
            start, time = float(table.get("start", 0.0)), float(table["time"])
            return lambda t: np.clip((t - start) / time, 0.0, 1.0), (start, start + time)
        case "step":
            start = float(table["start"])
            return lambda t: np.where(t < start, 0.0, 1.0), (start,)
        case _:
            turning, phase = 2 * np.pi * float(table["frequency"]), float(angle_of(table, "phase"))
            return lambda t: np.sin(turning * t + phase), ()
