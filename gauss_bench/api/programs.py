"""Write programs that run a linkage in an engine with a setting; a process that has the engine's library writes them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from gauss_bench.api.in_worker import answer_plainly, read_answer
from gauss_bench.engines.base import Choice
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import WRITERS, add_head, can_export, write_snippet
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.programs import program_there, read_program, writes_programs
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import RunFailure

LIMIT = 60.0  # [s] time limit for writing one program of a report
LARGEST = 30_000  # characters of a program in a report; `gauss-bench export` writes longer ones
BEATS = 50  # samples that a program prints if its integrator chooses its own steps
# errors because of which a report has no program of a setting
UNWRITTEN = (ExchangeError, LinkageError, RunFailure, WorkerFailure, ImportError, ValueError, KeyError)

Call = Callable[[Callable[..., Any], tuple[Any, ...]], Any]  # calls a function with arguments in the process of an engine


def write_program(call: Call, linkage: str, mechanism: Mechanism, engine: str, choice: Choice, remarks: tuple[str, ...]) -> str:
    """Return the text of a program that runs a mechanism over its duration in an engine.

    The program states the name or path `linkage`, and `remarks` in its header comment.

    Raises:
        ExchangeError, RunFailure: a program cannot express the setting, or the engine refuses it.
        MissingExtra: the engine's library is missing; WorkerFailure: its process failed.
    """
    if engine in WRITERS:
        arguments = (mechanism, linkage, engine, choice, mechanism.duration, remarks)
        return str(read_answer(call(answer_plainly, (write_snippet, *arguments)), linkage))
    if writes_programs(engine):
        return add_head(mechanism, read_program(engine, call(program_there, (engine, mechanism, choice))), remarks)
    return write_snippet(mechanism, linkage, engine, choice, mechanism.duration, remarks)


class Wanted(NamedTuple):
    """A setting of an engine in a report, with the end `until` [s] of its run; a step [s] or tolerance is NaN if not used."""

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
        """The setting as the `Choice` that an engine accepts."""
        # for an integrator that chooses its own steps, the step of `Choice` is the time between samples
        step = self.step if math.isfinite(self.step) else self.until / BEATS
        tolerance = self.tolerance if math.isfinite(self.tolerance) else None
        return Choice(self.settings, self.integrator, self.stabilization, step, tolerance)


def programs(wanted: Sequence[tuple[Any, ...]]) -> Mapping[tuple[Any, ...], str]:
    """Return setting (a tuple with the fields of `Wanted`) -> text of a program that runs this setting.

    Settings whose program cannot be written on this machine, or is too long for a report, are left out.
    """
    written: dict[tuple[Any, ...], str] = {}
    with Worker() as worker:
        settings = sorted(map(Wanted._make, wanted), key=lambda x: x.engine)  # in this order each engine starts only once
        for x in settings:
            if not can_export(x.engine, x.integrator, x.stabilization):  # no program can express this setting
                continue
            call = partial(worker.under(interpreter_of(x.engine)).call, limit=LIMIT)
            remarks = (f"The error of this setting over {x.until:g} s is in the report that shows this program.",)
            try:
                mechanism = replace(load(x.linkage, x.scenario), duration=x.until)
                text = write_program(call, x.linkage, mechanism, x.engine, x.choice, remarks)
            except UNWRITTEN:
                continue
            if len(text) <= LARGEST:
                written[x] = text
    return written
