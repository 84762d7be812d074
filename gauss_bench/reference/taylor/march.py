"""Integration by Taylor series from chart to chart.

A chart is a choice of free coordinates. The other coordinates are eliminated from the constraint rows in an order of pivots that is
good at the present position. After every step the pivots of the equations are computed. If one has become small, another order is
chosen: the chart changes, but not the motion. If a pivot changes its sign within a step, that step is repeated with half the
length. A singular position, at which no order has usable pivots, therefore ends the motion, even if the series would continue it
analytically: two branches cross there, and the equations do not determine on which of them the motion goes on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.motion import Progress
from gauss_bench.reference.taylor.compiled import CompiledSeries, compile_series
from gauss_bench.reference.taylor.elimination import Order, Pivots
from gauss_bench.reference.taylor.equations import Chart, choose_chart, rates
from gauss_bench.reference.taylor.law_pieces import Piece
from gauss_bench.reference.taylor.moving_vectors import at_states
from gauss_bench.reference.taylor.rows import LoopRows
from gauss_bench.reference.taylor.samples import LoopStates, join
from gauss_bench.reference.taylor.solve import Long, epsilon, split_columns, stack_arrays

WORN = 0.1  # size of a pivot, in units of its coordinate, below which another order is chosen
WEAKER = 0.5  # if the best order has smaller pivots, the next order is chosen when its smallest pivot has halved
GOOD_ENOUGH = 0.7  # smallest pivot relative to the best chart's, with which a chart is used if it is compiled already
SINGULAR = 1e-5  # size of a pivot that costs five of thirty-three digits
COLLAPSED = 1e-7  # length relative to the longest step: shorter steps show a singularity that is not in the pivots
PARTS = 4  # number of times within a step at which the pivots are computed


class Leg(NamedTuple):
    """A part of the motion within one chart, a choice of free coordinates.

    Attributes:
        t, state: time [s] and state at its end.
        samples: (time, state) of the samples in it.
        worn: whether a pivot became too small at its end.
        stopped: the reason why the motion cannot go on, or empty.
    """

    t: Any
    state: Long
    samples: list[tuple[Any, Long]]
    worn: bool
    stopped: str


@dataclass(eq=False)
class March:
    """Integrates a motion from chart to chart and from piece to piece of the motion laws.

    Attributes:
        number: type of number.
        pieces: the pieces of the motion laws.
        times: times of the samples [s], from 0.
        progress: called with the time reached [s], or None.
        compiled: (order of pivots, index of the piece) -> series compiled so far.
        steps, longest: number of steps of the Taylor series so far, and the longest that was tried [s].
    """

    rows: LoopRows
    number: Number
    pieces: Sequence[Piece]
    times: Sequence[Any]
    progress: Progress | None
    compiled: dict[tuple[Order, int], CompiledSeries] = field(default_factory=dict)
    steps: int = 0
    longest: float = 0.0

    def run(self, chart: Chart, x: Long, v: Long) -> tuple[LoopStates, str]:
        """Return the states at the sample times from a start x, v (1, n), and the reason for an early end or an empty text.

        The motion is integrated in one chart until one of its pivots is smaller than `least_pivot`; then in a better chart.

        Raises:
            Unsolved: the loops cannot be closed at a position where the chart changes.
        """
        t, state = self.times[0], np.concatenate([x[0], v[0, list(chart.free)]])
        least_pivot = WORN  # a chart with a smaller pivot is changed
        parts = [self._states(chart, [(t, state)])]
        for k, piece in enumerate(self.pieces):
            end = self.times[-1] if piece.end is None else min(piece.end, self.times[-1])
            while t < end:
                leg = self._leg(self._series(chart, k), t, state, end, least_pivot)
                t, state = leg.t, leg.state
                if leg.samples:
                    parts.append(self._states(chart, leg.samples))
                if leg.stopped:
                    return join(parts), leg.stopped
                if leg.worn:
                    fresh, pivots = self._other_chart(chart, k, state)
                    if len(pivots.order) != len(chart.order) or pivots.smallest < SINGULAR:
                        return join(parts), self._singular(float(t), pivots)
                    here = self._states(chart, [(t, state)])
                    # a chart satisfies only independent rows, and errors in the others would grow at every change of the chart
                    closed = self.rows.close(here.x, self.rows.laws(here.t), epsilon(self.number))
                    state = np.concatenate([closed[0], here.v[0, list(fresh.free)]])
                    chart, least_pivot = fresh, min(WORN, WEAKER * pivots.smallest)
        return join(parts), ""

    def _other_chart(self, chart: Chart, k: int, state: Long) -> tuple[Chart, Pivots]:
        """Return a better chart at a state within piece k, and its pivots; one that is compiled already if it is good enough."""
        x = state[: self.rows.coordinates.n]
        fresh, best = choose_chart(self.rows, at_states(x[None]), chart.scale)
        for (order, piece), series in self.compiled.items():
            smallest = float(np.abs(series.pivots(state)).min())
            if piece == k and smallest > GOOD_ENOUGH * best.smallest:
                return series.chart, best._replace(order=order, smallest=smallest)
        return fresh, best

    def _leg(self, series: CompiledSeries, t: Any, state: Long, end: Any, least_pivot: float) -> Leg:
        """Take steps from a state at time t until the time `end` [s], or until a pivot is smaller than `least_pivot`.

        A step in which a pivot changes its sign is repeated with half the length, so that no pivot passes zero.
        """
        samples: list[tuple[Any, Long]] = []
        ahead = [x for x in self.times if x > t]
        signs = np.sign(series.pivots(state))
        begin, limit = t, end - t
        while True:
            h = series.step(t, state, limit)
            if h is None:
                text = f"the Taylor series ceases to be finite after t = {float(t):.6g} s"
                return Leg(t, state, samples, worn=False, stopped=text)
            self.longest = max(self.longest, float(h))
            now = end if t + h >= end else t + h
            pivots = np.array([series.pivots(series.at(t + h * part / PARTS)) for part in range(1, PARTS + 1)])
            if (np.sign(pivots) != signs).any():
                limit = h / 2
                if float(limit) > COLLAPSED * self.longest:
                    continue
                text = f"the position at t = {float(t):.6g} s is singular: a pivot of the loops vanishes in every chart"
                # after some steps another chart may help; at the beginning of a leg the chart is fresh, so that none would
                return Leg(t, state, samples, worn=True, stopped="" if t > begin else text)
            while ahead and ahead[0] <= now:
                samples.append((ahead[0], series.at(ahead.pop(0))))
            t, state, limit = now, series.at(now), end - now
            self.steps += 1
            if self.progress:
                self.progress(float(now))
            if now == end:
                return Leg(end, state, samples, worn=False, stopped="")
            if np.abs(pivots).min() < least_pivot:
                return Leg(now, state, samples, worn=True, stopped="")
            if float(h) < COLLAPSED * self.longest:
                where = f"the steps of the Taylor series collapse at t = {float(now):.6g} s"
                text = f"{where}: the motion is singular there{'' if series.chart.free else ', or at a limit of its motion'}"
                return Leg(now, state, samples, worn=False, stopped=text)

    def _series(self, chart: Chart, k: int) -> CompiledSeries:
        """Return the compiled Taylor series of a chart within piece k of the motion laws."""
        key = (chart.order, k)
        if key not in self.compiled:
            self.compiled[key] = compile_series(self.rows, chart, self.pieces[k], self.number)
        return self.compiled[key]

    def _states(self, chart: Chart, samples: list[tuple[Any, Long]]) -> LoopStates:
        """Return all coordinates and their rates at samples (time, state) within one chart, whose states have the free rates only.

        Drivers are evaluated by the motion laws themselves, and not by the formulas that the compiled series has for them.
        """
        n = self.rows.coordinates.n
        t, y = np.array([time for time, _ in samples]), np.array([state for _, state in samples])
        positions, free_rates = y[:, :n], y[:, n:]
        motion = rates(self.rows, chart, at_states(positions), split_columns(free_rates), self.rows.laws(t))
        zero = t - t  # (k,) zeros in the number type of the times
        levels = motion.velocity, motion.acceleration  # each coordinate -> value
        v, a = (stack_arrays([by_coordinate.get(j, 0) for j in range(n)], zero) for by_coordinate in levels)
        return LoopStates(t, positions, v, a)

    def _singular(self, t: float, pivots: Pivots) -> str:
        """Return the reason for an end at a singular position."""
        return (
            f"the position at t = {t:.6g} s is singular: the rows of {self.rows.names[pivots.weakest]} depend on the others "
            f"(pivot {pivots.smallest:.1e})"
        )
