"""The field: what every engine is asked beside its cases and its searched best, also engines that are not installed.

Two runs in two new processes must agree bit by bit. The suite computes joint forces from the engine's accelerations; forces that an
engine tells itself are compared too. A start is the first use of the engine in a new process: import, model and first step.
"""

from typing import Any

import numpy as np

from gauss_bench.bench.cases import variants
from gauss_bench.bench.clock import spread
from gauss_bench.bench.measure import reference_of
from gauss_bench.bench.sizes import size_of
from gauss_bench.bench.tasks import CASE_LIMIT, LIMIT, Context, Rows, Tables, Task, place_of
from gauss_bench.engines import ELSEWHERE, names, unknown
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.metrics import joint_force_errors
from gauss_bench.reference.build import sample_times
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import offer
from gauss_bench.runs.one_run import sampling
from gauss_bench.runs.questions import ask_along
from gauss_bench.runs.starting import start_there, time_start
from gauss_bench.runs.worker import Worker
from gauss_bench.suites.schema import PLAIN, SameQuestions, Suite
from gauss_bench.trajectory import Status, Trajectory

START = "start"  # the timed quantity


def engines_of(part: SameQuestions) -> list[str]:
    """Return the engines of a part that are here."""
    return [x for x in part.engines or names() if x in names()]


def absent(part: SameQuestions) -> list[str]:
    """Return the engines of a part that are not installed."""
    here = names()
    return [x for x in part.engines or ELSEWHERE if x not in here]


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return a task for each linkage, engine and setting, without stabilisation and with the engine's first integrator."""
    tasks = []
    for part in suite.field:
        for place in part.linkages.items():
            for name in engines_of(part):
                for chosen in (x for x in variants(offer(name), 1, name in PLAIN) if x[2] == "none"):
                    columns = dict(zip(("engine", "settings", "integrator", "stabilization"), (name, *chosen), strict=True))
                    arguments = (*place, name, chosen, part.step, part.until, context.store)
                    tasks.append(context.task("field", compare_runs, arguments, *place, **columns, step=part.step))
    return tasks


def compare_runs(
    linkage: str, scenario: str, engine: str, chosen: tuple[str, str, str], step: float, until: float, store: str
) -> Tables:
    """Return the row of an engine at a setting: whether two runs agree bit by bit, and the error of the joint forces."""
    mechanism, offered = load(linkage, scenario or None), offer(engine)
    choice = Choice(*chosen, step)
    row: dict[str, Any] = place_of(mechanism) | {"engine": engine, "step": step}
    row |= dict(zip(("settings", "integrator", "stabilization"), chosen, strict=True))
    if not offered.usable:
        return {"field": [row | {"status": str(offered.status), "message": offered.reason}]}
    reference = reference_of(linkage, scenario, until, store)
    forces = ask_along(mechanism, reference)
    wanted = sampling(step, until, sample_times(until))
    request = Request(linkage, mechanism.scenario, engine, choice, wanted, forces.ask, answers=forces.answers)
    runs = []
    for _ in range(2):
        with Worker() as worker:
            runs.append(run_apart(request, mechanism, CASE_LIMIT, worker))
    first, second = (run.trajectory for run in runs)
    if first is None or second is None:
        failed = runs[0] if first is None else runs[1]
        return {"field": [row | {"status": str(failed.status), "message": failed.message}]}
    same, apart = repeats(first, second)
    agreement = {"same_bits": same, "difference": apart}
    agreement["force_error"] = float(joint_force_errors(Evaluator(mechanism), first, reference).max())
    agreement["told_force_error"], _ = forces.compare(runs[0].answer)
    return {"field": [row | agreement | {"status": str(Status.OK), "message": ""}]}


def repeats(one: Trajectory, other: Trajectory) -> tuple[bool, float]:
    """Tell whether two runs agree bit by bit, and return the largest difference of their positions [m, rad]."""
    pairs = [(getattr(one, x), getattr(other, x)) for x in ("t", "q", "v", "a")]
    same = all(x.shape == y.shape and x.tobytes() == y.tobytes() for x, y in pairs)
    apart = np.abs(one.q - other.q).max() if one.q.shape == other.q.shape else np.inf
    return same, float(apart)


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return the starts of every engine on the first linkage of a part; those of one engine lie apart in time."""
    tasks = []
    for part in suite.field:
        place = next(iter(part.linkages.items()))
        for number in range(part.processes):
            for name in (x for x in engines_of(part) if offer(x).usable):
                arguments = (*place, name, part.step, number)
                tasks.append(context.task("untimed", first_use, arguments, *place, engine=name, quantity=START))
    return tasks


def first_use(linkage: str, scenario: str, engine: str, step: float, number: int) -> Tables:
    """Return the processor time of a start of an engine with its defaults, in a new process, or the reason why there is none."""
    mechanism, offered = load(linkage, scenario or None), offer(engine)
    settings, integrator = next(iter(offered.settings)), offered.integrators[0]
    row: dict[str, Any] = place_of(mechanism) | {"engine": engine, "settings": settings, "integrator": integrator}
    row |= {"stabilization": "none", "quantity": START}
    started = time_start(start_there, engine, mechanism, Choice(settings, integrator, "none", step), LIMIT)
    if "status" in started:
        return {"untimed": [row | started]}
    return {"samples": [row | {"step": step, "process": number, "round": 0} | started]}


def complete(suite: Suite, tables: Tables) -> None:
    """Add start and size to the rows of every engine, and a row for each engine that is not installed."""
    rows = tables.get("field", [])
    for part in suite.field:
        redundant = next((load(*x).name for x in part.redundant.items()), "")
        for linkage, scenario in part.linkages.items():
            place = place_of(load(linkage, scenario or None))
            missing = {"status": str(Status.SKIP), "settings": "", "integrator": "", "stabilization": "", "step": part.step}
            rows += [place | missing | {"engine": x, "message": str(unknown(x).args[0])} for x in absent(part)]
            for row in rows:
                if {k: row[k] for k in place} == place:
                    row["redundant"] = redundant
    sizes = {x: size_of(x) for x in dict.fromkeys(row["engine"] for row in rows)}
    starts = {x: start_columns(tables.get("samples", []), x) for x in sizes}
    for row in rows:
        size = sizes[row["engine"]]
        row |= {"size": size.megabytes, "size_of": size.of} | starts[row["engine"]]
    if rows:
        tables["field"] = rows


def start_columns(samples: Rows, engine: str) -> dict[str, Any]:
    """Return the columns of an engine's start, over all processes that started it; none if no start was timed."""
    seconds = [[r["seconds"]] for r in samples if r["quantity"] == START and r["engine"] == engine]
    return dict(spread("start", np.array(seconds))) if seconds else {}
