"""Programs for a report's settings: each choice becomes a program for its engine, written in a worker that has the engine."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.snippets import WRITERS, holds, snippet, with_head
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.programs import program_there, read_program, writes_programs
from gauss_bench.runs.worker import Interpreter, Worker, WorkerFailure
from gauss_bench.trajectory import RunFailure

LIMIT = 300.0  # [s] for all programs of an engine
LARGEST = 30_000  # characters: a longer program is left to `gauss-bench export`
BEATS = 50  # samples of a run whose integrator chooses its own steps


def programs(wanted: Sequence[tuple[Any, ...]]) -> Mapping[tuple[Any, ...], str]:
    """Return choice -> program; choices whose engine is not installed, or that cannot be written, are left out.

    A choice is (linkage, scenario, engine, settings, integrator, stabilisation, step [s], tolerance, end of the run [s]).
    """
    written: dict[tuple[Any, ...], str] = {}
    with Worker() as worker:
        for engine in dict.fromkeys(x[2] for x in wanted):
            some = [x for x in wanted if x[2] == engine]
            try:
                if engine not in WRITERS and writes_programs(engine):
                    texts = [_ask_engine(worker, *x) for x in some]
                else:
                    texts = worker.under(Interpreter()).call(write_there, ([list(x) for x in some],), LIMIT)
            except WorkerFailure:
                continue
            written |= {x: text for x, text in zip(some, texts, strict=True) if text}
    return written


def write_there(wanted: list[list[Any]]) -> list[str]:
    """Return the programs of one engine; an empty text for each that cannot be written."""
    return [_write(*x) for x in wanted]


def _ask_engine(worker: Worker, linkage: str, scenario: str, engine: str, *setting: Any) -> str:
    """Return the program that an engine writes itself, or an empty text.

    Raises:
        WorkerFailure: the engine's process failed.
    """
    choice, until = _read_setting(*setting)
    try:
        mechanism = replace(load(linkage, scenario), duration=until)
        answer = worker.under(interpreter_of(engine)).call(program_there, (engine, mechanism, choice), LIMIT)
        text = with_head(mechanism, read_program(engine, answer), (remark_on(until),))
    except (LinkageError, RunFailure, ValueError, KeyError):
        return ""
    return text if len(text) <= LARGEST else ""


def remark_on(until: float) -> str:
    """Return the sentence on the error of a program, for its head."""
    return f"The error of this setting over {until:g} s is in the report that shows this program."


def _read_setting(
    settings: str, integrator: str, stabilization: str, step: float, tolerance: float, until: float
) -> tuple[Choice, float]:
    """Return a choice and the end of its run [s]; a step or tolerance that is not finite is not given."""
    exact = tolerance if math.isfinite(tolerance) else None
    return Choice(settings, integrator, stabilization, step if math.isfinite(step) else until / BEATS, exact), until


def _write(linkage: str, scenario: str, engine: str, *setting: Any) -> str:
    """Return the program of a choice, or an empty text if it cannot be written."""
    choice, until = _read_setting(*setting)
    if not holds(engine, choice.integrator, choice.stabilization):
        return ""
    try:
        mechanism = replace(load(linkage, scenario), duration=until)
        text = snippet(mechanism, linkage, engine, choice, until, (remark_on(until),))
    except (ExchangeError, LinkageError, RunFailure, ImportError, ValueError, KeyError):
        return ""
    return text if len(text) <= LARGEST else ""
