"""Thousands of trajectories on one core, each from a state of its own: lanes of the kernel against MuJoCo's rollout on one thread.

The states are random ones on the constraints, crank speeds up to 30 rad/s either way. MuJoCo is given the same states and fewer
steps of each, which changes nothing in the time of one. That the lanes do not disturb each other is checked against runs of single
trajectories, by other code: the same arithmetic with one lane.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, Key, Row, at_least, gather_rounds, lasting, row
from gauss_bench.bench.survived import race_survivors
from gauss_bench.bench.tasks import Context, Tables, Task, place_of
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import random_states
from gauss_bench.suites.schema import Batch, Suite
from gauss_bench.terms import Array

QUANTITY = "batch of different states"
CHECKED = 32  # trajectories that are run again alone


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """One task for each linkage."""
    return context.each(suite.batch, "kernel_batch", race_batch)


def race_batch(linkage: str, scenario: str, part: Batch, race: Callable[..., Any] = race_survivors) -> Tables:
    """The row of a linkage, over several processes; a ratio is per step of one trajectory.

    Where an engine crashes or hangs in a process, that is the reason.
    """
    mechanism = load(linkage, scenario or None)
    start: Row = place_of(mechanism) | {"states": part.states, "steps": part.step_count}
    start |= {"rival": part.rival, "settings": part.settings, "rival_steps": part.rival_step_count}
    own, rival = keys = list_keys(part)
    processes = [race(entries, (linkage, scenario, part), part.rounds, [x.engine for x in keys]) for _ in range(part.processes)]
    measured = gather_rounds((r | {"process": k} for k, rows in enumerate(processes) for r in rows), strict=True)
    found = row(start, lambda: measured.compare(own, rival) | measured.facts.get(own, {}))
    return {"kernel_batch": [at_least(found, "ratio", part.targets.get(mechanism.name))]}


def list_keys(part: Batch) -> tuple[Key, Key]:
    return Key(QUANTITY, part.own), Key(QUANTITY, part.rival, part.settings)


def entries(linkage: str, scenario: str, part: Batch) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Both, from the same states in a random order, the same each time: neighbours in angle would make lanes too much alike."""
    mechanism = load(linkage, scenario or None)
    states = random_states(mechanism, part.states)
    order = np.random.default_rng(1).permutation(len(states.q))
    for key, steps in zip(list_keys(part), (part.step_count, part.rival_step_count), strict=True):
        yield key, partial(make, mechanism, part, key, states.q[order], states.v[order], steps)


def make(mechanism: Mechanism, part: Batch, key: Key, q: Array, v: Array, steps: int) -> Block:
    model: Any = get(key.engine).build(mechanism, Choice(key.settings, "rk4", "none", part.step))
    block = lasting(key, model.batch(q, v, steps), steps * len(q))
    return replace(block, facts=partial(check_lanes, model, q, v, steps)) if key.engine == part.own else block


def check_lanes(model: Any, q: Array, v: Array, steps: int) -> Row:
    """Largest difference of positions in lanes and alone [m, rad], and trajectories that were lost in lanes."""
    ends = model.batch(q, v, steps)()
    lost = model.kernel.lost
    some = np.linspace(0, len(q) - 1, min(CHECKED, len(q))).astype(int)
    alone = np.array([model.batch(q[k], v[k], steps)() for k in some])
    return {"lanes": model.kernel.lanes, "lanes_error": float(np.abs(ends[some] - alone).max()), "lost": lost}
