"""Time to solution at equal accuracy: what each method takes to reach an error, at the largest step with which it does.

First, ladders: every method is run at a step of FIRST and then at half of it, again and again, until the linkage's measured
coordinate at one second is as near the certified one as the finest accuracy asks, or cannot be: a run would take longer than the
cap, its error has stopped falling, or the run fails. The error is that at one time, so that it may be small by chance on one rung;
the largest step within an accuracy is taken all the same, for all methods alike. A method that chooses its steps itself has one
rung.

Then a race of all methods over the same second of motion. Runs longer than the suite's lead are cut to their first part, and their
time is scaled by what is left out: steps cost the same all along, but for a few per cent of Newton iterations. Ratios are taken to
the fastest way of the suite's own engine.
"""

import hashlib
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.bench.apart import Request, run_of
from gauss_bench.bench.clock import BLOCK, Block, Measured, Race, Row, common, ratio, row, spread
from gauss_bench.bench.context import Context
from gauss_bench.bench.offers import offer
from gauss_bench.bench.one_run import sampling_at
from gauss_bench.bench.tasks import LIMIT, Rows, Tables, Task
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, Model
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import state_errors
from gauss_bench.reference.store import stored_reference
from gauss_bench.suites.schema import EqualAccuracy, Method, Suite
from gauss_bench.trajectory import Reference, Status

AT = 1.0  # [s]
FIRST = 1e-2  # [s]
RUNGS = 20
SHORT = 0.1  # [s] a run that is over sooner is repeated: the first finds the processor's caches empty
STALLED = 3  # halvings without ...
FALLS = 0.7  # ... the least error falling below so much of itself: even a method of first order halves it
COARSE = ("nan", "diverged", "not_converged", "warning", "error")  # a failure that a smaller step may mend
CANNOT = "cannot reach"


def exact(suite: Suite, context: Context) -> list[Task]:
    """One ladder for each linkage and method."""
    return [
        context.task("kernel_ladder", ladder, (*x, way, min(part.accuracies), part.cap, context.store), *x, **way.model_dump())
        for part in suite.equal_accuracy
        for x in part.linkages.items()
        for way in part.methods
    ]


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """One race for each linkage, given what its ladders reached."""
    tasks = []
    for part in suite.equal_accuracy:
        for linkage, scenario in part.linkages.items():
            mechanism = load(linkage, scenario or None)
            place = (mechanism.name, mechanism.scenario)
            rungs = [r for r in tables.get("kernel_ladder", []) if (r["mechanism"], r["scenario"]) == place]
            seen = hashlib.sha256(json.dumps(rungs, sort_keys=True).encode()).hexdigest()
            only = part.model_copy(update={"linkages": {linkage: scenario}})
            arguments = (linkage, scenario, only, rungs)
            tasks.append(context.task("kernel_accuracy", equal_accuracy, arguments, linkage, scenario, seen))
    return tasks


def choice_of(way: Method, step: float) -> Choice:
    return Choice(way.settings, way.integrator, way.stabilization, step)


def ladder(linkage: str, scenario: str, way: Method, finest: float, cap: float, store: str) -> Tables:
    """Errors at every step tried; the last row tells why no smaller one was."""
    mechanism = load(linkage, scenario or None)
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, **way.model_dump()}
    reference = stored_reference(mechanism, AT, Path(store))
    own_steps = way.integrator in offer(way.engine).adaptive
    rows: Rows = []
    for rung in range(1 if own_steps else RUNGS):
        told = measured(linkage, mechanism, reference, way, FIRST / 2**rung, own_steps)
        if told["status"] == Status.SKIP:
            return {"kernel_ladder": [start | told | {"step": None, "ended": told["message"]}]}
        rows.append(start | told)
        if reason := why_ended(rows, finest, cap):
            break
    rows[-1]["ended"] = reason or ("it chooses its steps itself" if own_steps else f"{RUNGS} steps were tried")
    return {"kernel_ladder": rows}


def measured(linkage: str, mechanism: Mechanism, reference: Reference, way: Method, step: float, own_steps: bool) -> Row:
    """One rung: errors after one second, and the seconds it takes."""
    told: Row = {"step": None if own_steps else step}
    wanted = sampling_at(step, [0.0, AT])
    request = Request(linkage, mechanism.scenario, way.engine, choice_of(way, step), wanted, partial(first_step, step), SHORT)
    run = run_of(request, mechanism, LIMIT)
    if run.trajectory is None:
        return told | {"seconds": run.seconds, "status": str(run.status), "message": run.message}
    errors = state_errors(mechanism, run.trajectory, reference)
    named: Row = {"seconds": run.seconds, "measured": mechanism.measured.name, "measured_unit": mechanism.measured.unit}
    told |= {"error": float(errors.measured[-1]), "error_bar": float(errors.position_bar[-1])}
    apart = {"length_error": float(errors.length[-1].max()), "angle_error": float(errors.angle[-1].max())}
    return told | named | apart | {"status": str(Status.OK), "message": ""}


def first_step(step: float, model: Model) -> None:
    """One step that is not timed: it waits for code to be generated and compiled."""
    model.prepare(np.array([0.0, step]))
    model.run()


