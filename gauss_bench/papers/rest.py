"""Find where the crank-slider can rest, whether it comes to rest from its start, and which parameters separate rest from turning.

F(theta) = d . Q(q, 0) is the static torque of weight and spring on the crank, with d = dq/dtheta. Under an applied torque tau, the
crank is in equilibrium where F + tau = 0; this equilibrium is stable if dF/dtheta < 0.

The equation of motion does not depend on time, so that two motions cannot cross in the plane of crank angle and speed. A crank that
starts at rest and completes a turn is back at its starting angle with some speed. In every later turn the crank is faster at each
angle than it was in the first turn, so that it never stops. A crank that turns back before it completes the first turn stays
between its starting angle and the angle at which it turned back, because torque, weight and spring are conservative and the damper
takes energy. Such a crank comes to rest.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from gauss_bench.papers.crank_motion import RTOL, CrankMotion
from gauss_bench.papers.crank_slider import derivative
from gauss_bench.terms import Array

GRID = 720  # angles in a turn: the slope of the static torque changes sign only a few times in a turn
LONGEST = 60.0  # [s] of a first turn; it takes less than 1 s, unless the data are within rounding of a bound
WIDTH = 1e-9  # relative width of a bracket at which bisection ends, about the error of the integration
MARGIN = 100.0  # distance from the last bracket at which the second search begins, in widths of the bracket
SECOND_TOLERANCE = 1e-2  # factor on the tolerance of a second search, which shows the error of the integration


class Extreme(NamedTuple):
    """Largest or smallest static torque [N m] on the crank, and the crank angle [rad] at which it acts."""

    torque: float
    theta: float


class Equilibrium(NamedTuple):
    """A crank angle [rad] in (-pi, pi] at which the crank can rest."""

    theta: float
    stable: bool


def torque_range(motion: CrankMotion) -> tuple[Extreme, Extreme]:
    """Return the smallest and the largest static torque of weight and spring on the crank during one turn of the crank."""
    idle = replace(motion, torque=0.0)
    theta, step = np.linspace(-np.pi, np.pi, GRID + 1), 2 * np.pi / GRID
    F, extremes = idle.static_torque(theta), []
    for sign in (1.0, -1.0):
        near = float(theta[(sign * F).argmin()])
        ends, options = (near - step, near + step), {"xatol": 1e-10}
        best = minimize_scalar(lambda x, k=sign: k * idle.static_torque(float(x)), bounds=ends, method="bounded", options=options)
        extremes.append(Extreme(sign * float(best.fun), float(best.x)))
    return extremes[0], extremes[1]


def equilibria(motion: CrankMotion) -> tuple[Equilibrium, ...]:
    """Return the equilibria of the crank under the torque `motion.torque`, with ascending angles; empty if there are none."""
    theta = np.linspace(-np.pi, np.pi, GRID + 1)
    F = motion.static_torque(theta)
    places = []
    for k in np.flatnonzero(F[:-1] * F[1:] < 0):
        root = float(brentq(lambda x: float(motion.static_torque(x)), float(theta[k]), float(theta[k + 1]), xtol=1e-14))
        places.append(Equilibrium(root, bool(derivative(motion.static_torque, root, 1.0) < 0)))
    return tuple(places)


def settles(motion: CrankMotion, rtol: float = RTOL) -> bool:
    """Tell whether the crank, started at rest at theta = 0, turns back before it completes a turn.

    A crank that turns back swings and comes to rest. A crank that completes the first turn begins the second turn faster than the
    first, and so runs on for ever.

    Raises:
        ArithmeticError: the crank neither turns back nor completes the first turn within LONGEST [s]. Then the parameters lie,
            within rounding, on the boundary between a crank that comes to rest and one that runs on.
    """
    push = float(motion.static_torque(0.0))
    if push == 0.0:
        return True

    def first_turn(t: float, y: Array) -> float:
        """Return a number that is 0 at the start, then positive, and falls to 0 when the crank turns back or completes a turn."""
        return float(min(np.sign(push) * y[1], 2 * np.pi - abs(y[0])))

    first_turn.terminal, first_turn.direction = True, -1.0  # type: ignore[attr-defined]
    run = motion.run(LONGEST, rtol=rtol, event=first_turn)
    if not run.stopped:
        raise ArithmeticError(f"whether the crank comes to rest is not decided within {LONGEST:g} s")
    return bool(abs(run.theta[-1]) < np.pi * 2 * (1 - 1e-6))


def find_bound(make: Callable[[float], CrankMotion], settled: float, running: float, width: float = WIDTH) -> tuple[float, float]:
    """Return the threshold of a parameter between motions that come to rest and those that run on, and its uncertainty.

    The bisection ends with two values of the parameter, one with which the crank comes to rest and one with which it runs on. The
    uncertainty is half the distance between the two values, plus the change of the threshold if the motion is integrated with a
    smaller tolerance.

    Args:
        make: value of the parameter -> motion.
        settled, running: value with which the crank comes to rest, and value with which it runs on.
        width: relative distance of the two values at which the bisection ends.

    Raises:
        ValueError: the crank does not come to rest with `settled`, or does with `running`.
    """
    low, high = bisect(make, settled, running, RTOL, width)
    near = MARGIN * (high - low)
    fine = bisect(make, low - near, high + near, SECOND_TOLERANCE * RTOL, width)
    value = (fine[0] + fine[1]) / 2
    return value, abs(fine[1] - fine[0]) / 2 + abs(value - (low + high) / 2)


def bisect(make: Callable[[float], CrankMotion], settled: float, running: float, rtol: float, width: float) -> tuple[float, float]:
    """Narrow the bracket (settled, running) of a threshold by bisection, and return its last two values in the same order.

    With the value `settled` of the parameter the crank comes to rest, and with `running` it runs on. Bisection ends when their
    relative distance is at most `width`. `make` maps a value of the parameter to the motion; `rtol` is the tolerance of the
    integration.
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
