"""The first pipeline of a certificate: Taylor series in 128 bit, of the equations of motion in loop coordinates.

heyoka expands the solution to order 40 by automatic differentiation of compiled code, with steps for which the last terms vanish in
rounding. The equations are written as symbols of the state (x, u), with every constant a parameter, so that a linkage with other
numbers runs in the same compiled code. A linkage that its drivers leave no freedom is geometry, and needs no series.
Source: Biscani and Izzo, Monthly Notices of the Royal Astronomical Society 504 (2021), on heyoka; Jorba and Zou, Experimental
Mathematics 14 (2005), on orders and steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.load import load_document
from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.motion import Motion, Progress
from gauss_bench.reference.taylor.arithmetic import NUMBERS, Arithmetic
from gauss_bench.reference.taylor.elimination import factorise
from gauss_bench.reference.taylor.equations import Chart, choose_chart, rates
from gauss_bench.reference.taylor.law_pieces import Piece, pieces
from gauss_bench.reference.taylor.march import SINGULAR, March
from gauss_bench.reference.taylor.moving_vectors import Instant
from gauss_bench.reference.taylor.rows import LoopRows, loop_rows
from gauss_bench.reference.taylor.samples import sample
from gauss_bench.reference.taylor.solve import Long, columns, epsilon
from gauss_bench.reference.taylor.start import start_state
from gauss_bench.reference.taylor.vector_sums import LoopCoordinates
from gauss_bench.terms import Array


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
    rows = loop_rows(LoopCoordinates(mechanism))
    chosen = document["scenarios"][scenario]
    x, v = start_state(rows, chosen, rows.coordinates.start(assembled.q0), number)
    chart, pivots = choose_chart(rows, Instant(columns(x), NUMBERS))
    if pivots.smallest < SINGULAR:
        raise ArithmeticError(f"the start is a singular position: smallest pivot {pivots.smallest:.1e}")
    redundant = rows.m - len(chart.order) + len(rows.coordinates.turn_gaps)
    march = March(
        rows=rows,
        eps=epsilon(number),
        pieces=pieces(mechanism.drivers, chosen, number),
        times=[number(t) for t in times],
        compiled=lambda chart, piece: compile_series(rows, chart, piece, number),
        progress=progress,
    )
    states, stopped = march.run(chart, x, v)
    way = f"Taylor series (steps: {march.steps}, charts: {len(march.built)})"
    bits = 1 - int(np.log2(epsilon(number)))
    method = f"loop coordinates in {bits} bits; {way}; heyoka {heyoka.__version__}"
    return sample(rows, states, times[: len(states.t)], redundant, stopped, method, number)


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


class Constants:
    """The numbers in a set of equations, each as a parameter of the compiled code."""

    def __init__(self) -> None:
        self.known: dict[str, int] = {}  # every digit as text -> number of the parameter

    def __call__(self, value: Any) -> Any:
        import heyoka

        return heyoka.par[self.known.setdefault(str(value), len(self.known))]

    def values(self, number: Number) -> list[Any]:
        return [number(text) for text in self.known]


def symbols(constants: Constants) -> Arithmetic:
    import heyoka

    return Arithmetic(heyoka.cos, heyoka.sin, heyoka.sqrt, constants)


@dataclass(frozen=True, eq=False)
class CompiledSeries:
    """Equations of one chart as compiled code.

    Attributes:
        taylor: integrates them; watch: gives the pivots in double precision, with their parameters, or None without pivots.
    """

    chart: Chart
    taylor: Any
    watch: Any
    parameters: Array

    def step(self, t: Any, state: Long, limit: Any) -> Any | None:
        import heyoka

        self.taylor.time, self.taylor.state[:] = t, state
        outcome, h = self.taylor.step(limit, write_tc=True)
        good = (heyoka.taylor_outcome.success, heyoka.taylor_outcome.time_limit)
        return h if outcome in good else None

    def at(self, t: Any) -> Long:
        return np.array(self.taylor.update_d_output(t))

    def pivots(self, state: Long) -> Array:
        if self.watch is None:
            return np.full(1, np.inf)
        watched = self.watch(state[: len(self.chart.scale)].astype(float), pars=self.parameters)
        return np.asarray(watched / self.chart.scale[[c for _, c in self.chart.order]])


def compile_series(rows: LoopRows, chart: Chart, piece: Piece, number: Number) -> CompiledSeries:
    """The integrator of a chart within one piece of the motion laws."""
    import heyoka

    n = rows.coordinates.n
    names = [f"x{j:03d}" for j in range(n)] + [f"u{j:03d}" for j in range(len(chart.free))]
    state = [heyoka.make_vars(name) for name in names]
    none = heyoka.expression(0.0)
    constants, watched = Constants(), Constants()
    motion = rates(rows, chart, Instant(state[:n], symbols(constants)), state[n:], piece.laws(heyoka.time, symbols(constants)))
    right = [motion.velocity.get(j, 0) for j in range(n)] + motion.free
    system = [(name, none + value) for name, value in zip(state, right, strict=True)]
    taylor = heyoka.taylor_adaptive(system, [number("0")] * len(system), fp_type=number, compact_mode=True)
    taylor.pars[:] = constants.values(number)[: len(taylor.pars)]
    seen = factorise(rows.entries(Instant(state[:n], symbols(watched))), chart.order).pivots
    watch = heyoka.cfunc([none + x for x in seen], vars=state[:n], compact_mode=True) if seen else None
    parameters = np.array(watched.values(float))[: watch.nparams if watch else 0]
    return CompiledSeries(chart, taylor, watch, parameters)
