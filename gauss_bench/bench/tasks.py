"""Tasks answered in worker processes: named, resumable, and never lost with the worker.

A task answers with rows of tables. One that is lost answers too: with a row of the table it was to fill, and the reason. The
context that all tasks of a run share says where references are kept, and what their answers depend on.
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
from gauss_bench.runs.apart import Alteration, is_unaltered
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.suites.schema import OnLinkages
from gauss_bench.tables import TABLES
from gauss_bench.trajectory import Status

CASE_LIMIT = 120.0  # [s] the slowest case of the suites takes 10 s on a slow core
LIMIT = 600.0  # [s] the slowest task of the suites races all engines on one linkage, in a minute
LOST = (Status.CRASHED, Status.TIMEOUT)
RACES = 3  # of a task at most: who brings two of them down is a bug to be found, not a result
PAUSE = 15.0  # [s] between lines of progress
Rows = list[dict[str, Any]]
Tables = dict[str, Rows]


def place_of(mechanism: Mechanism) -> dict[str, Any]:
    """The linkage and the scenario that a row is about."""
    return {"mechanism": mechanism.name, "scenario": mechanism.scenario}


class Task(NamedTuple):
    """A task for a worker.

    Attributes:
        key: names the task and nothing else.
        function, arguments: function(*arguments) gives the rows of tables, by table.
        stamp: what the answer depends on besides.
        table, start: where a failure is told, and the names that its row begins with.
        limit: [s] that the answer may take.
    """

    key: str
    function: Callable[..., Tables]
    arguments: tuple[Any, ...]
    stamp: str
    table: str
    start: Mapping[str, Any] = {}
    limit: float = LIMIT

    def rows_of_failure(self, failure: WorkerFailure) -> Tables:
        """The answer of a task whose worker was lost."""
        columns = failure.columns
        if "status" in TABLES[self.table].names:
            return {self.table: [{**self.start, **columns}]}
        place = {k: x for k, x in self.start.items() if k in ("mechanism", "scenario")}
        return {"lost": [{"table": self.table, **place, **columns}]}

    @property
    def stamp_if_lost(self) -> str:
        """The stamp of a lost task, which includes its limit: with more time it might be answered."""
        return f"{self.stamp}.{self.limit:g}"

    def stamp_of(self, answer: Tables) -> str:
        """The stamp of an answer, in which a row may tell that the process of an engine was lost."""
        lost = any(row.get("status") in LOST for rows in answer.values() for row in rows)
        return self.stamp_if_lost if lost else self.stamp


def patient(task: Task, processes: int = 1) -> Task:
    """Return the task with a time limit for every race that may be run; each race runs in `processes` processes."""
    return task._replace(limit=processes * RACES * LIMIT)


def finish(tasks: list[Task], jobs: int, label: str, journal: Journal | None = None) -> dict[str, Tables]:
    """Answers of all tasks by key, in their order: from the journal where they stand there, else from workers."""
    done = {
        task.key: entry
        for task in tasks
        if journal and (entry := journal.find(task.key, task.stamp) or journal.find(task.key, task.stamp_if_lost))
    }
    waiting = {task.key: task for task in tasks if task.key not in done}
    todo: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
    answers: queue.SimpleQueue[tuple[str, str, Tables] | BaseException] = queue.SimpleQueue()
    workers = min(jobs, len(waiting))
    for item in [*waiting.values(), *[None] * workers]:
        todo.put(item)
    for _ in range(workers):
        threading.Thread(target=_serve, args=(todo, answers), daemon=True).start()
    for _ in describe_tasks(len(waiting), label):
        answer = answers.get()
        if isinstance(answer, BaseException):
            raise answer
        key, stamp, tables = answer
        if journal:
            journal.add(key, stamp, tables)
        done[key] = tables
    return {task.key: done[task.key] for task in tasks}


def describe_tasks(count: int, label: str) -> Iterator[int]:
    """0 to count - 1; meanwhile a bar on stderr, or a line first and every PAUSE seconds where that is no terminal."""
    if sys.stderr.isatty():
        from tqdm import tqdm  # nothing else has a use for it

        yield from tqdm(range(count), desc=label, file=sys.stderr)
        return
    said = time.monotonic()
    if count:
        print(f"{label}: {count} to do", file=sys.stderr, flush=True)
    for k in range(count):
        yield k
        if time.monotonic() - said > PAUSE:
            said = time.monotonic()
            print(f"{label}: {k + 1} of {count} done", file=sys.stderr, flush=True)


def gather(answers: Iterable[Tables]) -> Tables:
    """All rows by table, in the order of the answers."""
    tables: Tables = {}
    for answer in answers:
        for name, rows in answer.items():
            tables.setdefault(name, []).extend(rows)
    return tables


def _serve(todo: "queue.SimpleQueue[Task | None]", answers: "queue.SimpleQueue[Any]") -> None:
    """One thread with one worker process, taking tasks until there are none."""
    try:
        with Worker() as worker:
            while task := todo.get():
                try:
                    answer = worker.call(task.function, task.arguments, task.limit)
                    answers.put((task.key, task.stamp_of(answer), answer))
                except WorkerFailure as failure:
                    answers.put((task.key, task.stamp_if_lost, task.rows_of_failure(failure)))
    except BaseException as error:
        answers.put(error)


@dataclass(frozen=True)
class Context:
    """A run's surroundings.

    Attributes:
        store: folder of the references.
        stamp: digest of the code, the libraries and the certificates.
        alter: a fault that is planted in what engines are given.
        until, steps: [s] what a user asks for instead of the suite's.
        limit: [s] that one case may take.
    """

    store: str
    stamp: str
    alter: Alteration = is_unaltered
    until: float | None = None
    steps: tuple[float, ...] | None = None
    limit: float = CASE_LIMIT
    _loaded: dict[tuple[str, str], Mechanism] = field(default_factory=dict, repr=False, compare=False)

    def mechanism(self, linkage: str, scenario: str) -> Mechanism:
        """A linkage, read once in a run: hundreds of tasks ask for the same few."""
        if (linkage, scenario) not in self._loaded:
            self._loaded[linkage, scenario] = load(linkage, scenario or None)
        return self._loaded[linkage, scenario]

    def each(self, parts: Iterable[OnLinkages], table: str, function: Callable[..., Tables]) -> list[Task]:
        """A task function(linkage, scenario, part) for each linkage of some parts of a suite."""
        tasks = []
        for part in parts:
            asked = part.model_copy(update={"linkages": {}})
            for place in part.linkages.items():
                task = self.task(table, function, (*place, asked), *place)
                races = getattr(part, "processes", 0)  # of those that race, one after the other
                tasks.append(patient(task, races) if races else task)
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
        """A task that fills a table; `names` begin the row that tells of its failure, `seen` is what else it depends on.

        What every task is given besides, the store, the alteration and the limit, does not name it.
        """
        told = [repr(x) for x in arguments if not any(x is y for y in (self.store, self.alter, self.limit))]
        digest = hashlib.sha256("\n".join([*told, seen]).encode()).hexdigest()[:16]
        start: dict[str, Any] = dict(names)
        stamp = self.stamp
        if linkage:
            mechanism = self.mechanism(linkage, scenario)
            start = place_of(mechanism) | start
            stamp = f"{stamp}.{mechanism.sha256[:16]}"
        key = "|".join([table, function.__name__, linkage, scenario, *map(str, names.values()), digest])
        limit = self.limit if table == "results" else LIMIT
        return Task(key, function, arguments, stamp, table, start, limit)
