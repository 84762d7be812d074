"""Time all engines on a linkage side by side, and fill in the cost columns of the results.

These quantities of each engine are timed, steps in each combination of settings, integrator and stabilisation, and the others with
the first integrator and no stabilisation:

    build           a model and its first step, with all generated code already stored
    acceleration    an acceleration, called from Python
    step            a step, called from Python
    native_step     a step in the engine's own loop
    bare call       a call of the engine's library, for some engines
    empty call      the cost of a call alone, for the same engines
    batch step      a step of one of many trajectories that are computed at once, for some engines

A suite may ask for two further entries, the processor's latency and its rate (`processor.py`). Every other table of times on these
linkages is computed from the same samples, so that a quantity has one value.

Two further quantities are timed, each in a new process: a "cold build", a first model and step while no generated code is stored,
and a "start", which includes the import of the engine's library and uses the code that an earlier start has stored.
"""

from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from gauss_bench.bench.cases import combinations
from gauss_bench.bench.clock import NO_KEY, Key, Measured, gather_rounds, key_of, ratio_columns, time_of
from gauss_bench.bench.measurements.processor import PROCESSOR, processor
from gauss_bench.bench.survived import race_survivors
from gauss_bench.bench.tasks import LIMIT, LOST, Context, Rows, Tables, Task, group_by, place_of, with_race_limit
from gauss_bench.engines import environment_of, get, names
from gauss_bench.engines.base import Choice, ask
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.blocks import Block, Work, accelerations_block, block_elsewhere, calls_block, steps_block
from gauss_bench.runs.offers import offer
from gauss_bench.runs.starting import build_model, cold_there, first_step, start_there, time_start
from gauss_bench.suites.schema import Cost, Suite

BASELINE = "gauss"  # engine whose step time is the unit of cost: the formulation of Yuan and Ge
BUILD, ACCELERATION, STEP, NATIVE = "build", "acceleration", "step", "native_step"
BARE, EMPTY, BATCH = "bare call", "empty call", "batch step"
COLD, START = "cold build", "start"
IN_NEW_PROCESS = {COLD: cold_there, START: start_there}
TRAJECTORIES = 128  # number of trajectories in a batch, enough that the call from Python is negligible
BATCH_STEPS = 200  # number of steps of each trajectory in a batch

