"""Timing blocks: pieces of work of some milliseconds (steps, runs or calls), which a race times in turn.

A block is timed inside the process that does the work. All blocks of engines in another environment are in one process there, which
the race asks to time one block at a time. This file imports no package except numpy, because such an environment may have no other.
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
from gauss_bench.runs.worker import WorkerFailure, get_worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, in_a_sentence

BLOCK = 2e-3  # [s] shortest block: the clock and the scheduler have a resolution of 1 ms
MOTION = 1.0  # [s] longest motion in a block of steps: drift would change the work of a longer one
FIRST = 20  # number of steps that are timed to estimate the time of a run
LONGEST = 600.0  # [s] time limit of a block in another environment


@dataclass
class Block:
    """The work that is timed for one quantity of an engine, which is one entry of a race.

    To time a block, `ready`, which is not timed, and `go`, which is timed, are called in turn, `calls` times each. The result is
    the mean time of one repetition of the work.

    Attributes:
        entry: key of the entry; a race sets it.
        ready, go: functions that prepare the work (untimed) and do it (timed).
        count: number of repetitions of the work in one call of `go`; a fraction if the call does only a part of the work.
        calls: number of calls of `ready` and `go` in one block.
        facts: returns further columns of the entry's row; called after the race.
    """

    entry: Hashable
    ready: Callable[[], object]
    go: Callable[[], object]
    count: float
    calls: int = 1
    facts: Callable[[], dict[str, Any]] = dict

    def seconds(self) -> float:
        """Time the block, and return the time of one repetition of the work [s]: the mean over all repetitions in the block."""
        total = 0.0
        for _ in range(self.calls):
            self.ready()
            total += measure_seconds(self.go)
        return total / (self.count * self.calls)  # each call of `go` repeats the work `count` times


def calls_block(entry: Hashable, call: Callable[[], object], work: float = 1) -> Block:
    """Return a timing block that repeats a call, which is `work` repetitions of the timed work, for about BLOCK seconds."""
    call()  # code may be generated or cached in the first call
    shortest = max(1e-8, min(measure_seconds(call) for _ in range(3)))  # of three calls [s]; the clock may give 0
    count = max(1, math.ceil(BLOCK / shortest))

    def calls() -> None:
        for _ in range(count):
            call()

    return Block(entry, lambda: None, calls, count * work)


def steps_block(entry: Hashable, model: Model, step: float, native: bool) -> Block:
    """Return a timing block of steps of a model, either in the engine's own loop (`native`) or called one by one from Python.

    The motion has as many steps as take BLOCK seconds to compute, but lasts at most MOTION seconds. If its computation takes less
    than BLOCK seconds, the block repeats it.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    most, count = max(1, round(MOTION / step)), 1  # the number of steps grows until they last long enough
    while True:
        # the model is prepared for two sample times, the start and the end of `count` steps
        block = Block(entry, partial(model.prepare, step * np.arange(2.0) * count, native=native), model.run, count)
        block.ready()
        elapsed = measure_seconds(block.go)
        if elapsed >= BLOCK or count >= most:
            block.calls = max(1, math.ceil(BLOCK / max(elapsed, 1e-6)))
            return block
        # as many steps as would last 1.3 BLOCK, but at most ten times as many: the first steps may be slow
        count = min(most, int(count * min(10.0, 1.3 * BLOCK / max(elapsed, 1e-7))) + 1)


def accelerations_block(entry: Hashable, q: Array, v: Array, model: Model) -> Block:
    """Return a timing block of calls from Python that compute the accelerations of a model at one state q, v (n,)."""
    return calls_block(entry, partial(model.acceleration, 0.0, q, v))


def run_block(entry: Hashable, choice: Choice, times: Array, share: float, model: Any) -> Block:
    """Return a timing block that repeats a run over sample times (k,) [s] until it has taken about BLOCK seconds.

    The sample times cover the fraction `share` of a whole run; the measured time is extrapolated to the whole run.

    Raises:
        RunFailure: the run fails.
    """
    block = _run_once(entry, choice, times, share, model)
    block.ready()
    taken = measure_seconds(block.go)
    model.read()  # raises RunFailure if the run failed: a failed run must not be timed
    block.calls = max(1, math.ceil(BLOCK / max(taken, 1e-6)))
    return block


