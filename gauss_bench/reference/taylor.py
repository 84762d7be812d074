"""The first pipeline of a certificate: Taylor series in 128 bit, of the equations of motion in loop coordinates.

heyoka expands the solution to order 40 by automatic differentiation of compiled code, with steps for which the last terms vanish in
rounding. The equations are written as symbols of the state (x, u), with every constant a parameter, so that a linkage with other
numbers runs in the same compiled code. Whenever a pivot of the equations has become small along the motion, another order of pivots
takes over at the end of the step: the chart changes, the motion does not. Where no order is left the position is singular, and
the motion ends there. Source: Biscani and Izzo, Monthly Notices of the Royal Astronomical Society 504 (2021), on heyoka; Jorba and
Zou, Experimental Mathematics 14 (2005), on orders and steps.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.mechanism.build import build_mechanism
from gauss_bench.mechanism.load import load_document
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.arithmetic import NUMBERS, Arithmetic, literal
from gauss_bench.reference.driven_geometry import driven_states
from gauss_bench.reference.driver_pieces import Piece, pieces
from gauss_bench.reference.elimination import Pivots, factorised
from gauss_bench.reference.loop_motion import Chart, choose_chart, rates
from gauss_bench.reference.loop_rows import LoopRows, loop_rows
from gauss_bench.reference.loop_samples import States, joined, sampled
from gauss_bench.reference.loop_solve import Long, columns, corrected, dense, epsilon, pseudo_inverse, stacked
from gauss_bench.reference.loop_start import start_state
from gauss_bench.reference.motion import Motion, Progress
from gauss_bench.reference.moving_vectors import Instant
from gauss_bench.reference.vector_sums import loop_coordinates
from gauss_bench.terms import Array

WORN = 0.1  # a pivot below, in units of its coordinate, calls for another order
WEAKER = 0.5  # where no order does better: the next call comes when the smallest pivot has halved again
GOOD_ENOUGH = 0.7  # of the best chart's smallest pivot: rather one that is compiled already
SINGULAR = 1e-5  # costs five digits of thirty-three
COLLAPSED = 1e-7  # of the longest step: something not seen by the pivots is singular


def taylor_motion(
    document: dict[str, Any], scenario: str, times: Sequence[str], double: bool = False, progress: Progress | None = None
) -> Motion:
    """The motion at the sample times, up to where it has to stop.

    Args:
        document: with decimals as written (`decimal_document`) and the scenario's override merged.
        times: decimal texts [s], ascending from "0".
        double: in double precision instead of 128 bit, to compare neighbouring linkages.
        progress: told the time reached.

    Raises:
        LinkageError: the document has faults.
        ArithmeticError: dry friction acts, the start is singular, or the result does not fulfil the equations.
    """
    import heyoka

    number: Number = float if double else heyoka.real128
    document = {**document, "scenarios": {**document["scenarios"], scenario: _without_override(document, scenario)}}
    assembled = load_document(_floats(document), scenario)
    mechanism = build_mechanism(document, scenario, "", "", number)
    if mechanism.has_friction:
        raise ArithmeticError("dry friction acts: its loads are found by iteration in double precision, which certifies nothing")
    rows = loop_rows(loop_coordinates(mechanism))
    chosen = document["scenarios"][scenario]
    x, v = start_state(rows, chosen, rows.coordinates.start(assembled.q0), number)
    chart = _first_chart(rows, x)
    redundant = rows.m - len(chart.order) + len(rows.coordinates.turn_gaps)
    if not chart.free and not rows.edges:
        twin = loop_rows(loop_coordinates(assembled))
        states, stopped = driven_states(rows, twin, chart, x, times, number, progress)
        way = "Newton's method"
    else:
        march = March(rows, number, pieces(mechanism.drivers, chosen, number), [number(t) for t in times], progress)
        states, stopped = march.run(chart, x, v)
        way = f"Taylor series of order {march.order}, {march.steps} steps in {len(march.built)} charts"
    bits = 1 - int(np.log2(epsilon(number)))
    method = f"loop coordinates in {bits} bits; {way}; heyoka {heyoka.__version__}"
    return sampled(rows, states, times[: len(states.t)], redundant, stopped, method, number)


def _without_override(document: dict[str, Any], scenario: str) -> dict[str, Any]:
    """The scenario without its override, which is merged already and may have been changed since."""
    return {k: v for k, v in document["scenarios"][scenario].items() if k != "override"}


def _floats(item: Any) -> Any:
    """A document with its decimals as doubles."""
    if isinstance(item, dict):
        return {k: _floats(v) for k, v in item.items()}
    if isinstance(item, list):
        return [_floats(v) for v in item]
    return float(item) if isinstance(item, Decimal) else item


def _first_chart(rows: LoopRows, x: Long) -> Chart:
    chart, pivots = choose_chart(rows, Instant(columns(x), NUMBERS))
    if pivots.smallest < SINGULAR:
        raise ArithmeticError(f"the start is a singular position: smallest pivot {pivots.smallest:.1e}")
    return chart


class Constants:
    """The numbers in a set of equations, each as a parameter of the compiled code."""

    def __init__(self) -> None:
        self.values: dict[str, tuple[int, Any]] = {}

    def __call__(self, value: Any) -> Any:
        import heyoka

        index, _ = self.values.setdefault(str(value), (len(self.values), value))
        return heyoka.par[index]

    def list(self, number: Number) -> list[Any]:
        return [number(text) for text in self.values]


def symbols(constants: Constants) -> Arithmetic:
    import heyoka

    return Arithmetic(heyoka.cos, heyoka.sin, heyoka.sqrt, constants)


class Integrator(NamedTuple):
    """Compiled equations of one chart, and what watches its pivots."""

    taylor: Any
    pivots: Any
    parameters: Array
    chart: Chart

    def pivots_at(self, state: Long) -> Array:
        """All pivots in units of the chart's scale, at a state (x, u)."""
        if self.pivots is None:
            return np.full(1, np.inf)
        found = self.pivots(state[: len(self.chart.scale)].astype(float), pars=self.parameters[: self.pivots.nparams])
        return np.asarray(found / self.chart.scale[[c for _, c in self.chart.order]])


