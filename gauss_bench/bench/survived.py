"""Races that outlive an engine: all race in one process, and who brings it down is a row with a reason, not the end of the rest.

The process of a race tells in a few bytes of shared memory who is at work, which a crash or a hang leaves standing. The race is
then run again without the one that stands there.
"""

import math
import mmap
import os
import tempfile
from collections.abc import Callable, Hashable, Sequence
from typing import Any

from gauss_bench.bench.tasks import LIMIT, LOST, Tables, Task
from gauss_bench.runs.worker import Worker, WorkerFailure

ROOM = 256  # bytes of a name
RACES = 3  # of a task at most: who brings two of them down is a bug to be found, not a result
Watch = Callable[[Hashable], object]


def patient(task: Task, processes: int = 1) -> Task:
    """With time for as many races as there may be; `processes` that each has one to win."""
    return task._replace(limit=processes * RACES * LIMIT)


def list_survivors(
    race: Callable[..., Tables],
    arguments: tuple[Any, ...],
    engines: Sequence[str],
    limit: float = LIMIT,
    longest: float = math.inf,
) -> tuple[Tables, dict[str, WorkerFailure]]:
    """race(*arguments, engines, path) in a process of its own, and the engines that brought it down, which are left out of those.

    Args:
        path: of the memory in which the race tells who is at work: `watching`.
        limit, longest: [s] of one race, as `Worker.call` takes them.

    Raises:
        WorkerFailure: the race fails of itself, or nobody was at work.
    """
    lost: dict[str, WorkerFailure] = {}
    with tempfile.NamedTemporaryFile() as memory, Worker() as worker:
        while True:
            memory.seek(0)
            memory.write(bytes(ROOM))
            memory.flush()
            left = tuple(x for x in engines if x not in lost)
            try:
                return worker.call(race, (*arguments, left, memory.name), limit, longest=longest), lost
            except WorkerFailure as failure:
                guilty = at_work(memory.name)
                if failure.status not in LOST or guilty not in left:
                    raise
                lost[guilty] = WorkerFailure(failure.status, f"in the race of all engines, while this one was at work: {failure}")


def watching(path: str) -> Watch:
    """Report to the parent who is at work in a race, at a fifth of a microsecond between blocks; entries have an `engine`."""
    file = os.open(path, os.O_RDWR)
    try:
        memory = mmap.mmap(file, ROOM)
    finally:
        os.close(file)

    def told(entry: Hashable) -> None:
        memory[:] = str(getattr(entry, "engine", "")).encode()[:ROOM].ljust(ROOM, b"\0")

    return told


def at_work(path: str) -> str:
    """The engine that was at work last."""
    with open(path, "rb") as file:
        return file.read(ROOM).rstrip(b"\0").decode()
