"""Fixed-step integrators: one step each, from (t, q, v) to t + h.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (1993), sections II.1 and, for DOP853, II.5; the
semi-implicit Euler method as in Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), section I.1.2.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

ROUNDING = 4 * np.finfo(float).eps  # of two times and what they were made of
Array = NDArray[np.floating[Any]]
Acceleration = Callable[[float, Array, Array], Array]
Step = Callable[[Acceleration, float, Array, Array, float], tuple[Array, Array]]


def rk4(acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """The classical Runge-Kutta method, order 4, four evaluations."""
    a1 = acceleration(t, q, v)
    v2 = v + h / 2 * a1
    a2 = acceleration(t + h / 2, q + h / 2 * v, v2)
    v3 = v + h / 2 * a2
    a3 = acceleration(t + h / 2, q + h / 2 * v2, v3)
    v4 = v + h * a3
    a4 = acceleration(t + h, q + h * v3, v4)
    return q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def semi_implicit_euler(acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """Order 1, one evaluation: the new velocity moves the positions."""
    v = v + h * acceleration(t, q, v)
    return q + h * v, v


def dop853_fixed(acceleration: Acceleration, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
    """The twelve stages of DOP853 without its error estimate: order 8."""
    (nodes, rows, weights), n, y = dop853_tableau(), len(q), np.concatenate([q, v])
    rates = np.empty((len(weights), 2 * n))
    for k, (node, row) in enumerate(zip(nodes, rows, strict=True)):
        state = y + h * row.dot(rates[:k]) if k else y
        rates[k, :n], rates[k, n:] = state[n:], acceleration(t + node * h, state[:n], state[n:])
    y = y + h * weights.dot(rates)
    return y[:n], y[n:]


@cache
def dop853_tableau() -> tuple[list[float], list[Array], Array]:
    """Nodes (s,), the rows' weights of the stages before them, and the weights (s,) of the step; as scipy has them.

    Read when first asked for: importing scipy.integrate takes longer than most runs.
    """
    from scipy.integrate import DOP853

    weights = np.ascontiguousarray(DOP853.B)
    rows = [np.ascontiguousarray(row[:k]) for k, row in enumerate(DOP853.A[: len(weights)])]
    return DOP853.C[: len(weights)].tolist(), rows, weights


@cache
def dop853_estimates() -> tuple[Array, Array]:
    """Weights (s,) of the same stages that give the difference from a step of order 5, and from one of order 3."""
    from scipy.integrate import DOP853

    s = len(DOP853.B)  # scipy's have one more, of the next step's first stage, which is 0
    return np.ascontiguousarray(DOP853.E5[:s]), np.ascontiguousarray(DOP853.E3[:s])


STEPS: dict[str, Step] = {"rk4": rk4, "semi_implicit_euler": semi_implicit_euler, "dop853_fixed": dop853_fixed}
EVALUATIONS = {"rk4": 4, "semi_implicit_euler": 1, "dop853_fixed": 12}  # of accelerations in a step


def step_counts(times: Array, step: float) -> list[tuple[int, float]]:
    """(count, size) of the equal steps, none longer than `step`, between each two consecutive times.

    Where the times are multiples of `step`, as exactly as times can be told, the size is `step`; elsewhere a little less.
    """
    found = []
    for gap, end in zip(np.diff(times), times[1:], strict=True):
        count = max(1, int(np.ceil(gap / step * (1 - 1e-9))))
        whole = abs(gap - count * step) <= ROUNDING * end
        found.append((count, step if whole else float(gap) / count))
    return found


class Stretch(NamedTuple):
    """Equal steps without a kink in them.

    Attributes:
        begin: [s] where they begin; count, size: how many, and how long [s].
        last: [s] the last time at which accelerations are those of these steps: what jumps at the end of them jumps after it.
        row: number of the sample that they end at; None where they end at a kink on the way to it.
    """

    begin: float
    count: int
    size: float
    last: float
    row: int | None


def stretches(times: Array, step: float, kinks: Sequence[float] = ()) -> Iterator[Stretch]:
    """The steps from sample to sample, none longer than `step`, of which one ends at every kink [s] between the first and last."""
    for row, (begin, end) in enumerate(pairwise(times), start=1):
        near = ROUNDING * max(abs(end), abs(begin))
        ends = [*(t for t in kinks if begin + near < t < end - near), end]
        jumps = any(abs(t - end) <= near for t in kinks)
        nodes = np.array([begin, *ends])
        for k, (count, size) in enumerate(step_counts(nodes, step)):
            whole = k == len(ends) - 1
            last = np.inf if whole and not jumps else np.nextafter(nodes[k + 1] - (near if whole else 0.0), nodes[k])
            yield Stretch(float(nodes[k]), count, size, float(last), row if whole else None)


def held_back(acceleration: Acceleration, last: float) -> Acceleration:
    """The accelerations of steps that end where they jump."""
    return acceleration if last == np.inf else lambda t, q, v: acceleration(min(t, last), q, v)
