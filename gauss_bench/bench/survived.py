"""Races that survive a crash: an engine that crashes the process has one row with the reason, and the others race again.

The process of a race writes the name of the running engine into a small file. After a crash or a hang the parent reads it there,
and starts the race again without that engine.
"""

import math
import os
import tempfile
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path
from typing import Any

from gauss_bench.bench.clock import Measured, Race, gather_rounds
from gauss_bench.bench.tasks import LIMIT, LOST, Rows
from gauss_bench.runs.blocks import Block
from gauss_bench.runs.worker import Worker, WorkerFailure

ROOM = 256  # bytes for the name of the running engine
Watch = Callable[[Hashable], object]
Entries = Callable[..., Iterable[tuple[Any, Callable[[], Block]]]]  # keys (with a field `engine`) and functions that make blocks


def race_here(
    entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str] | None = None, path: str = ""
) -> Rows:
    """Race entries(*arguments) in this process; return one row for each round of an entry, for its facts, or for its failure.

    Args:
        engines: the engines that take part; all, if not given.
        path: the file into which the name of the running engine is written.
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
    for key, failure in measured.failed.items():
        rows.append(key._asdict() | failure.columns)  # type: ignore[attr-defined]
    return rows


def race_survivors(entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str]) -> Rows:
    """Race as `race_here` in a process of its own; every entry of an engine that crashes it has a row with the reason."""
    rows, lost = list_survivors(race_here, (entries, arguments, rounds), engines)
    for key, _ in entries(*arguments) if lost else ():
        if key.engine in lost:
            rows.append(key._asdict() | lost[key.engine].columns)
    return list(rows)


def race_processes(
    race: Callable[..., Rows], entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str], processes: int
) -> Measured:
    """Race several times by `race`; an engine that crashes or hangs in one of the processes has that reason and no times."""
    rows: Rows = []
    for number in range(processes):
        rows += [row | {"process": number} for row in race(entries, arguments, rounds, engines)]
    return gather_rounds(rows, strict=True)


def list_survivors(
    race: Callable[..., Any],
    arguments: tuple[Any, ...],
    engines: Sequence[str],
    limit: float = LIMIT,
    longest: float = math.inf,
) -> tuple[Any, dict[str, WorkerFailure]]:
    """Call race(*arguments, engines, path) in a worker, again without each engine that crashes it or hangs.

    Args:
        race: writes the name of the running engine into the file `path`.
        limit, longest: [s] of one race, as `Worker.call` takes them.

    Returns:
        What the last race returned, and engine -> failure of those that were left out.

    Raises:
        WorkerFailure: the race failed while no engine was running, or raised an error itself.
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
    """Return a function that writes the engine of an entry into the file, which takes a microsecond."""
    file = os.open(path, os.O_WRONLY)
    return lambda entry: os.pwrite(file, str(getattr(entry, "engine", "")).encode()[:ROOM].ljust(ROOM, b"\0"), 0)


def at_work(path: str) -> str:
    """Return the engine whose name was written last."""
    return Path(path).read_bytes().rstrip(b"\0").decode()
