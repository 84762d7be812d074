"""Libraries that take minutes to build, once for a user: built before an engine is searched, or when it is named.

It is built in a worker, which ends what it has started when its parent dies. Whatever fails here is said again by the engine, whose
runs are then skipped with the reason.
"""

from collections.abc import Callable, Iterable

from gauss_bench.engines import FOREIGN, get
from gauss_bench.runs.worker import Worker, WorkerFailure

LIMIT = 1800.0  # [s] of a build: on a busy machine it takes ten times as long as on an idle one


def build_first(engine: str, settings: Iterable[str], told: Callable[[str], object]) -> None:
    """Build what an engine needs for any of its settings, and is not there yet."""
    if engine not in FOREIGN or not hasattr(get(engine), "build_once"):
        return
    what = next(filter(None, map(get(engine).unbuilt, settings)), "")  # type: ignore[attr-defined]
    if not what:
        return
    told(f"building {what}")
    worker = Worker()
    try:
        worker.call(build_there, (engine,), LIMIT)
    except WorkerFailure as failure:
        told(f"it was not built: {failure}")
    finally:
        worker.stop()


def build_there(engine: str) -> None:
    get(engine).build_once()  # type: ignore[attr-defined]
