"""One right-hand side, a state in and its accelerations out, against Pinocchio's constraintDynamics.

Pinocchio is called with everything ready at one state, nothing of the suite around it, once as it is called from Python and once
less what such a call costs: a function of Pinocchio that takes two vectors, returns one, and subtracts them. That takes about a
tenth of a microsecond too little, as constraintDynamics is given more arguments, and so favours neither by more than that. The
kernel's is a quarter of a step of Runge-Kutta in its own loop, and its own call from Python. Inside the loop equal parts of
different stages are computed once: that is part of what compiling a loop gains.
"""

import numpy as np

from gauss_bench.bench.clock import Block, lasting
from gauss_bench.bench.kernel_timing import Key, Measured, Race, Row, compared, row
from gauss_bench.bench.measurements.steps import QUANTITY, H
from gauss_bench.bench.targets import RIGHT_HAND_SIDE, RIGHT_HAND_SIDE_OF, at_least
from gauss_bench.compiler.kernel import Kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

CALL, BARE, EMPTY = "acceleration call", "constraintDynamics", "empty call"
STAGES = 4
LOOP, CALLED = "in its own loop", "called from Python"
AS_CALLED, NET = "as called", "less the call"
RIVAL_SETTINGS = ("default", "one_iteration")
LEAST = 1e-9  # [s] a right-hand side takes at least: keeps noise from making the rival's net time negative


def enter_call(race: Race, mechanism: Mechanism, kernel: Kernel) -> None:
    """Enter the kernel's acceleration of one state, from Python."""
    race.add(Key(CALL, "gauss"), lambda: lasting(None, lambda: kernel.acceleration(mechanism.q0, mechanism.v0)))


def enter_rival(race: Race, mechanism: Mechanism, settings: str) -> None:
    """Enter Pinocchio's bare call and an empty one."""

    def make(which: int) -> Block:
        model = get("pinocchio").build(mechanism, Choice(settings, "rk4", "none", H))
        return lasting(None, model.bare_calls()[which])  # type: ignore[attr-defined]

    for which, quantity in enumerate((BARE, EMPTY)):
        race.add(Key(quantity, "pinocchio", settings), make, which)


def rhs_rows(mechanism: Mechanism, measured: Measured) -> list[Row]:
    """Every way to ask the kernel against every way to ask Pinocchio; the target stands at the strictest comparison of loops."""
    rows = []
    for settings in RIVAL_SETTINGS:
        for own in (LOOP, CALLED):
            for rival in (AS_CALLED, NET):
                start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "own": own, "rival": rival}
                start |= {"engine": "pinocchio", "settings": settings}
                found = row(start, _compared, measured, settings, own, rival)
                aimed = own == LOOP and rival == NET and mechanism.name in RIGHT_HAND_SIDE_OF
                rows.append(at_least(found, "ratio", RIGHT_HAND_SIDE if aimed else None))
    return rows


def _compared(measured: Measured, settings: str, own: str, rival: str) -> Row:
    return compared(_own(measured, own), _rival(measured, settings, rival))


def _own(measured: Measured, how: str) -> Array:
    samples = measured.of(Key(QUANTITY if how == LOOP else CALL, "gauss"))
    return np.asarray(samples / STAGES) if how == LOOP else samples


def _rival(measured: Measured, settings: str, how: str) -> Array:
    bare = measured.of(Key(BARE, "pinocchio", settings))
    if how == AS_CALLED:
        return bare
    empty = float(np.quantile(measured.of(Key(EMPTY, "pinocchio", settings)), 0.25))
    return np.asarray(np.maximum(bare - empty, LEAST))
