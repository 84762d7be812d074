"""Laws theta(t) of a prescribed rotation: value, rate and second rate, consistent with each other.

Formulas as in the textbook family of cam laws named by Wang et al. (2010): constant speed, sine (cycloidal) and cosine
acceleration, 3-4-5 polynomial, table. A law that runs for a time holds its end position afterwards and its start before.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.terms import Array

Motion = tuple[Any, Any, Any]


@dataclass(frozen=True, eq=False)
class MotionLaw:
    """A callable t -> (theta [rad], rate [rad/s], second rate [rad/s^2]); t may be an array."""

    name: str
    motion: Callable[[Any], Motion]

    def __call__(self, t: Any) -> Motion:
        return self.motion(t)


def constant(start: float, speed: float) -> MotionLaw:
    """Constant speed [rad/s] from `start` [rad]."""
    return MotionLaw("constant", lambda t: (start + speed * t, speed + 0.0 * t, 0.0 * t))


def sine(s: Any) -> Motion:
    """Cycloidal law on 0..1: the acceleration is a sine."""
    w = 2 * np.pi
    return s - np.sin(w * s) / w, 1 - np.cos(w * s), w * np.sin(w * s)


def cosine(s: Any) -> Motion:
    """Harmonic law on 0..1: the acceleration is a cosine and jumps at the ends."""
    return (1 - np.cos(np.pi * s)) / 2, np.pi / 2 * np.sin(np.pi * s), np.pi**2 / 2 * np.cos(np.pi * s)


def poly345(s: Any) -> Motion:
    """3-4-5 polynomial on 0..1."""
    return (
        s**3 * (10 - 15 * s + 6 * s**2),
        30 * s**2 * (1 - s) ** 2,
        60 * s * (1 - s) * (1 - 2 * s),
    )


RISE_LAWS: dict[str, Callable[[Any], Motion]] = {"sine": sine, "cosine": cosine, "poly345": poly345}


def rise(name: str, start: float, travel: float, time: float) -> MotionLaw:
    """One of RISE_LAWS from `start` over `travel` [rad] in `time` [s], at rest outside."""

    def motion(t: Any) -> Motion:
        s = np.clip(np.asarray(t) / time, 0.0, 1.0)
        moving = (np.asarray(t) >= 0) & (np.asarray(t) <= time)
        x, rate, second = RISE_LAWS[name](s)
        return start + travel * x, travel / time * rate * moving, travel / time**2 * second * moving

    return MotionLaw(name, motion)


def table(start: float, times: Array, angles: Array) -> MotionLaw:
    """Cubic spline through a table, at rest at both ends and outside; angles [rad] are added to `start`."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(times, angles, bc_type="clamped")

    def motion(t: Any) -> Motion:
        inside = np.clip(t, times[0], times[-1])
        moving = (np.asarray(t) >= times[0]) & (np.asarray(t) <= times[-1])
        return start + spline(inside), spline(inside, 1) * moving, spline(inside, 2) * moving

    return MotionLaw("table", motion)
