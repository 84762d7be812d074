"""Programs for a report's settings: each choice becomes a program for its engine, written in a worker that has the engine."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gauss_bench.engines.base import Choice
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.snippets import holds, snippet
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.linkage.load import load
from gauss_bench.runs.worker import Worker, WorkerFailure
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
                texts = worker.call(write_there, ([list(x) for x in some],), LIMIT)
            except WorkerFailure:
                continue
            written |= {x: text for x, text in zip(some, texts, strict=True) if text}
    return written


def write_there(wanted: list[list[Any]]) -> list[str]:
    """Return the programs of one engine; an empty text for each that cannot be written."""
    return [_write(*x) for x in wanted]


def _write(linkage: str, scenario: str, engine: str, settings: str, integrator: str, stabilization: str, *sizes: float) -> str:
    step, tolerance, until = sizes
    if not holds(engine, integrator, stabilization):
        return ""
    exact = tolerance if math.isfinite(tolerance) else None
    choice = Choice(settings, integrator, stabilization, step if math.isfinite(step) else until / BEATS, exact)
    try:
        mechanism = replace(load(linkage, scenario), duration=until)
        remark = f"The error of this setting over {until:g} s is in the report that shows this program."
        text = snippet(mechanism, linkage, engine, choice, until, (remark,))
    except (ExchangeError, LinkageError, RunFailure, ImportError, ValueError, KeyError):
        return ""
    return text if len(text) <= LARGEST else ""
