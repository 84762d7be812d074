"""How the time of one right-hand side grows with the number of loops: this package's kernels compared with engines.

The linkage is the N-four-bar, a chain of N four-bars ("windows"); N is the size of the linkage. A right-hand side computes the
accelerations of a state. A contender is a kernel or a call of a library that is timed here. All contenders compute the
accelerations at the same state, half a second after the start, where the accelerations are known in closed form
(reference/exact.py). Of a library, those calls are timed that an expert would make, without the conversion of coordinates around
them. Some of these calls are defined by the suite's adapters (CONTENDERS). The others are offered by engines from outside, which
are plug-ins and engines of other environments (`library_calls` in `engines/base.py`). A kernel of this package is timed in two
ways: in its own loop, where a right-hand side is a quarter of a step of the fourth-order Runge-Kutta method, and called from Python
for one state.

All contenders for one size N are timed alternately in one process (a race), and the race is repeated in several processes. A
reported time is the median over the processes. For each contender, the exponent p of time ~ size^p is fitted to the times at
several sizes. The spread of the growth exponent p is computed from the exponents that the single processes give; the exponent of a
repeated race is expected to lie in it.
"""

import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from gauss_bench.bench.clock import NO_KEY, Key, Row, foreseen, gather_rounds, row, spread
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
from gauss_bench.runs.blocks import Block, TimedCall, call_of, lasting, prepare_call
from gauss_bench.runs.offers import offers_from_outside
from gauss_bench.suites.schema import Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

MOMENT = "0.5"  # [s] time of the state in the closed form
STEP = 1e-6  # [s] of own kernels, so short that they stay near the state
LOOPED = 1000  # steps in one call, so that the cost of calling is negligible
LOOP, CALLED, IMPLICIT = "in its own loop", "called from Python", "one implicit step"
# library -> the largest size at which it is timed, and why no larger size is
SIZE_LIMITS = {"pinocchio": (64, "building and checking the model takes more than a minute")}


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return one task for each process and size of the linkage; the processes of one size do not follow each other directly."""
    calls, tasks = list_calls() if suite.growth else [], []
    for part in suite.growth:
        for number, size in product(range(part.processes), part.sizes):
            arguments = (size, part.rounds, number, calls)
            tasks.append(with_race_limit(context.task("scaling_races", race_growth, arguments, size=size, process=number)))
    return tasks


def complete(suite: Suite, tables: Tables) -> None:
    """Add the table of times over all processes, and the table of the exponents with which the times grow with the size."""
    races = tables.get("scaling_races", [])
    for part in suite.growth:  # suites have one such part; of several, the last would count
        tables["scaling"] = over_races(races)
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


# the quantities of a contender that are timed, and the function that makes one timing block for each of them
Contender = tuple[tuple[str, ...], Callable[[ExactState], list[Block]]]


def exact_state(size: int) -> ExactState:
    """Return the chain of `size` four-bars in its state at the time MOMENT, with the accelerations from the closed form."""
    mechanism = load(f"n_four_bar_{size}")
    motion = closed_form(mechanism, [MOMENT])
    assert motion is not None
    return ExactState(mechanism, *(np.array(x[0], dtype=float) for x in (motion.q, motion.v, motion.a)))


def list_calls() -> list[tuple[str, str]]:
    """Return the name of the engine and the name of the call, for each library call that an engine from outside offers."""
    return [(x.name, call) for x in offers_from_outside() if x.usable for call in x.library_calls]


def contenders(outside: Sequence[Sequence[str]]) -> dict[str, Contender]:
    """Return name -> contender: those in CONTENDERS, and the library calls (engine, name) of engines from outside."""
    return CONTENDERS | {f"{engine}, {call}": ((CALLED,), partial(make_offered_blocks, engine, call)) for engine, call in outside}


def race_growth(
    size: int, rounds: int, number: int = 0, outside: Sequence[Sequence[str]] = (), race: Callable[..., Any] = race_survivors
) -> Tables:
    """Time all contenders in one process on a chain of four-bars; return one row for each timed quantity of each contender.

    If a contender cannot be built, crashes or hangs, its rows have a status and the reason instead of times.

    Args:
        size: number of four-bars in the chain.
        number: index of the process, which is written into the rows.
        outside: (engine, call) pairs: the plug-ins and engines of other environments that are timed too, and their library calls.
        race: function that times the contenders; `race_survivors` does so in a new process, `race_here` in this one (in tests).
    """
    entered = contenders(outside)
    measured = gather_rounds(race(entries, (size, outside), rounds, [*entered]))
    start: Row = {"size": size, "process": number, "n": load(f"n_four_bar_{size}").n}

    def summarise(key: Key) -> Row:
        """Return the columns with the time of an entry of the race, and the further columns that its block returned (facts)."""
        return spread("seconds", measured.of(key)) | measured.facts.get(key, {})

    keys = [Key(quantity, engine) for engine, (quantities, _) in entered.items() for quantity in quantities]
    return {"scaling_races": [row(start | {"engine": k.engine, "quantity": k.quantity}, summarise, k) for k in keys]}


def entries(size: int, outside: Sequence[Sequence[str]] = ()) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield the key of every timed quantity of every contender, and the function that makes its block, the work to be timed.

    Args:
        size: number of four-bars in the chain.
        outside: (engine, call) pairs: the plug-ins and engines of other environments that are timed too, and their library calls.
    """
    state, entered = exact_state(size), contenders(outside)

    @cache  # all blocks of a contender are made at once, when the first of them is needed
    def make_blocks(contender: str) -> list[Block]:
        """Return the timing blocks of a contender, one for each timed quantity.

        Raises:
            RunFailure: the linkage is too large for the contender.
        """
        library = contender.partition(",")[0]  # the name of a contender may be "library, call"
        most, reason = SIZE_LIMITS.get(library, (size, ""))
        if size > most:
            raise RunFailure(Status.SKIP, reason)
        _, make = entered[contender]
        return make(state)

    def pick(contender: str, k: int) -> Block:
        """Return the timing block of a contender for its timed quantity number k."""
        return make_blocks(contender)[k]

    for contender, (quantities, _) in entered.items():
        for k, quantity in enumerate(quantities):
            yield Key(quantity, contender), partial(pick, contender, k)


