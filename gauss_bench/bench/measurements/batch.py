"""Thousands of trajectories on one core, each from a state of its own: lanes of the kernel against MuJoCo's rollout on one thread.

The states are random ones on the constraints, crank speeds up to 30 rad/s either way. MuJoCo is given the same states and fewer
steps of each, which changes nothing in the time of one. That the lanes do not disturb each other is checked against runs of single
trajectories, by other code: the same arithmetic with one lane.
"""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, Key, Measured, Missing, Race, Row, at_least, lasting, over_processes, row
from gauss_bench.bench.context import Context
from gauss_bench.bench.survived import Watch, list_survivors, patient, watching
from gauss_bench.bench.tasks import Rows, Tables, Task
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import random_states
from gauss_bench.suites.schema import Batch, Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

QUANTITY = "batch of different states"
CHECKED = 32  # trajectories that are run again alone


def timed(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """One task for each linkage."""
    return [
        patient(context.task("kernel_batch", race_batch, (*place, part), *place), part.processes)
        for part in suite.batch
        for place in part.linkages.items()
    ]


def race_batch(linkage: str, scenario: str, part: Batch) -> Tables:
    """The row of a linkage; where an engine crashes or hangs in a process, that is the reason."""
    mechanism, answers = load(linkage, scenario or None), []
    for _ in range(part.processes):
        answer, lost = list_survivors(_race_of, (linkage, scenario, part), (part.own, part.rival))
        for failure in lost.values():
            return {"kernel_batch": [_aim(_start(mechanism, part) | failure.told, mechanism, part)]}
        answers.append(answer)
    return {"kernel_batch": [batch_row(mechanism, part, answers)]}


def _start(mechanism: Mechanism, part: Batch) -> Row:
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "states": part.states, "steps": part.step_count}
    return start | {"rival": part.rival, "settings": part.settings, "rival_steps": part.rival_step_count}


def batch_row(mechanism: Mechanism, part: Batch, answers: Sequence[Tables]) -> Row:
    """A row from the results of several processes, each by `batch`; a ratio is per step of one trajectory."""
    samples: dict[Key, dict[int, list[float]]] = {}
    failed: dict[Hashable, Missing] = {}
    for number, answer in enumerate(answers):
        for told in answer["times"]:
            if "seconds" in told:
                samples.setdefault(Key(*told["key"]), {})[number] = told["seconds"]
            else:
                failed[Key(*told["key"])] = Missing(Status(told["status"]), told["message"])
    measured, (lanes,) = Measured(over_processes(samples), failed), answers[-1]["lanes"]
    found = row(_start(mechanism, part), lambda: measured.compared(*_keys(part)) | lanes)
    return _aim(found, mechanism, part)


def _aim(found: Row, mechanism: Mechanism, part: Batch) -> Row:
    return at_least(found, "ratio", part.targets.get(mechanism.name))


def _keys(part: Batch) -> tuple[Key, Key]:
    return Key(QUANTITY, part.own), Key(QUANTITY, part.rival, part.settings)


def _race_of(linkage: str, scenario: str, part: Batch, engines: Sequence[str], path: str) -> Tables:
    return batch(linkage, scenario, part, engines, watching(path))


def batch(linkage: str, scenario: str, part: Batch, engines: Sequence[str] = (), watch: Watch = id) -> Tables:
    """Seconds of both in one process, or why there are none, and how lanes compare with single runs.

    `engines` are those that take part, all where there are none.
    """
    mechanism = load(linkage, scenario or None)
    states = random_states(mechanism, part.states)
    q, v = shuffle(states.q, states.v)
    models: dict[str, Any] = {}

    def entry(engine: str, settings: str, steps: int) -> Callable[[], Block]:
        def make() -> Block:
            models[engine] = get(engine).build(mechanism, Choice(settings, "rk4", "none", part.step))
            return lasting(None, models[engine].batch(q, v, steps), steps * len(q))

        return make

    own, rival = _keys(part)
    entries = {own: entry(part.own, "default", part.step_count), rival: entry(part.rival, part.settings, part.rival_step_count)}
    race = Race(watch)
    for key, make in entries.items():
        if key.engine in (engines or (part.own, part.rival)):
            race.add(key, make)
    measured = race.run(part.rounds)
    watch(own)
    lanes = _lanes(models[part.own], q, v, part.step_count) if part.own in models else {}
    times: Rows = [{"key": key, "seconds": x[0][np.isfinite(x[0])].tolist()} for key, x in measured.samples.items()]
    times += [{"key": key, "status": str(x.status), "message": str(x)} for key, x in measured.failed.items()]
    return {"times": times, "lanes": [lanes]}


def shuffle(q: Array, v: Array) -> tuple[Array, Array]:
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
