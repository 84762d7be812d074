"""The equations of motion for one chart, which is a choice of free (independent) coordinates, as compiled code of heyoka."""

from typing import Any

import numpy as np

from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.taylor.arithmetic import Arithmetic, Long
from gauss_bench.reference.taylor.elimination import factorise
from gauss_bench.reference.taylor.equations import Chart, rates
from gauss_bench.reference.taylor.law_pieces import Piece
from gauss_bench.reference.taylor.rows import LoopRows
from gauss_bench.reference.taylor.vector_sums import Instant
from gauss_bench.terms import Array


class CompiledSeries:
    """The equations of motion for one choice of free coordinates and one interval of time, as compiled code.

    Each constant is a parameter, so that linkages with other numbers share the compiled code.

    Attributes:
        chart: the free coordinates, and the pivots that eliminate the others.
        taylor: heyoka's integrator by Taylor series; its state has all coordinates and the speeds of the free ones.
        watch: function that returns the pivots at given coordinates in double precision, or None if there are no pivots.
        parameters: values of the parameters of `watch`.
    """

    def __init__(self, rows: LoopRows, chart: Chart, piece: Piece, number: Number):
        """Compile the equations of the rows for a chart and for the motion laws of a piece, in a type of number."""
        import heyoka

        def symbols(known: dict[str, int]) -> Arithmetic:
            """Return the arithmetic of symbols; `known` collects the digits of each constant -> index of its parameter."""
            return Arithmetic(heyoka.cos, heyoka.sin, heyoka.sqrt, lambda x: heyoka.par[known.setdefault(str(x), len(known))])

        n, self.chart = rows.coordinates.n, chart
        names = [f"x{j:03d}" for j in range(n)] + [f"u{j:03d}" for j in range(len(chart.free))]
        state = [heyoka.make_vars(name) for name in names]
        zero = heyoka.expression(0.0)  # added to a literal it gives a symbol
        constants, watch_constants = dict[str, int](), dict[str, int]()
        laws = piece.laws(heyoka.time, symbols(constants))
        motion = rates(rows, chart, Instant(state[:n], symbols(constants)), state[n:], laws)
        right_sides = [motion.velocity.get(j, 0) for j in range(n)] + motion.free
        system = [(symbol, zero + value) for symbol, value in zip(state, right_sides, strict=True)]
        self.taylor: Any = heyoka.taylor_adaptive(system, [number("0")] * len(system), fp_type=number, compact_mode=True)
        # heyoka has parameters up to the last one in the simplified equations: further values are left out, here and below
        self.taylor.pars[:] = [number(digits) for digits in constants][: len(self.taylor.pars)]
        pivots = factorise(rows.entries(Instant(state[:n], symbols(watch_constants))), chart.order).pivots
        watch = heyoka.cfunc([zero + x for x in pivots], vars=state[:n], compact_mode=True) if pivots else None
        self.watch: Any = watch
        self.parameters = np.array([float(digits) for digits in watch_constants])[: watch.nparams if watch else 0]

    def step(self, t: Any, state: Long, limit: Any) -> Any | None:
        """Take one step from a state at the time t; return its length [s], at most `limit`, or None if the series is not finite.

        `at` returns the state at the end of the step or within it.
        """
        import heyoka

        self.taylor.time, self.taylor.state[:] = t, state
        outcome, h = self.taylor.step(limit, write_tc=True)
        return h if outcome in (heyoka.taylor_outcome.success, heyoka.taylor_outcome.time_limit) else None

    def at(self, t: Any) -> Long:
        """Return the state at a time within the last step."""
        return np.array(self.taylor.update_d_output(t))

    def pivots(self, state: Long) -> Array:
        """Return the pivots at a state in double precision, divided by the chart's scales; a single infinity without pivots."""
        if self.watch is None:
            return np.full(1, np.inf)
        pivots = self.watch(state[: len(self.chart.scale)].astype(float), pars=self.parameters)
        return np.asarray(pivots / self.chart.scale[[c for _, c in self.chart.order]])
