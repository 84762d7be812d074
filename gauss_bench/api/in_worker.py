"""Call functions that return plain data or refuse with a sentence, in a worker."""

from collections.abc import Callable
from typing import Any

from gauss_bench.engines import MissingExtra, not_installed
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.runs.worker import Worker, WorkerFailure


def answer_in_worker(
    worker: Worker, function: Callable[..., dict[str, Any]], arguments: tuple[Any, ...], limit: float, file: str
) -> dict[str, Any]:
    """Return the answer of a function that a worker calls within `limit` seconds; errors name `file`.

    Raises:
        ExchangeError: the function refused, or the process failed; MissingExtra: a library is missing.
    """
    try:
        return read_answer(worker.call(answer_plainly, (function, *arguments), limit), file)
    except WorkerFailure as failure:
        raise ExchangeError(f"{file}: {failure}") from failure


def read_answer(answer: object, file: str) -> dict[str, Any]:
    """Return the data of an answer that `answer_plainly` made; errors name `file`.

    Raises:
        ExchangeError: the function refused, or the answer is something else; MissingExtra: a library is missing.
    """
    match answer:
        case {"refused": str(sentence)}:
            raise ExchangeError(sentence)
        case {"missing": str(sentence), "library": str(library)}:
            raise MissingExtra(sentence, name=library)
        case dict():
            return answer
    raise ExchangeError(f"{file}: the worker did not answer")


def answer_plainly(function: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """Return a function's answer, or the reason for its refusal, as plain data that a worker can send."""
    try:
        return function(*arguments)
    except ExchangeError as error:
        return {"refused": str(error)}
    except ImportError as error:
        return {"missing": not_installed(error), "library": error.name or ""}
