"""Time thousands of trajectories on one core: this package's kernel against another library's loop on one thread.

The kernel computes several trajectories at once, each in one lane (element) of the processor's vectors. The trajectories start at
random states on the constraints, with crank speeds up to 30 rad/s in either direction. The other library takes fewer steps from the
same states, which does not change its time per step. Some trajectories are computed again, one at a time, to check that lanes do
not affect each other.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Key, Row, at_least, row
from gauss_bench.bench.survived import race_processes
from gauss_bench.bench.tasks import Context, Tables, Task, place_of
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, ask
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import random_states
from gauss_bench.runs.blocks import Block, calls_block
from gauss_bench.suites.schema import Batch, Suite
from gauss_bench.terms import Array

QUANTITY = "batch of different states"
CHECKED = 32  # number of trajectories that are run again one by one


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    return context.each(suite.batch, "kernel_batch", race_batch)


def race_batch(linkage: str, scenario: str, part: Batch) -> Tables:
    """Time our own batch of trajectories and a rival engine's in several processes, and return the linkage's row.

    Times are those of one step of one trajectory. If an engine crashes or hangs in a process, the row has the reason.
    """
    mechanism = load(linkage, scenario or None)
    start: Row = place_of(mechanism) | {"states": part.states, "steps": part.step_count}
    start |= {"rival": part.rival, "settings": part.settings, "rival_steps": part.rival_step_count}
    own, rival = list_keys(part)
    measured = race_processes(entries, (linkage, scenario, part), part.rounds, [own.engine, rival.engine], part.processes)
    result = row(start, lambda: measured.compare(own, rival) | measured.facts.get(own, {}))
    return {"kernel_batch": [at_least(result, "ratio", part.targets.get(mechanism.name))]}


def list_keys(part: Batch) -> tuple[Key, Key]:
    """Return the keys of the two timed quantities: that of our own engine and that of the rival engine."""
    return Key(QUANTITY, part.own), Key(QUANTITY, part.rival, part.settings)


def entries(linkage: str, scenario: str, part: Batch) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield the key of our own engine and that of its rival, each with the function that makes its timing block.

    Both start at the same states, in a fixed random order: if they were sorted by crank angle, adjacent lanes would have nearly
    equal states.
    """
    mechanism = load(linkage, scenario or None)
    states = random_states(mechanism, part.states)
    order = np.random.default_rng(1).permutation(len(states.q))
    for key, steps in zip(list_keys(part), (part.step_count, part.rival_step_count), strict=True):
        yield key, partial(make_block, mechanism, part, key, states.q[order], states.v[order], steps)


def make_block(mechanism: Mechanism, part: Batch, key: Key, q: Array, v: Array, steps: int) -> Block:
    """Return the timing block of one engine: `steps` steps of each trajectory from the states q, v (k, n).

    One repetition is one step of one trajectory. The block of our own engine has a function `facts`, which compares trajectories
    computed together with single ones.
    """
    model: Any = get(key.engine).build(mechanism, Choice(key.settings, "rk4", "none", part.step))
    block = calls_block(key, ask(model, "batch")(q, v, steps), steps * len(q))  # last argument: number of repetitions
    return replace(block, facts=partial(check_lanes, model, q, v, steps)) if key.engine == part.own else block


def check_lanes(model: Any, q: Array, v: Array, steps: int) -> Row:
    """Compute all trajectories in vector lanes, and CHECKED of them one by one; return the columns `lanes`, `lanes_error`, `lost`.

    `lanes` is the number of trajectories that are computed at once, `lanes_error` the largest difference [m, rad] between the last
    states in a lane and in a single run, `lost` the number of trajectories that failed in lanes. States q, v are (k, n).
    """
    ends = ask(model, "batch")(q, v, steps)()
    lost = model.kernel.lost  # read before the single runs overwrite it
    some = np.linspace(0, len(q) - 1, min(CHECKED, len(q))).astype(int)
    alone = np.array([ask(model, "batch")(q[k], v[k], steps)() for k in some])
    return {"lanes": model.kernel.lanes, "lanes_error": float(np.abs(ends[some] - alone).max()), "lost": lost}
