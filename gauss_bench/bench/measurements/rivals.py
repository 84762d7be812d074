"""Steps and right-hand sides of compiled formulations against a rival's, taken from the races.

A step is one in each engine's own loop, at the same length. Forces, springs and the guards of the pivots are in what is timed, and
so is the call from Python, a few parts in a hundred of the kernel's time.

A right-hand side is a state in and its accelerations out. The rival's library is called with everything ready at one state, nothing
of the suite around it, once as it is called from Python and once less what such a call costs: a function of the same library that
takes two vectors, returns one, and subtracts them. That takes about a tenth of a microsecond too little, as the call in question is
given more arguments, and so favours neither by more than that. The kernel's is a quarter of a step of Runge-Kutta in its own loop,
and its own call from Python. Inside the loop equal parts of different stages are computed once: that is part of what compiling a
loop gains.
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
LEAST = 1e-9  # [s] a right-hand side takes at least: keeps noise from making the rival's net time negative


def complete(suite: Suite, tables: Tables) -> None:
    """Add the rows of every linkage on which the own engines raced with the rival."""
    lengths = {(r["mechanism"], r["scenario"]): r["step"] for r in tables.get("samples", [])}
    for place, measured in gather_by_linkage(tables).items():
        raced = {k.engine for k in (*measured.samples, *measured.failed) if isinstance(k, Key)}
        for steps in (x for x in suite.steps if x.rival in raced):
            tables.setdefault("kernel_steps", []).extend(step_rows(place, steps, lengths.get(place), measured))
        for sides in (x for x in suite.right_hand_side if x.rival in raced):
            tables.setdefault("kernel_rhs", []).extend(rhs_rows(place, sides, measured))


def step_rows(place: tuple[str, str], part: Steps, step: float | None, measured: Measured) -> Rows:
    """One row for each formulation, stabilisation and setting of the rival; the first formulation has targets."""
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
    """Every way to ask the one against every way to ask the other; the target stands at the strictest comparison of loops."""
    rows = []
    for settings, own, rival in product(part.settings, (LOOP, CALLED), (AS_CALLED, NET)):
        start: Row = {"mechanism": place[0], "scenario": place[1], "own": own, "rival": rival}
        start |= {"engine": part.rival, "settings": settings}
        aimed = own == LOOP and rival == NET and place[0] in part.target_of
        comparison = row(start, compare_sides, measured, part, settings, own, rival)
        rows.append(at_least(comparison, "ratio", part.target if aimed else None))
    return rows


def compare_sides(measured: Measured, part: RightHandSide, settings: str, own: str, rival: str) -> Row:
    """Both times.

    Raises:
        Missing: one was not measured.
    """
    ours = measured.of(Key(NATIVE if own == LOOP else ACCELERATION, part.own))
    if own == LOOP:
        ours = np.asarray(ours / EVALUATIONS["rk4"])
    bare = measured.of(Key(BARE, part.rival, settings))
    if rival == NET:
        empty = measured.time(Key(EMPTY, part.rival, settings))
        bare = np.maximum(bare - empty, LEAST)
    return compare(ours, bare)
