"""The cost of one right-hand side against the number of loops: N-four-bars of N windows, own kernels against engines.

Everything is asked for the accelerations of the same state, half a second after the start, where they are known in closed form
(reference/exact.py). Of libraries, calls are timed that experts would make, without the translation of coordinates around them:
those of the suite's adapters (CONTENDERS), and those that engines from outside offer (`library_calls` in `engines/base.py`).

Own kernels are timed in their own loop, a quarter of a step of Runge and Kutta, and called from Python for one state. All of a size
are timed in one interleaved run, which is repeated in several processes: a time is the median of theirs. An exponent is fitted to
the times of all processes, and its spread is where that of a second race falls, from the exponents of the single processes.
"""

import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Key, Row, foreseen, gather_rounds, row, spread
from gauss_bench.bench.survived import race_survivors
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, patient
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

MOMENT = "0.5"  # [s] of the closed form
STEP = 1e-6  # [s] of own kernels, so short that they stay near the state
LOOPED = 1000  # steps in one call, so that the cost of calling is negligible
LOOP, CALLED, IMPLICIT = "in its own loop", "called from Python", "one implicit step"
TOO_LONG = {  # engine -> the largest size that is built, and why no larger one
    "pinocchio": (64, "building and checking the model takes more than a minute"),
}


def timing_tasks(suite: Suite, context: Context, tables: Tables) -> list[Task]:
    """Return a race for each process and size; the processes of a size lie apart in time."""
    outside = [calls] if suite.growth and (calls := list_calls()) else []
    tasks = [
        context.task("scaling_races", race_growth, (size, part.rounds, number, *outside), size=size, process=number)
        for part in suite.growth
        for number in range(part.processes)
        for size in part.sizes
    ]
    return list(map(patient, tasks))


def complete(suite: Suite, tables: Tables) -> None:
    """Add the times over all processes, and the exponents that are fitted to the times of all sizes."""
    races = tables.get("scaling_races", [])
    for part in suite.growth:
        tables["scaling"] = over_races(races)
        tables["kernel_growth"] = exponents(races, part.large)


@dataclass(frozen=True, eq=False)
class ExactState:
    """A mechanism at a state, with its exact accelerations."""

    mechanism: Mechanism
    q: Array
    v: Array
    a: Array

    def error(self, a: Array) -> float:
        """Return the largest error of accelerations (n,), relative to the largest acceleration."""
        return float(np.abs(a - self.a).max() / np.abs(self.a).max())


Contender = tuple[tuple[str, ...], Callable[[ExactState], list[Block]]]  # quantities, and the function that makes their blocks


def exact_state(size: int) -> ExactState:
    """Return the N-four-bar of a size at the time MOMENT, with its accelerations in closed form."""
    mechanism = load(f"n_four_bar_{size}")
    motion = closed_form(mechanism, [MOMENT])
    assert motion is not None
    return ExactState(mechanism, *(np.array(x[0], dtype=float) for x in (motion.q, motion.v, motion.a)))


def list_calls() -> list[tuple[str, str]]:
    """List engine and name of the library calls that engines offer themselves."""
    return [(x.name, call) for x in offers_from_outside() if x.usable for call in x.library_calls]


def contenders(outside: Sequence[Sequence[str]]) -> dict[str, Contender]:
    """Return all entries of a race: CONTENDERS, and calls (engine, name) that engines offer themselves."""
    return CONTENDERS | {f"{engine}, {call}": ((CALLED,), partial(make_offered, engine, call)) for engine, call in outside}


def race_growth(
    size: int, rounds: int, number: int = 0, outside: Sequence[Sequence[str]] = (), race: Callable[..., Any] = race_survivors
) -> Tables:
    """Return the rows of one race; an entry that cannot be built, crashes or hangs has a status and a reason."""
    entered = contenders(outside)
    measured = gather_rounds(race(entries, (size, outside), rounds, [*entered]))
    start: Row = {"size": size, "process": number, "n": load(f"n_four_bar_{size}").n}

    def summarise(key: Key) -> Row:
        return spread("seconds", measured.of(key)) | measured.facts.get(key, {})

    keys = [Key(quantity, engine) for engine, (quantities, _) in entered.items() for quantity in quantities]
    return {"scaling_races": [row(start | {"engine": k.engine, "quantity": k.quantity}, summarise, k) for k in keys]}


def entries(size: int, outside: Sequence[Sequence[str]] = ()) -> Iterator[tuple[Key, Callable[[], Block]]]:
    """Yield every timed quantity of every engine, with the function that makes its block."""
    wanted = exact_state(size)
    for engine, (quantities, make) in contenders(outside).items():
        most, reason = TOO_LONG.get(engine.partition(",")[0], (size, ""))
        blocks = cache(partial(make, wanted) if size <= most else partial(refuse, reason))
        for k, quantity in enumerate(quantities):
            yield Key(quantity, engine), partial(pick, blocks, k)


def refuse(reason: str) -> list[Block]:
    """Raise the failure of a size that is not built."""
    raise RunFailure(Status.SKIP, reason)


