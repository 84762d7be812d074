"""The first computation of a certificate: Taylor series in 128-bit numbers, of the equations of motion in loop coordinates.

The library heyoka expands the solution in a Taylor series of order 40 by automatic differentiation of compiled code. The steps are
so short that the last terms of the series are below rounding. The equations are written in symbols of the state (x, u), where x are
the loop coordinates and u the speeds of the free (independent) ones. Every constant is a parameter, so that linkages with other
numbers share the compiled code. If a linkage is driven completely, no coordinate is free, and the state has the positions x only.
Sources: Biscani and Izzo, Monthly Notices of the Royal Astronomical Society 504 (2021), on heyoka; Jorba and Zou, Experimental
Mathematics 14 (2005), on orders and steps.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.mechanism.numbers import Number
from gauss_bench.reference.motion import Motion, Progress, assemble_doubles
from gauss_bench.reference.taylor.equations import choose_chart
from gauss_bench.reference.taylor.law_pieces import cut_pieces
from gauss_bench.reference.taylor.march import SINGULAR, March
from gauss_bench.reference.taylor.moving_vectors import at_states
from gauss_bench.reference.taylor.rows import loop_rows
from gauss_bench.reference.taylor.samples import sample
from gauss_bench.reference.taylor.solve import epsilon
from gauss_bench.reference.taylor.start import start_state
from gauss_bench.reference.taylor.vector_sums import LoopCoordinates


def taylor_motion(
    document: dict[str, Any], scenario: str, times: Sequence[str], double: bool = False, progress: Progress | None = None
) -> Motion:
    """Return the motion at the sample times; it ends earlier if it cannot be continued, such as at a singular position.

    Args:
        document: the linkage file with decimals kept as text (`decimal_document`), after the scenario's changes (`override`) have
            been merged into it.
        scenario: name of the scenario.
        times: sample times as decimal texts [s], ascending from "0".
        double: whether to compute in double precision, which suffices to compare linkages with slightly different parameters,
            instead of in 128-bit numbers.
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
