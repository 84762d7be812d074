"""Measure costs on a linkage in one interleaved race, and fill in the cost columns of the results.

The entries of each engine at its variants are a model and its first step ("build"), an acceleration called from Python
("acceleration"), a step called from Python ("step") and a step in the engine's own loop ("native_step"). Some engines also have the
bare library call ("bare call"), the cost of calling alone ("empty call") and steps of many trajectories at once ("batch step"). The
processor's latency and rate may take part. Every other table of times on these linkages is computed from the same samples, so that
a quantity has one value.

A "cold build" is the first model in a new process with no generated code stored; for a "build" all generated code is stored.
"""

from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from gauss_bench.bench.cases import variants
from gauss_bench.bench.clock import Key, Measured, gather_rounds, key_of, ratio, time_of
from gauss_bench.bench.measurements.processor import PROCESSOR, processor
from gauss_bench.bench.survived import race_survivors
from gauss_bench.bench.tasks import LIMIT, Context, Rows, Tables, Task, patient, place_of
from gauss_bench.engines import environment_of, get, names
from gauss_bench.engines.base import Choice, Engine, ask
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.blocks import Block, accelerating, block_elsewhere, lasting, stepping
from gauss_bench.runs.offers import offer
from gauss_bench.runs.starting import build_model, cold_there, first_step, time_start
from gauss_bench.suites.schema import Cost, Suite
from gauss_bench.trajectory import Status

BASELINE = "gauss"  # costs are ratios to this engine: Gauss's principle as its authors wrote it
BUILD, ACCELERATION, STEP, NATIVE = "build", "acceleration", "step", "native_step"
COLD = "cold build"
BARE, EMPTY, BATCH = "bare call", "empty call", "batch step"
TRAJECTORIES = 128  # in a batch: enough that the call from Python is negligible
BATCH_STEPS = 200  # of each trajectory

Make = Callable[[], Block]


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return a race for each linkage and process, and the cold builds.

    Engines that crashed or hung on a linkage do not race there. The processes of a linkage lie apart in time, so that a disturbance
    of a minute affects few of them.
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
    for cold in suite.cold_builds:
        for place, engine in product(cold.linkages.items(), filter(lambda x: offer(x).usable, cold.engines)):
            arguments = (*place, engine, cold.step)
            tasks.append(context.task("untimed", first_build, arguments, *place, engine=engine, quantity=COLD))
    return tasks


def race_cost(linkage: str, scenario: str, part: Cost, number: int = 0, race: Callable[..., Any] = race_survivors) -> Tables:
    """Return rows with the seconds of every entry in every round, and rows with the reasons of entries without times.

    An engine that crashes or hangs has the reason at each of its entries.
    """
    start = place_of(load(linkage, scenario or None))
    rows = race(entries, (linkage, scenario, part), part.rounds, (*part.engines, PROCESSOR))
    samples = [start | r | {"step": part.step, "process": number} for r in rows if "seconds" in r]
    return {"samples": samples, "untimed": [start | r for r in rows if "status" in r]}


def entries(linkage: str, scenario: str, part: Cost) -> Iterator[tuple[Key, Make]]:
    """Yield the entries of a race, each with the function that makes its block."""
    mechanism = load(linkage, scenario or None)
    for name in part.engines:
        offered = offer(name)
        for chosen in variants(offered, part.integrators, name in part.plain):
            choice = Choice(*chosen, part.step)
            if choice.integrator not in offered.adaptive:
                here = environment_of(name) is None
                timed = (
                    quantities(get(name), mechanism, choice, part) if here else quantities_elsewhere(name, mechanism, choice, part)
                )
                for quantity, make in timed:
                    yield Key(quantity, name, *chosen), make
    if part.processor:
        yield from processor()


