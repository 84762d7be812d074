"""The first computation of a certificate: Taylor series in 128-bit numbers, of the equations of motion in loop coordinates.

The library heyoka expands the solution in a Taylor series of order 40, with steps so short that the last terms are below rounding.

A chart is a choice of free coordinates: the others are eliminated from the constraint rows in an order of pivots that is good at
the present position. If a pivot has become small after a step, another chart is chosen. If a pivot changes its sign within a step,
that step is repeated with half the length. At a singular position no order has pivots that are large enough. The motion ends there,
even if the series could continue it: two branches of the motion cross there, and the equations do not determine which is followed.
Sources: Biscani and Izzo, Monthly Notices of the Royal Astronomical Society 504 (2021), on heyoka; Jorba and Zou, Experimental
Mathematics 14 (2005), on orders and steps.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.motion import Motion, Progress, assemble_doubles
from gauss_bench.reference.taylor.arithmetic import Long, epsilon, stack_arrays
from gauss_bench.reference.taylor.compiled import CompiledSeries
from gauss_bench.reference.taylor.elimination import Order, Pivots
from gauss_bench.reference.taylor.equations import Chart, choose_chart, rates
from gauss_bench.reference.taylor.law_pieces import Piece, cut_pieces
from gauss_bench.reference.taylor.rows import LoopRows, loop_rows, start_state
from gauss_bench.reference.taylor.samples import LoopStates, sample
from gauss_bench.reference.taylor.vector_sums import LoopCoordinates, at_states

WORN = 0.1  # size of a pivot, relative to the scale of its coordinate, below which another chart is chosen
WEAKER = 0.5  # if the best chart has smaller pivots, the next chart is chosen when its smallest pivot has halved
GOOD_ENOUGH = 0.7  # a compiled chart is preferred if its smallest pivot is larger than this share of the best chart's
SINGULAR = 1e-5  # size of a pivot below which a position counts as singular: it costs five of thirty-three digits
COLLAPSED = 1e-7  # length relative to the longest step: shorter steps show a singularity that is not in the pivots
PARTS = 4  # number of times within a step at which the pivots are computed


def taylor_motion(
    document: dict[str, Any], scenario: str, times: Sequence[str], double: bool = False, progress: Progress | None = None
) -> Motion:
    """Return the motion at the sample times; it ends earlier if it cannot be continued, such as at a singular position.

    Args:
        document: the linkage file with decimals kept as text, after the scenario's `override` has been merged into it.
        times: sample times as decimal texts [s], ascending from "0".
        double: whether to compute in double precision instead of in 128-bit numbers.
        progress: called with the time reached [s].

    Raises:
        AssemblyError: the linkage cannot be assembled.
        ArithmeticError: dry friction acts, the start is singular, or the result does not satisfy the equations.
    """
    import heyoka

    number: Number = float if double else heyoka.real128
    mechanism = build_mechanism(document, scenario, "", "", number)
    if mechanism.has_friction:
        raise ArithmeticError("dry friction acts: its loads are found by iteration in double precision, which certifies nothing")
    rows = loop_rows(LoopCoordinates(mechanism))
    chosen = document["scenarios"][scenario]
    x, v = start_state(rows, chosen, rows.coordinates.start(assemble_doubles(document, scenario).q0), number)
    chart, pivots = choose_chart(rows, at_states(x))
    if pivots.smallest < SINGULAR:
        raise ArithmeticError(f"the start is a singular position: smallest pivot {pivots.smallest:.1e}")
    redundant = rows.m - len(chart.order) + len(rows.coordinates.turn_gaps)
    moments = [number(t) for t in times]
    march = March(rows, number, cut_pieces(mechanism.drivers, chosen, number), moments, progress)
    states, stopped = march.run(chart, x, v)
    bits, counts = 1 - int(np.log2(epsilon(number))), f"steps: {march.steps}, charts: {len(march.compiled)}"
    method = f"loop coordinates in {bits} bits; Taylor series ({counts}); heyoka {heyoka.__version__}"
    return sample(rows, states, times[: len(states.t)], redundant, stopped, method, number)


class Leg(NamedTuple):
    """A part of the motion that is integrated in one chart.

    Attributes:
        t, state: time [s] and state at the end of this part; a state has all coordinates, and the speeds of the free ones.
        samples: (time, state) of every sample within this part.
        worn: whether a pivot became too small at the end, so that the chart must be changed.
        stopped: the reason why the motion cannot go on after this part, or empty.
    """

    t: Any
    state: Long
    samples: list[tuple[Any, Long]]
    worn: bool = False
    stopped: str = ""


class March:
    """Integrates a motion by Taylor series, and changes the chart (the choice of free coordinates) where necessary.

    Attributes:
        pieces: intervals of time within which all motion laws of the drivers are smooth.
        times: times of the samples [s], from 0.
        compiled: (order of pivots of a chart, index of the piece) -> code that was compiled for them.
        longest: length of the longest step so far, repeated steps included [s].
    """

    def __init__(
        self, rows: LoopRows, number: Number, pieces: Sequence[Piece], times: Sequence[Any], progress: Progress | None
    ) -> None:
        """Prepare to integrate the equations of the rows, in a type of number."""
        self.rows, self.number, self.pieces, self.times, self.progress = rows, number, pieces, times, progress
        self.compiled: dict[tuple[Order, int], CompiledSeries] = {}
        self.steps, self.longest = 0, 0.0

    def run(self, chart: Chart, x: Long, v: Long) -> tuple[LoopStates, str]:
        """Integrate the motion from a start x, v (1, n); return the states at the sample times, and why the motion ends early.

        The second result is empty if the motion reaches the last sample time.

        Raises:
            Unsolved: the loops cannot be closed at a position where the chart changes.
        """
        t, state = self.times[0], np.concatenate([x[0], v[0, list(chart.free)]])
        least_pivot, stopped = WORN, ""  # if a pivot is smaller than `least_pivot`, the chart is changed
        parts = [self._states_of(chart, [(t, state)])]
        for k, piece in enumerate(self.pieces):
            end = self.times[-1] if piece.end is None else min(piece.end, self.times[-1])
            while t < end and not stopped:
                key = (chart.order, k)
                if key not in self.compiled:
                    self.compiled[key] = CompiledSeries(self.rows, chart, piece, self.number)
                t, state, samples, worn, stopped = self._integrate_leg(self.compiled[key], t, state, end, least_pivot)
                if samples:
                    parts.append(self._states_of(chart, samples))
                if worn and not stopped:
                    new_chart, pivots = self._change_chart(chart, k, state)
                    if len(pivots.order) != len(chart.order) or pivots.smallest < SINGULAR:
                        depends = f"the rows of {self.rows.names[pivots.weakest]} depend on the others"
                        stopped = f"the position at t = {float(t):.6g} s is singular: {depends} (pivot {pivots.smallest:.1e})"
                        break
                    last = self._states_of(chart, [(t, state)])
                    # a chart satisfies only independent rows, and errors in the others would grow at every change of the chart
                    closed = self.rows.close(last.x, self.rows.laws(last.t), epsilon(self.number))
                    state = np.concatenate([closed[0], last.v[0, list(new_chart.free)]])
                    chart, least_pivot = new_chart, min(WORN, WEAKER * pivots.smallest)
        return LoopStates(*(np.concatenate([getattr(part, level) for part in parts]) for level in "txva")), stopped

    def _change_chart(self, chart: Chart, k: int, state: Long) -> tuple[Chart, Pivots]:
        """Return a better chart at a state within piece k of the motion laws, and its pivots.

        A chart that is compiled already is preferred if its smallest pivot is larger than GOOD_ENOUGH times that of the best chart.
        """
        x = state[: self.rows.coordinates.n]
        best_chart, best = choose_chart(self.rows, at_states(x[None]), chart.scale)
        for (order, piece), series in self.compiled.items():
            smallest = float(np.abs(series.pivots(state)).min())
            if piece == k and smallest > GOOD_ENOUGH * best.smallest:
                return series.chart, best._replace(order=order, smallest=smallest)
        return best_chart, best

    def _integrate_leg(self, series: CompiledSeries, t: Any, state: Long, end: Any, least_pivot: float) -> Leg:
        """Integrate in one chart from a state at time t up to `end` [s], or to the first step with a pivot below `least_pivot`.

        A step in which a pivot changes its sign is repeated with half the length, so that no pivot passes zero. The motion stops if
        the series is not finite, if steps become extremely short, or if a pivot vanishes at the beginning of this part.
        """
        samples: list[tuple[Any, Long]] = []
        ahead = [x for x in self.times if x > t]  # sample times that are not reached yet
        signs = np.sign(series.pivots(state))
        begin, limit = t, end - t
        while True:
            h = series.step(t, state, limit)
            if h is None:
                return Leg(t, state, samples, stopped=f"the Taylor series is not finite after t = {float(t):.6g} s")
            self.longest = max(self.longest, float(h))
            now = end if t + h >= end else t + h
            pivots = np.array([series.pivots(series.at(t + h * part / PARTS)) for part in range(1, PARTS + 1)])
            if (np.sign(pivots) != signs).any():
                limit = h / 2
                if float(limit) > COLLAPSED * self.longest:
                    continue
                text = f"the position at t = {float(t):.6g} s is singular: a pivot of the loops vanishes in every chart"
                # after some steps another chart may help; at the beginning of a leg the chart is new, and no other would help
                return Leg(t, state, samples, worn=True, stopped="" if t > begin else text)
            while ahead and ahead[0] <= now:
                samples.append((ahead[0], series.at(ahead.pop(0))))
            t, state, limit = now, series.at(now), end - now
            self.steps += 1
            if self.progress:
                self.progress(float(now))
            if now == end or np.abs(pivots).min() < least_pivot:
                return Leg(now, state, samples, worn=now != end)
            if float(h) < COLLAPSED * self.longest:
                where = f"the steps of the Taylor series collapse at t = {float(now):.6g} s"
                text = f"{where}: the motion is singular there{'' if series.chart.free else ', or at a limit of its motion'}"
                return Leg(now, state, samples, stopped=text)

    def _states_of(self, chart: Chart, samples: list[tuple[Any, Long]]) -> LoopStates:
        """Return positions, velocities and accelerations of all coordinates at samples (time, state) of one chart.

        The values that drivers prescribe are computed by the motion laws themselves, and not by the formulas of the compiled code.
        """
        n = self.rows.coordinates.n
        t, y = np.array([time for time, _ in samples]), np.array([state for _, state in samples])
        motion = rates(self.rows, chart, at_states(y[:, :n]), list(y[:, n:].T), self.rows.laws(t))
        zero = t - t  # (k,) zeros in the number type of the times
        levels = motion.velocity, motion.acceleration  # each coordinate -> value
        v, a = (stack_arrays([by_coordinate.get(j, 0) for j in range(n)], zero) for by_coordinate in levels)
        return LoopStates(t, y[:, :n], v, a)