def make_kernel_blocks(formulation: str, state: ExactState) -> list[Block]:
    """Compile a kernel, and return its two timing blocks: steps in the kernel's own loop, and single accelerations from Python.

    Raises:
        RunFailure: the mechanism has no kernel.
    """
    try:
        kernel = compile_kernel(state.mechanism, formulation, cache=False)  # not cached: its compilation is timed
    except KernelError as error:
        raise RunFailure(Status.SKIP, str(error)) from error
    facts = {"generate_seconds": kernel.generate_seconds, "compile_seconds": kernel.compile_seconds}
    facts |= {"error": state.error(kernel.acceleration(state.q, state.v))}
    # a step of the Runge-Kutta method has four right-hand sides: a call does the work of 4 LOOPED of them
    steps = lasting(NO_KEY, lambda: kernel.rollout(state.q, state.v, STEP, LOOPED), 4 * LOOPED)
    single = lasting(NO_KEY, lambda: kernel.acceleration(state.q, state.v))
    return [replace(x, facts=lambda: facts) for x in (steps, single)]


def make_library_blocks(prepare: Callable[[Mechanism, Array, Array], LibraryCall], state: ExactState) -> list[Block]:
    """Return a list of one timing block: a call of a library in this process.

    `prepare`(mechanism, q, v) returns the call to be timed.
    """
    return [with_facts(prepare_call(prepare, state.mechanism, state.q, state.v), state)]


