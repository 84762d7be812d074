"""Laws theta(t) of a prescribed rotation: value, rate and second rate, consistent with each other.

Formulas as in the textbook family of cam laws named by Wang et al. (2010): constant speed, sine (cycloidal) and cosine
acceleration, 3-4-5 polynomial, table. A law that runs for a time holds its end position afterwards and its start before.
Arguments may be of any type of number; what a law computes then is of that type too.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import PI, Number
from gauss_bench.terms import Array

Motion = tuple[Any, Any, Any]


@dataclass(frozen=True, eq=False)
class MotionLaw:
    """A callable t -> (theta [rad], rate [rad/s], second rate [rad/s^2]); t may be an array.

    Attributes:
        name: of the family.
        motion: what is called.
        numbers: what the law is made of, for those who write it in another form.
    """

    name: str
    motion: Callable[[Any], Motion]
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, t: Any) -> Motion:
        return self.motion(t)

    def __reduce__(self) -> tuple[Callable[..., "MotionLaw"], tuple[str, dict[str, Any]]]:
        """On its way to another process a law in floats is what it is made of."""
        return make_law, (self.name, dict(self.numbers))


def make_law(name: str, numbers: Mapping[str, Any]) -> MotionLaw:
    """The law of this name that is made of these floats."""
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
    """t held between two bounds, and whether it lies there (1 or 0)."""
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
