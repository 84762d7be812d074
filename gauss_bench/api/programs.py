"""Programs for settings: an engine with a setting becomes a program, written in a process that has the engine's library."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

from gauss_bench.api.in_worker import read_answer, tell_plainly
from gauss_bench.engines.base import Choice
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.snippets import WRITERS, holds, snippet, with_head
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.programs import program_there, read_program, writes_programs
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import RunFailure

LIMIT = 60.0  # [s] for a program of a report
LARGEST = 30_000  # characters: a longer program is left to `gauss-bench export`
BEATS = 50  # samples of a run whose integrator chooses its own steps, in a report
UNWRITTEN = (ExchangeError, LinkageError, RunFailure, WorkerFailure, ImportError, ValueError, KeyError)

Call = Callable[[Callable[..., Any], tuple[Any, ...]], Any]  # calls a function with arguments in the process of an engine


def write_program(call: Call, linkage: str, mechanism: Mechanism, engine: str, choice: Choice, remarks: tuple[str, ...]) -> str:
    """Return the program that runs a mechanism over its duration in an engine; `linkage` is its name or path in the program.

    Raises:
        ExchangeError, RunFailure: the program cannot express this, or the engine refuses it.
        MissingExtra: the engine's library is missing; WorkerFailure: its process failed.
    """
    if engine in WRITERS:
        arguments = (linkage, mechanism.scenario, mechanism.duration, engine, choice, remarks)
        return str(read_answer(call(snippet_there, arguments), linkage)["text"])
    if writes_programs(engine):
        return with_head(mechanism, read_program(engine, call(program_there, (engine, mechanism, choice))), remarks)
    return snippet(mechanism, linkage, engine, choice, mechanism.duration, remarks)


def snippet_there(
    linkage: str, scenario: str, until: float, engine: str, choice: Choice, remarks: tuple[str, ...]
) -> dict[str, Any]:
    """Run `snippet` in the worker and return plain data."""
    mechanism = load_until(linkage, scenario, until)
    return tell_plainly(lambda: {"text": snippet(mechanism, linkage, engine, choice, until, remarks)})


@lru_cache(maxsize=32)
def load_until(linkage: str, scenario: str, until: float) -> Mechanism:
    """Load a built-in linkage for a run of another duration `until` [s]; a report asks for each of them some sixty times.

    Raises:
        LinkageError: as `load`.
    """
    return replace(load(linkage, scenario), duration=until)


class Wanted(NamedTuple):
    """A setting of a report; a step [s] or tolerance that is not finite is not given, and `until` [s] ends the run."""

    linkage: str
    scenario: str
    engine: str
    settings: str
    integrator: str
    stabilization: str
    step: float
    tolerance: float
    until: float

    @property
    def choice(self) -> Choice:
        """The setting as an engine takes it."""
        step = self.step if math.isfinite(self.step) else self.until / BEATS
        tolerance = self.tolerance if math.isfinite(self.tolerance) else None
        return Choice(self.settings, self.integrator, self.stabilization, step, tolerance)


def programs(wanted: Sequence[tuple[Any, ...]]) -> Mapping[tuple[Any, ...], str]:
    """Return setting (as the fields of Wanted) -> program; a setting whose program cannot be written here is left out."""
    written: dict[tuple[Any, ...], str] = {}
    with Worker() as worker:
        for x in sorted(map(Wanted._make, wanted), key=lambda x: x.engine):  # which starts each engine once
            if not holds(x.engine, x.integrator, x.stabilization):
                continue
            call = partial(worker.under(interpreter_of(x.engine)).call, limit=LIMIT)
            remarks = (f"The error of this setting over {x.until:g} s is in the report that shows this program.",)
            try:
                mechanism = load_until(x.linkage, x.scenario, x.until)
                text = write_program(call, x.linkage, mechanism, x.engine, x.choice, remarks)
            except UNWRITTEN:
                continue
            if len(text) <= LARGEST:
                written[x] = text
    return written