def make_offered_blocks(engine: str, call: str, state: ExactState) -> list[Block]:
    """Return one timing block, in a list, for a library call that a plug-in or an engine of another environment offers.

    Raises:
        RunFailure: the engine cannot model the mechanism, or returns accelerations of the wrong shape.
    """
    made = call_of(engine, call, state.mechanism, state.q, state.v)
    if made.acceleration.shape != state.a.shape:
        raise RunFailure(Status.ERROR, f"accelerations of shape {made.acceleration.shape} where {state.a.shape} is wanted")
    return [with_facts(made, state)]


def with_facts(made: TimedCall, state: ExactState) -> Block:
    """Return the timing block of a library call, with a function `facts` that returns further columns of the call's row.

    The column `generate_seconds` has the time that the preparation of the call took [s], the column `error` the relative error of
    the accelerations that the call returns.
    """
    facts = {"generate_seconds": made.seconds, "compile_seconds": 0.0, "error": state.error(made.acceleration)}
    return replace(made.block, facts=lambda: facts)


CONTENDERS: dict[str, Contender] = {
    f"{formulation}-native": ((LOOP, CALLED), partial(make_kernel_blocks, formulation)) for formulation in ("gauss", "lagrange")
}
for library, calls, quantity in (
    ("pinocchio", pinocchio.CALLS, CALLED),
    ("mujoco", mujoco.CALLS, CALLED),
    ("exudyn", exudyn.CALLS, IMPLICIT),
):
    CONTENDERS |= {f"{library}, {way}": ((quantity,), partial(make_library_blocks, asked)) for way, asked in calls.items()}


def over_races(races: Rows) -> Rows:
    """Return a row for each engine, quantity and size: the time over all processes, or the reason why there is no time."""
    ended = [r for r in races if r["status"] == Status.OK]
    summary = []
    for rows in group_by(ended, "engine", "quantity", "size").values():
        # the spread of a single process is that of its rounds, which its row has
        found = spread("seconds", np.array([[r["seconds"]] for r in rows])) if len(rows) > 1 else rows[0]
        first = {k: x for k, x in rows[0].items() if k != "process" and not k.startswith("seconds")}
        built = {k: statistics.median(r[k] for r in rows) for k in ("generate_seconds", "compile_seconds")}
        times = {"seconds": found["seconds"], "low": found["seconds_low"], "high": found["seconds_high"]}
        summary.append(first | built | times | {"error": max(r["error"] for r in rows), "processes": len(rows)})
    timed = group_by(ended, "engine", "size")
    for place, rows in group_by([r for r in races if r["status"] != Status.OK], "engine", "size").items():
        if place not in timed:
            summary.append({k: x for k, x in rows[0].items() if k != "process"} | {"quantity": "", "processes": 0})
    return summary


def exponents(races: Rows, large: int) -> Rows:
    """Return a row for each engine and quantity with the exponent p of time ~ size^p, over sizes of at least `large`.

    An engine has a row only if at least two of these sizes were timed. The exponent is fitted to the medians of the times over the
    processes. The spread of the exponent follows from one exponent for each process, fitted to the times of this process alone.
    """
    ended = [r for r in races if r["status"] == Status.OK and r["size"] >= large]
    summary = []
    for (engine, quantity), rows in group_by(ended, "engine", "quantity").items():
        by_size = {size: statistics.median(r["seconds"] for r in same) for (size,), same in group_by(rows, "size").items()}
        if len(by_size) == 1:
            continue
        whole = [x for x in group_by(rows, "process").values() if len(x) == len(by_size)]  # processes that timed all sizes
        by_process = [exponent([r["size"] for r in x], [r["seconds"] for r in x]) for x in whole]
        # `foreseen` expects positive values and works on their logarithms: given exp(exponent), it works on the exponents
        low, high = (np.log(foreseen(np.exp(by_process))).tolist()) if len(by_process) > 1 else (math.nan, math.nan)
        names = {"engine": engine, "quantity": quantity, "sizes": len(by_size), "from": large, "processes": len(by_process)}
        of_medians = exponent([*by_size], [*by_size.values()])
        summary.append(names | {"exponent": of_medians, "exponent_low": low, "exponent_high": high})
    return summary


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Return p of seconds ~ size^p, by least squares of the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
