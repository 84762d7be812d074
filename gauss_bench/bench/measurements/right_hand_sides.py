"""One right-hand side, a state in and its accelerations out, taken from the races: a compiled formulation against an engine.

The engine's library is called with everything ready at one state, nothing of the suite around it, once as it is called from Python
and once less what such a call costs: a function of the same library that takes two vectors, returns one, and subtracts them. That
takes about a tenth of a microsecond too little, as the call in question is given more arguments, and so favours neither by more
than that. The kernel's is a quarter of a step of Runge-Kutta in its own loop, and its own call from Python. Inside the loop equal
parts of different stages are computed once: that is part of what compiling a loop gains.
"""

import numpy as np

from gauss_bench.bench.clock import Key, Measured, Row, at_least, compare, row
from gauss_bench.bench.measurements.cost import ACCELERATION, BARE, EMPTY, NATIVE, gather_by_linkage
from gauss_bench.bench.tasks import Rows, Tables
from gauss_bench.integrate.fixed_step import EVALUATIONS
from gauss_bench.suites.schema import RightHandSide, Suite
from gauss_bench.terms import Array

LOOP, CALLED = "in its own loop", "called from Python"
AS_CALLED, NET = "as called", "less the call"
LEAST = 1e-9  # [s] a right-hand side takes at least: keeps noise from making the rival's net time negative


def complete(suite: Suite, tables: Tables) -> None:
    """Add the rows of every linkage on which both raced."""
    for part in suite.right_hand_side:
        for place, measured in gather_by_linkage(tables).items():
            if any(isinstance(k, Key) and k.engine == part.rival for k in (*measured.samples, *measured.failed)):
                tables.setdefault("kernel_rhs", []).extend(rhs_rows(place, part, measured))


def rhs_rows(place: tuple[str, str], part: RightHandSide, measured: Measured) -> Rows:
    """Every way to ask the one against every way to ask the other; the target stands at the strictest comparison of loops."""
    rows = []
    for settings in part.settings:
        for own in (LOOP, CALLED):
            for rival in (AS_CALLED, NET):
                start: Row = {"mechanism": place[0], "scenario": place[1], "own": own, "rival": rival}
                start |= {"engine": part.rival, "settings": settings}
                comparison = row(start, _compare, measured, part, settings, own, rival)
                aimed = own == LOOP and rival == NET and place[0] in part.target_of
                rows.append(at_least(comparison, "ratio", part.target if aimed else None))
    return rows


def _compare(measured: Measured, part: RightHandSide, settings: str, own: str, rival: str) -> Row:
    return compare(_own(measured, part, own), _rival(measured, part, settings, rival))


def _own(measured: Measured, part: RightHandSide, how: str) -> Array:
    if how == LOOP:
        return np.asarray(measured.of(Key(NATIVE, part.own)) / EVALUATIONS["rk4"])
    return measured.of(Key(ACCELERATION, part.own))


def _rival(measured: Measured, part: RightHandSide, settings: str, how: str) -> Array:
    bare = measured.of(Key(BARE, part.rival, settings))
    if how == AS_CALLED:
        return bare
    empty = measured.time(Key(EMPTY, part.rival, settings))
    return np.asarray(np.maximum(bare - empty, LEAST))
