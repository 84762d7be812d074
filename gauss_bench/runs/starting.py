"""Time the first model and the first step of an engine in a new process.

That process imports this file and may have no package but numpy.
"""

import os
from collections.abc import Callable
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, Engine
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.one_run import measure_seconds
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import RunFailure, Status

Start = Callable[[str, Mechanism, Choice], dict[str, Any]]


def start_there(engine: str, mechanism: Mechanism, choice: Choice) -> dict[str, Any]:
    """Time an engine in this new process until its first step, including the import of its library.

    Generated code that an earlier process has stored is used.

    Return {"seconds": processor time [s]}, or the status and the message of a failure.
    """
    return time_with_compilers(lambda: first_step(get(engine), mechanism, choice))


def cold_there(engine: str, mechanism: Mechanism, choice: Choice) -> dict[str, Any]:
    """Time an engine's first model and step without stored generated code and without the import of its library.

    Return {"seconds": processor time [s]}, or the status and the message of a failure.
    """
    adapter = get(engine)
    adapter.version()  # imports the engine's library, so that the import is not timed
    with TemporaryDirectory() as empty:
        os.environ["XDG_CACHE_HOME"] = empty  # of this process alone, which runs nothing else
        return time_with_compilers(lambda: first_step(adapter, mechanism, choice))


def first_step(engine: Engine, mechanism: Mechanism, choice: Choice) -> None:
    """Build a model and take one step; code may be generated or compiled meanwhile.

    Raises:
        RunFailure: the engine refuses the mechanism.
    """
    model = build_model(engine, mechanism, choice)
    model.prepare(np.array([0.0, choice.step]))
    model.run()


def build_model(engine: Engine, mechanism: Mechanism, choice: Choice) -> Any:
    """Build a model of a mechanism in an engine.

    Raises:
        RunFailure: the engine refuses the mechanism.
    """
    if reason := engine.skip(mechanism, choice):
        raise RunFailure(Status.SKIP, reason)
    return engine.build(mechanism, choice)


def time_with_compilers(call: Callable[[], object]) -> dict[str, Any]:
    """Return {"seconds": processor time [s] of a call and of the compilers that it starts}, or the columns of its failure."""
    compilers = sum(os.times()[2:4])  # children of this process, which its own clock leaves out
    try:
        seconds = measure_seconds(call)
    except RunFailure as failure:
        return dict(failure.columns)
    return {"seconds": seconds + sum(os.times()[2:4]) - compilers}


def time_start(
    start: Callable[..., dict[str, Any]], engine: str, mechanism: Mechanism, choice: Choice, limit: float
) -> dict[str, Any]:
    """Call `start` (`start_there` or `cold_there`) in a new process; return its result, or the columns of the process's failure."""
    try:
        with Worker() as worker:
            return dict(worker.under(interpreter_of(engine)).call(start, (engine, mechanism, choice), limit))
    except WorkerFailure as failure:
        return failure.columns
