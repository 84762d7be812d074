"""Measure how the time of a right-hand side grows with the number of loops, in this package's kernels and in engines.

The linkage is a chain of N four-bars. All contenders (kernels and calls of libraries) compute the accelerations at the same state,
where they are known in closed form. The calls of libraries are those that an expert would make, without conversion of coordinates:
those in CONTENDERS, and the `library_calls` of plug-ins and engines of other environments. A kernel is timed in its own loop, where
a right-hand side is a quarter of a step of the fourth-order Runge-Kutta method, and in calls from Python for one state.

The exponent p of time ~ N^p is fitted to the medians over the processes; its spread follows from the exponents of single processes.
"""

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product

import numpy as np

from gauss_bench.bench.clock import NO_KEY, Key, Row, gather_rounds, prediction_interval, row, spread
from gauss_bench.bench.survived import race_survivors
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, group_by, with_race_limit
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import compile_kernel
from gauss_bench.engines.base import LibraryCall
from gauss_bench.engines.exudyn import library_calls as exudyn
from gauss_bench.engines.mujoco import library_calls as mujoco
from gauss_bench.engines.pinocchio import library_calls as pinocchio
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.exact import closed_form
from gauss_bench.runs.blocks import Block, TimedCall, call_of, calls_block, prepare_call
from gauss_bench.runs.offers import offers_from_outside
from gauss_bench.suites.schema import Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

MOMENT = "0.5"  # [s] time of the state in the closed form
STEP = 1e-6  # [s] step of the kernels, so short that they stay near the state
LOOPED = 1000  # steps in one call, enough that the cost of the call is negligible
LOOP, CALLED, IMPLICIT = "in its own loop", "called from Python", "one implicit step"
# library -> the largest size at which it is timed, and the reason for this limit
SIZE_LIMITS = {"pinocchio": (64, "building and checking the model takes more than a minute")}


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return one task for each process and size of the linkage; the processes of a size are not consecutive."""
    tasks = []
    for part in suite.growth:
        calls = [(x.name, call) for x in offers_from_outside() if x.usable for call in x.library_calls]  # (engine, name of a call)
        for number, size in product(range(part.processes), part.sizes):
            arguments = (size, part.rounds, number, calls)
            tasks.append(with_race_limit(context.task("scaling_races", race_growth, arguments, size=size, process=number)))
    return tasks


def complete(suite: Suite, tables: Tables) -> None:
    """Add the table of times over all processes, and the table of exponents of their growth with the size."""
    races = tables.get("scaling_races", [])
    for part in suite.growth:  # suites have at most one such part
        tables["scaling"] = summarise_races(races)
        tables["kernel_growth"] = exponents(races, part.large)


@dataclass(frozen=True, eq=False)
class ExactState:
    """A mechanism, a state q, v (n,) of it, and the exact accelerations a (n,) at this state."""

    mechanism: Mechanism
    q: Array
    v: Array
    a: Array

    def error(self, a: Array) -> float:
        """Return the largest error of accelerations (n,), relative to the largest acceleration."""
        return float(np.abs(a - self.a).max() / np.abs(self.a).max())


@dataclass(frozen=True)
class Contender:
    """A timed kernel or library call: its timed quantities, and the function that makes one block for each of them."""

    quantities: tuple[str, ...]
    make_blocks: Callable[[ExactState], list[Block]]


def exact_state(size: int) -> ExactState:
    """Return the chain of `size` four-bars in its state at the time MOMENT, with the accelerations from the closed form."""
    mechanism = load(f"n_four_bar_{size}")
    motion = closed_form(mechanism, [MOMENT])  # (1, n) arrays
    assert motion is not None
    return ExactState(mechanism, *(np.array(x[0], dtype=float) for x in (motion.q, motion.v, motion.a)))


def contenders(outside: Sequence[Sequence[str]]) -> dict[str, Contender]:
    """Return name -> contender: CONTENDERS, and the library calls (engine, name of the call) in `outside`."""
    offered = {f"{engine}, {call}": partial(make_offered_blocks, engine, call) for engine, call in outside}
    return CONTENDERS | {name: Contender((CALLED,), make_blocks) for name, make_blocks in offered.items()}


def race_growth(size: int, rounds: int, number: int, outside: Sequence[Sequence[str]]) -> Tables:
    """Time all contenders in process `number` on a chain of `size` four-bars; return one row for each timed quantity.

    If a contender cannot be built, crashes or hangs, its rows have a status and the reason. `outside` lists (engine, call) of
    plug-ins and engines of other environments.
    """
    entered = contenders(outside)
    measured = gather_rounds(race_survivors(entries, (size, outside), rounds, [*entered]))
    start: Row = {"size": size, "process": number, "n": load(f"n_four_bar_{size}").n}
    keys = [Key(quantity, name) for name, contender in entered.items() for quantity in contender.quantities]
    return {"scaling_races": [row(start | {"engine": k.engine, "quantity": k.quantity}, measured.summary, k) for k in keys]}


def entries(size: int, outside: Sequence[Sequence[str]]) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield each timed quantity's key, and the function that makes its block, for all contenders on a chain of `size` four-bars.

    `outside` lists (engine, call) of plug-ins and engines of other environments.
    """
    state = exact_state(size)
    for name, contender in contenders(outside).items():
        # cached, because all blocks of a contender are made at once: when the race makes the first of them
        blocks = cache(partial(make_blocks, name, contender, size, state))
        for k, quantity in enumerate(contender.quantities):
            yield Key(quantity, name), partial(pick_block, blocks, k)


