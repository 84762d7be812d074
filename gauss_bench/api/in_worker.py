"""Call functions in a worker process. They return plain data, or raise an error whose message says why they refuse their input.

A result that is a dataclass comes back as a dictionary of its fields.
"""

from collections.abc import Callable
from dataclasses import asdict, is_dataclass
from typing import Any

from gauss_bench.engines import MissingExtra, not_installed
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.runs.worker import Worker, WorkerFailure


def answer_in_worker(worker: Worker, function: Callable[..., Any], arguments: tuple[Any, ...], limit: float, file: str) -> Any:
    """Call a function in a worker process within `limit` seconds, and return its result; error messages mention `file`.

    Raises:
        ExchangeError: the function refused its input, or the worker process failed.
        MissingExtra: a library is missing.
    """
    try:
        return read_answer(worker.call(answer_plainly, (function, *arguments), limit), file)
    except WorkerFailure as failure:
        raise ExchangeError(f"{file}: {failure}") from failure


def read_answer(answer: object, file: str) -> Any:
    """Return the data in an answer of `answer_plainly`; error messages mention `file`.

    Raises:
        ExchangeError: the function refused its input, or `answer` is no result of `answer_plainly`.
        MissingExtra: a library is missing.
    """
    match answer:
        case {"refused": str(sentence)}:
            raise ExchangeError(sentence)
        case {"missing": str(sentence), "library": str(library)}:
            raise MissingExtra(sentence, name=library)
        case {"answer": data}:
            return data
    raise ExchangeError(f"{file}: the worker did not answer")


def answer_plainly(function: Callable[..., Any], *arguments: Any) -> dict[str, Any]:
    """Call a function, and return its result, or the reason why it refused its input, as plain data that a worker can send."""
    try:
        result = function(*arguments)
        return {"answer": asdict(result) if is_dataclass(result) and not isinstance(result, type) else result}
    except ExchangeError as error:
        return {"refused": str(error)}
    except ImportError as error:
        return {"missing": not_installed(error), "library": error.name or ""}
