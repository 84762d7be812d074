"""Costs: everything that is timed on a linkage, in one interleaved race, and its columns in the results.

Each engine at its variants is asked for a model and its first step ("build"), an acceleration from Python ("acceleration"), a step
called from Python ("step") and one in its own loop ("native_step"). Where engines have them, the bare library call and what calling
costs ("bare call", "empty call") and steps of many trajectories at once ("batch step") race along, and so may the processor's own
latency and rate. Every other table of times on these linkages is worked out from the same samples: a quantity has one value.
"""

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from gauss_bench.bench.cases import variants
from gauss_bench.bench.clock import Block, Key, Measured, Missing, Race, lasting, over_processes, ratio, stepping, time_of
from gauss_bench.bench.context import Context
from gauss_bench.bench.measurements.processor import processor
from gauss_bench.bench.survived import Watch, list_survivors, patient, watching
from gauss_bench.bench.tasks import Rows, Tables, Task
from gauss_bench.engines import get, names
from gauss_bench.engines.base import Choice, Engine
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import offer
from gauss_bench.suites.schema import Cost, Suite
from gauss_bench.trajectory import RunFailure, Status

BASELINE = "gauss"  # costs are ratios to this engine: the formulation the suite is about, and the one its authors wrote
BUILD, ACCELERATION, STEP, NATIVE = "build", "acceleration", "step", "native_step"
COLD = "cold build"
BARE, EMPTY, BATCH = "bare call", "empty call", "batch step"
TRAJECTORIES = 128  # in a batch: enough that a call from Python does not count
BATCH_STEPS = 200  # of each of them

Make = Callable[[], Block]


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """A race for each linkage and process, of the engines that can share one: they have neither crashed nor hung on it.

    Those of a linkage lie apart in time, so that what disturbs the machine for a minute is in few of them.
    """
    lost = {(r["mechanism"], r["engine"]) for r in tables.get("results", []) if r["status"] in (Status.CRASHED, Status.TIMEOUT)}
    tasks = []
    for part in suite.cost:
        for number, (linkage, scenario) in product(range(part.processes), part.linkages.items()):
            name = load(linkage, scenario or None).name
            fit = tuple(x for x in part.engines or names() if (name, x) not in lost and offer(x).usable)
            chosen = part.model_copy(update={"engines": fit, "linkages": {linkage: scenario}})
            task = context.task("untimed", race_cost, (linkage, scenario, chosen, number), linkage, scenario)
            tasks.append(patient(task))
    return tasks


def race_cost(linkage: str, scenario: str, part: Cost, number: int) -> Tables:
    """Run `race`; an engine that crashes or hangs in it is left out, with the reason at everything it was to be timed at."""
    tables, lost = list_survivors(_race_of, (linkage, scenario, part, number), part.engines)
    mechanism = load(linkage, scenario or None)
    start = {"mechanism": mechanism.name, "scenario": mechanism.scenario}
    for engine, failure in lost.items():
        tables["untimed"] += [start | key._asdict() | failure.told for key, _ in entries(mechanism, part) if key.engine == engine]
    return tables


def _race_of(linkage: str, scenario: str, part: Cost, number: int, engines: Sequence[str], path: str) -> Tables:
    return race(linkage, scenario, part.model_copy(update={"engines": tuple(engines)}), number, watching(path))


def race(linkage: str, scenario: str, part: Cost, number: int = 0, watch: Watch = id) -> Tables:
    """Seconds per repetition of every entry in every round, and what could not be timed. Call it in a process of its own."""
    mechanism = load(linkage, scenario or None)
    start = {"mechanism": mechanism.name, "scenario": mechanism.scenario}
    entered = Race(watch)
    for key, make in entries(mechanism, part):
        entered.add(key, make)
    for key, make in processor() if part.processor else ():
        entered.add(key, make)
    measured = entered.run(part.rounds)
    samples = [
        start | key._asdict() | {"step": part.step, "process": number, "round": k, "seconds": float(x)}
        for key, values in measured.samples.items()
        if isinstance(key, Key)
        for k, x in enumerate(values[0])
        if math.isfinite(x)
    ]
    lost = [
        start | key._asdict() | {"status": str(missing.status), "message": str(missing)}
        for key, missing in measured.failed.items()
        if isinstance(key, Key)
    ]
    return {"samples": samples, "untimed": lost}


def entries(mechanism: Mechanism, part: Cost) -> Iterator[tuple[Key, Make]]:
    """The entries of a race, each with how its block is made."""
    for name in part.engines:
        engine, told = get(name), offer(name)
        for number, (settings, integrator, stabilization) in enumerate(variants(told, part.integrators, name in part.plain)):
            if integrator in told.adaptive:
                continue
            choice = Choice(settings, integrator, stabilization, part.step)
            model = cache(partial(_model, engine, mechanism, choice))
            words = (name, settings, integrator, stabilization)
            if (integrator, stabilization) == (told.integrators[0], "none"):
                yield Key(BUILD, *words), partial(_building, engine, mechanism, choice)
                yield Key(ACCELERATION, *words), partial(_accelerating, model, mechanism)
                if name in part.bare:
                    for which, quantity in enumerate((BARE, EMPTY)):
                        yield Key(quantity, *words), partial(_bare, model, which)
            if told.python_loop:
                yield Key(STEP, *words), partial(_stepping, model, part.step, False)
            if told.native_loop:
                yield Key(NATIVE, *words), partial(_stepping, model, part.step, True)
            if name in part.batch and number == 0:
                yield Key(BATCH, *words), partial(_batch, model, mechanism)


