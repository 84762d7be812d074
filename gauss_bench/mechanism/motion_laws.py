"""Functions of time: laws theta(t) of a prescribed motion, and factors of forces that vary.

A law has a value, a rate and a second rate, consistent with each other.

Formulas as in the textbook family of cam laws named by Wang et al. (2010): constant speed, sine (cycloidal) and cosine
acceleration, 3-4-5 polynomial, table. A law that runs for a time holds its end position afterwards and its start before.
Arguments may be of any type of number; what a law computes then is of that type too.

Factors of a steady force: one of the time, and one of the direction in which its point or link moves.

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

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import PI, Number, angle_of
from gauss_bench.terms import Array

Motion = tuple[Any, Any, Any]
STEADY = (1.0, 0.0)  # a line of a factor: its value at t = 0 [-] and its slope [1/s]


@dataclass(frozen=True, eq=False)
class MotionLaw:
    """A callable t -> (theta [rad], rate [rad/s], second rate [rad/s^2]); t may be an array.

    Attributes:
        name: the family of the law.
        motion: the function itself.
        numbers: parameters of the law, from which other code can rebuild it in its own form.
    """

    name: str
    motion: Callable[[Any], Motion]
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, t: Any) -> Motion:
        return self.motion(t)

    def __reduce__(self) -> tuple[Callable[..., "MotionLaw"], tuple[str, dict[str, Any]]]:
        """Pickle the name and the numbers: a closure cannot be sent to another process."""
        return make_law, (self.name, dict(self.numbers))


def make_law(name: str, numbers: Mapping[str, Any]) -> MotionLaw:
    """Build the law of this name from its parameters, in floats."""
    match name:
        case "constant":
            return constant(numbers["start"], numbers["speed"])
        case "table":
            return table(numbers["start"], numbers["times"], numbers["angles"])
        case _:
            return rise(name, numbers["start"], numbers["travel"], numbers["time"])


def constant(start: Any, speed: Any) -> MotionLaw:
    """Constant speed [rad/s] from `start` [rad]."""
    numbers = {"start": start, "speed": speed}
    return MotionLaw("constant", lambda t: (start + speed * t, speed + 0 * t, 0 * t), numbers)


def sine(s: Any, pi: Any = np.pi) -> Motion:
    """Cycloidal law on 0..1: the acceleration is a sine."""
    w = 2 * pi
    return s - np.sin(w * s) / w, 1 - np.cos(w * s), w * np.sin(w * s)


def cosine(s: Any, pi: Any = np.pi) -> Motion:
    """Harmonic law on 0..1: the acceleration is a cosine and jumps at the ends."""
    return (1 - np.cos(pi * s)) / 2, pi / 2 * np.sin(pi * s), pi * pi / 2 * np.cos(pi * s)


def poly345(s: Any, pi: Any = np.pi) -> Motion:
    """3-4-5 polynomial on 0..1."""
    return (
        s * s * s * (10 - 15 * s + 6 * s * s),
        30 * s * s * (1 - s) * (1 - s),
        60 * s * (1 - s) * (1 - 2 * s),
    )


RISE_LAWS: dict[str, Callable[..., Motion]] = {"sine": sine, "cosine": cosine, "poly345": poly345}


def rise(name: str, start: Any, travel: Any, time: Any, number: Number = float) -> MotionLaw:
    """One of RISE_LAWS from `start` over `travel` [rad] in `time` [s], at rest outside."""
    pi, low, high = number(PI), number("0"), number("1")

    def motion(t: Any) -> Motion:
        s, moving = within(t / time, low, high)
        x, rate, second = RISE_LAWS[name](s, pi)
        return start + travel * x, travel / time * rate * moving, travel / (time * time) * second * moving

    return MotionLaw(name, motion, {"start": start, "travel": travel, "time": time})


def within(t: Any, low: Any, high: Any) -> tuple[Any, Any]:
    """Return t clipped to two bounds, and 1 where t was between them, else 0."""
    before, after = t < low, t > high
    return np.where(before, low, np.where(after, high, t))[()], np.where(before | after, low - low, low - low + 1)[()]


def table(start: Any, times: Array, angles: Array) -> MotionLaw:
    """Cubic spline through a table, at rest at both ends and outside; angles [rad] are added to `start`.

    With curvatures k at the knots and h, d the widths and slopes of the pieces, the first derivative is continuous where

        h_j-1 k_j-1 + 2 (h_j-1 + h_j) k_j + h_j k_j+1 = 6 (d_j - d_j-1),    slopes beyond the ends being zero.
    """
    h = times[1:] - times[:-1]
    d = (angles[1:] - angles[:-1]) / h
    k = _curvatures(h, d)

    def motion(t: Any) -> Motion:
        inside, moving = within(t, times[0], times[-1])
        j = np.minimum(np.searchsorted(times.astype(float), np.asarray(inside, dtype=float), side="right") - 1, len(h) - 1)
        x, width, bend = inside - times[j], h[j], (k[j + 1] - k[j]) / h[j]
        slope = d[j] - width * (2 * k[j] + k[j + 1]) / 6
        value = angles[j] + x * (slope + x * (k[j] / 2 + x * bend / 6))
        return start + value, (slope + x * (k[j] + x * bend / 2)) * moving, (k[j] + x * bend) * moving

    return MotionLaw("table", motion, {"start": start, "times": times, "angles": angles, "curvatures": k})


def _curvatures(h: Array, d: Array) -> Array:
    """Curvatures at the knots: the tridiagonal system above, by elimination."""
    none = h[:1] * 0
    below, above = np.concatenate([none, h]), np.concatenate([h, none])
    main = 2 * (below + above)
    slopes = np.concatenate([none, d, none])
    k: Array = 6 * (slopes[1:] - slopes[:-1])
    for j in range(1, len(main)):
        factor = below[j] / main[j - 1]
        main[j], k[j] = main[j] - factor * above[j - 1], k[j] - factor * k[j - 1]
    k[-1] = k[-1] / main[-1]
    for j in range(len(main) - 2, -1, -1):
        k[j] = (k[j] - above[j] * k[j + 1]) / main[j]
    return k


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
        lines: (level, slope [1/s]) of level + slope t, before, between and after the kinks; at a kink the later line holds.
        wave: a sine that replaces the lines, or None.
        share, speed: share of the force when its point moves against it, and the transition speed [m/s or rad/s].
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
    """Read the factor of a force's table from `over_time` and `against`; None if it has neither."""
    if "over_time" not in table and "against" not in table:
        return None
    against = table.get("against", {})
    return Factor(*_of_time(table.get("over_time")), float(against.get("share", 1.0)), float(against.get("speed", 1.0)))


def _of_time(table: Mapping[str, Any] | None) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...], Wave | None]:
    """Read kinks, lines and wave from the table `over_time`."""
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