def lead_block(entry: Hashable, choice: Choice, until: float, steps: int, lead: float, model: Any) -> Block:
    """Return a timing block that runs only the first part of a run, about `lead` [s] of processor time long.

    The whole run has `steps` equal steps and ends at t = `until` [s]. The length of the part is estimated from the time of the
    first steps. The measured time is extrapolated to the whole run.
    """
    first = min(steps, FIRST) / steps  # fraction of the run
    block = _run_once(entry, choice, np.array([0.0, first * until]), first, model)
    block.ready()
    share = share_of(max(measure_seconds(model.run), 1e-9) / first, lead, steps)  # from the estimated time of the whole run
    return run_block(entry, choice, np.array([0.0, share * until]), share, model)


@dataclass(frozen=True, eq=False)
class TimedCall:
    """A call of an engine's library that can be timed.

    Attributes:
        block: the timing block of the call.
        acceleration: (n,) the result of the call, in absolute coordinates.
        seconds: elapsed time of the preparation of the call [s].
    """

    block: Block
    acceleration: Array
    seconds: float


def prepare_call(prepare: Callable[[Mechanism, Array, Array], LibraryCall], mechanism: Mechanism, q: Array, v: Array) -> TimedCall:
    """Return the timed call of a library's function at a state q, v (n,); prepare(mechanism, q, v) returns the call.

    Raises:
        RunFailure: the library cannot model the mechanism.
    """
    start = time.perf_counter()
    prepared = prepare(mechanism, q, v)
    seconds = time.perf_counter() - start
    # A call with a count other than 1 repeats the work itself, and may have to be prepared each time. Other calls are short and are
    # repeated by the block. The race sets the block's key, here None.
    repeats_itself = prepared.count != 1
    block = Block(None, prepared.ready, prepared.call, prepared.count) if repeats_itself else calls_block(None, prepared.call)
    return TimedCall(block, np.asarray(prepared.acceleration, dtype=float), seconds)


def call_of(engine: str, name: str, mechanism: Mechanism, q: Array, v: Array) -> TimedCall:
    """Return one of the `library_calls` that an engine offers, prepared in this process or in that of the engine's environment.

    Raises:
        RunFailure: the engine cannot model the mechanism, or the call of its library failed.
    """
    if environment_of(engine) is not None:
        ask_there = _asking_there(engine)
        number, count, calls, acceleration, seconds = ask_there(make_call_there, engine, name, mechanism, q, v)
        return TimedCall(_block_there(ask_there, number, count, calls), np.asarray(acceleration, dtype=float), seconds)
    try:
        return prepare_call(ask(get(engine), "library_calls")[name], mechanism, q, v)
    except (RunFailure, ImportError):
        raise
    except Exception as error:  # a plug-in must not end the race of all engines
        raise RunFailure(Status.ERROR, f"{type(error).__name__}: {in_a_sentence(error)}") from error


def share_of(seconds: float, lead: float, steps: int) -> float:
    """Return the fraction of a run that can be computed in about `lead` [s], rounded to whole steps; 1 for a run that is shorter.

    `seconds` is the time that the computation of the whole run takes, and `steps` the number of its equal steps.
    """
    return max(1, round(lead / seconds * steps)) / steps if seconds > lead else 1.0


def _run_once(entry: Hashable, choice: Choice, times: Array, share: float, model: Any) -> Block:
    """Return a timing block of a run over sample times (k,) [s] that cover the fraction `share` of the whole run."""

    def ready() -> None:
        model.choice = choice  # blocks share the model, and another block may have set another step
        model.prepare(times)

    return Block(entry, ready, model.run, share)


Work = Callable[[Model], Block]  # one of the functions above with all arguments but the model


