"""Races that survive a crash: all engines race in one process; one that crashes it becomes a row with a reason.

The process of a race tells in a few bytes of a file who is at work, which a crash or a hang leaves standing. The race is
then run again without the one that stands there.
"""

import math
import os
import tempfile
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path
from typing import Any

from gauss_bench.bench.clock import Block, Race
from gauss_bench.bench.tasks import LIMIT, LOST, Rows
from gauss_bench.runs.worker import Worker, WorkerFailure

ROOM = 256  # bytes of a name
Watch = Callable[[Hashable], object]
Entries = Callable[..., Iterable[tuple[Any, Callable[[], Block]]]]  # names, each with an `engine`, and how their blocks are made


def race_here(
    entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str] | None = None, path: str = ""
) -> Rows:
    """Race entries(*arguments): rows of their names with the seconds of a round, with facts, or with why they have none.

    Args:
        engines: that take part; all, if not given.
        path: of the file in which the race tells who is at work: `watching`.
    """
    watch = watching(path) if path else id
    race = Race(watch)
    for key, make in entries(*arguments):
        if engines is None or key.engine in engines:
            race.add(key, make)
    measured, rows = race.run(rounds), []
    for block in race.blocks:
        name = block.entry._asdict()  # type: ignore[attr-defined]
        rows += [name | {"process": 0, "round": k, "seconds": x} for k, x in enumerate(measured.samples[block.entry][0].tolist())]
        watch(block.entry)
        if facts := block.facts():
            rows.append(name | {"facts": facts})
    for key, missing in measured.failed.items():
        rows.append(key._asdict() | {"status": str(missing.status), "message": str(missing)})  # type: ignore[attr-defined]
    return rows


def race_survivors(entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str]) -> Rows:
    """As `race_here`, in a process of its own: all that an engine was to be timed at tells why it brought the process down."""
    rows, lost = list_survivors(race_here, (entries, arguments, rounds), engines)
    for key, _ in entries(*arguments) if lost else ():
        if key.engine in lost:
            rows.append(key._asdict() | lost[key.engine].columns)
    return list(rows)


def list_survivors(
    race: Callable[..., Any],
    arguments: tuple[Any, ...],
    engines: Sequence[str],
    limit: float = LIMIT,
    longest: float = math.inf,
) -> tuple[Any, dict[str, WorkerFailure]]:
    """race(*arguments, engines, path) in a process of its own, and the engines that brought it down, which are left out of those.

    Args:
        path: of the file in which the race tells who is at work: `watching`.
        limit, longest: [s] of one race, as `Worker.call` takes them.

    Raises:
        WorkerFailure: the race fails of itself, or nobody was at work.
    """
    lost: dict[str, WorkerFailure] = {}
    with tempfile.NamedTemporaryFile() as file, Worker() as worker:
        while True:
            Path(file.name).write_bytes(bytes(ROOM))
            left = tuple(x for x in engines if x not in lost)
            try:
                return worker.call(race, (*arguments, left, file.name), limit, longest=longest), lost
            except WorkerFailure as failure:
                guilty = at_work(file.name)
                if failure.status not in LOST or guilty not in left:
                    raise
                lost[guilty] = WorkerFailure(failure.status, f"in the race of all engines, while this one was at work: {failure}")


def watching(path: str) -> Watch:
    """Report to the parent who is at work in a race, at a microsecond between blocks; entries have an `engine`."""
    file = os.open(path, os.O_WRONLY)
    return lambda entry: os.pwrite(file, str(getattr(entry, "engine", "")).encode()[:ROOM].ljust(ROOM, b"\0"), 0)


def at_work(path: str) -> str:
    """Return the engine that ran last."""
    return Path(path).read_bytes().rstrip(b"\0").decode()