def quantities(engine: Engine, mechanism: Mechanism, choice: Choice, part: Cost) -> Iterator[tuple[str, Make]]:
    """Yield the quantities of an engine at one choice, each with the function that makes its block.

    Builds and accelerations do not depend on the integrator and are timed with the first one only.
    """
    offered, model = offer(engine.name), cache(partial(build_model, engine, mechanism, choice))
    start = mechanism.q0, mechanism.v0

    def batch() -> Block:
        """Return a block of steps of many trajectories, all of which begin at the start of the scenario."""
        q, v = (np.tile(x, (TRAJECTORIES, 1)) for x in start)
        return lasting(None, ask(model(), "batch")(q, v, BATCH_STEPS), BATCH_STEPS * TRAJECTORIES)

    if (choice.integrator, choice.stabilization) == (offered.integrators[0], "none"):
        yield BUILD, lambda: lasting(None, lambda: first_step(engine, mechanism, choice))
        yield ACCELERATION, lambda: accelerating(None, *start, model())
        if engine.name in part.bare:
            yield BARE, lambda: lasting(None, ask(model(), "bare_calls")()[0])
            yield EMPTY, lambda: lasting(None, ask(model(), "bare_calls")()[1])
        if engine.name in part.batch and choice.settings == next(iter(offered.settings)):
            yield BATCH, batch
    if offered.python_loop:
        yield STEP, lambda: stepping(None, model(), part.step, native=False)
    if offered.native_loop:
        yield NATIVE, lambda: stepping(None, model(), part.step, native=True)


def quantities_elsewhere(name: str, mechanism: Mechanism, choice: Choice, part: Cost) -> Iterator[tuple[str, Make]]:
    """Yield the quantities that are timed of an engine of another environment: accelerations and steps."""
    offered, make = offer(name), partial(block_elsewhere, name, mechanism, choice)
    if (choice.integrator, choice.stabilization) == (offered.integrators[0], "none"):
        yield ACCELERATION, partial(make, partial(accelerating, None, mechanism.q0, mechanism.v0))
    if offered.python_loop:
        yield STEP, partial(make, partial(stepping, None, step=part.step, native=False))
    if offered.native_loop:
        yield NATIVE, partial(make, partial(stepping, None, step=part.step, native=True))


def first_build(linkage: str, scenario: str, engine: str, step: float) -> Tables:
    """Return the seconds until an engine's first model has taken its first step, in a new process, or the reason why not."""
    offered, mechanism = offer(engine), load(linkage, scenario or None)
    key = Key(COLD, engine, next(iter(offered.settings)), offered.integrators[0])
    start = place_of(mechanism) | key._asdict()
    sample = time_start(cold_there, engine, mechanism, Choice(*key[2:], step), LIMIT)
    if "status" in sample:
        return {"untimed": [start | sample]}
    return {"samples": [start | {"step": step, "process": 0, "round": 0} | sample]}


def gather_by_linkage(tables: Tables) -> dict[tuple[str, str], Measured]:
    """Gather the races' results by mechanism and scenario."""
    places: dict[tuple[str, str], Rows] = {}
    for r in [*tables.get("samples", []), *tables.get("untimed", [])]:
        here = places.setdefault((r["mechanism"], r["scenario"]), [])
        if "quantity" in r:  # a race that failed as a whole has one row without a quantity
            here.append(r)
    return {place: gather_rounds(rows) for place, rows in places.items()}


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in the cost columns of the results, and drop repeated rows of what could not be timed."""
    if "untimed" in tables:
        tables["untimed"] = [dict(x) for x in dict.fromkeys(tuple(r.items()) for r in tables["untimed"])]
    with_costs(tables.get("results", []), gather_by_linkage(tables))


def with_costs(rows: Rows, races: dict[tuple[str, str], Measured]) -> None:
    """Give each row the times of its variant, and their ratios to the baseline's; steps cost the same whatever their length."""
    columns = cache(partial(_columns, races))
    for row in rows:
        row |= columns(row["mechanism"], row["scenario"], key_of(row | {"quantity": ""})[1:])


def _columns(
    races: dict[tuple[str, str], Measured], mechanism: str, scenario: str, variant: tuple[str, str, str, str]
) -> dict[str, float]:
    """Return the cost columns of a variant (engine, settings, integrator, stabilization)."""
    samples = races[mechanism, scenario].samples if (mechanism, scenario) in races else {}
    columns: dict[str, float] = {}
    for quantity in (BUILD, COLD, ACCELERATION, STEP, NATIVE):
        known = 4 if quantity in (STEP, NATIVE) else 2  # the other quantities depend on engine and settings alone
        own = [x for k, x in samples.items() if isinstance(k, Key) and k[: 1 + known] == (quantity, *variant[:known])]
        if not own:
            continue
        columns[f"{quantity.replace(' ', '_')}_time"] = time_of(own[0])
        baseline = samples.get(Key(ACCELERATION if quantity == ACCELERATION else STEP, BASELINE))
        if baseline is not None and quantity not in (BUILD, COLD):
            names = (f"{quantity}_{k}" for k in ("ratio", "ratio_low", "ratio_high"))
            columns |= dict(zip(names, ratio(own[0], baseline), strict=True))
    return columns
