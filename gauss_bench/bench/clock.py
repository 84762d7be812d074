"""Cost as ratios: all engines of a comparison in one process, in blocks, in a new random order every round.

A machine's speed wanders, but it wanders for neighbours alike: the ratio of lower quartiles of interleaved blocks varies by a few
per cent where single timings vary by half. What counts is the processor's time: waiting for a processor that others use too would
lengthen long blocks, which always meet it, and spare short ones. Blocks last at least a millisecond, the garbage collector rests,
and every block is kept; only compiled steps, of which a second of motion takes less, come in shorter ones. Sources: the practice of
paired benchmarking as in Kalibera and Jones, Rigorous benchmarking in reasonable time (2013).
"""

import gc
import math
import random
import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, Model
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure

BLOCK = 2e-3  # [s] shortest block, twice the millisecond that the clock and the scheduler need to look fine
ROUNDS = 40
LONGEST = 1000  # steps in a block: beyond a second of motion drift would change what is timed
SLOW, SLOW_ROUNDS = 0.1, 4  # [s] blocks beyond it run in the first rounds only: 40 of them would take minutes
RESAMPLES = 200  # of the rounds, for the spread of a ratio
STEP = 1e-3  # [s] at which steps are timed: every engine is stable there


@dataclass(frozen=True)
class Entry:
    """What is timed: a quantity ("build", "step" from Python, "native_step", "acceleration") of one engine at one choice."""

    engine: str
    settings: str
    integrator: str
    quantity: str


@dataclass
class Block:
    """A piece of work known by its entry: `ready()` untimed, `go()` timed, `count` repetitions in it, or a share of one."""

    entry: Hashable
    ready: Callable[[], None]
    go: Callable[[], None]
    count: float


def entries(engines: list[str]) -> list[Entry]:
    """Each engine's settings and integrators, with the loops it has."""
    found = []
    for name in engines:
        adapter = get(name)
        for settings in adapter.settings:
            found += [Entry(name, settings, adapter.integrators[0], quantity) for quantity in ("build", "acceleration")]
            for integrator in adapter.integrators:
                if integrator == "dop853":
                    continue
                if adapter.python_loop:
                    found.append(Entry(name, settings, integrator, "step"))
                if adapter.native_loop:
                    found.append(Entry(name, settings, integrator, "native_step"))
    return found


def block(mechanism: Mechanism, entry: Entry) -> Block:
    """A block of at least BLOCK seconds.

    Raises:
        RunFailure, ImportError: the engine cannot run the mechanism.
    """
    choice = Choice(entry.settings, entry.integrator, "none", STEP)
    adapter = get(entry.engine)
    model = adapter.build(mechanism, choice)
    count = 1
    while True:
        if entry.quantity == "build":
            made = _repeated(entry, lambda: adapter.build(mechanism, choice), count)
        else:
            made = _of(model, mechanism, entry, count)
        made.ready()
        elapsed = timed(made.go)
        most = LONGEST if "step" in entry.quantity else 1_000_000
        if elapsed >= BLOCK or count >= most:
            return made
        count = min(most, int(count * min(10.0, 1.3 * BLOCK / max(elapsed, 1e-7))) + 1)


def _of(model: Model, mechanism: Mechanism, entry: Entry, count: int) -> Block:
    if entry.quantity == "acceleration":
        return _repeated(entry, lambda: model.acceleration(0.0, mechanism.q0, mechanism.v0), count)
    times = np.array([0.0, count * STEP])
    return Block(entry, lambda: model.prepare(times, native=entry.quantity == "native_step"), model.run, count)


def lasting(entry: Hashable, call: Callable[[], object], work: int = 1) -> Block:
    """A call that needs nothing ready, as often as BLOCK seconds take; each counts as `work` repetitions."""
    call()
    count = max(1, math.ceil(BLOCK / min(timed(call) for _ in range(3))))
    block = _repeated(entry, call, count)
    block.count = count * work
    return block


def _repeated(entry: Hashable, call: Callable[[], object], count: int) -> Block:
    def calls() -> None:
        for _ in range(count):
            call()

    return Block(entry, lambda: None, calls, count)


def timed(go: Callable[[], object]) -> float:
    """Seconds of the processor, in all threads of this process, that a call takes."""
    start = time.process_time_ns()
    go()
    return (time.process_time_ns() - start) * 1e-9


def interleaved(blocks: list[Block], rounds: int = ROUNDS, seed: int = 1) -> Iterator[tuple[Block, int, float]]:
    """Each block once a round, in a new random order every round: the block, the round, and seconds per repetition.

    A block that takes long, such as generating code, sits out the later rounds.
    """
    order = random.Random(seed)
    slow: set[int] = set()
    gc.disable()
    try:
        for number in range(rounds):
            for item in order.sample(blocks, len(blocks)):
                if id(item) in slow and number >= SLOW_ROUNDS:
                    continue
                item.ready()
                seconds = timed(item.go)
                if seconds > SLOW:
                    slow.add(id(item))
                yield item, number, seconds / item.count
    finally:
        gc.enable()


def compare_costs(linkage: str, scenario: str, engines: list[str], seed: int = 1) -> dict[str, Any]:
    """Seconds per repetition of every entry in every round, {"samples": [...], "failed": [...]}: one interleaved run.

    Call it in a process of its own: a foreign engine may end it.
    """
    mechanism = load(linkage, scenario or None)
    blocks, failed = [], []
    for entry in entries(engines):
        if get(entry.engine).skip(mechanism, Choice(entry.settings, entry.integrator, "none", STEP)):
            continue
        try:
            blocks.append(block(mechanism, entry))
        except (RunFailure, ImportError) as error:
            failed.append({**vars(entry), "message": str(error)})
    samples = [{**vars(item.entry), "round": k, "seconds": x} for item, k, x in interleaved(blocks, seed=seed)]
    return {"samples": samples, "failed": failed}


def ratio(samples: Array, baseline: Array, seed: int = 1) -> tuple[float, float, float]:
    """Ratio of lower quartiles, and its 5 % and 95 % points over resampled rounds; both (rounds,) [s]."""
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, len(samples), (RESAMPLES, len(samples)))
    spread = np.quantile(samples[picks], 0.25, axis=1) / np.quantile(baseline[picks], 0.25, axis=1)
    low, high = np.quantile(spread, (0.05, 0.95))
    return float(np.quantile(samples, 0.25) / np.quantile(baseline, 0.25)), float(low), float(high)
