"""Compute ratios of times between this package's compiled formulations (kernels) and a rival engine, from the races of `cost.py`.

All steps have the same length, and each engine takes them in its own loop. The times include forces, springs, the checks of pivots,
and the call from Python, which is a few per cent of the kernel's time.

A right-hand side computes the accelerations of a state. For the rival, a call of its library at a prepared state is timed (the
"bare call"), with and without the cost of a call from Python, which is taken as the time of an empty call (about 0.1 us too small,
because the bare call has more arguments). For the kernel, a right-hand side is either a quarter of a Runge-Kutta step in its own
loop, where terms that several stages have in common are computed once, or a call from Python.
"""

from itertools import product

import numpy as np

from gauss_bench.bench.clock import Key, Measured, Row, at_least, compare, row
from gauss_bench.bench.measurements.cost import ACCELERATION, BARE, EMPTY, NATIVE, gather_by_linkage
from gauss_bench.bench.tasks import Rows, Tables
from gauss_bench.integrate.fixed_step import EVALUATIONS
from gauss_bench.suites.schema import RightHandSide, Steps, Suite

LOOP, CALLED = "in its own loop", "called from Python"
AS_CALLED, NET = "as called", "less the call"
LEAST = 1e-9  # [s] least time of a right-hand side: the rival's time less the call could be negative because of noise


def complete(suite: Suite, tables: Tables) -> None:
    """Add rows to the tables `kernel_steps` and `kernel_rhs` for each linkage on which the rival was timed with our own engines."""
    step_of = {(r["mechanism"], r["scenario"]): r["step"] for r in tables.get("samples", [])}
    for place, measured in gather_by_linkage(tables).items():
        timed_engines = {k.engine for k in (*measured.samples, *measured.failed) if isinstance(k, Key)}
        for steps in suite.steps:
            if steps.rival in timed_engines:
                tables.setdefault("kernel_steps", []).extend(step_rows(place, steps, step_of.get(place), measured))
        for part in suite.right_hand_side:
            if part.rival in timed_engines:
                tables.setdefault("kernel_rhs", []).extend(rhs_rows(place, part, measured))


def step_rows(place: tuple[str, str], part: Steps, step: float | None, measured: Measured) -> Rows:
    """Return one row for each formulation, stabilisation and setting of the rival engine.

    The ratio of the first formulation has a target if the suite states one for the linkage. `place` is mechanism and scenario,
    `step` the length of the timed steps [s].
    """
    rows = []
    for (formulation, engine), stabilization, settings in product(part.own.items(), part.stabilizations, part.settings):
        start: Row = {"mechanism": place[0], "scenario": place[1], "formulation": formulation}
        start |= {"stabilization": stabilization, "rival": part.rival, "settings": settings, "step": step}
        own, rival = Key(NATIVE, engine, stabilization=stabilization), Key(NATIVE, part.rival, settings)
        aimed = formulation == next(iter(part.own))
        target = part.targets.get(stabilization, {}).get(place[0]) if aimed else None
        rows.append(at_least(row(start, measured.compare, own, rival), "ratio", target))
    return rows


def rhs_rows(place: tuple[str, str], part: RightHandSide, measured: Measured) -> Rows:
    """Return a row for each setting of the rival engine, each method of timing our kernel, and each method of timing the rival.

    The kernel is timed in its own loop or called from Python. The rival's time is taken as measured, or less the cost of the call.
    Only the kernel in its own loop has a target, against the rival's time less the call. `place` is mechanism and scenario.
    """
    rows = []
    for settings, own, rival in product(part.settings, (LOOP, CALLED), (AS_CALLED, NET)):
        start: Row = {"mechanism": place[0], "scenario": place[1], "own": own, "rival": rival}
        start |= {"engine": part.rival, "settings": settings}
        aimed = own == LOOP and rival == NET and place[0] in part.target_of
        comparison = row(start, compare_sides, measured, part, settings, own, rival)
        rows.append(at_least(comparison, "ratio", part.target if aimed else None))
    return rows


def compare_sides(measured: Measured, part: RightHandSide, settings: str, own: str, rival: str) -> Row:
    """Return the times of one right-hand side in our own engine and in the rival engine, and their ratio.

    `own` is LOOP (a Runge-Kutta step in the kernel's own loop, divided by the number of its right-hand sides) or CALLED (a call
    from Python); `rival` is AS_CALLED (a call of the library from Python) or NET (this time less that of an empty call).

    Raises:
        Failure: one of the timed quantities was not measured.
    """
    ours = measured.of(Key(NATIVE if own == LOOP else ACCELERATION, part.own))
    if own == LOOP:  # a Runge-Kutta step evaluates several right-hand sides
        ours = np.asarray(ours / EVALUATIONS["rk4"])
    bare = measured.of(Key(BARE, part.rival, settings))
    if rival == NET:
        empty = measured.time(Key(EMPTY, part.rival, settings))
        bare = np.maximum(bare - empty, LEAST)
    return compare(ours, bare)
