"""Blocks of timed work: some milliseconds of steps, whole runs or calls, which a race times in turn.

A block is timed inside the process that does the work. All blocks of engines in another environment are in one process there, and
the race asks that process to time one block at a time. That environment possibly has no package except numpy, so that this file
imports no other.
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
        count: number of repetitions of the work in one call of `go`; a fraction if the call does only a part of the work.
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
    """Return a block that repeats a call for about BLOCK seconds, without preparation; each call counts as `work` repetitions."""
    call()  # code may be generated or cached in the first call
    count = max(1, math.ceil(BLOCK / max(min(measure_seconds(call) for _ in range(3)), 1e-8)))

    def calls() -> None:
        """Call as often as BLOCK seconds need."""
        for _ in range(count):
            call()

    return Block(entry, lambda: None, calls, count * work)


def stepping(entry: Hashable, model: Model, step: float, native: bool) -> Block:
    """Return a block of steps of a model, in its own loop (`native`) or called from Python.

    The motion has as many steps as take BLOCK seconds, but lasts at most MOTION seconds. If such a motion is computed in less time
    than BLOCK, the block repeats it.

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
    """Return a block that computes the accelerations of a model at one state q, v (n,) again and again, by calls from Python."""
    return lasting(entry, partial(model.acceleration, 0.0, q, v))


def running(entry: Hashable, choice: Choice, times: Array, share: float, model: Any) -> Block:
    """Return a block that repeats a run over sample times (k,) [s] until it has taken about BLOCK seconds.

    `share` is the fraction of the whole run that these sample times cover: the block's time is that of the whole run.

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
    """Return a block as `running` does, but only for the first part of the run: as much of it as takes about `lead` seconds.

    The length of this part is estimated from the time of the first steps.

    Args:
        until: end of the whole run [s]; steps: number of its equal steps; lead: processor time of one run of the first part [s].
    """
    first = min(steps, FIRST) / steps  # fraction of the run
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
    """Prepare calls of a library's function at a state q, v (n,), to be timed as one block.

    Args:
        asked: prepares the function for a mechanism at a state.

    Raises:
        RunFailure: the library cannot model the mechanism.
    """
    start = time.perf_counter()
    prepared = asked(mechanism, q, v)
    seconds = time.perf_counter() - start
    # a short call is repeated; one that does several repetitions itself may need preparation. The race sets the key, here None.
    several = prepared.count != 1
    block = Block(None, prepared.ready, prepared.call, prepared.count) if several else lasting(None, prepared.call)
    return TimedCall(block, np.asarray(prepared.acceleration, dtype=float), seconds)


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
    """Return the fraction of a run that takes about `lead` seconds, rounded to whole steps; 1 if the whole run takes no longer.

    `seconds` is the time that the whole run takes, and `steps` the number of its equal steps.
    """
    return max(1, round(lead / seconds * steps)) / steps if seconds > lead else 1.0


def _run_once(entry: Hashable, choice: Choice, times: Array, share: float, model: Any) -> Block:
    """Return a block of one run over sample times (k,) [s]; `share` is the fraction of the whole run that they cover."""

    def ready() -> None:
        """Prepare the run; another block may have left another choice in the model."""
        model.choice = choice
        model.prepare(times)

    return Block(entry, ready, model.run, share)


Work = Callable[[Model], Block]  # one of the functions above with all arguments but the model


@dataclass
class BlockElsewhere(Block):
    """A timed block whose work is done in a process of another environment.

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
    """Return a timed block of work of an engine that runs in the engine's own environment.

    The work is done in a process of that environment, which is kept for all races of this process. `work` makes the block of a
    model there.

    Raises:
        RunFailure: the engine cannot run the mechanism, or the process gave no answer.
    """
    ask_there = _asking_there(engine)
    return _block_there(ask_there, *ask_there(make_there, engine, mechanism, choice, work))


def _block_there(ask_there: Callable[..., Any], number: int, count: float, again: int) -> BlockElsewhere:
    """Return a block that stands for a block of the process that `ask_there` calls.

    `number` is the index of the block in that process; `count` and `again` are its attributes there.
    """
    return BlockElsewhere(None, dict, dict, count, again, timed=partial(ask_there, time_there, number))


def _asking_there(engine: str) -> Callable[..., Any]:
    """Return a function that calls a given function with arguments in the process of an engine's environment.

    The returned function raises RunFailure if that process gives no answer. The environment has one such process for all races of
    this process.
    """
    interpreter = interpreter_of(engine)
    worker = keep(f"races in {interpreter.python}").under(interpreter)

    def ask_there(function: Callable[..., Any], *arguments: Any) -> Any:
        """Return function(*arguments), called in the process of the environment."""
        try:
            return worker.call(function, arguments, LONGEST)
        except WorkerFailure as failure:
            raise RunFailure(failure.status, str(failure)) from failure

    return ask_there


Models = dict[Hashable, Any]  # linkage, engine, settings, integrator and stabilisation -> model


def build_or_reuse(models: Models, engine: str, mechanism: Mechanism, choice: Choice) -> Any:
    """Build a model for a choice, and keep it in `models`; or return the model that is kept there.

    A kept model serves only if the engine is `resizable`, that is, if its models can take another step and tolerance. Then all
    choices that differ in step or tolerance alone share a model. Otherwise a model is built at every call.
    """
    adapter, key = get(engine), (mechanism.sha256, engine, choice.settings, choice.integrator, choice.stabilization)
    if key not in models or not ask(adapter, "resizable"):
        models[key] = adapter.build(mechanism, choice)
    return models[key]


_blocks: list[Block] = []  # blocks that other processes have asked this process to make
_models: Models = {}


def make_there(engine: str, mechanism: Mechanism, choice: Choice, work: Work) -> tuple[int, float, int]:
    """Make a block in this process, on request of another; return its index in `_blocks`, its `count` and its `again`."""
    _blocks.append(work(build_or_reuse(_models, engine, mechanism, choice)))
    return len(_blocks) - 1, _blocks[-1].count, _blocks[-1].again


def make_call_there(engine: str, name: str, mechanism: Mechanism, q: Array, v: Array) -> tuple[Any, ...]:
    """Make the block of a library's call in this process, on request of another.

    Return its index in `_blocks`, its `count` and its `again`, as `make_there` does; then the acceleration (n,) that the call finds
    and the elapsed time of its preparation [s].
    """
    timed = prepare_call(ask(get(engine), "library_calls")[name], mechanism, q, v)
    _blocks.append(timed.block)
    return len(_blocks) - 1, timed.block.count, timed.block.again, timed.acceleration, timed.seconds


def time_there(number: int) -> float:
    """Return the time of one repetition of a block of this process [s]; the garbage collector is off during the block."""
    gc.disable()
    try:
        return _blocks[number].seconds()
    finally:
        gc.enable()
