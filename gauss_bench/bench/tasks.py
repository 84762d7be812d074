"""Tasks answered in worker processes: named, resumable, and never lost with the worker."""

import queue
import sys
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

from tqdm import tqdm

from gauss_bench.bench.journal import Journal
from gauss_bench.bench.worker import Worker, WorkerFailure


class Task(NamedTuple):
    """What a worker is asked: function(*arguments), known by `key`; `stamp` says what the answer depends on."""

    key: str
    function: Callable[..., dict[str, Any]]
    arguments: tuple[Any, ...]
    stamp: str


def finish(tasks: list[Task], jobs: int, limit: float, label: str, journal: Journal | None = None) -> dict[str, dict[str, Any]]:
    """Answers of all tasks by key: from the journal where they stand there, else from workers."""
    done = {task.key: entry for task in tasks if journal and (entry := journal.finished(task.key, task.stamp))}
    waiting = {task.key: task for task in tasks if task.key not in done}
    todo: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
    answers: queue.SimpleQueue[tuple[str, dict[str, Any]] | BaseException] = queue.SimpleQueue()
    workers = min(jobs, len(waiting))
    for item in [*waiting.values(), *[None] * workers]:
        todo.put(item)
    for _ in range(workers):
        threading.Thread(target=_serve, args=(todo, answers, limit), daemon=True).start()
    for _ in tqdm(waiting, desc=label, disable=not sys.stderr.isatty(), file=sys.stderr):
        answer = answers.get()
        if isinstance(answer, BaseException):
            raise answer
        key, content = answer
        if journal:
            journal.add(key, waiting[key].stamp, content)
        done[key] = content
    return done


def _serve(todo: "queue.SimpleQueue[Task | None]", answers: "queue.SimpleQueue[Any]", limit: float) -> None:
    """One thread with one worker process, taking tasks until there are none."""
    try:
        with Worker() as worker:
            while task := todo.get():
                try:
                    answers.put((task.key, worker.call(task.function, task.arguments, limit)))
                except WorkerFailure as failure:
                    answers.put((task.key, {"row": {"status": str(failure.status), "message": str(failure)}}))
    except BaseException as error:
        answers.put(error)
