"""Integration by Taylor series in one choice of free coordinates (chart) after the other.

A chart is a choice of free (independent) coordinates. The dependent coordinates are eliminated from the constraint rows in an order
of pivots that is good at the present position. After every step the pivots of the equations are computed. If a pivot has become
small, another order of pivots is chosen, and with it another set of free coordinates: the chart changes, but not the motion. If a
pivot changes its sign within a step, that step is repeated with half the length.

At a singular position no order of elimination has pivots that are large enough. The motion ends there, even if the Taylor series
could continue it: two branches of the motion cross, and the equations do not determine which of them the motion follows.
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
    """A part of the motion that is integrated in one chart, that is, with one choice of free coordinates.

    Attributes:
        t, state: time [s] and state at the end of this part; a state has all coordinates, and the speeds of the free ones.
        samples: (time, state) of every sample within this part.
        worn: whether a pivot became too small at the end of this part, so that the chart must be changed.
        stopped: the reason why the motion cannot go on after this part, or empty.
    """

    t: Any
    state: Long
    samples: list[tuple[Any, Long]]
    worn: bool
    stopped: str


@dataclass(eq=False)
class March:
    """Integrates a motion by Taylor series, and changes the chart (the choice of free coordinates) where necessary.

    Attributes:
        rows: the constraint rows of the linkage.
        number: type of number of the computation.
        pieces: intervals of time within which all motion laws of the drivers are smooth.
        times: times of the samples [s], from 0.
        progress: called with the time reached [s], or None.
        compiled: (order of pivots of a chart, index of the piece) -> code of the Taylor series that was compiled for them.
        steps: number of steps of the Taylor series so far.
        longest: length of the longest step so far, repeated steps included [s].
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
        """Integrate the motion from a start x, v (1, n); return the states at the sample times, and why the motion ends early.

        The second result is empty if the motion reaches the last sample time. The motion is integrated with one choice of free
        coordinates (chart) until a pivot of its elimination is smaller than `least_pivot`, and then with a better choice. Whenever
        another choice is made, the loops are closed again.

        Raises:
            Unsolved: the loops cannot be closed at a position where the chart changes.
        """
        t, state = self.times[0], np.concatenate([x[0], v[0, list(chart.free)]])
        least_pivot = WORN  # if a pivot is smaller, the chart is changed
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
        """Return a better chart (choice of free coordinates) at a state within time interval k, and the pivots of this chart.

        The best chart is replaced by one that is already compiled for this piece, if the smallest pivot of the compiled chart is
        larger than GOOD_ENOUGH times that of the best chart.
        """
        x = state[: self.rows.coordinates.n]
        fresh, best = choose_chart(self.rows, at_states(x[None]), chart.scale)
        for (order, piece), series in self.compiled.items():
            smallest = float(np.abs(series.pivots(state)).min())
            if piece == k and smallest > GOOD_ENOUGH * best.smallest:
                return series.chart, best._replace(order=order, smallest=smallest)
        return fresh, best

    def _leg(self, series: CompiledSeries, t: Any, state: Long, end: Any, least_pivot: float) -> Leg:
        """Integrate with one choice of free coordinates (chart) from a state at time t up to `end` [s], while all pivots are large.

        The integration ends at `end`, or after the first step with a pivot smaller than `least_pivot`; then `worn` is true.

        A step in which a pivot changes its sign is repeated with half the length, so that no pivot passes zero. The motion stops if
        the series is not finite, if steps become extremely short, or if a pivot vanishes at the beginning of this part.
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
        """Return the compiled code of the Taylor series for a chart and for time interval k; compile it if necessary."""
        key = (chart.order, k)
        if key not in self.compiled:
            self.compiled[key] = compile_series(self.rows, chart, self.pieces[k], self.number)
        return self.compiled[key]

    def _states(self, chart: Chart, samples: list[tuple[Any, Long]]) -> LoopStates:
        """Return positions, velocities and accelerations of all coordinates at samples (time, state) of one chart.

        A chart is a choice of the free coordinates, whose velocities determine all others. A given state has the positions of all
        coordinates, and the velocities of the free coordinates. The values that drivers prescribe are computed by the motion laws
        themselves, and not by the formulas for these laws in the compiled Taylor series.
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
        """Return the message that the motion ends at a singular position at the time t."""
        return (
            f"the position at t = {t:.6g} s is singular: the rows of {self.rows.names[pivots.weakest]} depend on the others "
            f"(pivot {pivots.smallest:.1e})"
        )
