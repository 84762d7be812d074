"""The crank-slider at rest: the torque that weight and spring put on the crank, and where it is in equilibrium.

F(theta) = d . Q(q, 0) without the applied torque;   equilibrium F + tau = 0, stable where dF/dtheta < 0
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from gauss_bench.papers.crank_motion import CrankMotion
from gauss_bench.papers.crank_slider import derivative

GRID = 720  # angles of a turn: the torque changes its slope a few times a turn only


@dataclass(frozen=True)
class Extreme:
    """Largest or smallest static torque [N m] and its crank angle [rad]."""

    torque: float
    theta: float


@dataclass(frozen=True)
class Equilibrium:
    """A crank angle [rad] in (-pi, pi] at which the crank can rest."""

    theta: float
    stable: bool


def torque_range(motion: CrankMotion) -> tuple[Extreme, Extreme]:
    """Smallest and largest static torque of weight and spring over a turn."""
    idle = replace(motion, torque=0.0)
    theta = np.linspace(-np.pi, np.pi, GRID + 1)
    F, step = idle.static_torque(theta), 2 * np.pi / GRID
    found = []
    for sign, near in ((1.0, theta[F.argmin()]), (-1.0, theta[F.argmax()])):
        best = minimize_scalar(
            lambda x, sign=sign: sign * float(idle.static_torque(x)),
            bounds=(near - step, near + step),
            method="bounded",
            options={"xatol": 1e-10},
        )
        found.append(Extreme(sign * float(best.fun), float(best.x)))
    return found[0], found[1]


def equilibria(motion: CrankMotion) -> tuple[Equilibrium, ...]:
    """Where the crank can rest under the motion's torque, in the order of the angle; empty where no angle balances it."""
    theta = np.linspace(-np.pi, np.pi, GRID + 1)
    F = motion.static_torque(theta)
    found = []
    for k in np.flatnonzero(F[:-1] * F[1:] < 0):
        root = float(brentq(lambda x: float(motion.static_torque(x)), theta[k], theta[k + 1], xtol=1e-14))
        found.append(Equilibrium(root, bool(derivative(motion.static_torque, root, 1.0) < 0)))
    return tuple(found)
