"""Races that survive a crash: an engine that crashes gets rows with the reason, and all others are timed again.

The process of a race writes the name of the running engine into a small file. After a crash or a hang the parent reads the name
there, and starts the race again without that engine.
"""

import math
import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from gauss_bench.bench.clock import Measured, Race, Watch, gather_rounds, watch_nothing
from gauss_bench.bench.tasks import LIMIT, LOST, Rows
from gauss_bench.runs.blocks import Block
from gauss_bench.runs.worker import Worker, WorkerFailure

ROOM = 256  # bytes for the name of the running engine
# function that returns for each entry its key, a named tuple with a field `engine`, and the function that makes its block
Entries = Callable[..., Iterable[tuple[Any, Callable[[], Block]]]]


def race_here(
    entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str] | None = None, path: str = ""
) -> Rows:
    """Time entries(*arguments) alternately in this process; return a row for each round of an entry, and one for each failed entry.

    A block whose `facts` has further columns gets one more row with them. `engines` names the engines that take part, by default
    all. The name of an engine is written into the file `path`, if given, before its code runs.
    """
    watch = write_engine_to(path) if path else watch_nothing
    race = Race(watch)
    for key, make in entries(*arguments):
        if engines is None or key.engine in engines:
            race.add(key, make)
    measured, rows = race.run(rounds), []
    for block in (x for x in race.blocks if x.entry in measured.samples):  # without those whose process ended
        names = block.entry._asdict()  # type: ignore[attr-defined]
        seconds = measured.samples[block.entry][0].tolist()
        rows += [names | {"process": 0, "round": k, "seconds": x} for k, x in enumerate(seconds)]
        watch(block.entry)  # facts may crash too
        if facts := block.facts():
            rows.append(names | {"facts": facts})
    return rows + [key._asdict() | failure.columns for key, failure in measured.failed.items()]  # type: ignore[attr-defined]


def race_survivors(entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str]) -> Rows:
    """Time entries(*arguments) alternately, as `race_here` does, but in a process of its own.

    If an engine crashes this process or hangs, each entry of the engine gets one row with the reason, and the race of all other
    entries is repeated.
    """
    rows, lost = list_survivors(race_here, (entries, arguments, rounds), engines)
    if lost:
        rows += [key._asdict() | lost[key.engine].columns for key, _ in entries(*arguments) if key.engine in lost]
    return list(rows)


def race_processes(entries: Entries, arguments: tuple[Any, ...], rounds: int, engines: Sequence[str], processes: int) -> Measured:
    """Call `race_survivors` `processes` times, and collect the times of all entries.

    An entry whose engine crashes or hangs in one of the calls has the reason of the failure and no times.
    """
    rows: Rows = []
    for number in range(processes):
        rows += [row | {"process": number} for row in race_survivors(entries, arguments, rounds, engines)]
    return gather_rounds(rows, strict=True)


def list_survivors(
    race: Callable[..., Any], arguments: tuple[Any, ...], engines: Sequence[str], limit: float = LIMIT, longest: float = math.inf
) -> tuple[Any, dict[str, WorkerFailure]]:
    """Call race(*arguments, engines, path) in a worker; after a crash or a hang, repeat it without the engine that was running.

    Return the result of the last race, and engine -> failure for each engine that crashed or hung in an earlier one.

    Args:
        race: function that writes the name of the running engine, at most ROOM bytes, into the file `path`.
        limit: largest time [s] of one race without waits for a processor.
        longest: largest elapsed time [s] of one race.

    Raises:
        WorkerFailure: the race crashed while no engine was running, or raised an error.
    """
    lost: dict[str, WorkerFailure] = {}
    with tempfile.NamedTemporaryFile() as file, Worker() as worker:
        while True:
            Path(file.name).write_bytes(bytes(ROOM))  # no engine is running
            remaining = tuple(x for x in engines if x not in lost)
            try:
                return worker.call(race, (*arguments, remaining, file.name), limit, longest=longest), lost
            except WorkerFailure as failure:
                guilty = read_engine(file.name)
                if failure.status not in LOST or guilty not in remaining:  # neither a crash nor a hang of an engine
                    raise
                lost[guilty] = WorkerFailure(failure.status, f"in the race of all engines, while this one was running: {failure}")


def write_engine_to(path: str) -> Watch:
    """Return a function that writes the name of an entry's engine into the file `path`; its argument is the key of the entry.

    The name is padded to ROOM bytes, so that it replaces all of an earlier name; a call takes a microsecond.
    """
    file = os.open(path, os.O_WRONLY)
    return lambda entry: os.pwrite(file, str(getattr(entry, "engine", "")).encode()[:ROOM].ljust(ROOM, b"\0"), 0)


def read_engine(path: str) -> str:
    """Return the name of the engine that was last written into the file `path`, or an empty text if none was."""
    return Path(path).read_bytes().rstrip(b"\0").decode()
