"""Thousands of trajectories on one core, each from a state of its own: lanes of the kernel against MuJoCo's rollout on one thread.

The states are random ones on the constraints, crank speeds up to 30 rad/s either way. MuJoCo is given the same states and fewer
steps of each, which changes nothing in the time of one. That the lanes do not disturb each other is checked against runs of single
trajectories, by other code: the same arithmetic with one lane.
"""

from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, lasting
from gauss_bench.bench.kernel_effort import Effort
from gauss_bench.bench.kernel_timing import Key, Measured, Race, Row, row
from gauss_bench.bench.measurements.steps import STEPS, H
from gauss_bench.bench.targets import BATCH, at_least
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.load import load
from gauss_bench.reference.build import random_states
from gauss_bench.terms import Array

LINKAGES = ("crank_slider", "six_bar")
TARGETED = "crank_slider"
SETTINGS = "tuned"
RIVAL_STEPS = 10
CHECKED = 32  # trajectories that are run again alone
ROUNDS = 6  # an entry is timed in a sixth of the effort's rounds: one takes half a second


def batch(linkage: str, scenario: str, effort: Effort) -> dict[str, Any]:
    """The row of a linkage, {"kernel_batch": [...]}; a ratio is per step of one trajectory."""
    mechanism, race, kernels = load(linkage, scenario or None), Race(), list[Kernel]()
    states = random_states(mechanism, effort.batch)
    q, v = shuffled(states.q, states.v)

    def own() -> Block:
        kernels.append(compile_kernel(mechanism, "gauss", backend="llvm"))
        return lasting(None, lambda: kernels[0].rollout(q, v, H, STEPS), STEPS * len(q))

    def rival() -> Block:
        model = get("mujoco").build(mechanism, Choice(SETTINGS, "rk4", "none", H))
        return lasting(None, model.batch(q, v, RIVAL_STEPS), RIVAL_STEPS * len(q))  # type: ignore[attr-defined]

    race.add(Key("batch", "gauss"), own)
    race.add(Key("batch", "mujoco", SETTINGS), rival)
    measured = race.run(max(3, effort.rounds // ROUNDS))
    start: Row = {"mechanism": mechanism.name, "scenario": mechanism.scenario, "states": len(q), "steps": STEPS}
    start |= {"rival": "mujoco", "settings": SETTINGS, "rival_steps": RIVAL_STEPS}
    found = row(start, lambda: _row(kernels[0], q, v, measured))
    return {"kernel_batch": [at_least(found, "ratio", BATCH if mechanism.name == TARGETED else None)]}


def shuffled(q: Array, v: Array) -> tuple[Array, Array]:
    """The states in a random order, the same each time: neighbours in angle would make lanes more alike than a user's are."""
    order = np.random.default_rng(1).permutation(len(q))
    return q[order], v[order]


def _row(kernel: Kernel, q: Array, v: Array, measured: Measured) -> Row:
    found = measured.compared(Key("batch", "gauss"), Key("batch", "mujoco", SETTINGS))
    difference, lost = against_single_runs(kernel, q, v)
    return found | {"lanes": kernel.lanes, "lanes_error": difference, "lost": lost}


def against_single_runs(kernel: Kernel, q: Array, v: Array) -> tuple[float, int]:
    """Largest difference of positions in lanes and alone [m, rad], and trajectories that were lost in lanes."""
    ends, _ = kernel.rollout(q, v, H, STEPS)
    lost = kernel.lost
    some = np.linspace(0, len(q) - 1, min(CHECKED, len(q))).astype(int)
    alone = np.array([kernel.rollout(q[k], v[k], H, STEPS)[0] for k in some])
    return float(np.abs(ends[some] - alone).max()), lost