def _model(engine: Engine, mechanism: Mechanism, choice: Choice) -> Any:
    if reason := engine.skip(mechanism, choice):
        raise RunFailure(Status.SKIP, reason)
    return engine.build(mechanism, choice)


def _building(engine: Engine, mechanism: Mechanism, choice: Choice) -> Block:
    return lasting(None, lambda: first_step(engine, mechanism, choice))


def first_step(engine: Engine, mechanism: Mechanism, choice: Choice) -> None:
    """Take one step, so that everything generated or compiled at first need is there."""
    model = _model(engine, mechanism, choice)
    model.prepare(np.array([0.0, choice.step]))
    model.run()


def _accelerating(model: Callable[[], Any], mechanism: Mechanism) -> Block:
    asked = model().acceleration
    return lasting(None, lambda: asked(0.0, mechanism.q0, mechanism.v0))


def _bare(model: Callable[[], Any], which: int) -> Block:
    return lasting(None, model().bare_calls()[which])


def _stepping(model: Callable[[], Any], step: float, native: bool) -> Block:
    return stepping(None, model(), step, native)


def _batch(model: Callable[[], Any], mechanism: Mechanism) -> Block:
    """All from the start: here only formulations are compared."""
    q, v = (np.tile(x, (TRAJECTORIES, 1)) for x in (mechanism.q0, mechanism.v0))
    return lasting(None, model().batch(q, v, BATCH_STEPS), BATCH_STEPS * TRAJECTORIES)


def gather_by_linkage(tables: Tables) -> dict[tuple[str, str], Measured]:
    """Gather the races' results by mechanism and scenario."""
    samples: dict[tuple[str, str], dict[Key, dict[int, list[float]]]] = {}
    failed: dict[tuple[str, str], dict[Hashable, Missing]] = {}
    for row in sorted(tables.get("samples", []), key=lambda r: r["round"]):
        samples.setdefault(_place(row), {}).setdefault(_key(row), {}).setdefault(row["process"], []).append(row["seconds"])
    for row in tables.get("untimed", []):
        if "quantity" in row:
            failed.setdefault(_place(row), {})[_key(row)] = Missing(Status(row["status"]), row["message"])
    places = dict.fromkeys(_place(row) for name in ("samples", "untimed") for row in tables.get(name, []))
    return {x: Measured(over_processes(samples.get(x, {})), failed.get(x, {})) for x in places}


def _place(row: dict[str, Any]) -> tuple[str, str]:
    return row["mechanism"], row["scenario"]


def _key(row: dict[str, Any]) -> Key:
    return Key(*(row[field] for field in Key._fields))


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in the cost columns of the results, and tell once what no process could time."""
    if "untimed" in tables:
        tables["untimed"] = [dict(x) for x in dict.fromkeys(tuple(r.items()) for r in tables["untimed"])]
    with_costs(tables.get("results", []), gather_by_linkage(tables))


def with_costs(rows: Rows, races: dict[tuple[str, str], Measured]) -> None:
    """Give each row the times of its variant, and their ratios to the baseline's; steps cost the same whatever their length."""
    columns = cache(partial(_columns, races))
    for row in rows:
        row |= columns(*(row[k] for k in ("mechanism", "scenario", "engine", "settings", "integrator", "stabilization")))


def _columns(
    races: dict[tuple[str, str], Measured], mechanism: str, scenario: str, engine: str, settings: str, *rest: str
) -> dict[str, float]:
    """The cost columns of a variant."""
    samples = races[mechanism, scenario].samples if (mechanism, scenario) in races else {}
    columns: dict[str, float] = {}
    for quantity in (BUILD, COLD, ACCELERATION, STEP, NATIVE):
        keys = [k for k in samples if isinstance(k, Key) and k[:3] == (quantity, engine, settings)]
        own = keys if quantity in (BUILD, COLD, ACCELERATION) else [k for k in keys if k[3:] == rest]
        if not own:
            continue
        seconds = samples[own[0]]
        columns[f"{quantity.replace(' ', '_')}_time"] = time_of(seconds)
        baseline = samples.get(Key(ACCELERATION if quantity == ACCELERATION else STEP, BASELINE))
        if baseline is not None and quantity not in (BUILD, COLD):
            names = (f"{quantity}_{k}" for k in ("ratio", "ratio_low", "ratio_high"))
            columns |= dict(zip(names, ratio(seconds, baseline), strict=True))
    return columns
