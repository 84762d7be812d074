"""The time of an engine's first model in a new process with no generated code stored; once, and in a process of its own.

The races' "build" is the same where all that is generated is stored already. Both stand in the results.
"""

import os
from tempfile import TemporaryDirectory
from typing import Any

from gauss_bench.bench.clock import Key
from gauss_bench.bench.context import Context
from gauss_bench.bench.measurements.cost import COLD, first_step
from gauss_bench.bench.tasks import LIMIT, Tables, Task
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import offer
from gauss_bench.runs.one_run import measure_seconds as processor_time
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.suites.schema import Suite
from gauss_bench.trajectory import RunFailure


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """One task for each linkage and engine."""
    return [
        context.task("untimed", first_build, (*place, engine, part.step), *place, engine=engine, quantity=COLD)
        for part in suite.cold_builds
        for place in part.linkages.items()
        for engine in part.engines
        if offer(engine).usable
    ]


def first_build(linkage: str, scenario: str, engine: str, step: float) -> Tables:
    """Seconds until an engine's first model has taken its first step, in a process of its own; or why there are none."""
    told, mechanism = offer(engine), load(linkage, scenario or None)
    key = Key(COLD, engine, next(iter(told.settings)), told.integrators[0])
    start = {"mechanism": mechanism.name, "scenario": mechanism.scenario} | key._asdict()
    try:
        with Worker() as worker:
            sample = worker.call(cold, (linkage, scenario, engine, Choice(*key[2:], step)), LIMIT)
    except WorkerFailure as failure:
        sample = {"status": str(failure.status), "message": str(failure)}
    if "status" in sample:
        return {"untimed": [start | sample]}
    return {"samples": [start | {"step": step, "process": 0, "round": 0} | sample]}


def cold(linkage: str, scenario: str, engine: str, choice: Choice) -> dict[str, Any]:
    """Processor time of a build, with no generated code stored: that of this process and of compilers that it runs.

    The engine's library is imported before. Call it in a new process.
    """
    asked, mechanism = get(engine), load(linkage, scenario or None)
    asked.version()
    with TemporaryDirectory() as empty:
        os.environ["XDG_CACHE_HOME"] = empty
        compilers = sum(os.times()[2:4])
        try:
            seconds = processor_time(lambda: first_step(asked, mechanism, choice))
        except RunFailure as failure:
            return {"status": str(failure.status), "message": str(failure)}
    return {"seconds": seconds + sum(os.times()[2:4]) - compilers}
