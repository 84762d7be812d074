"""Integration from chart to chart, each with the order of pivots that is good where the motion is.

After every step the pivots of the equations are looked at. When one has become small another order takes over: the chart changes,
the motion does not. No pivot is ever stepped over: where one changes its sign within a step, that step is taken back and halved, so
that a singular position, where no order has usable pivots, ends the motion even if the series would continue it analytically. What
happens beyond is not determined by the equations: two branches cross there.
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
from gauss_bench.reference.taylor.solve import Long, columns, epsilon, stack_arrays

WORN = 0.1  # a pivot below, in units of its coordinate, calls for another order
WEAKER = 0.5  # where no order does better: the next call comes when the smallest pivot has halved again
GOOD_ENOUGH = 0.7  # of the best chart's smallest pivot: rather one that is compiled already
SINGULAR = 1e-5  # costs five digits of thirty-three
COLLAPSED = 1e-7  # of the longest step: something not seen by the pivots is singular
PARTS = 4  # places within a step at which the pivots are looked at


class Leg(NamedTuple):
    """A part of the motion within one chart, up to t.

    `worn` tells that a pivot became too small there, and `stopped` why the motion cannot go on at all, or is empty.
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
        number: the type of number; times: of the samples [s], from 0.
        built: those made so far, by order of pivots and number of the piece.
        steps, longest: how many steps of the Taylor series were taken, and the longest that was tried [s].
    """

    rows: LoopRows
    number: Number
    pieces: Sequence[Piece]
    times: Sequence[Any]
    progress: Progress | None
    built: dict[tuple[Order, int], CompiledSeries] = field(default_factory=dict)
    steps: int = 0
    longest: float = 0.0

    def run(self, chart: Chart, x: Long, v: Long) -> tuple[LoopStates, str]:
        """States at the sample times from a start (1, n), and why they end before the last of them, or empty.

        Raises:
            Unsolved: a position does not close where the chart changes.
        """
        t, state, trust = self.times[0], np.concatenate([x[0], v[0, list(chart.free)]]), WORN
        parts = [self._states(chart, [(t, state)])]
        for k, piece in enumerate(self.pieces):
            end = self.times[-1] if piece.end is None else min(piece.end, self.times[-1])
            while t < end:
                leg = self._leg(self._series(chart, k), t, state, end, trust)
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
                    # a chart keeps only independent rows; what has gathered in the others would be multiplied at every change
                    closed = self.rows.close(here.x, self.rows.laws(here.t), epsilon(self.number))
                    state = np.concatenate([closed[0], here.v[0, list(fresh.free)]])
                    chart, trust = fresh, min(WORN, WEAKER * pivots.smallest)
        return join(parts), ""

    def _other_chart(self, chart: Chart, k: int, state: Long) -> tuple[Chart, Pivots]:
        """A better chart at a state, one that is compiled already if it is good enough."""
        x = state[: self.rows.coordinates.n]
        fresh, best = choose_chart(self.rows, at_states(x[None]), chart.scale)
        for (order, piece), series in self.built.items():
            smallest = float(np.abs(series.pivots(state)).min())
            if piece == k and smallest > GOOD_ENOUGH * best.smallest:
                return series.chart, best._replace(order=order, smallest=smallest)
        return fresh, best

    def _leg(self, series: CompiledSeries, t: Any, state: Long, end: Any, trust: float) -> Leg:
        """Steps from a state until the end, or until a pivot is smaller than `trust`.

        A step in which a pivot changes its sign is taken back and halved, so that none is jumped over.
        """
        samples: list[tuple[Any, Long]] = []
        ahead = [x for x in self.times if x > t]
        signs = np.sign(series.pivots(state))
        begin, limit = t, end - t
        while True:
            h = series.step(t, state, limit)
            if h is None:
                return Leg(t, state, samples, False, f"the Taylor series ceases to be finite after t = {float(t):.6g} s")
            self.longest = max(self.longest, float(h))
            now = end if t + h >= end else t + h
            pivots = np.array([series.pivots(series.at(t + h * part / PARTS)) for part in range(1, PARTS + 1)])
            if (np.sign(pivots) != signs).any():
                limit = h / 2
                if float(limit) > COLLAPSED * self.longest:
                    continue
                text = f"the position at t = {float(t):.6g} s is singular: a pivot of the loops vanishes in every chart"
                return Leg(t, state, samples, True, "" if t > begin else text)
            while ahead and ahead[0] <= now:
                samples.append((ahead[0], series.at(ahead.pop(0))))
            t, state, limit = now, series.at(now), end - now
            self.steps += 1
            if self.progress:
                self.progress(float(now))
            if now == end:
                return Leg(end, state, samples, False, "")
            if np.abs(pivots).min() < trust:
                return Leg(now, state, samples, True, "")
            if float(h) < COLLAPSED * self.longest:
                where = f"the steps of the Taylor series collapse at t = {float(now):.6g} s"
                text = f"{where}: the motion is singular there{'' if series.chart.free else ', or at a limit of its motion'}"
                return Leg(now, state, samples, False, text)

    def _series(self, chart: Chart, k: int) -> CompiledSeries:
        key = (chart.order, k)
        if key not in self.built:
            self.built[key] = compile_series(self.rows, chart, self.pieces[k], self.number)
        return self.built[key]

    def _states(self, chart: Chart, samples: list[tuple[Any, Long]]) -> LoopStates:
        """Full coordinates and rates at times within one chart; where a law has a corner the law itself says which side counts."""
        n = self.rows.coordinates.n
        t, y = np.array([x for x, _ in samples]), np.array([x for _, x in samples])
        motion = rates(self.rows, chart, at_states(y[:, :n]), columns(y[:, n:]), self.rows.laws(t))
        v, a = (stack_arrays([x.get(j, 0) for j in range(n)], t - t) for x in (motion.velocity, motion.acceleration))
        return LoopStates(t, y[:, :n], v, a)

    def _singular(self, t: float, pivots: Pivots) -> str:
        return (
            f"the position at t = {t:.6g} s is singular: the rows of {self.rows.names[pivots.weakest]} depend on the others "
            f"(pivot {pivots.smallest:.1e})"
        )