def compiled(rows: LoopRows, chart: Chart, piece: Piece, number: Number) -> Integrator:
    """The integrator of a chart within one piece of the motion laws."""
    import heyoka

    n, f = rows.coordinates.n, len(chart.free)
    names = heyoka.make_vars(*[f"x{j:03d}" for j in range(n)], *[f"u{j:03d}" for j in range(f)])
    names = names if isinstance(names, list) else [names]
    constants = Constants()
    arithmetic = symbols(constants)
    at = Instant(names[:n], arithmetic)
    found = rates(rows, chart, at, names[n:], piece.laws(heyoka.time, arithmetic))
    right = [found.velocity.get(j, 0) for j in range(n)] + found.free
    system = [(name, heyoka.expression(0.0) + value) for name, value in zip(names, right, strict=True)]
    zeros = [number("0")] * len(system)
    taylor = heyoka.taylor_adaptive(system, zeros, fp_type=number, compact_mode=True)
    taylor.pars[:] = constants.list(number)[: len(taylor.pars)]
    watched = Constants()
    seen = factorised(rows.entries(Instant(names[:n], symbols(watched))), chart.order)
    pivots = [heyoka.expression(0.0) + x for x in seen.pivots]
    watch = heyoka.cfunc(pivots, vars=names[:n], compact_mode=True) if pivots else None
    return Integrator(taylor, watch, np.array(watched.list(float)), chart)



class Leg(NamedTuple):
    """A part of the motion within one chart: where it ended, samples on the way, and whether a pivot is worn or all is over."""

    t: Any
    state: Long
    samples: list[tuple[Any, Long]]
    worn: bool
    stopped: str