@dataclass
class BlockElsewhere(Block):
    """A timing block whose work is done and timed in a process of an engine's own environment.

    Attributes:
        timed: function that asks the engine's process to time the block, and returns the time of one repetition [s].
        failure: the reason why there are no further times: the process ended, or the work failed.
    """

    timed: Callable[[], float] = field(default=lambda: math.nan)
    failure: RunFailure | None = None

    def seconds(self) -> float:
        """Return the time of one repetition of the work [s], measured in the engine's process; NaN after a failure."""
        if self.failure is None:
            try:
                return self.timed()
            except RunFailure as failure:
                self.failure = failure
        return math.nan


def block_elsewhere(engine: str, mechanism: Mechanism, choice: Choice, work: Work) -> BlockElsewhere:
    """Return a block that stands for the block that `work` makes of a model in the process of an engine's environment.

    Raises:
        RunFailure: the engine cannot run the mechanism, or the process gave no answer.
    """
    ask_there = _asking_there(engine)
    return _block_there(ask_there, *ask_there(make_there, engine, mechanism, choice, work))


def _block_there(ask_there: Callable[..., Any], number: int, count: float, calls: int) -> BlockElsewhere:
    """Return a block that stands for block `number`, with its `count` and `calls`, of the process that `ask_there` calls."""
    # for `ready` and `go`, `dict` serves as a function without effect: the work is done in the other process
    return BlockElsewhere(None, dict, dict, count, calls, timed=partial(ask_there, time_there, number))


def _asking_there(engine: str) -> Callable[..., Any]:
    """Return ask_there(function, *arguments), which calls a function in the process of an engine's environment.

    It raises RunFailure if the process gives no answer. Each environment has one such process, which serves all races of the
    calling process.
    """
    interpreter = interpreter_of(engine)
    worker = get_worker(f"races in {interpreter.python}").under(interpreter)

    def ask_there(function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return worker.call(function, arguments, LONGEST)
        except WorkerFailure as failure:
            raise RunFailure(failure.status, str(failure)) from failure

    return ask_there


Models = dict[Hashable, Any]  # linkage, scenario, engine, settings, integrator and stabilisation -> model


def get_model(models: Models, engine: str, mechanism: Mechanism, choice: Choice) -> Any:
    """Return a model for a choice: the one that `models` has or, if there is none, a new one, which is added to `models`.

    Only models of a `resizable` engine, which accept another step and tolerance, are used again.
    """
    adapter = get(engine)
    key = (mechanism.sha256, mechanism.scenario, engine, choice.settings, choice.integrator, choice.stabilization)
    if key not in models or not ask(adapter, "resizable"):
        models[key] = adapter.build(mechanism, choice)
    return models[key]


_blocks: list[Block] = []  # blocks that other processes have asked this process to make
_models: Models = {}


def make_there(engine: str, mechanism: Mechanism, choice: Choice, work: Work) -> tuple[int, float, int]:
    """Make a timing block in an engine's process; return its index in `_blocks`, its `count` and its `calls`."""
    _blocks.append(work(get_model(_models, engine, mechanism, choice)))
    return len(_blocks) - 1, _blocks[-1].count, _blocks[-1].calls


def make_call_there(engine: str, name: str, mechanism: Mechanism, q: Array, v: Array) -> tuple[Any, ...]:
    """Make the timing block of a library's call in an engine's process.

    Return the same as `make_there`, the acceleration (n,) of the call, and the elapsed time of its preparation [s].
    """
    timed = prepare_call(ask(get(engine), "library_calls")[name], mechanism, q, v)
    _blocks.append(timed.block)
    return len(_blocks) - 1, timed.block.count, timed.block.calls, timed.acceleration, timed.seconds


def time_there(number: int) -> float:
    """Time block `number` of this process once, with the garbage collector off, and return the time of one repetition [s]."""
    gc.disable()
    try:
        return _blocks[number].seconds()
    finally:
        gc.enable()
