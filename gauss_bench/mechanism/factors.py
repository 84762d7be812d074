"""Factors of a steady force: one of the time, and one of the direction in which its point or link moves.

    table    straight lines between rows (t, factor), the first and last value outside
    ramp     from 0 at `start` to 1 after `time`
    step     0 before `start`, 1 from then on
    sine     sin(2 pi frequency t + phase)

Against its own direction a force may have a share of its value only. With w the speed along the force (its power over its size) and
a speed of regularisation, the share goes over smoothly, as in dry friction:

    (1 + share) / 2 + (1 - share) / 2 tanh(w / speed)

Where a factor of time has a kink or jumps stands with it, so that who integrates can start anew there; between kinks it is a
straight line, or the sine.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import angle_of
from gauss_bench.terms import Array

STEADY = (1.0, 0.0)  # a line: its value at t = 0 [-] and its slope [1/s]


@dataclass(frozen=True)
class Wave:
    """The factor sin(turning t + phase); [rad/s] and [rad]."""

    turning: float
    phase: float


@dataclass(frozen=True)
class Factor:
    """A factor of time t (...) [s] and of the speed (...) along the force.

    Attributes:
        kinks: times [s], in order, at which the factor of time has no derivative, or jumps.
        lines: before, between and after the kinks: level and slope [1/s] of level + slope t; at a kink the line after it holds.
        wave: what stands in place of the lines, or None.
        share, speed: against the direction of the force, and the speed over which it goes over [m/s or rad/s].
    """

    kinks: tuple[float, ...] = ()
    lines: tuple[tuple[float, float], ...] = (STEADY,)
    wave: Wave | None = None
    share: float = 1.0
    speed: float = 1.0

    def line(self, t: float | Array) -> Array:
        """(..., 2) level and slope at times (...)."""
        return np.asarray(np.array(self.lines)[np.searchsorted(self.kinks, t, side="right")])

    def of_time(self, t: Any) -> Array:
        """The factor of time at times (...)."""
        t = np.asarray(t, dtype=float)
        if self.wave:
            return np.asarray(np.sin(self.wave.turning * t + self.wave.phase))
        level, slope = np.moveaxis(self.line(t), -1, 0)
        return np.asarray(level + slope * t)

    def __call__(self, t: Any, w: Array) -> Array:
        """The factor at times and speeds (...)."""
        way = 1.0 if self.share == 1.0 else (1 + self.share) / 2 + (1 - self.share) / 2 * np.tanh(w / self.speed)
        return np.asarray(self.of_time(t) * way + 0.0 * w)


def read_factor(table: Mapping[str, Any]) -> Factor | None:
    """The factor that a force's table names, or None: `over_time`, `against`."""
    if "over_time" not in table and "against" not in table:
        return None
    against = table.get("against", {})
    return Factor(*_of_time(table.get("over_time")), float(against.get("share", 1.0)), float(against.get("speed", 1.0)))


def _of_time(table: Mapping[str, Any] | None) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...], Wave | None]:
    """Kinks, lines and wave."""
    if table is None:
        return (), (STEADY,), None
    match table["law"]:
        case "table":
            return *_through([(float(t), float(factor)) for t, factor in table["rows"]]), None
        case "ramp":
            start, time = float(table.get("start", 0.0)), float(table["time"])
            return *_through([(start, 0.0), (start + time, 1.0)]), None
        case "step":
            return (float(table["start"]),), ((0.0, 0.0), STEADY), None
        case _:
            return (), (STEADY,), Wave(2 * np.pi * float(table["frequency"]), float(angle_of(table, "phase")))


def _through(rows: list[tuple[float, float]]) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...]]:
    """Kinks and lines of a factor that is straight from row to row, (t, factor), and rests before and after them."""
    slopes = [(y - x) / (t - s) for (s, x), (t, y) in pairwise(rows)]
    between = [(x - slope * t, slope) for (t, x), slope in zip(rows, slopes, strict=False)]
    return tuple(t for t, _ in rows), ((rows[0][1], 0.0), *between, (rows[-1][1], 0.0))
