"""Functions of time: laws of a prescribed motion, and factors of forces that vary.

A law gives a value and its first and second time derivatives, in the number type of its parameters and of t. The families are those
of cam mechanisms (Wang et al., 2010): constant speed, sine (cycloidal) and cosine acceleration, 3-4-5 polynomial, table. A law that
ends keeps its first value before the beginning and its last value after the end.

The time factor of a force is one of

    table:    straight lines between rows (t, factor), the first and last value outside
    ramp:     from 0 at `start` to 1 after `time`
    step:     0 before `start`, 1 from then on
    sine:     sin(2 pi frequency t + phase)

A `Factor` lists the times of its kinks and jumps, so that an integrator can restart there. The direction factor changes smoothly
from `share`, where the point of application moves against the force, to 1, where it moves with the force. With the speed w along
the force (power divided by magnitude), and the width `speed` of the transition, it is

    (1 + share) / 2 + (1 - share) / 2 tanh(w / speed)
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import PI, Number, angle_of
from gauss_bench.terms import Array

Motion = tuple[Any, Any, Any]  # a value and its first and second time derivative
STEADY = (1.0, 0.0)  # the line of a constant factor 1: value at t = 0 [-] and slope [1/s]


@dataclass(frozen=True, eq=False)
class MotionLaw:
    """A function of t [s] that returns a value [rad or m] and its first and second time derivative; t may be an array.

    Other code can rebuild the law from its family `name` and its parameters `numbers`. The function `motion` of a law in this file
    can be pickled, because laws are sent to other processes.
    """

    name: str
    motion: Callable[[Any], Motion]
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, t: Any) -> Motion:
        """Return the value and both derivatives at time(s) t [s]."""
        return self.motion(t)


def constant(start: Any, speed: Any) -> MotionLaw:
    """Return the law of constant speed [rad/s, m/s] that has the value `start` [rad, m] at t = 0."""
    return MotionLaw("constant", partial(_constant, start, speed), {"start": start, "speed": speed})


def _constant(start: Any, speed: Any, t: Any) -> Motion:
    """Return the value and both derivatives at t of a motion at constant speed."""
    return start + speed * t, speed + 0 * t, 0 * t


def sine(s: Any, pi: Any = np.pi) -> Motion:
    """Return the cycloidal law and its first and second derivative at s in 0..1: its acceleration is a sine."""
    w = 2 * pi
    return s - np.sin(w * s) / w, 1 - np.cos(w * s), w * np.sin(w * s)


def cosine(s: Any, pi: Any = np.pi) -> Motion:
    """Return the harmonic law and its first and second derivative at s: its acceleration is a cosine, which jumps at both ends."""
    return (1 - np.cos(pi * s)) / 2, pi / 2 * np.sin(pi * s), pi * pi / 2 * np.cos(pi * s)


def poly345(s: Any, pi: Any = np.pi) -> Motion:
    """Return 10 s^3 - 15 s^4 + 6 s^5 and both derivatives at s in 0..1; like all RISE_LAWS it takes `pi`, but does not use it."""
    return (
        s * s * s * (10 - 15 * s + 6 * s * s),
        30 * s * s * (1 - s) * (1 - s),
        60 * s * (1 - s) * (1 - 2 * s),
    )


RISE_LAWS: dict[str, Callable[..., Motion]] = {"sine": sine, "cosine": cosine, "poly345": poly345}


def rise(name: str, start: Any, travel: Any, time: Any, number: Number = float) -> MotionLaw:
    """Return a law that moves from `start` by `travel` [rad, m] within `time` [s], as the law `name` in RISE_LAWS does from 0 to 1.

    The value is constant before and afterwards. `number` converts text to the type of the numbers.
    """
    motion = partial(_rise, name, start, travel, time, number(PI), number("0"), number("1"))
    return MotionLaw(name, motion, {"start": start, "travel": travel, "time": time})


def _rise(name: str, start: Any, travel: Any, time: Any, pi: Any, zero: Any, one: Any, t: Any) -> Motion:
    """Return the value and both derivatives at t, by the chain rule with s = t / time in [0, 1]; `moving` is 0 outside."""
    s, moving = clip(t / time, zero, one)
    x, rate, second = RISE_LAWS[name](s, pi)
    return start + travel * x, travel / time * rate * moving, travel / (time * time) * second * moving


def clip(t: Any, low: Any, high: Any) -> tuple[Any, Any]:
    """Return t limited to [low, high], and a factor that is 1 if t was inside and 0 if not, both in the type of the limits."""
    before, after = t < low, t > high
    zero = low - low  # in the type of the limits
    return np.where(before, low, np.where(after, high, t))[()], np.where(before | after, zero, zero + 1)[()]


def table(start: Any, times: Array, angles: Array) -> MotionLaw:
    """Return `start` plus a cubic spline through angles [rad] (or lengths [m]) at times [s], at rest at both ends and outside.

    With second derivatives k (curvatures) at the knots, widths h of the pieces and slopes d of their chords, the first derivative
    is continuous if

        h_j-1 k_j-1 + 2 (h_j-1 + h_j) k_j + h_j k_j+1 = 6 (d_j - d_j-1),    where slopes beyond the ends are zero.
    """
    h = times[1:] - times[:-1]  # widths of the pieces
    d = (angles[1:] - angles[:-1]) / h  # slopes of the chords
    k = _solve_curvatures(h, d)
    motion = partial(_table, start, times, angles, h, d, k)
    return MotionLaw("table", motion, {"start": start, "times": times, "angles": angles, "curvatures": k})


def _table(start: Any, times: Array, angles: Array, h: Array, d: Array, k: Array, t: Any) -> Motion:
    """Return value, first and second derivative at t of the cubic on the piece that contains t; at rest outside."""
    inside, moving = clip(t, times[0], times[-1])
    piece = np.searchsorted(times.astype(float), np.asarray(inside, dtype=float), side="right") - 1
    j = np.minimum(piece, len(h) - 1)  # the last time belongs to the last piece
    x = inside - times[j]
    bend = (k[j + 1] - k[j]) / h[j]  # third derivative
    slope = d[j] - h[j] * (2 * k[j] + k[j + 1]) / 6  # first derivative at the beginning of the piece
    value = angles[j] + x * (slope + x * (k[j] / 2 + x * bend / 6))
    return start + value, (slope + x * (k[j] + x * bend / 2)) * moving, (k[j] + x * bend) * moving


def _solve_curvatures(h: Array, d: Array) -> Array:
    """Return the curvatures k of a spline from the tridiagonal equations in `table`.

    Solvers of numpy and scipy would round longer number types to double.
    """
    zero = h[:1] * 0
    below, above = np.concatenate([zero, h]), np.concatenate([h, zero])
    main = 2 * (below + above)
    slopes = np.concatenate([zero, d, zero])
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
    """The factor sin(turning t + phase) of a force at time t [s], with `turning` in [rad/s] and `phase` in [rad]."""

    turning: float
    phase: float


@dataclass(frozen=True)
class Factor:
    """A factor of a force that depends on time t (...) [s] and on the speed w (...) along the force.

    Attributes:
        kinks: times [s], in order, at which the time factor or its slope jumps.
        lines: (level, slope [1/s]) of the line level + slope t before the first kink, between two kinks, and after the last one.
        wave: a sine in place of the straight lines, or None.
        share, speed: of the direction factor, see the top of this file [-, m/s or rad/s].
    """

    kinks: tuple[float, ...] = ()
    lines: tuple[tuple[float, float], ...] = (STEADY,)
    wave: Wave | None = None
    share: float = 1.0
    speed: float = 1.0

    def line(self, t: float | Array) -> Array:
        """Return level and slope of the straight line at times t (...) [s], as an array (..., 2); at a kink, those after it."""
        return np.asarray(np.array(self.lines)[np.searchsorted(self.kinks, t, side="right")])

    def of_time(self, t: Any) -> Array:
        """Return the time factor at times t (...) [s]."""
        t = np.asarray(t, dtype=float)
        if self.wave:
            return np.asarray(np.sin(self.wave.turning * t + self.wave.phase))
        level, slope = np.moveaxis(self.line(t), -1, 0)
        return np.asarray(level + slope * t)

    def __call__(self, t: Any, w: Array) -> Array:
        """Return the product of time factor and direction factor."""
        of_direction = (1 + self.share) / 2 + (1 - self.share) / 2 * np.tanh(w / self.speed)
        return np.asarray(self.of_time(t) * of_direction)


def read_factor(table: Mapping[str, Any]) -> Factor | None:
    """Return the factor of a force from its table; None if it has neither `over_time` nor `against`.

    `over_time` is a function of time, `against` applies while the point of application moves against the force.
    """
    if "over_time" not in table and "against" not in table:
        return None
    factor = _read_over_time(table["over_time"]) if "over_time" in table else Factor()
    against = table.get("against")
    return replace(factor, share=float(against["share"]), speed=float(against["speed"])) if against is not None else factor


def _read_over_time(table: Mapping[str, Any]) -> Factor:
    """Return the time factor of a force from its table `over_time`."""
    match table["law"]:
        case "table":
            return _straight_between([(float(t), float(factor)) for t, factor in table["rows"]])
        case "ramp":
            start, time = float(table.get("start", 0.0)), float(table["time"])
            return _straight_between([(start, 0.0), (start + time, 1.0)])
        case "step":
            return Factor(kinks=(float(table["start"]),), lines=((0.0, 0.0), STEADY))  # 0 before the kink, 1 after it
        case _:  # "sine"
            return Factor(wave=Wave(2 * np.pi * float(table["frequency"]), float(angle_of(table, "phase"))))


def _straight_between(rows: list[tuple[float, float]]) -> Factor:
    """Return a factor with straight lines between rows (t [s], factor), constant before the first and after the last."""
    lines = [(rows[0][1], 0.0)]  # level and slope of each line
    for (t0, x0), (t1, x1) in pairwise(rows):
        slope = (x1 - x0) / (t1 - t0)
        lines.append((x0 - slope * t0, slope))
    lines.append((rows[-1][1], 0.0))
    return Factor(kinks=tuple(t for t, _ in rows), lines=tuple(lines))
