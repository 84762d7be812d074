"""Time to solution at equal accuracy: what each method takes to reach an error, at the largest step with which it does.

Methods race over the same second of motion. Runs longer than the effort's lead are cut to their first part, and their time is
scaled by the steps left out: steps cost the same all along, but for a few per cent of Newton iterations. Ratios are taken to the
fastest of the compiled formulation's own ways.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gauss_bench.bench.clock import BLOCK, Block
from gauss_bench.bench.kernel_timing import Measured, Race, Row, compared, row, spread
from gauss_bench.bench.measurements.ladder import AT, TARGETS, Method, largest_step, smallest_error
from gauss_bench.engines import get
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import Status

OWN = "gauss-native"
ROUNDS = 3  # an entry is timed in a third of the effort's rounds: there are many, and long ones
CANNOT = "cannot reach"
Ladders = Sequence[tuple[Method, Sequence[Row], str]]


def equal_accuracy(linkage: str, scenario: str, ladders: Ladders, rounds: int, lead: float) -> dict[str, Any]:
    """Times to both targets, {"kernel_accuracy": [...]}; `ladders` says of each method what it reached and why it ended."""
    mechanism = load(linkage, scenario or None)
    rows = [row for target in TARGETS for row in _at(mechanism, target, ladders, max(3, rounds // ROUNDS), lead)]
    return {"kernel_accuracy": rows}


def _at(mechanism: Mechanism, target: float, ladders: Ladders, rounds: int, lead: float) -> list[Row]:
    """The rows of one target, raced."""
    race, found = Race(), {method: largest_step(steps, target) for method, steps, _ in ladders}
    for method, rung in found.items():
        if rung is not None:
            race.add(method, _block, mechanism, method, rung, lead)
    measured = race.run(rounds)
    rows = [_row(mechanism, target, *entry, found[entry[0]], measured) for entry in ladders]
    return with_ratios(rows, measured)


def lead_time(rung: Row, lead: float) -> float:
    """How much of the motion is timed [s]: all of it, or as many whole steps as take about `lead` seconds."""
    share = min(1.0, lead / max(float(rung["seconds"]), 1e-9))
    return AT if share == 1.0 else min(AT, max(1, round(share * AT / rung["step"])) * float(rung["step"]))


def _block(mechanism: Mechanism, method: Method, rung: Row, lead: float) -> Block:
    """A run of the method at the step of its rung; a repetition is the whole second, of which only a part may be run.

    Before a run that is shorter than a block should be, another one warms the processor's caches.
    """
    model = get(method.engine).build(mechanism, method.choice(float(rung["step"])))
    until = lead_time(rung, lead)
    times, warm = np.array([0.0, until]), float(rung["seconds"]) < BLOCK

    def ready() -> None:
        model.prepare(times)
        if warm:
            model.run()
            model.prepare(times)

    return Block(method, ready, model.run, until / AT)


def _row(
    mechanism: Mechanism, target: float, method: Method, steps: Sequence[Row], ended: str, rung: Row | None, measured: Measured
) -> Row:
    """What a method takes to reach the target; without a rung that does, how near it came and why it was followed no further."""
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "accuracy": target, **asdict(method), "ended": ended}
    if rung is not None:
        known = {"step": rung["step"], "error": rung["error"]}
        return row(start | known, _seconds_of, measured, method)
    best = smallest_error(steps)
    if best is None:
        return start | {"status": steps[-1]["status"], "message": steps[-1]["message"]}
    text = f"came to {best['error']:.1e} rad at step {best['step']:.2g} s; {ended}"
    return start | {"step": best["step"], "error": best["error"], "status": CANNOT, "message": text}


def _seconds_of(measured: Measured, method: Method) -> Row:
    return spread("seconds", measured.of(method))


def with_ratios(rows: list[Row], measured: Measured) -> list[Row]:
    """Rows with `best`, whether they are their engine's fastest, and their time over that of the compiled formulation's fastest."""
    timed_rows = [r for r in rows if r["status"] == Status.OK]
    fastest = {e: min((r for r in timed_rows if r["engine"] == e), key=_seconds) for e in {r["engine"] for r in timed_rows}}
    if OWN not in fastest:
        return [r | {"best": r is fastest.get(r["engine"])} for r in rows]
    base = measured.of(_method(fastest[OWN]))
    found = []
    for r in rows:
        ratios = {}
        if r["status"] == Status.OK:
            ratios = {k: x for k, x in compared(base, measured.of(_method(r))).items() if k.startswith("ratio")}
        found.append(r | {"best": r is fastest.get(r["engine"])} | ratios)
    return found


def _seconds(r: Row) -> float:
    return float(r["seconds"])


def _method(r: Row) -> Method:
    return Method(r["engine"], r["settings"], r["integrator"], r["stabilization"])
