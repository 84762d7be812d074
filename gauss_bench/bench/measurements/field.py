"""Measure further figures of every engine, for the table `field`: repetition, joint forces, start-up time and installed size.

Two runs in two new processes must agree bit by bit. Joint forces that the suite computes from the engine's accelerations, and joint
forces that the engine itself reports, are compared with the reference. A start is the first use of the engine in a new process:
import, model and first step. An engine that is not installed has a row with the reason.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from gauss_bench.bench.cases import Combination, combinations
from gauss_bench.bench.clock import spread
from gauss_bench.bench.measure import reference_of
from gauss_bench.bench.measurements.cost import START, task_of_first_step
from gauss_bench.bench.sizes import size_of
from gauss_bench.bench.tasks import CASE_LIMIT, Context, Rows, Tables, Task, group_by, place_of
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
from gauss_bench.runs.worker import Worker
from gauss_bench.suites.schema import PLAIN, SameQuestions, Suite
from gauss_bench.trajectory import Status, Trajectory


def engines_of(part: SameQuestions) -> list[str]:
    """Return the listed engines (`names`) among those that a section of the suite names, by default all listed engines.

    Engines of ELSEWHERE are listed only if they are installed; an engine of FOREIGN is listed even if its library is missing.
    """
    listed = names()
    return [x for x in part.engines or listed if x in listed]


def absent_engines(part: SameQuestions) -> list[str]:
    """Return the engines that are not listed, among those that a section of the suite names, by default among ELSEWHERE."""
    listed = names()
    return [x for x in part.engines or ELSEWHERE if x not in listed]


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return the tasks that run `compare_runs`, one for each linkage, engine and setting.

    The engine's first integrator is used, without stabilisation. The engines in PLAIN, which solve the same equations by different
    methods, are run only with their default setting.
    """
    tasks = []
    for part in suite.field:
        for place, name in product(part.linkages.items(), engines_of(part)):
            for chosen in combinations(offer(name), integrators=1, plain=name in PLAIN):
                if chosen.stabilization == "none":
                    arguments = (*place, name, chosen, part.step, part.until, context.store)
                    columns = {"engine": name, **chosen._asdict(), "step": part.step}
                    tasks.append(context.task("field", compare_runs, arguments, *place, **columns))
    return tasks


def compare_runs(linkage: str, scenario: str, engine: str, chosen: Sequence[str], step: float, until: float, store: str) -> Tables:
    """Return the row of an engine: whether two runs agree bit for bit, and the errors of the joint forces.

    `chosen` has the names of settings, integrator and stabilisation; `step` and `until` are the step and the end of the runs [s].
    """
    mechanism, offered, names = load(linkage, scenario or None), offer(engine), Combination(*chosen)
    row: dict[str, Any] = place_of(mechanism) | {"engine": engine, "step": step} | names._asdict()
    if not offered.usable:
        return {"field": [row | {"status": str(offered.status), "message": offered.reason}]}
    reference = reference_of(linkage, scenario, until, store)
    forces = ask_along(mechanism, reference)
    wanted = sampling(step, until, sample_times(until))
    request = Request(linkage, mechanism.scenario, engine, Choice(*names, step), wanted, forces.ask, answers=forces.answers)
    runs = []
    for _ in range(2):
        with Worker() as worker:
            runs.append(run_apart(request, mechanism, CASE_LIMIT, worker))
    first, second = (run.trajectory for run in runs)
    if first is None or second is None:
        failed = runs[0] if first is None else runs[1]
        return {"field": [row | {"status": str(failed.status), "message": failed.message}]}
    row["same_bits"], row["difference"] = repeats(first, second)
    row["force_error"] = float(joint_force_errors(Evaluator(mechanism), first, reference).max())
    row["told_force_error"], _ = forces.compare(runs[0].answer)  # of the joint forces that the engine itself reports
    return {"field": [row | {"status": str(Status.OK), "message": ""}]}


def repeats(one: Trajectory, other: Trajectory) -> tuple[bool, float]:
    """Return whether two runs agree bit for bit, and the largest difference of their positions [m, rad]."""
    pairs = [(getattr(one, x), getattr(other, x)) for x in ("t", "q", "v", "a")]
    same = all(x.shape == y.shape and x.tobytes() == y.tobytes() for x, y in pairs)
    apart = np.abs(one.q - other.q).max() if one.q.shape == other.q.shape else np.inf
    return same, float(apart)


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return the tasks that time the start-up of every usable engine, on the first linkage of each section of the suite.

    The repetitions of an engine are not consecutive, so that a slow time of the machine does not affect all. The bench calls all
    functions of this name alike; `tables` is not needed here.
    """
    tasks = []
    for part in suite.field:
        place = next(iter(part.linkages.items()))
        usable = [x for x in engines_of(part) if offer(x).usable]
        tasks += [task_of_first_step(context, place, x, part.step, START, k) for k in range(part.processes) for x in usable]
    return tasks


def complete(suite: Suite, tables: Tables) -> None:
    """Complete the table `field`.

    Each row gets the start-up time and the installed size of its engine, and the name of the suite's linkage with redundant rows,
    by which the report finds the engine's runs on that linkage. Each engine that is not installed gets a row with the reason.
    """
    rows = tables.get("field", [])
    for part in suite.field:
        redundant = [load(*place).name for place in part.redundant.items()]  # the first one is used
        for linkage, scenario in part.linkages.items():
            place = place_of(load(linkage, scenario or None))
            skipped = {"status": str(Status.SKIP), "settings": "", "integrator": "", "stabilization": "", "step": part.step}
            # the error for an unknown name says how the engine can be installed
            rows += [place | skipped | {"engine": name, "message": str(unknown(name).args[0])} for name in absent_engines(part)]
            for row in rows:
                if {k: row[k] for k in place} == place:
                    row["redundant"] = redundant[0] if redundant else ""
    for (engine,), own in group_by(rows, "engine").items():
        size = size_of(engine)
        columns = {"size": size.megabytes, "size_of": size.measured} | start_columns(tables.get("samples", []), engine)
        for row in own:
            row |= columns
    if rows:
        tables["field"] = rows


def start_columns(samples: Rows, engine: str) -> dict[str, Any]:
    """Return the columns of an engine's start-up time over all processes, given the rows `samples` of all engines.

    The result is empty if no start of the engine was timed.
    """
    seconds = [[r["seconds"]] for r in samples if r["quantity"] == START and r["engine"] == engine]
    return dict(spread("start", np.array(seconds))) if seconds else {}
