"""The papers' claim, that n - m unknowns are cheaper than n + m, with nothing else that differs.

Both formulations come from one eliminator with one search for pivots, are compiled by one code generator and race in one run. The
textbook's form of both, dense numpy on the same terms, races too. Operations, divisions and the longest chain of dependent
operations are those of one acceleration with its guards. The verdict follows from the measured ratio alone: it is open where the
ratio's spread covers 1.
"""

import numpy as np

from gauss_bench.bench.clock import Block, lasting
from gauss_bench.bench.kernel_timing import Key, Measured, Missing, Race, Row, row
from gauss_bench.bench.measurements.steps import FORMULATIONS, QUANTITY, STEPS, H
from gauss_bench.compiler.elimination.program import costs, known_program
from gauss_bench.compiler.kernel import Kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism

BATCH, TEXTBOOK = "batch step", "acceleration"
GROUPS = 16  # of lanes in a batch: enough that a call from Python does not count


def enter_batch(race: Race, mechanism: Mechanism, formulation: str, kernel: Kernel) -> None:
    """Enter steps of many trajectories at once, all from the start: here only the formulations are compared."""
    count = GROUPS * kernel.lanes
    q, v = (np.tile(x, (count, 1)) for x in (mechanism.q0, mechanism.v0))
    race.add(Key(BATCH, formulation), lambda: lasting(None, lambda: kernel.rollout(q, v, H, STEPS), STEPS * count))


def enter_textbook(race: Race, mechanism: Mechanism, formulation: str) -> None:
    """Enter one acceleration of the textbook's form, terms included."""

    def make() -> Block:
        model = get(formulation).build(mechanism, Choice(step=H))
        return lasting(None, lambda: model.acceleration(0.0, mechanism.q0, mechanism.v0))

    race.add(Key(TEXTBOOK, formulation), make)


def claim_row(mechanism: Mechanism, kernels: dict[str, Kernel | None], measured: Measured) -> Row:
    """What both formulations cost, and how many times longer Lagrange's takes."""
    rows = mechanism.n - mechanism.dof
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "n": mechanism.n, "rows": rows}
    start |= {"unknowns_gauss": mechanism.dof, "unknowns_lagrange": mechanism.n + rows}
    for formulation in FORMULATIONS:
        if kernels[formulation] is not None:
            found = costs(known_program(mechanism, formulation, (), None, None))
            start |= {f"{x}_{formulation}": getattr(found, x) for x in ("operations", "divisions", "critical")}

    def make() -> Row:
        found = measured.compared(*(Key(QUANTITY, x) for x in FORMULATIONS))
        return found | {"verdict": verdict(found["ratio_low"], found["ratio_high"])}

    return row(start, make) | _ratio("batch", BATCH, measured) | _ratio("numpy", TEXTBOOK, measured)


def _ratio(name: str, quantity: str, measured: Measured) -> Row:
    """Lagrange's time over Gauss's, under another name; nothing where it was not measured."""
    try:
        found = measured.compared(*(Key(quantity, x) for x in FORMULATIONS))
    except Missing:
        return {}
    return {f"{name}_{x}": found[x] for x in ("ratio", "ratio_low", "ratio_high")}


def verdict(low: float, high: float) -> str:
    """Whether fewer unknowns are faster, from the spread of Lagrange's time over Gauss's."""
    if low > 1.0:
        return "holds"
    return "reversed" if high < 1.0 else "open"
