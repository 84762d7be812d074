"""Tasks: functions that run in worker processes and return rows of tables.

A resumed run does not repeat a finished task. A task whose worker crashed or was stopped gets one row with the reason.
"""

import hashlib
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from gauss_bench.bench.journal import Journal
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Alteration, leave_unaltered
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.suites.schema import OnLinkages
from gauss_bench.tables import TABLES
from gauss_bench.trajectory import Status

CASE_LIMIT = 120.0  # [s] limit of one case; the slowest of the suites takes 10 s on a slow core
LIMIT = 600.0  # [s] limit of one task; the slowest of the suites, a race of all engines on one linkage, takes a minute
LOST = (Status.CRASHED, Status.TIMEOUT)  # statuses of a task without an answer
RACES = 3  # most attempts of a race, each without the engines that crashed before; more crashes would be a fault of the suite
PAUSE = 15.0  # [s] between lines of progress
Rows = list[dict[str, Any]]
Tables = dict[str, Rows]


def place_of(mechanism: Mechanism) -> dict[str, Any]:
    """Return the columns that name a linkage and its scenario."""
    return {"mechanism": mechanism.name, "scenario": mechanism.scenario}


def group_by(rows: Rows, *columns: str) -> dict[tuple[Any, ...], Rows]:
    """Group rows that have the same values in some columns; return these values -> rows of the group, in the given order."""
    groups: dict[tuple[Any, ...], Rows] = {}
    for row in rows:
        groups.setdefault(tuple(row[x] for x in columns), []).append(row)
    return groups


class Task(NamedTuple):
    """A task for a worker, in which function(*arguments) returns table -> rows.

    Attributes:
        key: identifies the task in the journal, the file of finished tasks.
        stamp: digest of the code and data on which the rows depend.
        table, start: the name of the table that gets a row if the task fails, and the first columns of this row.
        limit: time [s] after which the worker is stopped.
    """

    key: str
    function: Callable[..., Tables]
    arguments: tuple[Any, ...]
    stamp: str
    table: str
    start: Mapping[str, Any] = {}
    limit: float = LIMIT

    def rows_of_failure(self, failure: WorkerFailure) -> Tables:
        """Return the row, as table -> rows, of a task whose worker crashed, was stopped, or raised an error.

        It is a row of the task's table or, if this table has no column for a status, of the table `lost`.
        """
        if "status" in TABLES[self.table].names:
            return {self.table: [{**self.start, **failure.columns}]}
        place = {k: x for k, x in self.start.items() if k in ("mechanism", "scenario")}
        return {"lost": [{"table": self.table, **place, **failure.columns}]}

    @property
    def stamp_if_lost(self) -> str:
        """The stamp of a task that crashed or was stopped; it includes the time limit, because a longer one may be enough."""
        return f"{self.stamp}.{self.limit:g}"


def with_race_limit(task: Task, processes: int = 1) -> Task:
    """Return a task that times engines, with a limit that suffices for RACES attempts in each of `processes` processes."""
    return task._replace(limit=processes * RACES * LIMIT)


def finish(tasks: list[Task], jobs: int, label: str, journal: Journal | None = None) -> Tables:
    """Run the tasks that the journal does not have yet, `jobs` at a time, and return table -> rows of all tasks, in their order.

    Finished tasks are added to the journal; `label` names the tasks in reports of progress.
    """
    stored = {task.key: journal.find(task.key, task.stamp, task.stamp_if_lost) for task in tasks} if journal else {}
    done: dict[str, Tables] = {key: rows for key, rows in stored.items() if rows is not None}
    waiting = {task.key: task for task in tasks if task.key not in done}
    todo: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
    answers: queue.SimpleQueue[tuple[str, str, Tables] | BaseException] = queue.SimpleQueue()
    workers = min(jobs, len(waiting))
    for item in [*waiting.values(), *[None] * workers]:  # a None ends one worker
        todo.put(item)
    for _ in range(workers):
        threading.Thread(target=_run_tasks, args=(todo, answers), daemon=True).start()
    for _ in count_with_progress(len(waiting), label):
        answer = answers.get()
        if isinstance(answer, BaseException):
            raise answer
        key, stamp, tables = answer
        if journal:
            journal.add(key, stamp, tables)
        done[key] = tables
    return gather(done[task.key] for task in tasks)


