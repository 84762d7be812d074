"""Adaptive integration: DOP853 of scipy.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), section II.5 (order 8, error control).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from gauss_bench.integrate.fixed_step import Acceleration

Array = NDArray[np.floating[Any]]


class StepFailure(ArithmeticError):
    """The error control could not continue."""


def dop853(acceleration: Acceleration, times: Array, q: Array, v: Array, rtol: float, atol: float) -> tuple[int, int]:
    """Fill the states q, v (k, n) at the times from their first rows on; number of steps, number of evaluations.

    What is not reached, because an acceleration fails or the error control does, stays as it is.

    Raises:
        StepFailure: with scipy's own reason.
    """
    n, done, steps = q.shape[1], 0, 0

    def rate(t: float, y: Array) -> Array:
        return np.concatenate([y[n:], acceleration(t, y[:n], y[n:])])

    solver = DOP853(rate, times[0], np.concatenate([q[0], v[0]]), times[-1], rtol=rtol, atol=atol)
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            raise StepFailure(message)
        steps += 1
        part = slice(done, int(np.searchsorted(times, solver.t, side="right")))
        states = solver.dense_output()(times[part])
        q[part], v[part], done = states[:n].T, states[n:].T, part.stop
    return steps, int(solver.nfev)
