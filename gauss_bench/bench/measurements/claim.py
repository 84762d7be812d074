"""Test the papers' claim that n - m unknowns are cheaper than n + m, with all else equal.

Both formulations use the same elimination, the same search for pivots and the same code generator, and they race in one process: a
step of one trajectory, a step with projection, and a step in a batch. Every race is repeated in several processes, because the
memory addresses of code and data change the ratio by a few per cent and are fixed within a process. The ratio is the median over
the processes. Its spread is an interval that also contains, with a probability of 99 %, the ratio that a repeated race would give
(`clock.foreseen`). The verdict is "open" if the spread covers 1.

The table also counts operations, divisions and the longest chain of dependent operations of one acceleration with its checks of
pivots.
"""

import math
import statistics
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import product
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Key, Row, foreseen, gather_rounds, row
from gauss_bench.bench.measurements import cost
from gauss_bench.bench.measurements.cost import BATCH, NATIVE
from gauss_bench.bench.survived import race_survivors
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, group_by, place_of, with_race_limit
from gauss_bench.compiler.elimination.program import known_program
from gauss_bench.compiler.errors import KernelError
from gauss_bench.linkage.load import load
from gauss_bench.runs.blocks import Block
from gauss_bench.suites.schema import Claim, Cost, Suite
from gauss_bench.trajectory import Status

FORMULATIONS = ("gauss", "lagrange")
STEP, PROJECTED, LANES = "step", "projected", "batch"
COLUMNS = {STEP: "", PROJECTED: "projected_", LANES: "batch_"}  # what is timed -> prefix of its columns
# what is timed -> quantity and stabilisation of the entries in the race
QUANTITIES = {STEP: (NATIVE, "none"), PROJECTED: (NATIVE, "projection"), LANES: (BATCH, "none")}


def pairs(part: Claim) -> dict[str, list[Key]]:
    """Return, for each of QUANTITIES, the keys of the two entries that are compared.

    The first is that of the engine with n - m unknowns, the second that of the engine with n + m (`part.compiled`).
    """
    return {
        what: [Key(quantity, engine, stabilization=stabilization) for engine in part.compiled]
        for what, (quantity, stabilization) in QUANTITIES.items()
    }


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return the tasks that count operations, one for each linkage of the races."""
    places = [x for part in suite.claim for x in part.linkages.items()]
    return [context.task("kernel_claim", count, place, *place) for place in dict.fromkeys(places)]


def count(linkage: str, scenario: str) -> Tables:
    """Return one row with the counts of unknowns and operations of both formulations.

    A formulation that cannot be compiled has no count of operations.
    """
    mechanism = load(linkage, scenario or None)
    rows = mechanism.n - mechanism.dof
    start: Row = place_of(mechanism) | {"n": mechanism.n, "rows": rows}
    start |= {"unknowns_gauss": mechanism.dof, "unknowns_lagrange": mechanism.n + rows}
    for formulation in FORMULATIONS:
        with suppress(KernelError):  # the row of the race has the reason
            counted = known_program(mechanism, formulation).acceleration.costs
            start |= {f"{x}_{formulation}": getattr(counted, x) for x in ("operations", "divisions", "critical")}
    return {"kernel_claim": [start]}


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return a race for each linkage and process; the processes of a linkage are separated in time."""
    tasks = []
    for part in suite.claim:
        asked = part.model_copy(update={"linkages": {}})
        for number, place in product(range(part.processes), part.linkages.items()):
            task = context.task("claim_races", race_claim, (*place, asked, number), *place, process=number)
            tasks.append(with_race_limit(task))
    return tasks


def race_claim(linkage: str, scenario: str, part: Claim, number: int, race: Callable[..., Any] = race_survivors) -> Tables:
    """Return the rows of one race, one for each of QUANTITIES: both times of a step, and their ratio.

    The times are those with n - m unknowns and with n + m. The ratio is the time with n + m over the time with n - m.

    Args:
        number: of the process.
        race: `race_survivors`, or `race_here` in tests.
    """
    start: Row = place_of(load(linkage, scenario or None)) | {"process": number}
    measured = gather_rounds(race(entries, (linkage, scenario, part), part.rounds, part.compiled))
    return {"claim_races": [row(start | {"what": what}, measured.compare, *pair) for what, pair in pairs(part).items()]}


def entries(linkage: str, scenario: str, part: Claim) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield the key of each entry that `pairs` compares, and the function that makes its timing block.

    They are entries of the race of all costs (`cost.py`), of which the others are left out.
    """
    wanted = [key for pair in pairs(part).values() for key in pair]
    asked = Cost(linkages={}, engines=part.compiled, integrators=1, step=part.step, rounds=part.rounds, batch=part.compiled)
    return ((key, make) for key, make in cost.entries(linkage, scenario, asked) if key in wanted)


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in the ratios and verdicts."""
    races = group_by(tables.get("claim_races", []), "mechanism", "scenario")
    rows = tables.get("kernel_claim", [])
    rows[:] = [claim_row(start, races.get((start["mechanism"], start["scenario"]), [])) for start in rows]


def claim_row(start: Row, races: Rows) -> Row:
    """Return the row of a linkage: `start`, and the median of each ratio over its races with the spread and the verdict.

    If the time of a step has no ratio, the status is that of a race that failed, or "skip".
    """
    columns: Row = {"status": str(Status.SKIP), "message": "no step was timed"}
    # a race that failed as a whole has a row that does not say what was timed
    if failed := next((r for r in races if r["status"] != Status.OK and r.get("what") in (STEP, None, "")), None):
        columns = {"status": failed["status"], "message": failed["message"]}
    columns = start | columns | {"processes": 0}
    for what, prefix in COLUMNS.items():
        ended = [float(r["ratio"]) for r in races if r.get("what") == what and r["status"] == Status.OK]
        if not ended:
            continue
        low, high = foreseen(np.array(ended)) if len(ended) > 1 else (math.nan, math.nan)
        columns |= {f"{prefix}ratio": statistics.median(ended), f"{prefix}ratio_low": low, f"{prefix}ratio_high": high}
        columns |= {f"{prefix}verdict": verdict(low, high)}
        if what == STEP:
            columns |= {"status": str(Status.OK), "message": "", "processes": len(ended)}
    return columns


def verdict(low: float, high: float) -> str:
    """Decide whether fewer unknowns are faster, from the ends of the spread of the ratio: time with n + m over time with n - m."""
    if low > 1.0:
        return "holds"
    return "reversed" if high < 1.0 else "open"
