"""Blocks of timed work: steps, whole runs or calls, which a race times in turn.

A block is timed inside the process that does the work. The blocks of an engine of another environment are in one process there, and
the race asks this process to time one block at a time. It may have no package but numpy, so that this file imports no other.
"""

import gc
import math
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.engines import environment_of, get
from gauss_bench.engines.base import Choice, LibraryCall, Model, ask
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.one_run import measure_seconds
from gauss_bench.runs.worker import WorkerFailure, keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, in_a_sentence

BLOCK = 2e-3  # [s] shortest block; clock and scheduler resolve 1 ms
MOTION = 1.0  # [s] longest motion in a block of steps: drift would change the work of a longer one
FIRST = 20  # number of steps from whose time that of a run is extrapolated
LONGEST = 600.0  # [s] limit of one block in another environment


@dataclass
class Block:
    """The work of one entry of a race.

    Attributes:
        entry: key of the entry; a race sets it.
        ready: prepares the work, and is not timed.
        go: does the work, and is timed.
        count: number of repetitions in a call of `go`, or the part of one.
        again: number of calls of `ready` and `go` in one block.
        facts: returns further columns of the entry, after the race.
    """

    entry: Hashable
    ready: Callable[[], object]
    go: Callable[[], object]
    count: float
    again: int = 1
    facts: Callable[[], dict[str, Any]] = dict

    def seconds(self) -> float:
        """Return the time of one repetition [s], the mean over the block."""
        whole = 0.0
        for _ in range(self.again):
            self.ready()
            whole += measure_seconds(self.go)
        return whole / (self.count * self.again)


def lasting(entry: Hashable, call: Callable[[], object], work: float = 1) -> Block:
    """Return a block that repeats a call without preparation for BLOCK seconds; each call counts as `work` repetitions."""
    call()  # code may be generated or cached in the first call
    count = max(1, math.ceil(BLOCK / max(min(measure_seconds(call) for _ in range(3)), 1e-8)))

    def calls() -> None:
        for _ in range(count):
            call()

    return Block(entry, lambda: None, calls, count * work)


