"""The papers' claim, that n - m unknowns are cheaper than n + m, with nothing else that differs.

Both formulations come from one eliminator with one search for pivots, are compiled by one code generator and race in one run: a
step of one trajectory, the same with projection, and a step in a batch. Where code and data happen to lie in memory moves such a
ratio by a few per cent and stays as it is for the life of a process, so that every linkage is raced in several, each of which loads
code anew. A ratio is the median of theirs, and its spread where that of a second race falls. The verdict follows from that alone:
it is open where the spread covers 1.

Operations, divisions and the longest chain of dependent operations are those of one acceleration with its guards.
"""

import math
import statistics
from collections.abc import Mapping, Sequence

import numpy as np

from gauss_bench.bench.clock import Key, Race, Row, foreseen, row
from gauss_bench.bench.context import Context
from gauss_bench.bench.measurements.cost import BATCH, NATIVE, entries
from gauss_bench.bench.survived import list_survivors, patient, watching
from gauss_bench.bench.tasks import Rows, Tables, Task
from gauss_bench.compiler.elimination.program import costs, known_program
from gauss_bench.compiler.errors import KernelError
from gauss_bench.linkage.load import load
from gauss_bench.suites.schema import Claim, Cost, Suite
from gauss_bench.trajectory import Status

FORMULATIONS = ("gauss", "lagrange")
STEP, PROJECTED, LANES = "step", "projected", "batch"
COLUMNS = {STEP: "", PROJECTED: "projected_", LANES: "batch_"}  # what is raced -> how its columns begin


def pairs(part: Claim) -> dict[str, tuple[Key, Key]]:
    """The two that race: with few unknowns, with many."""
    few, many = part.compiled
    return {
        STEP: (Key(NATIVE, few), Key(NATIVE, many)),
        PROJECTED: (Key(NATIVE, few, stabilization="projection"), Key(NATIVE, many, stabilization="projection")),
        LANES: (Key(BATCH, few), Key(BATCH, many)),
    }


def exact(suite: Suite, context: Context) -> list[Task]:
    """Counts of operations on every linkage that both formulations race on."""
    places = [x for part in suite.claim for x in part.linkages.items()]
    return [context.task("kernel_claim", count, x, *x) for x in dict.fromkeys(places)]


def count(linkage: str, scenario: str) -> Tables:
    """Unknowns and operations of both formulations, as far as they can be compiled."""
    mechanism = load(linkage, scenario or None)
    rows = mechanism.n - mechanism.dof
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "n": mechanism.n, "rows": rows}
    start |= {"unknowns_gauss": mechanism.dof, "unknowns_lagrange": mechanism.n + rows}
    for formulation in FORMULATIONS:
        try:
            told = costs(known_program(mechanism, formulation, (), None, None))
        except KernelError:
            continue  # the race tells why
        start |= {f"{x}_{formulation}": getattr(told, x) for x in ("operations", "divisions", "critical")}
    return {"kernel_claim": [start]}


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """A race for each linkage and process; those of a linkage lie apart in time."""
    tasks = [
        context.task("claim_races", race_claim, (*place, part.model_copy(update={"linkages": {}}), number), *place, process=number)
        for part in suite.claim
        for number in range(part.processes)
        for place in part.linkages.items()
    ]
    return list(map(patient, tasks))


def race_claim(linkage: str, scenario: str, part: Claim, number: int) -> Tables:
    """The rows of one race, in a process of its own."""
    tables, lost = list_survivors(race, (linkage, scenario, part, number), part.compiled)
    for r in tables["claim_races"]:
        for key in pairs(part)[r["what"]]:
            if key.engine in lost:
                r |= lost[key.engine].told
    return tables


def race(linkage: str, scenario: str, part: Claim, number: int, engines: Sequence[str], path: str) -> Tables:
    """Race both ways: how many times longer many unknowns take."""
    mechanism, entered = load(linkage, scenario or None), Race(watching(path))
    wanted = {key for pair in pairs(part).values() for key in pair}
    asked = Cost(linkages={}, engines=tuple(engines), integrators=1, step=part.step, rounds=part.rounds, batch=part.compiled)
    for key, make in entries(mechanism, asked):
        if key in wanted:
            entered.add(key, make)
    measured = entered.run(part.rounds)
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "process": number}
    return {"claim_races": [row(start | {"what": what}, measured.compared, *pair) for what, pair in pairs(part).items()]}


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in the ratios and verdicts."""
    races = tables.get("claim_races", [])
    for number, start in enumerate(tables.get("kernel_claim", [])):
        here = [r for r in races if (r["mechanism"], r["scenario"]) == (start["mechanism"], start["scenario"])]
        tables["kernel_claim"][number] = claim_row(start, here)


def claim_row(start: Row, races: Rows) -> Row:
    """A linkage with the median over its processes of each ratio, its spread, and what follows; `races` are its own."""
    told: Row = dict(start) | {"status": str(Status.SKIP), "message": "no step was timed"}
    for what, begins in COLUMNS.items():
        ended = [float(r["ratio"]) for r in races if r.get("what") == what and r["status"] == Status.OK]
        if ended:
            low, high = foreseen(np.array(ended)) if len(ended) > 1 else (math.nan, math.nan)
            told |= {f"{begins}ratio": statistics.median(ended), f"{begins}ratio_low": low, f"{begins}ratio_high": high}
            told |= {f"{begins}verdict": verdict(low, high)}
        if what == STEP:
            failed = next((r for r in races if r["status"] != Status.OK and r.get("what") in (STEP, None, "")), None)
            reason: Mapping[str, object] = failed or {"status": told["status"], "message": told["message"]}
            told |= {"status": str(Status.OK), "message": ""} if ended else {x: reason[x] for x in ("status", "message")}
            told |= {"processes": len(ended)}
    return told


def verdict(low: float, high: float) -> str:
    """Decide whether fewer unknowns are faster, from the spread of the time with many over that with few."""
    if low > 1.0:
        return "holds"
    return "reversed" if high < 1.0 else "open"
