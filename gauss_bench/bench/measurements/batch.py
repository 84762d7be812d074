"""Thousands of trajectories on one core, each from a state of its own: lanes of the kernel against MuJoCo's rollout on one thread.

The states are random ones on the constraints, crank speeds up to 30 rad/s either way. MuJoCo is given the same states and fewer
steps of each, which changes nothing in the time of one. That the lanes do not disturb each other is checked against runs of single
trajectories, by other code: the same arithmetic with one lane.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, Key, Race, Row, at_least, lasting, row
from gauss_bench.bench.context import Context
from gauss_bench.bench.survived import Watch, patient, survived, watching
from gauss_bench.bench.tasks import Tables, Task
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.reference.build import random_states
from gauss_bench.suites.schema import Batch, Suite
from gauss_bench.terms import Array

QUANTITY = "batch of different states"
CHECKED = 32  # trajectories that are run again alone


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """One task for each linkage."""
    tasks = [context.task("kernel_batch", raced, (*place, part), *place) for part in suite.batch for place in part.linkages.items()]
    return list(map(patient, tasks))


def raced(linkage: str, scenario: str, part: Batch) -> Tables:
    """What `batch` tells; where an engine crashes or hangs in it, that is the reason."""
    tables, lost = survived(_race_of, (linkage, scenario, part), (part.own, part.rival))
    for failure in lost.values():
        tables["kernel_batch"][0] |= failure.told
    return tables


def _race_of(linkage: str, scenario: str, part: Batch, engines: Sequence[str], path: str) -> Tables:
    return batch(linkage, scenario, part, engines, watching(path))


def batch(linkage: str, scenario: str, part: Batch, engines: Sequence[str] = (), watch: Watch = id) -> Tables:
    """The row of a linkage; a ratio is per step of one trajectory. `engines` are those that take part, all where there are none."""
    mechanism = load(linkage, scenario or None)
    states = random_states(mechanism, part.states)
    q, v = shuffled(states.q, states.v)
    models: dict[str, Any] = {}

    def entry(engine: str, settings: str, steps: int) -> Callable[[], Block]:
        def make() -> Block:
            models[engine] = get(engine).build(mechanism, Choice(settings, "rk4", "none", part.step))
            return lasting(None, models[engine].batch(q, v, steps), steps * len(q))

        return make

    own, rival = Key(QUANTITY, part.own), Key(QUANTITY, part.rival, part.settings)
    entries = {own: entry(part.own, "default", part.step_count), rival: entry(part.rival, part.settings, part.rival_step_count)}
    race = Race(watch)
    for key, make in entries.items():
        if key.engine in (engines or (part.own, part.rival)):
            race.add(key, make)
    measured = race.run(part.rounds)
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "states": len(q), "steps": part.step_count}
    start |= {"rival": part.rival, "settings": part.settings, "rival_steps": part.rival_step_count}
    watch(own)
    told = row(start, lambda: measured.compared(own, rival) | _lanes(models[part.own], q, v, part.step_count))
    return {"kernel_batch": [at_least(told, "ratio", part.targets.get(mechanism.name))]}


def shuffled(q: Array, v: Array) -> tuple[Array, Array]:
    """The states in a random order, the same each time: neighbours in angle would make lanes more alike than a user's are."""
    order = np.random.default_rng(1).permutation(len(q))
    return q[order], v[order]


def _lanes(model: Any, q: Array, v: Array, steps: int) -> Row:
    difference, lost = against_single_runs(model, q, v, steps)
    return {"lanes": model.kernel.lanes, "lanes_error": difference, "lost": lost}


def against_single_runs(model: Any, q: Array, v: Array, steps: int) -> tuple[float, int]:
    """Largest difference of positions in lanes and alone [m, rad], and trajectories that were lost in lanes."""
    ends = model.batch(q, v, steps)()
    lost = model.kernel.lost
    some = np.linspace(0, len(q) - 1, min(CHECKED, len(q))).astype(int)
    alone = np.array([model.batch(q[k], v[k], steps)() for k in some])
    return float(np.abs(ends[some] - alone).max()), lost
