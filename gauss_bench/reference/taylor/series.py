"""The first pipeline of a certificate: Taylor series in 128 bit, of the equations of motion in loop coordinates.

heyoka expands the solution to order 40 by automatic differentiation of compiled code. Its steps are so short that the last terms
are below rounding. The equations are symbols of the state (x, u), and every constant is a parameter, so that linkages with other
numbers share the compiled code. The state of a linkage that is driven completely is x alone.
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
    """Return the motion at the sample times, up to where it has to stop.

    Args:
        document: the linkage file with decimals as written (`decimal_document`), and with the scenario's override merged.
        times: sample times as decimal texts [s], ascending from "0".
        double: whether to compute in double precision instead of 128 bit, to compare neighbouring linkages.
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
