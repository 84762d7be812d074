"""Test the papers' claim that a step takes less time if n - m unknowns are solved for instead of n + m, with all else equal.

Here n is the number of coordinates and m the number of constraints. Gauss's formulation has n - m unknowns, Lagrange's has n + m.
The compiled codes of both use the same elimination, the same search for pivots and the same code generator, and race in several
processes: a step of one trajectory, a step with projection, and a step in a batch of trajectories. The reported ratio is the median
of the ratios of all processes, with the spread of `clock.prediction_interval`; the verdict is "open" if the spread covers 1.

For one evaluation of the accelerations, including the checks of pivots, the table also has the number of operations, the number of
divisions, and the length of the longest chain of dependent operations.
"""

import statistics
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import product

import numpy as np

from gauss_bench.bench.clock import Key, Row, gather_rounds, prediction_interval, row
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
    """Return the keys of two entries for each of QUANTITIES: of the engine with n - m unknowns, and of the one with n + m."""
    return {
        what: [Key(quantity, engine, stabilization=stabilization) for engine in part.compiled]
        for what, (quantity, stabilization) in QUANTITIES.items()
    }


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return the tasks that count operations, one for each linkage of the races."""
    places = [x for part in suite.claim for x in part.linkages.items()]
    return [context.task("kernel_claim", count_operations, place, *place) for place in dict.fromkeys(places)]


def count_operations(linkage: str, scenario: str) -> Tables:
    """Return one row with the numbers of unknowns and of arithmetic operations of Gauss's and Lagrange's formulation.

    For one evaluation of the accelerations, the row has the number of operations, the number of divisions, and the length of the
    longest chain of dependent operations ("critical"), unless the formulation cannot be compiled.
    """
    mechanism = load(linkage, scenario or None)
    constraint_rows = mechanism.n - mechanism.dof
    start: Row = place_of(mechanism) | {"n": mechanism.n, "rows": constraint_rows}
    start |= {"unknowns_gauss": mechanism.dof, "unknowns_lagrange": mechanism.n + constraint_rows}
    for formulation in FORMULATIONS:
        with suppress(KernelError):  # the row of the race has the reason
            counted = known_program(mechanism, formulation).acceleration.costs
            start |= {f"{x}_{formulation}": getattr(counted, x) for x in ("operations", "divisions", "critical")}
    return {"kernel_claim": [start]}


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return one task for each linkage and process of a race; processes of the same linkage are not consecutive."""
    tasks = []
    for part in suite.claim:
        # without linkages, so that the task of a linkage does not depend on other linkages
        asked = part.model_copy(update={"linkages": {}})
        for number, place in product(range(part.processes), part.linkages.items()):  # `place`: linkage and scenario
            task = context.task("claim_races", race_claim, (*place, asked, number), *place, process=number)
            tasks.append(with_race_limit(task))
    return tasks


def race_claim(linkage: str, scenario: str, part: Claim, number: int) -> Tables:
    """Time both formulations on a linkage in one process; return one row for each of QUANTITIES.

    A row has both times, and the ratio of the time with n + m unknowns to that with n - m. `number` is the index of the process.
    """
    start: Row = place_of(load(linkage, scenario or None)) | {"process": number}
    measured = gather_rounds(race_survivors(entries, (linkage, scenario, part), part.rounds, part.compiled))
    return {"claim_races": [row(start | {"what": what}, measured.compare, *pair) for what, pair in pairs(part).items()]}


def entries(linkage: str, scenario: str, part: Claim) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield the key of each entry that `pairs` compares, and the function that makes its timing block."""
    wanted = [key for pair in pairs(part).values() for key in pair]
    asked = Cost(linkages={}, engines=part.compiled, integrators=1, step=part.step, rounds=part.rounds, batch=part.compiled)
    return ((key, make) for key, make in cost.entries(linkage, scenario, asked) if key in wanted)


def complete(suite: Suite, tables: Tables) -> None:
    """Add the ratios and verdicts of the races to the rows of the table `kernel_claim`."""
    races = group_by(tables.get("claim_races", []), "mechanism", "scenario")
    rows = tables.get("kernel_claim", [])
    rows[:] = [claim_row(start, races.get((start["mechanism"], start["scenario"]), [])) for start in rows]


def claim_row(start: Row, races: Rows) -> Row:
    """Return the row of a linkage: the columns `start` and, for each ratio, its median over the races, its spread and the verdict.

    If no race has a ratio of the times of a step, the status of the row is that of a race that failed or, if none failed, "skip".
    """
    columns = start | {"status": str(Status.SKIP), "message": "no step was timed", "processes": 0}
    # if a whole race failed, its row does not say what was timed
    failed = [r for r in races if r["status"] != Status.OK and r.get("what") in (STEP, None, "")]
    if failed:
        columns |= {"status": failed[0]["status"], "message": failed[0]["message"]}
    for what, prefix in COLUMNS.items():
        ended = [float(r["ratio"]) for r in races if r.get("what") == what and r["status"] == Status.OK]
        if not ended:
            continue
        low, high = prediction_interval(np.array(ended))
        columns |= {f"{prefix}ratio": statistics.median(ended), f"{prefix}ratio_low": low, f"{prefix}ratio_high": high}
        columns |= {f"{prefix}verdict": verdict(low, high)}
        if what == STEP:
            columns |= {"status": str(Status.OK), "message": "", "processes": len(ended)}
    return columns


def verdict(low: float, high: float) -> str:
    """Return "holds" if fewer unknowns make a step faster, "reversed" if slower, and "open" if the ratio's spread covers 1."""
    if low > 1.0:
        return "holds"
    return "reversed" if high < 1.0 else "open"
