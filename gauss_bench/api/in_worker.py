"""Calls of this room's functions in a worker, whose answers are plain data or the sentence of a refusal."""

from collections.abc import Callable
from typing import Any

from gauss_bench.engines import MissingExtra, not_installed
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.runs.worker import Worker, WorkerFailure


def answer_in_worker(
    worker: Worker, function: Callable[..., dict[str, Any]], arguments: tuple[Any, ...], limit: float, file: str
) -> dict[str, Any]:
    """Call a function of this room in a worker, within `limit` seconds; an error names `file`.

    Raises:
        ExchangeError: it refused, or the process failed; MissingExtra: a library is missing.
    """
    try:
        return read_answer(worker.call(function, arguments, limit), file)
    except WorkerFailure as failure:
        raise ExchangeError(f"{file}: {failure}") from failure


def read_answer(answer: object, file: str) -> dict[str, Any]:
    """Return the data of an answer that `tell_plainly` made.

    Raises:
        ExchangeError: the function refused, or gave no such answer for `file`; MissingExtra: a library is missing.
    """
    match answer:
        case {"refused": str(sentence)}:
            raise ExchangeError(sentence)
        case {"missing": str(sentence), "library": str(library)}:
            raise MissingExtra(sentence, name=library)
        case dict():
            return answer
    raise ExchangeError(f"{file}: the process that should answer did not")


def tell_plainly(made: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return a result, or the reason for its failure, as plain data that a worker can send."""
    try:
        return made()
    except ExchangeError as error:
        return {"refused": str(error)}
    except ImportError as error:
        return {"missing": not_installed(error), "library": error.name or ""}
