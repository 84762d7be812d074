"""Adaptive integration: DOP853 of scipy.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), section II.5 (order 8, error control).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gauss_bench.integrate.fixed_step import Acceleration

Array = NDArray[np.floating[Any]]


class StepFailure(ArithmeticError):
    """The error control could not continue."""


def dop853(
    acceleration: Acceleration, times: Array, q0: Array, v0: Array, rtol: float, atol: float
) -> tuple[Array, Array, int, int]:
    """States (k, n) at the times, number of steps, number of evaluations.

    Raises:
        StepFailure: with scipy's own reason.
    """
    n = len(q0)

    def rate(t: float, y: Array) -> Array:
        return np.concatenate([y[n:], acceleration(t, y[:n], y[n:])])

    solution = solve_ivp(
        rate, (times[0], times[-1]), np.concatenate([q0, v0]), "DOP853", t_eval=times, rtol=rtol, atol=atol, dense_output=True
    )
    if not solution.success:
        raise StepFailure(solution.message)
    return solution.y[:n].T, solution.y[n:].T, len(solution.sol.ts) - 1, int(solution.nfev)