def why_ended(rows: Sequence[Row], finest: float, cap: float) -> str:
    """Why a ladder ends with its last row, or an empty text."""
    last = rows[-1]
    if last["status"] != Status.OK and last["status"] not in COARSE:
        return str(last["message"])
    errors = [float(row["error"]) if row["status"] == Status.OK else np.inf for row in rows]
    if errors[-1] <= finest:
        return "the finest target is reached"
    if last.get("seconds", 0.0) > cap / 2:
        return f"half the step would take longer than {cap:g} s"
    before, after = min(errors[:-STALLED], default=np.inf), min(errors[-STALLED:])
    if np.isfinite(before) and after > FALLS * before:
        return f"the error has not fallen in {STALLED} halvings"
    return ""


def largest_step(rows: Sequence[Row], target: float) -> Row | None:
    """The first row whose error is within the target, which has the largest step; None where there is none."""
    return next((r for r in rows if r["status"] == Status.OK and r["error"] <= target), None)


def smallest_error(rows: Sequence[Row]) -> Row | None:
    """The row with the smallest error; None where no run ended."""
    return min((r for r in rows if r["status"] == Status.OK), key=lambda r: float(r["error"]), default=None)


def equal_accuracy(linkage: str, scenario: str, part: EqualAccuracy, rungs: Rows) -> Tables:
    """Times to every accuracy; `rungs` are the rows of all ladders of the linkage."""
    mechanism = load(linkage, scenario or None)
    ladders = [(way, [r for r in rungs if all(r[k] == x for k, x in way.model_dump().items())]) for way in part.methods]
    return {"kernel_accuracy": [r for target in part.accuracies for r in _at(mechanism, target, ladders, part)]}


def _at(mechanism: Mechanism, target: float, ladders: Sequence[tuple[Method, Rows]], part: EqualAccuracy) -> Rows:
    """The rows of one accuracy, raced."""
    race, reached = Race(), {way: largest_step(rungs, target) for way, rungs in ladders}
    for way, rung in reached.items():
        if rung is not None:
            race.add(way, _block, mechanism, way, rung, part.lead)
    measured = race.run(part.rounds)
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "accuracy": target}
    rows = [_row(start, way, rungs, reached[way], measured) for way, rungs in ladders]
    return with_ratios(rows, measured, part.own)


def lead_time(rung: Row, lead: float) -> float:
    """How much of the motion is timed [s]: all of it, or as many whole steps as take about `lead` seconds."""
    share = min(1.0, lead / max(float(rung["seconds"]), 1e-9))
    if share == 1.0 or not rung["step"]:
        return share * AT
    step = float(rung["step"])
    return min(AT, max(1, round(share * AT / step)) * step)


def _block(mechanism: Mechanism, way: Method, rung: Row, lead: float) -> Block:
    """A run of the method at the step of its rung; a repetition is the whole second, of which only a part may be run.

    Before a run that is shorter than a block should be, another one warms the processor's caches.
    """
    model = get(way.engine).build(mechanism, choice_of(way, float(rung["step"] or FIRST)))
    until = lead_time(rung, lead)
    times, warm = np.array([0.0, until]), float(rung["seconds"]) < BLOCK

    def ready() -> None:
        model.prepare(times)
        if warm:
            model.run()
            model.prepare(times)

    return Block(way, ready, model.run, until / AT)


def _row(start: Row, way: Method, rungs: Rows, rung: Row | None, measured: Measured) -> Row:
    """What a method takes to reach the accuracy; without a rung that does, how near it came and why it went no further."""
    ended = str(rungs[-1].get("ended") or rungs[-1]["message"])
    start = start | way.model_dump() | {"ended": ended}
    if rung is not None:
        return row(start | {"step": rung["step"]} | errors_of(rung), lambda: spread("seconds", measured.of(way)))
    best = smallest_error(rungs)
    if best is None:
        return start | {"status": rungs[-1]["status"], "message": rungs[-1]["message"]}
    at = f" at step {best['step']:.2g} s" if best["step"] else ""
    text = f"came to {best['error']:.1e} {best['measured_unit']}{at}; {ended}"
    return start | {"step": best["step"]} | errors_of(best) | {"status": CANNOT, "message": text}


def errors_of(rung: Row) -> Row:
    """What a row of a ladder says of its error: of which coordinate, and of all links."""
    return {k: rung[k] for k in ("measured", "measured_unit", "error", "length_error", "angle_error")}


def with_ratios(rows: Rows, measured: Measured, own: str) -> Rows:
    """Rows with `best`, whether they are their engine's fastest, and their time over that of the own engine's fastest."""
    ended = [r for r in rows if r["status"] == Status.OK]
    fastest = {e: min((r for r in ended if r["engine"] == e), key=_seconds) for e in {r["engine"] for r in ended}}
    base = measured.of(_way(fastest[own])) if own in fastest else None
    told = []
    for r in rows:
        ratios: dict[str, Any] = {}
        if r["status"] == Status.OK and base is not None:
            values = ratio(*common(measured.of(_way(r)), base))
            ratios = dict(zip(("ratio", "ratio_low", "ratio_high"), values, strict=True))
        told.append(r | {"best": r is fastest.get(r["engine"])} | ratios)
    return told


def _seconds(r: Row) -> float:
    return float(r["seconds"])


def _way(r: Row) -> Method:
    return Method(**{k: r[k] for k in Method.model_fields})
