"""The first use of an engine in a new process: import, model and first step. The process may have numpy alone."""

import os
from typing import Any

import numpy as np

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.one_run import measure_seconds
from gauss_bench.trajectory import RunFailure, Status


def start_there(engine: str, mechanism: Mechanism, choice: Choice) -> dict[str, Any]:
    """Return the processor time [s] until an engine has taken its first step in this process, or why it takes none.

    It includes the import of the engine's library and compilers that it calls. Generated code that is stored from an earlier start
    is used, as in every start but the first.
    """

    def first_use() -> None:
        adapter = get(engine)
        if reason := adapter.skip(mechanism, choice):
            raise RunFailure(Status.SKIP, reason)
        model = adapter.build(mechanism, choice)
        model.prepare(np.array([0.0, choice.step]))
        model.run()

    compilers = sum(os.times()[2:4])  # children of this process, which its own clock leaves out
    try:
        seconds = measure_seconds(first_use)
    except RunFailure as failure:
        return {"status": str(failure.status), "message": str(failure)}
    return {"seconds": seconds + sum(os.times()[2:4]) - compilers}
