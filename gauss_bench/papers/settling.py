"""Whether the crank-slider comes to rest: decided within its first turn, and the bounds between one fate and the other.

The equation of motion has no time in it, so two motions cannot cross in the plane of crank angle and speed. A crank that starts at
rest and completes a turn is back at the same angle with a speed; it stays ahead of its first turn in the second and in every later
one, and never stops. A crank that turns back before that is caught between the angle where it turned and the one where it started,
because torque, weight and spring give back no more than they took and the damper only takes; it comes to rest.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gauss_bench.papers.crank_motion import RTOL, CrankMotion
from gauss_bench.terms import Array

LONGEST = 60.0  # [s]; a first turn takes less than 1 s, longer only within rounding of a bound
WIDTH = 1e-9  # of the bound: about what the integration leaves
MARGIN = 100.0  # brackets by which the second search starts outside the first
FINER = 1e-2  # of the tolerance: integrated again with it, the bound moves by what the integration leaves


@dataclass(frozen=True)
class Bound:
    """A value between two fates and its uncertainty: half the bracket, plus what a finer integration moves it by."""

    value: float
    bracket: float


def settles(motion: CrankMotion, rtol: float = RTOL) -> bool:
    """Whether the crank, started at rest at theta = 0, comes to rest.

    Raises:
        ArithmeticError: not decided within LONGEST, which happens at an exact bound only.
    """
    push = float(motion.static_torque(0.0))
    if push == 0.0:
        return True

    def decided(t: float, y: Array) -> float:
        """Negative once the crank has turned back or completed a turn; zero at the start, and positive after it."""
        return float(min(np.sign(push) * y[1], 2 * np.pi - abs(y[0])))

    decided.terminal, decided.direction = True, -1.0  # type: ignore[attr-defined]
    course = motion.run(LONGEST, rtol=rtol, event=decided)
    if not course.stopped:
        raise ArithmeticError(f"the fate of the crank is not decided within {LONGEST:g} s")
    return bool(abs(course.theta[-1]) < np.pi * 2 * (1 - 1e-6))


def bound(make: Callable[[float], CrankMotion], settled: float, running: float, width: float = WIDTH) -> Bound:
    """Where, between a value with which it settles and one with which it runs, the fate changes; `width` is relative.

    Raises:
        ValueError: the fates at the two values are not these.
    """
    low, high = bisected(make, settled, running, RTOL, width)
    near = MARGIN * (high - low)
    fine = bisected(make, low - near, high + near, FINER * RTOL, width)
    value = (fine[0] + fine[1]) / 2
    return Bound(value, abs(fine[1] - fine[0]) / 2 + abs(value - (low + high) / 2))


def bisected(
    make: Callable[[float], CrankMotion], settled: float, running: float, rtol: float, width: float
) -> tuple[float, float]:
    """Both ends of the bracket, narrowed to `width` of the larger of them.

    Raises:
        ValueError: the fates at the two ends are not these.
    """
    if not settles(make(settled), rtol) or settles(make(running), rtol):
        raise ValueError(f"no bound between {settled:g} and {running:g}")
    while abs(running - settled) > width * max(abs(running), abs(settled)):
        middle = (settled + running) / 2
        if settles(make(middle), rtol):
            settled = middle
        else:
            running = middle
    return settled, running
