"""A linkage that its drivers leave no freedom: its motion is geometry, found by Newton's method in extended precision.

The branch is followed in double precision, in steps that the second-order prediction foresees well; the samples are then closed
together, all times in one batch, to the last digit. Rates follow from A x' = rate and A x'' = gamma.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.motion import Progress
from gauss_bench.reference.taylor.arithmetic import NUMBERS
from gauss_bench.reference.taylor.elimination import factorise
from gauss_bench.reference.taylor.equations import Chart, choose_chart
from gauss_bench.reference.taylor.moving_vectors import Instant
from gauss_bench.reference.taylor.rows import LoopRows
from gauss_bench.reference.taylor.samples import LoopStates
from gauss_bench.reference.taylor.solve import (
    RANK_TOLERANCE,
    Long,
    Unsolved,
    apply,
    columns,
    correct,
    dense,
    epsilon,
    pseudo_inverse,
    stack_arrays,
)
from gauss_bench.terms import Array

FORESEEN = 0.01  # [rad] or of the longest arm: a prediction further off is one of too long a step
SHORTEST = 1e-6  # of the time between two samples
NEWTON_STEPS = 8
CLOSED = 1e-12  # [rad] or of the longest arm: what double precision leaves
SINGULAR = 1e-6  # smallest pivot, in units of what the coordinates move the loops by


class Closures:
    """The rows of a driven linkage in double precision, at one time after the other."""

    def __init__(self, rows: LoopRows, chart: Chart):
        self.rows = rows
        self.scale = chart.scale
        self.unit = chart.scale / chart.scale.max(initial=0.0)
        self.laws = [driver.law for driver in rows.coordinates.mechanism.drivers]

    def _instant(self, x: Array) -> Instant:
        return Instant(columns(x[None]), NUMBERS)

    def _solve(self, x: Array, b: Sequence[Any]) -> Array:
        """Solution (n,) of A(x) y = b, whose redundant rows agree."""
        y: Array = np.linalg.lstsq(self.matrix(x), stack_arrays(b, np.zeros(1))[0], rcond=RANK_TOLERANCE)[0]
        return y

    def matrix(self, x: Array) -> Array:
        return np.asarray(dense(self.rows.entries(self._instant(x)), 1, len(x))[0])

    def rates(self, t: float, x: Array) -> tuple[Array, Array]:
        """x' and x'' (n,)."""
        laws = [law(np.array([t])) for law in self.laws]
        v = self._solve(x, self.rows.rates(laws))
        return v, self._solve(x, self.rows.biases(self._instant(x), dict(enumerate(columns(v[None]))), laws))

    def close(self, t: float, x: Array) -> Array:
        """The position at t near a prediction.

        Raises:
            Unsolved: Newton's method leads elsewhere.
        """
        start, laws = x, [law(np.array([t])) for law in self.laws]
        for _ in range(NEWTON_STEPS):
            step = self._solve(x, self.rows.residuals(self._instant(x), laws))
            x = x - step
            if not np.abs((x - start) * self.unit).max() < FORESEEN:
                break
            if np.abs(step * self.unit).max() < CLOSED:
                return x
        raise Unsolved("the prediction is too far off")

    def crosses(self, x: Array, y: Array) -> bool:
        """Tell whether one of the pivots that are best at x changes its sign on the way to y, or all vanish.

        Their product, the determinant, would not do: two loops that are singular at once leave its sign as it was.
        """
        chart, best = choose_chart(self.rows, self._instant(x), self.scale)
        if len(chart.order) < len(x) or best.smallest < SINGULAR:
            return True
        signs = []
        for place in (x, y):
            pivots = factorise(self.rows.entries(self._instant(place)), chart.order).pivots
            signs.append(np.sign(stack_arrays(pivots, np.zeros(1))))
        return bool((signs[0] != signs[1]).any())


def follow(closures: Closures, times: Array, x: Array) -> Iterator[Array]:
    """Positions (n,) at the times, on the branch that x (n,) at the first of them lies on.

    Raises:
        Unsolved: the branch ends, or becomes singular.
    """
    t = float(times[0])
    for end in times:
        step = whole = float(end) - t
        while t < end:
            reached = end if t + step >= end else t + step
            try:
                v, a = closures.rates(t, x)
                h = reached - t
                closed = closures.close(reached, x + h * (v + h / 2 * a))
                crossed = closures.crosses(x, closed)
            except (Unsolved, np.linalg.LinAlgError):
                crossed = True
            if not crossed:
                t, x, step = float(reached), closed, 2 * step
            elif step < SHORTEST * whole:
                raise Unsolved(f"the driven linkage is singular, or at a limit of its motion, at t = {t:.6g} s")
            else:
                step /= 2
        yield x


def driven_states(
    rows: LoopRows, double: LoopRows, chart: Chart, x: Long, times: Sequence[str], number: Number, progress: Progress | None
) -> tuple[LoopStates, str]:
    """States at the times up to where the branch ends, and why it ends there; `double` are the rows in double precision."""
    path: list[Array] = []
    stopped = ""
    t = np.array([number(text) for text in times])
    try:
        for now, place in zip(times, follow(Closures(double, chart), t.astype(float), x[0].astype(float)), strict=True):
            path.append(place)
            if progress:
                progress(float(now))
    except Unsolved as error:
        stopped = str(error)
        if not path:
            raise
    return _refine(rows, np.array(path), t[: len(path)], number), stopped


def _refine(rows: LoopRows, path: Array, t: Long, number: Number) -> LoopStates:
    """The states at times t (k,) of positions (k, n) in double precision, to the last digit."""
    like, eps, n = t - t, epsilon(number), rows.coordinates.n
    laws: list[Any] = [driver.law(t) for driver in rows.coordinates.mechanism.drivers]
    x = path + like[:, None]

    def instant(x: Long) -> Instant:
        return Instant(columns(x), NUMBERS)

    P = pseudo_inverse(dense(rows.entries(instant(x)), len(t), n))
    x = correct(lambda y: stack_arrays(rows.residuals(instant(y), laws), like), P, x, eps)
    at = instant(x)
    A, rates = rows.entries(at), stack_arrays(rows.rates(laws), like)
    v = correct(lambda y: apply(A, y) - rates, P, np.zeros_like(x), eps)
    gamma = stack_arrays(rows.biases(at, dict(enumerate(columns(v))), laws), like)
    return LoopStates(t, x, v, correct(lambda y: apply(A, y) - gamma, P, np.zeros_like(x), eps))