def stepping(entry: Hashable, model: Model, step: float, native: bool) -> Block:
    """Return a block of steps of a model, in its own loop (`native`) or called from Python.

    The block lasts BLOCK seconds. Its motion covers MOTION seconds at most; if that takes less time, the block repeats the motion.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    most, count = max(1, round(MOTION / step)), 1  # the number of steps grows until they last long enough
    while True:
        block = Block(entry, partial(model.prepare, step * np.arange(2.0) * count, native=native), model.run, count)
        block.ready()
        elapsed = measure_seconds(block.go)
        if elapsed >= BLOCK or count >= most:
            block.again = max(1, math.ceil(BLOCK / max(elapsed, 1e-6)))
            return block
        # as many steps as would last 1.3 BLOCK, but at most ten times as many: the first steps may be slow
        count = min(most, int(count * min(10.0, 1.3 * BLOCK / max(elapsed, 1e-7))) + 1)


def accelerating(entry: Hashable, q: Array, v: Array, model: Model) -> Block:
    """Return a block of accelerations of a model at one state q, v (n,), each called from Python."""
    return lasting(entry, partial(model.acceleration, 0.0, q, v))


def running(entry: Hashable, choice: Choice, times: Array, share: float, model: Any) -> Block:
    """Return a block of runs over sample times (k,) [s] that lasts BLOCK seconds; a run is the part `share` of a repetition.

    Raises:
        RunFailure: the run fails.
    """
    block = _run_once(entry, choice, times, share, model)
    block.ready()
    taken = measure_seconds(block.go)
    model.read()  # raises RunFailure if the run failed: it must not race
    block.again = max(1, math.ceil(BLOCK / max(taken, 1e-6)))
    return block


def leading(entry: Hashable, choice: Choice, until: float, steps: int, lead: float, model: Any) -> Block:
    """Return a block as `running` does, of the first part of a run until `until` [s] that takes `lead` [s].

    The length of this part is estimated from the time of the first of the run's equal `steps`.
    """
    first = min(steps, FIRST) / steps  # part of the run
    block = _run_once(entry, choice, np.array([0.0, first * until]), first, model)
    block.ready()
    share = share_of(max(measure_seconds(model.run), 1e-9) / first, lead, steps)
    return running(entry, choice, np.array([0.0, share * until]), share, model)


@dataclass(frozen=True, eq=False)
class TimedCall:
    """A call of an engine's library that can be timed.

    Attributes:
        block: of the call.
        acceleration: (n,) its result, in absolute coordinates.
        seconds: elapsed time of its preparation.
    """

    block: Block
    acceleration: Array
    seconds: float


def prepare_call(asked: Callable[[Mechanism, Array, Array], LibraryCall], mechanism: Mechanism, q: Array, v: Array) -> TimedCall:
    """Return the calls, timed as one block, of a library's function at a state q, v (n,).

    Raises:
        RunFailure: the library cannot model the mechanism.
    """
    start = time.perf_counter()
    made = asked(mechanism, q, v)
    seconds = time.perf_counter() - start
    block = lasting(None, made.call) if made.count == 1 else Block(None, made.ready, made.call, made.count)
    return TimedCall(block, np.asarray(made.acceleration, dtype=float), seconds)


def call_of(engine: str, name: str, mechanism: Mechanism, q: Array, v: Array) -> TimedCall:
    """Return one of the `library_calls` of an engine as a block, in this process or in the engine's environment.

    Raises:
        RunFailure: the engine cannot model the mechanism, or its call failed.
    """
    if environment_of(engine) is not None:
        ask_there = _asking_there(engine)
        *made, acceleration, seconds = ask_there(make_call_there, engine, name, mechanism, q, v)
        return TimedCall(_block_there(ask_there, *made), np.asarray(acceleration, dtype=float), seconds)
    try:
        return prepare_call(ask(get(engine), "library_calls")[name], mechanism, q, v)
    except (RunFailure, ImportError):
        raise
    except Exception as error:  # a plug-in must not end the race of all engines
        raise RunFailure(Status.ERROR, f"{type(error).__name__}: {in_a_sentence(error)}") from error


def share_of(seconds: float, lead: float, steps: int) -> float:
    """Return the part of a run at equal steps, in whole steps, that takes `lead` [s], or 1 if the run takes no longer.

    `seconds` is the time of the run, and `steps` the number of its steps.
    """
    return max(1, round(lead / seconds * steps)) / steps if seconds > lead else 1.0


def _run_once(entry: Hashable, choice: Choice, times: Array, share: float, model: Any) -> Block:
    """Return a block of one run over sample times (k,) [s]; the run is the part `share` of a repetition."""

    def ready() -> None:
        model.choice = choice
        model.prepare(times)

    return Block(entry, ready, model.run, share)


Work = Callable[[Model], Block]  # one of the functions above with all arguments but the model


@dataclass
class BlockElsewhere(Block):
    """A block in a process of another environment.

    Attributes:
        timed: asks that process for the time of one repetition [s].
        failure: why there are no further times: the process ended, or the work failed.
    """

    timed: Callable[[], float] = field(default=lambda: math.nan)
    failure: RunFailure | None = None

    def seconds(self) -> float:
        """Return the time of one repetition [s], taken in that process; NaN after a failure."""
        if self.failure is None:
            try:
                return self.timed()
            except RunFailure as failure:
                self.failure = failure
        return math.nan


def block_elsewhere(engine: str, mechanism: Mechanism, choice: Choice, work: Work) -> BlockElsewhere:
    """Return the block of some work of an engine, in the process of the engine's environment that serves this process's races.

    Raises:
        RunFailure: the engine cannot run the mechanism, or the process gave no answer.
    """
    ask_there = _asking_there(engine)
    return _block_there(ask_there, *ask_there(make_there, engine, mechanism, choice, work))


def _block_there(ask_there: Callable[..., Any], number: int, count: float, again: int) -> BlockElsewhere:
    """Return the block with a number in the process that `ask_there` asks; `count` and `again` are those of that block."""
    return BlockElsewhere(None, dict, dict, count, again, timed=partial(ask_there, time_there, number))


def _asking_there(engine: str) -> Callable[..., Any]:
    """Return a function that calls a function with arguments in the process of an engine's environment.

    It raises RunFailure if that process gives no answer. The environment has one such process for all races of this process.
    """
    interpreter = interpreter_of(engine)
    worker = keep(f"races in {interpreter.python}").under(interpreter)

    def ask_there(function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return worker.call(function, arguments, LONGEST)
        except WorkerFailure as failure:
            raise RunFailure(failure.status, str(failure)) from failure

    return ask_there


Models = dict[Hashable, Any]  # linkage, engine, settings, integrator and stabilisation -> model


def build_once(models: Models, engine: str, mechanism: Mechanism, choice: Choice) -> Any:
    """Return the model of a choice, and keep it in `models`.

    If the engine is `resizable`, choices that differ in step or tolerance alone share a model.
    """
    adapter, key = get(engine), (mechanism.sha256, engine, choice.settings, choice.integrator, choice.stabilization)
    if key not in models or not ask(adapter, "resizable"):
        models[key] = adapter.build(mechanism, choice)
    return models[key]


_blocks: list[Block] = []  # blocks that other processes have asked this process to make
_models: Models = {}


def make_there(engine: str, mechanism: Mechanism, choice: Choice, work: Work) -> tuple[int, float, int]:
    """Make a block in this process; return its number, its `count` and its `again`."""
    _blocks.append(work(build_once(_models, engine, mechanism, choice)))
    return len(_blocks) - 1, _blocks[-1].count, _blocks[-1].again


def make_call_there(engine: str, name: str, mechanism: Mechanism, q: Array, v: Array) -> tuple[Any, ...]:
    """Make the block of a library's call in this process; return the same as `make_there`, the acceleration and the seconds."""
    made = prepare_call(ask(get(engine), "library_calls")[name], mechanism, q, v)
    _blocks.append(made.block)
    return len(_blocks) - 1, made.block.count, made.block.again, made.acceleration, made.seconds


def time_there(number: int) -> float:
    """Return the time of one repetition of a block of this process [s]; the garbage collector is off during the block."""
    gc.disable()
    try:
        return _blocks[number].seconds()
    finally:
        gc.enable()