def make_blocks(name: str, contender: Contender, size: int, state: ExactState) -> list[Block]:
    """Return the timing blocks of a contender, one for each of its quantities, on the chain of `size` four-bars at a state.

    Raises:
        RunFailure: the library is not timed at this size, or the contender cannot be built.
    """
    library = name.partition(",")[0]  # the name may be "library, call"
    most, reason = SIZE_LIMITS.get(library, (size, ""))
    if size > most:
        raise RunFailure(Status.SKIP, reason)
    return contender.make_blocks(state)


def pick_block(blocks: Callable[[], list[Block]], k: int) -> Block:
    """Return block number k of a contender; the first call of `blocks` makes all blocks of the contender."""
    return blocks()[k]


def make_kernel_blocks(formulation: str, state: ExactState) -> list[Block]:
    """Compile a kernel, and return its two timing blocks: steps in its own loop, and accelerations called from Python.

    Raises:
        RunFailure: the mechanism has no kernel.
    """
    try:
        kernel = compile_kernel(state.mechanism, formulation, cache=False)  # not cached: its compilation is timed
    except KernelError as error:
        raise RunFailure(Status.SKIP, str(error)) from error
    facts = {"generate_seconds": kernel.generate_seconds, "compile_seconds": kernel.compile_seconds}
    facts |= {"error": state.error(kernel.acceleration(state.q, state.v))}
    # a step of the Runge-Kutta method has four right-hand sides: a call evaluates 4 LOOPED of them
    steps = calls_block(NO_KEY, lambda: kernel.rollout(state.q, state.v, STEP, LOOPED), 4 * LOOPED)
    single = calls_block(NO_KEY, lambda: kernel.acceleration(state.q, state.v))
    return [replace(x, facts=lambda: facts) for x in (steps, single)]


def make_library_blocks(prepare: Callable[[Mechanism, Array, Array], LibraryCall], state: ExactState) -> list[Block]:
    """Return a list with the timing block of a library's call in this process; prepare(mechanism, q, v) returns the call."""
    return [with_facts(prepare_call(prepare, state.mechanism, state.q, state.v), state)]


def make_offered_blocks(engine: str, call: str, state: ExactState) -> list[Block]:
    """Return a list with the timing block of a library call that a plug-in or an engine of another environment offers.

    Raises:
        RunFailure: the engine cannot model the mechanism, or returns accelerations of the wrong shape.
    """
    made = call_of(engine, call, state.mechanism, state.q, state.v)
    if made.acceleration.shape != state.a.shape:
        raise RunFailure(Status.ERROR, f"accelerations of shape {made.acceleration.shape} where {state.a.shape} is wanted")
    return [with_facts(made, state)]


def with_facts(made: TimedCall, state: ExactState) -> Block:
    """Return the timing block of a library call with its facts: the time of its preparation [s] and its relative error."""
    facts = {"generate_seconds": made.seconds, "compile_seconds": 0.0, "error": state.error(made.acceleration)}
    return replace(made.block, facts=lambda: facts)


CONTENDERS: dict[str, Contender] = {
    f"{name}-native": Contender((LOOP, CALLED), partial(make_kernel_blocks, name)) for name in ("gauss", "lagrange")
}
for library, calls, quantity in (
    ("pinocchio", pinocchio.CALLS, CALLED),
    ("mujoco", mujoco.CALLS, CALLED),
    ("exudyn", exudyn.CALLS, IMPLICIT),
):
    for call, prepare in calls.items():
        CONTENDERS[f"{library}, {call}"] = Contender((quantity,), partial(make_library_blocks, prepare))


def summarise_races(races: Rows) -> Rows:
    """Return a row for each engine, quantity and size: the time over all processes, or the reason why there is no time."""
    ended = [r for r in races if r["status"] == Status.OK]
    summary = []
    for rows in group_by(ended, "engine", "quantity", "size").values():
        # the row of a single process has the spread over its rounds
        time = spread("seconds", np.array([[r["seconds"]] for r in rows])) if len(rows) > 1 else rows[0]
        names = {k: x for k, x in rows[0].items() if k != "process" and not k.startswith("seconds")}
        preparation = {k: statistics.median(r[k] for r in rows) for k in ("generate_seconds", "compile_seconds")}
        times = {"seconds": time["seconds"], "low": time["seconds_low"], "high": time["seconds_high"]}
        summary.append(names | preparation | times | {"error": max(r["error"] for r in rows), "processes": len(rows)})
    timed = group_by(ended, "engine", "size")
    for place, rows in group_by([r for r in races if r["status"] != Status.OK], "engine", "size").items():
        if place not in timed:
            summary.append({k: x for k, x in rows[0].items() if k != "process"} | {"quantity": "", "processes": 0})
    return summary


def exponents(races: Rows, large: int) -> Rows:
    """Return rows with the exponent p of time ~ size^p, of each engine and quantity timed at two or more sizes >= `large`."""
    ended = [r for r in races if r["status"] == Status.OK and r["size"] >= large]
    summary = []
    for (engine, quantity), rows in group_by(ended, "engine", "quantity").items():
        by_size = {size: statistics.median(r["seconds"] for r in same) for (size,), same in group_by(rows, "size").items()}
        if len(by_size) == 1:
            continue
        timed_all = [x for x in group_by(rows, "process").values() if len(x) == len(by_size)]  # processes that timed all sizes
        by_process = [exponent([r["size"] for r in x], [r["seconds"] for r in x]) for x in timed_all]
        # `prediction_interval` works on the logarithms of positive values: given exp(exponent), it works on the exponents
        low, high = np.log(prediction_interval(np.exp(by_process))).tolist()
        names = {"engine": engine, "quantity": quantity, "sizes": len(by_size), "from": large, "processes": len(by_process)}
        of_medians = exponent([*by_size], [*by_size.values()])
        summary.append(names | {"exponent": of_medians, "exponent_low": low, "exponent_high": high})
    return summary


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Return p of seconds ~ size^p, by least squares of the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