@dataclass
class March:
    """Integrates a motion from chart to chart and from piece to piece of the motion laws.

    Attributes:
        built: integrators by order of pivots and piece.
        order, steps, longest: of the Taylor series; how many steps were taken, and the longest [s].
    """

    rows: LoopRows
    number: Number
    pieces: Sequence[Piece]
    times: Sequence[Any]
    progress: Progress | None
    built: dict[tuple[Any, int], Integrator] = field(default_factory=dict)
    order: int = 0
    steps: int = 0
    longest: float = 0.0

    def run(self, chart: Chart, x: Long, v: Long) -> tuple[States, str]:
        """States at the sample times from a start (1, n), and why they end before the last of them, or empty."""
        t, state, trust = self.times[0], np.concatenate([x[0], v[0, list(chart.free)]]), WORN
        parts = [self._states(chart, self.pieces[0], [(t, state)])]
        for k, piece in enumerate(self.pieces):
            end = self.times[-1] if piece.end is None else min(piece.end, self.times[-1])
            while t < end:
                leg = self._leg(self._integrator(chart, k), t, state, end, trust)
                t, state = leg.t, leg.state
                if leg.samples:
                    parts.append(self._states(chart, piece, leg.samples))
                if leg.stopped:
                    return joined(parts), leg.stopped
                if leg.worn:
                    fresh, pivots = self._other_chart(chart, k, state)
                    if len(pivots.order) < len(chart.order) or pivots.smallest < SINGULAR:
                        return joined(parts), self._singular(float(t), pivots)
                    here = self._states(chart, piece, [(t, state)])
                    state = np.concatenate([self._closed(here)[0], here.v[0, list(fresh.free)]])
                    chart, trust = fresh, min(WORN, WEAKER * pivots.smallest)
        return joined(parts), ""

    def _closed(self, here: States) -> Long:
        """The position (1, n) with all rows closed to the last digit.

        A chart keeps only as many rows as are independent. What has gathered in the others would be multiplied at every change.
        """
        n, edges = self.rows.coordinates.n, [0] * len(self.rows.edges)
        laws = [driver.law(here.t) for driver in self.rows.coordinates.mechanism.drivers]

        def instant(x: Long) -> Instant:
            return Instant(columns(x), NUMBERS)

        def residual(x: Long) -> Long:
            return stacked([*self.rows.residuals(instant(x), laws), *edges], here.t)

        P = pseudo_inverse(dense(self.rows.entries(instant(here.x)), 1, n))
        return corrected(residual, P, here.x, epsilon(self.number))

    def _other_chart(self, chart: Chart, k: int, state: Long) -> tuple[Chart, Pivots]:
        """A better chart at a state, one that is compiled already if it is good enough."""
        x = state[: self.rows.coordinates.n]
        fresh, best = choose_chart(self.rows, Instant(columns(x[None]), NUMBERS), chart.scale)
        for (_, piece), integrator in self.built.items():
            smallest = float(np.abs(integrator.pivots_at(state)).min())
            if piece == k and smallest > GOOD_ENOUGH * best.smallest:
                return integrator.chart, best._replace(order=integrator.chart.order, smallest=smallest)
        return fresh, best

    def _leg(self, integrator: Integrator, t: Any, state: Long, end: Any, trust: float) -> Leg:
        """Steps from a state until the end, or until a pivot is smaller than `trust`.

        A step in which a pivot changes its sign is taken back and halved, so that none is jumped over.
        """
        import heyoka

        taylor = integrator.taylor
        samples: list[tuple[Any, Long]] = []
        ahead = [x for x in self.times if x > t]
        signs = np.sign(integrator.pivots_at(state))
        limit = end - t
        while True:
            taylor.time, taylor.state[:] = t, state
            outcome, h = taylor.step(limit, write_tc=True)
            if outcome not in (heyoka.taylor_outcome.success, heyoka.taylor_outcome.time_limit):
                return Leg(t, state, samples, False, f"the Taylor series ceases to be finite after t = {float(t):.6g} s")
            now = end if t + h >= end else t + h
            pivots = np.array([integrator.pivots_at(taylor.update_d_output(t + h * part / 4)) for part in (1, 2, 3, 4)])
            if (np.sign(pivots) != signs).any():
                limit = h / 2
                if float(limit) < COLLAPSED * max(self.longest, float(h)):
                    return Leg(t, state, samples, True, "")
                continue
            while ahead and ahead[0] <= now:
                samples.append((ahead[0], taylor.update_d_output(ahead.pop(0)).copy()))
            t, state, limit = now, taylor.state.copy(), end - now
            self.steps += 1
            if self.progress:
                self.progress(float(now))
            if now == end:
                return Leg(end, state, samples, False, "")
            if np.abs(pivots).min() < trust:
                return Leg(now, state, samples, True, "")
            self.longest = max(self.longest, float(h))
            if float(h) < COLLAPSED * self.longest:
                text = f"the steps of the Taylor series collapse at t = {float(now):.6g} s: the motion is singular there"
                return Leg(now, state, samples, False, text)

    def _integrator(self, chart: Chart, k: int) -> Integrator:
        key = (chart.order, k)
        if key not in self.built:
            self.built[key] = compiled(self.rows, chart, self.pieces[k], self.number)
            self.order = self.built[key].taylor.order
        return self.built[key]

    def _states(self, chart: Chart, piece: Piece, samples: list[tuple[Any, Long]]) -> States:
        """Full coordinates and rates at times within one chart and piece."""
        n = self.rows.coordinates.n
        t, y = np.array([x for x, _ in samples]), np.array([x for _, x in samples])
        at = Instant(columns(y[:, :n]), NUMBERS)
        found = rates(self.rows, chart, at, columns(y[:, n:]), piece.laws(t, NUMBERS))
        v, a = (stacked([x.get(j, 0) for j in range(n)], t - t) for x in (found.velocity, found.acceleration))
        return States(t, y[:, :n], v, a)

    def _singular(self, t: float, pivots: Pivots) -> str:
        return (
            f"the position at t = {t:.6g} s is singular: the rows of {self.rows.names[pivots.weakest]} depend on the others "
            f"(pivot {pivots.smallest:.1e})"
        )