def count_with_progress(count: int, label: str) -> Iterator[int]:
    """Yield 0 to count - 1 and report progress on stderr: by a bar on a terminal, else by a line every PAUSE seconds."""
    if sys.stderr.isatty():
        from tqdm import tqdm  # imported only where a bar is shown

        yield from tqdm(range(count), desc=label, file=sys.stderr)
        return
    last_line = time.monotonic()
    if count:
        print(f"{label}: {count} to do", file=sys.stderr, flush=True)
    for k in range(count):
        yield k
        if time.monotonic() - last_line > PAUSE:
            last_line = time.monotonic()
            print(f"{label}: {k + 1} of {count} done", file=sys.stderr, flush=True)


def gather(answers: Iterable[Tables]) -> Tables:
    """Merge several maps table -> rows into one, in the given order."""
    tables: Tables = {}
    for answer in answers:
        for name, rows in answer.items():
            tables.setdefault(name, []).extend(rows)
    return tables


def _run_tasks(todo: "queue.SimpleQueue[Task | None]", answers: "queue.SimpleQueue[Any]") -> None:
    """Run tasks from `todo` in one worker process until a None is taken, and put key, stamp and rows of each into `answers`.

    An unexpected exception is put there too, so that `finish` can raise it.
    """
    try:
        with Worker() as worker:
            while task := todo.get():
                try:
                    answer = worker.call(task.function, task.arguments, task.limit)
                    lost = any(row.get("status") in LOST for rows in answer.values() for row in rows)
                except WorkerFailure as failure:
                    answer, lost = task.rows_of_failure(failure), True
                answers.put((task.key, task.stamp_if_lost if lost else task.stamp, answer))
    except BaseException as error:
        answers.put(error)


@dataclass(frozen=True)
class Context:
    """The settings of all tasks of a run.

    Attributes:
        store: folder of the references.
        stamp: digest of the code, the libraries and the certificates.
        alter: plants a fault in the mechanism that engines are given.
        until, steps: end and steps [s] that a user asks for instead of the suite's.
        limit: time [s] that one case may take.
    """

    store: str
    stamp: str
    alter: Alteration = leave_unaltered
    until: float | None = None
    steps: tuple[float, ...] | None = None
    limit: float = CASE_LIMIT
    _loaded: dict[tuple[str, str], Mechanism] = field(default_factory=dict, repr=False, compare=False)

    def mechanism(self, linkage: str, scenario: str) -> Mechanism:
        """Return a linkage in a scenario; each is read once."""
        if (linkage, scenario) not in self._loaded:
            self._loaded[linkage, scenario] = load(linkage, scenario or None)
        return self._loaded[linkage, scenario]

    def each(self, parts: Iterable[OnLinkages], table: str, function: Callable[..., Tables]) -> list[Task]:
        """Return one task, function(linkage, scenario, part), for each linkage of some parts of a suite.

        The `part` that is passed to `function` has no linkages. If the task fails, a row of `table` records the failure.
        """
        tasks = []
        for part in parts:
            without_linkages = part.model_copy(update={"linkages": {}})  # so that the task's key depends on no other linkage
            for place in part.linkages.items():
                task = self.task(table, function, (*place, without_linkages), *place)
                processes = getattr(part, "processes", 0)  # number of processes in which a race is repeated, one after the other
                tasks.append(with_race_limit(task, processes) if processes else task)
        return tasks

    def task(
        self,
        table: str,
        function: Callable[..., Tables],
        arguments: tuple[Any, ...],
        linkage: str = "",
        scenario: str = "",
        seen: str = "",
        **names: Any,
    ) -> Task:
        """Return a task whose rows are added to a table.

        Args:
            function, arguments: function(*arguments) returns table -> rows.
            linkage, scenario: linkage and scenario of the rows; "" if the rows belong to none.
            seen: text on which the rows depend besides the arguments.
            names: columns that, besides linkage and scenario, identify the row of a failure.
        """
        # the key leaves out store and limit, which do not change rows, and the alteration: altered runs have no journal
        identifying = [repr(x) for x in arguments if not any(x is y for y in (self.store, self.alter, self.limit))]
        digest = hashlib.sha256("\n".join([*identifying, seen]).encode()).hexdigest()[:16]
        start, stamp = dict(names), self.stamp
        if linkage:
            mechanism = self.mechanism(linkage, scenario)
            start = place_of(mechanism) | start
            stamp = f"{stamp}.{mechanism.sha256[:16]}"
        key = "|".join([table, function.__name__, linkage, scenario, *map(str, names.values()), digest])
        limit = self.limit if table == "results" else LIMIT
        return Task(key, function, arguments, stamp, table, start, limit)
