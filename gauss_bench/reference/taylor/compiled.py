"""The equations of motion for one chart, which is a choice of free (independent) coordinates, as compiled code of heyoka."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.taylor.arithmetic import Arithmetic
from gauss_bench.reference.taylor.elimination import factorise
from gauss_bench.reference.taylor.equations import Chart, rates
from gauss_bench.reference.taylor.law_pieces import Piece
from gauss_bench.reference.taylor.moving_vectors import Instant
from gauss_bench.reference.taylor.rows import LoopRows
from gauss_bench.reference.taylor.solve import Long
from gauss_bench.terms import Array


class Constants:
    """The constants in a set of equations, each of which becomes a parameter of the compiled code.

    Attributes:
        known: text of a constant with all its digits -> index of its parameter.
    """

    def __init__(self) -> None:
        """Make an empty set of constants."""
        self.known: dict[str, int] = {}

    def __call__(self, value: Any) -> Any:
        """Return the parameter for a constant; equal constants share one."""
        import heyoka

        return heyoka.par[self.known.setdefault(str(value), len(self.known))]

    def values(self, number: Number) -> list[Any]:
        """Return the values of all parameters, converted to a type of number."""
        return [number(text) for text in self.known]


def symbols(constants: Constants) -> Arithmetic:
    """Return cos, sin and square root of heyoka's symbolic expressions, and the function that makes parameters of constants."""
    import heyoka

    return Arithmetic(heyoka.cos, heyoka.sin, heyoka.sqrt, constants)


@dataclass(frozen=True, eq=False)
class CompiledSeries:
    """The equations of motion for one choice of free coordinates, as compiled code.

    Attributes:
        chart: the choice of free coordinates for which the equations are valid, and the pivots that eliminate the others.
        taylor: heyoka's integrator by Taylor series; after a step its attribute `state` has the new state.
        watch: function that returns the pivots at given coordinates in double precision, or None if there are no pivots.
        parameters: values of the parameters of `watch`.
    """

    chart: Chart
    taylor: Any
    watch: Any
    parameters: Array

    def step(self, t: Any, state: Long, limit: Any) -> Any | None:
        """Take one step by Taylor series from a state at the time t.

        Return the length of the step [s], which is at most `limit`, or None if a coefficient of the Taylor series is not finite.
        `at` returns the state at the end of the step or within it.
        """
        import heyoka

        self.taylor.time, self.taylor.state[:] = t, state
        outcome, h = self.taylor.step(limit, write_tc=True)
        good = (heyoka.taylor_outcome.success, heyoka.taylor_outcome.time_limit)
        return h if outcome in good else None  # all other outcomes mean that the series is not finite

    def at(self, t: Any) -> Long:
        """Return the state at a time within the last step."""
        return np.array(self.taylor.update_d_output(t))

    def pivots(self, state: Long) -> Array:
        """Return the pivots at a state in double precision, each divided by the chart's scale of its coordinate.

        If there are no pivots, return one infinite value, which is never too small.
        """
        if self.watch is None:
            return np.full(1, np.inf)
        pivots = self.watch(state[: len(self.chart.scale)].astype(float), pars=self.parameters)
        return np.asarray(pivots / self.chart.scale[[c for _, c in self.chart.order]])


def compile_series(rows: LoopRows, chart: Chart, piece: Piece, number: Number) -> CompiledSeries:
    """Compile the equations of motion for one choice of free coordinates and one interval of time.

    The compiled code has an integrator by Taylor series, whose state has all coordinates x and the speeds u of the free
    coordinates, and a function `watch` that returns the pivots. A small pivot shows that the free coordinates hardly determine the
    others; then another chart must be chosen.

    Args:
        rows: the constraint rows of the linkage.
        chart: the choice of free coordinates, and the pivots that eliminate the others.
        piece: interval of time in which all motion laws of the drivers are smooth.
        number: type of number in which the code computes.
    """
    import heyoka

    n = rows.coordinates.n
    names = [f"x{j:03d}" for j in range(n)] + [f"u{j:03d}" for j in range(len(chart.free))]
    state = [heyoka.make_vars(name) for name in names]
    zero = heyoka.expression(0.0)  # added to a literal it gives a symbol
    constants, watch_constants = Constants(), Constants()
    motion = rates(rows, chart, Instant(state[:n], symbols(constants)), state[n:], piece.laws(heyoka.time, symbols(constants)))
    right_sides = [motion.velocity.get(j, 0) for j in range(n)] + motion.free
    system = [(symbol, zero + value) for symbol, value in zip(state, right_sides, strict=True)]
    taylor = heyoka.taylor_adaptive(system, [number("0")] * len(system), fp_type=number, compact_mode=True)
    # heyoka counts parameters up to the last that occurs in the simplified equations: further values are cut off, here and below
    taylor.pars[:] = constants.values(number)[: len(taylor.pars)]
    pivots = factorise(rows.entries(Instant(state[:n], symbols(watch_constants))), chart.order).pivots
    watch = heyoka.cfunc([zero + x for x in pivots], vars=state[:n], compact_mode=True) if pivots else None
    parameters = np.array(watch_constants.values(float))[: watch.nparams if watch else 0]
    return CompiledSeries(chart, taylor, watch, parameters)
