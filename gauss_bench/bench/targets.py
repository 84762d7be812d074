"""What the native kernel is meant to reach, set before it was built, and how a row is held against it.

A prototype without guards, forces, springs and projection had made a step of the crank-slider in 1/91, of the six-bar in 1/53 and
of the eight-bar in 1/37 of the time of MuJoCo's; and 720 of them, all from the same state, in a batch. What a user needs costs
more, so that the targets lie a little below. A row that misses its target says so, and so does the report.
"""

import math
from typing import Any

STEP = {"crank_slider": 80.0, "six_bar": 48.0, "eight_bar": 35.0}  # times MuJoCo: nine tenths of the prototype's
PROJECTED = {"crank_slider": 40.0, "six_bar": 24.0, "eight_bar": 18.0}  # half of STEP: one more factorisation may cost a step
BATCH = 500.0  # times MuJoCo: seven tenths of the prototype's, because lanes differ and results are stored
RIGHT_HAND_SIDE = 20.0  # times Pinocchio's constraintDynamics: its library is compiled too, but general
RIGHT_HAND_SIDE_OF = ("crank_slider", "six_bar", "eight_bar")
AGREEMENT = 1e-11  # relative: rounding (1e-16) at conditions up to 1e4, ten times over
DRIFT = 1e-13  # [m, rad], [m/s, rad/s]: what rounding (1e-16) leaves of sums of a few numbers up to some 100
ORDER = 4.0  # of Runge-Kutta: at half the step the energy error must fall at least 2^4-fold
ORDER_MARGIN = 0.2  # observed orders scatter by 0.1
KINEMATICS = {"four_bar": 7.4e6, "eight_bar": 1.0e6}  # positions with velocities and accelerations per second, on one core
CLOSURE = 1e-12  # [m, rad] relative to the largest value, of kinematics


def at_least(row: dict[str, Any], column: str, target: float | None) -> dict[str, Any]:
    """The row with its target, and whether the column reaches it; what was not measured has not reached it."""
    if target is None:
        return row
    return row | {"target": target, "met": bool(_number(row, column) >= target)}


def at_most(row: dict[str, Any], column: str, target: float) -> dict[str, Any]:
    """As `at_least`, for what should be small."""
    return row | {"target": target, "met": bool(_number(row, column) <= target)}


def _number(row: dict[str, Any], column: str) -> float:
    x = row.get(column)
    return math.nan if x is None else float(x)