Make = Callable[[], Block]


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return the tasks that time all engines, one for each linkage and process, and those of the cold builds.

    Engines that crashed or hung on a linkage are not timed there. The processes of one linkage are not consecutive, so that a
    disturbance that lasts a minute affects few of them.
    """
    lost = {(r["mechanism"], r["engine"]) for r in tables.get("results", []) if r["status"] in LOST}
    tasks = []
    for part in suite.cost:
        for number, (linkage, scenario) in product(range(part.processes), part.linkages.items()):
            name = load(linkage, scenario or None).name
            fit = tuple(x for x in part.engines or names() if (name, x) not in lost and offer(x).usable)
            chosen = part.model_copy(update={"engines": fit, "linkages": {linkage: scenario}})
            # "untimed" is the table that gets a row if the task fails
            task = context.task("untimed", race_cost, (linkage, scenario, chosen, number), linkage, scenario)
            tasks.append(with_race_limit(task))
    for cold in suite.cold_builds:
        for place, engine in product(cold.linkages.items(), cold.engines):
            if offer(engine).usable:
                tasks.append(task_of_first_step(context, place, engine, cold.step, COLD))
    return tasks


def task_of_first_step(context: Context, place: tuple[str, str], engine: str, step: float, quantity: str, number: int = 0) -> Task:
    """Return the task that calls `time_first_step` for a linkage and scenario (`place`), in process `number`."""
    arguments = (*place, engine, step, quantity, number)
    return context.task("untimed", time_first_step, arguments, *place, engine=engine, quantity=quantity)


def race_cost(linkage: str, scenario: str, part: Cost, number: int = 0) -> Tables:
    """Time all engines on a linkage in process `number`; return the tables `samples` and `untimed`.

    `samples` has a row with the seconds of every entry in every round, `untimed` a row for each entry without times, with the
    reason.
    """
    start = place_of(load(linkage, scenario or None))
    # the loops that measure the processor are entries of an engine named PROCESSOR
    rows = race_survivors(entries, (linkage, scenario, part), part.rounds, (*part.engines, PROCESSOR))
    samples = [start | r | {"step": part.step, "process": number} for r in rows if "seconds" in r]
    return {"samples": samples, "untimed": [start | r for r in rows if "status" in r]}


def entries(linkage: str, scenario: str, part: Cost) -> Iterator[tuple[Key, Make]]:
    """Yield the key of each entry, and the function that makes its timing block."""
    mechanism = load(linkage, scenario or None)
    for name in part.engines:
        offered = offer(name)
        for chosen in combinations(offered, part.integrators, plain=name in part.plain):  # `plain`: the defaults only
            if chosen.integrator not in offered.adaptive:  # adaptive integrators have no equal steps
                for quantity, make in quantities(name, mechanism, Choice(*chosen, part.step), part):
                    yield Key(quantity, name, *chosen), make
    if part.processor:  # two loops that measure the processor's speed
        yield from processor()


def quantities(name: str, mechanism: Mechanism, choice: Choice, part: Cost) -> Iterator[tuple[str, Make]]:
    """Yield the name of each timed quantity of an engine with a chosen setting, and the function that makes its timing block.

    Builds and accelerations do not depend on the integrator and are timed with the first one only. BARE is the library's own call,
    and EMPTY a trivial call, which shows the cost of calling; engines in `part.bare` have both. Of an engine with an environment of
    its own, only accelerations and steps are timed, in a process of this environment.
    """
    offered, start, is_here = offer(name), (mechanism.q0, mechanism.v0), environment_of(name) is None
    engine: Any = get(name) if is_here else None
    # the model is built when the first block needs it, and shared by all blocks
    model = cache(lambda: build_model(engine, mechanism, choice))

    def make(work: Work) -> Block:
        return work(model()) if is_here else block_elsewhere(name, mechanism, choice, work)

    def batch() -> Block:
        q, v = (np.tile(x, (TRAJECTORIES, 1)) for x in start)
        return calls_block(NO_KEY, ask(model(), "batch")(q, v, BATCH_STEPS), BATCH_STEPS * TRAJECTORIES)

    if (choice.integrator, choice.stabilization) == (offered.integrators[0], "none"):
        if is_here:
            yield BUILD, lambda: calls_block(NO_KEY, lambda: first_step(engine, mechanism, choice))
        yield ACCELERATION, partial(make, partial(accelerations_block, NO_KEY, *start))
        if is_here and name in part.bare:  # `bare_calls` returns the library's call and an empty one
            yield BARE, lambda: calls_block(NO_KEY, ask(model(), "bare_calls")()[0])
            yield EMPTY, lambda: calls_block(NO_KEY, ask(model(), "bare_calls")()[1])
        if is_here and name in part.batch and choice.settings == next(iter(offered.settings)):
            yield BATCH, batch
    if offered.python_loop:
        yield STEP, partial(make, partial(steps_block, NO_KEY, step=part.step, native=False))
    if offered.native_loop:
        yield NATIVE, partial(make, partial(steps_block, NO_KEY, step=part.step, native=True))


def time_first_step(linkage: str, scenario: str, engine: str, step: float, quantity: str, number: int = 0) -> Tables:
    """Time a cold build or a start (a quantity of IN_NEW_PROCESS) of an engine with its default setting, in a new process.

    The result is a row of `samples` with the processor time or, if the engine fails, a row of `untimed` with the reason. `number`
    is the index of the process.
    """
    offered, mechanism = offer(engine), load(linkage, scenario or None)
    key = Key(quantity, engine, next(iter(offered.settings)), offered.integrators[0])
    start, choice = place_of(mechanism) | key._asdict(), Choice(key.settings, key.integrator, key.stabilization, step)
    sample = time_start(IN_NEW_PROCESS[quantity], engine, mechanism, choice, LIMIT)
    if "status" in sample:
        return {"untimed": [start | sample]}
    return {"samples": [start | {"step": step, "process": number, "round": 0} | sample]}


def gather_by_linkage(tables: Tables) -> dict[tuple[Any, ...], Measured]:
    """Return (mechanism, scenario) -> the results of the races there."""
    places = group_by([*tables.get("samples", []), *tables.get("untimed", [])], "mechanism", "scenario")
    # rows without a quantity are left out: they belong to races that failed as a whole
    return {place: gather_rounds(r for r in rows if "quantity" in r) for place, rows in places.items()}


def complete(suite: Suite, tables: Tables) -> None:
    """Fill in the cost columns of the table `results`, and remove duplicate rows of `untimed` from several processes."""
    if "untimed" in tables:
        distinct = dict.fromkeys(tuple(r.items()) for r in tables["untimed"])
        tables["untimed"] = [dict(items) for items in distinct]
    add_costs(tables.get("results", []), gather_by_linkage(tables))


def add_costs(rows: Rows, races: dict[tuple[Any, ...], Measured]) -> None:
    """Add to each row of the results the times of its engine and setting, and their ratios to those of BASELINE.

    The time of a step does not depend on its length, so that the step of a row may differ from the timed one. `races` maps
    mechanism and scenario to the results of their races.
    """
    columns = cache(partial(_columns, races))
    for row in rows:
        row |= columns(row["mechanism"], row["scenario"], key_of(row | {"quantity": ""}))  # results have no quantity


def _columns(races: dict[tuple[Any, ...], Measured], mechanism: str, scenario: str, key: Key) -> dict[str, float]:
    """Return the cost columns of an engine and setting on a mechanism; the `quantity` of the key is not used."""
    samples = races[mechanism, scenario].samples if (mechanism, scenario) in races else {}
    columns: dict[str, float] = {}
    for quantity in (BUILD, COLD, ACCELERATION, STEP, NATIVE):
        wanted = key._replace(quantity=quantity)
        fields = len(wanted) if quantity in (STEP, NATIVE) else 3  # the others depend only on quantity, engine and settings
        own = next((x for k, x in samples.items() if isinstance(k, Key) and k[:fields] == wanted[:fields]), None)
        if own is None:
            continue
        columns[f"{quantity.replace(' ', '_')}_time"] = time_of(own)
        # the baseline has no native loop: native steps are compared with its steps called from Python
        baseline = samples.get(Key(ACCELERATION if quantity == ACCELERATION else STEP, BASELINE))
        if baseline is not None and quantity not in (BUILD, COLD):
            columns |= ratio_columns(own, baseline, f"{quantity}_ratio")
    return columns
