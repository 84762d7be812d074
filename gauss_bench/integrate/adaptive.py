"""Adaptive integration: DOP853 of scipy.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), section II.5 (order 8, error control).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gauss_bench.integrate import StepFailure
from gauss_bench.integrate.fixed_step import Acceleration
from gauss_bench.terms import Array

if TYPE_CHECKING:
    from scipy.integrate import DOP853

MOST = 100_000  # largest number of steps: some hundred per second are usual, but near a locked position steps shrink without end


def dop853(
    acceleration: Acceleration, times: Array, q: Array, v: Array, rtol: float, atol: float, kinks: Sequence[float] = ()
) -> tuple[int, int]:
    """Integrate from the first row of q, v (k, n), and write the states at the other times into the other rows.

    Return the numbers of steps and of evaluations. If an acceleration or the step size control fails at some time, the rows of q
    and v for later times keep their values.

    Args:
        times: (k,) times of the rows [s].
        kinks: times [s] at which an acceleration has a kink or jumps; the integration restarts there.

    Raises:
        StepFailure: scipy's step size control fails, or MOST steps are not enough.
    """
    from scipy.integrate import DOP853  # its import takes longer than most runs

    n, steps, evaluations = q.shape[1], 0, 0
    done = 1  # number of filled rows
    begin, finish, y = float(times[0]), float(times[-1]), np.concatenate([q[0], v[0]])
    for end in (*(t for t in kinks if begin < t < finish), finish):
        # latest time of an evaluation: a force that jumps at the kink has its old value just before
        last = np.inf if end == finish else np.nextafter(end, begin)

        def rate(t: float, y: Array, last: float = last) -> Array:
            """Return v and a (2 n,) at y = [q, v]; forces are evaluated no later than `last` [s]."""
            return np.concatenate([y[n:], acceleration(min(t, last), y[:n], y[n:])])

        solver = DOP853(rate, begin, y, end, rtol=rtol, atol=atol)
        while done < len(times) and solver.t < end:
            message = solver.step()
            if solver.status == "failed":
                raise StepFailure(message)
            steps += 1
            if steps > MOST:
                raise StepFailure(f"more than {MOST} steps before t = {solver.t:.6g} s")
            for state in _sample_step(solver, times[done:]):
                q[done], v[done], done = state[:n], state[n:], done + 1
        begin, y, evaluations = end, solver.y, evaluations + int(solver.nfev)
    return steps, evaluations


def _sample_step(solver: "DOP853", times: Array) -> list[Array]:
    """Return the states (2 n,) at those sample times that the last step has passed; `times` are increasing and not yet sampled."""
    passed = times[: np.searchsorted(times, solver.t, side="right")]
    # the interpolation inside the step costs evaluations, and is only needed for times before the end of the step
    inside = solver.dense_output() if len(passed) and passed[0] < solver.t else None
    return [solver.y if inside is None or t == solver.t else inside(t) for t in passed]