def pick(blocks: Callable[[], list[Block]], k: int) -> Block:
    """Return the k-th of the blocks that a function makes."""
    return blocks()[k]


def make_kernel(formulation: str, wanted: ExactState) -> list[Block]:
    """Return the blocks of a kernel: in its own loop, and called from Python."""
    try:
        kernel = compile_kernel(wanted.mechanism, formulation, cache=False)
    except KernelError as error:
        raise RunFailure(Status.SKIP, str(error)) from error
    facts = {"generate_seconds": kernel.generate_seconds, "compile_seconds": kernel.compile_seconds}
    facts |= {"error": wanted.error(kernel.acceleration(wanted.q, wanted.v))}
    steps = lasting(None, lambda: kernel.rollout(wanted.q, wanted.v, STEP, LOOPED), 4 * LOOPED)
    single = lasting(None, lambda: kernel.acceleration(wanted.q, wanted.v))
    return [replace(x, facts=lambda: facts) for x in (steps, single)]


def make_library(asked: Callable[[Mechanism, Array, Array], LibraryCall], wanted: ExactState) -> list[Block]:
    """Return the block of a call of an engine's library."""
    return [with_facts(prepare_call(asked, wanted.mechanism, wanted.q, wanted.v), wanted)]


def make_offered(engine: str, call: str, wanted: ExactState) -> list[Block]:
    """Return the block of a library call that an engine offers itself.

    Raises:
        RunFailure: the engine cannot model the mechanism, or its accelerations have another shape.
    """
    made = call_of(engine, call, wanted.mechanism, wanted.q, wanted.v)
    if made.acceleration.shape != wanted.a.shape:
        raise RunFailure(Status.ERROR, f"accelerations of shape {made.acceleration.shape} where {wanted.a.shape} is wanted")
    return [with_facts(made, wanted)]


def with_facts(made: TimedCall, wanted: ExactState) -> Block:
    """Return the block of a library call with the columns of its row: the time of its preparation, and its error."""
    facts = {"generate_seconds": made.seconds, "compile_seconds": 0.0, "error": wanted.error(made.acceleration)}
    return replace(made.block, facts=lambda: facts)


CONTENDERS: dict[str, Contender] = {
    f"{formulation}-native": ((LOOP, CALLED), partial(make_kernel, formulation)) for formulation in ("gauss", "lagrange")
}
for library, calls, quantity in (
    ("pinocchio", pinocchio.CALLS, CALLED),
    ("mujoco", mujoco.CALLS, CALLED),
    ("exudyn", exudyn.CALLS, IMPLICIT),
):
    CONTENDERS |= {f"{library}, {way}": ((quantity,), partial(make_library, asked)) for way, asked in calls.items()}


def over_races(races: Rows) -> Rows:
    """Return a row for each engine, quantity and size: the time over all processes, or the reason why there is none."""
    ended = [r for r in races if r["status"] == Status.OK]
    summary = []
    for rows in group(ended, "engine", "quantity", "size").values():
        found = spread("seconds", np.array([[r["seconds"]] for r in rows])) if len(rows) > 1 else rows[0]
        first = {k: x for k, x in rows[0].items() if k != "process" and not k.startswith("seconds")}
        built = {k: statistics.median(r[k] for r in rows) for k in ("generate_seconds", "compile_seconds")}
        times = {"seconds": found["seconds"], "low": found["seconds_low"], "high": found["seconds_high"]}
        summary.append(first | built | times | {"error": max(r["error"] for r in rows), "processes": len(rows)})
    timed_engines = {(r["engine"], r["size"]) for r in ended}
    for where, rows in group([r for r in races if r["status"] != Status.OK], "engine", "size").items():
        if where not in timed_engines:
            summary.append({k: x for k, x in rows[0].items() if k != "process"} | {"quantity": "", "processes": 0})
    return summary


def exponents(races: Rows, large: int) -> Rows:
    """Return the exponents of time ~ size^p over the sizes from `large` on, where two of them or more were timed.

    An exponent is fitted to the medians over the processes; its spread follows from the exponents of the single processes.
    """
    ended = [r for r in races if r["status"] == Status.OK and r["size"] >= large]
    summary = []
    for (engine, quantity), rows in group(ended, "engine", "quantity").items():
        by_size = {size: statistics.median(r["seconds"] for r in some) for (size,), some in group(rows, "size").items()}
        if len(by_size) == 1:
            continue
        whole = [x for x in group(rows, "process").values() if len(x) == len(by_size)]
        single = [exponent([r["size"] for r in x], [r["seconds"] for r in x]) for x in whole]
        low, high = (np.log(foreseen(np.exp(single))).tolist()) if len(single) > 1 else (math.nan, math.nan)
        names = {"engine": engine, "quantity": quantity, "sizes": len(by_size), "from": large, "processes": len(single)}
        found = exponent([*by_size], [*by_size.values()])
        summary.append(names | {"exponent": found, "exponent_low": low, "exponent_high": high})
    return summary



def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Return p of seconds ~ size^p, by least squares of the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
