"""The cost of one right-hand side against the number of loops: N-four-bars of N windows, own kernels against engines.

Everything is asked for the accelerations of the same state, half a second after the start, where they are known in closed form
(reference/exact.py). Of an engine the ways are timed that its room names in `library_calls`: the bare call, without the translation
of coordinates around it.

Own kernels are timed in their own loop, a quarter of a step of Runge and Kutta, and called from Python for one state. All of a size
are timed in one interleaved run, which is repeated in several processes: a time is the median of theirs. An exponent is fitted to
the times of all processes, and its spread is where that of a second race falls, from the exponents of the single processes.
"""

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, Key, foreseen, interleave, lasting, spread
from gauss_bench.bench.context import Context
from gauss_bench.bench.survived import Watch, list_survivors, patient, watching
from gauss_bench.bench.tasks import Rows, Tables
from gauss_bench.bench.tasks import Task as Request
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.engines.exudyn import library_calls as exudyn
from gauss_bench.engines.mujoco import library_calls as mujoco
from gauss_bench.engines.pinocchio import library_calls as pinocchio
from gauss_bench.engines.shared import LibraryCall
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.exact import closed_form
from gauss_bench.suites.schema import Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

MOMENT = "0.5"  # [s] of the closed form
STEP = 1e-6  # [s] of own kernels: so short that they stay near the state
LOOPED = 1000  # of them in one call: what calling costs no longer counts
TOO_LONG = {  # the largest size that is built, and what takes long beyond it
    "pinocchio": (64, "building and checking the model takes more than a minute"),
}

Row = dict[str, Any]
Asked = Callable[[Mechanism, Array, Array], LibraryCall]


def timed(suite: Suite, context: Context, tables: Tables) -> list[Request]:
    """A race for each process and size; those of a size lie apart in time."""
    tasks = [
        context.task("scaling_races", race_growth, (size, part.rounds, number), size=size, process=number)
        for part in suite.growth
        for number in range(part.processes)
        for size in part.sizes
    ]
    return list(map(patient, tasks))


def complete(suite: Suite, tables: Tables) -> None:
    """Add the times over all processes, and the exponents, which are worked out from all sizes."""
    races = tables.get("scaling_races", [])
    for part in suite.growth:
        tables["scaling"] = over_races(races)
        tables["kernel_growth"] = exponents(races, part.large)


@dataclass(frozen=True, eq=False)
class Right:
    """A mechanism at a state, with its accelerations in closed form."""

    mechanism: Mechanism
    q: Array
    v: Array
    a: Array

    def error(self, a: Array) -> float:
        """Of an acceleration, relative to the largest one."""
        return float(np.abs(a - self.a).max() / np.abs(self.a).max())


@dataclass(frozen=True, eq=False)
class Contender:
    """Something to be timed, each of its quantities as a block, and what it cost to build."""

    blocks: dict[str, Block]
    error: float
    generate_seconds: float
    compile_seconds: float


def race_growth(size: int, rounds: int, number: int = 0) -> Tables:
    """The rows of one race; an engine that crashes or hangs in it is a row with that reason."""
    tables, lost = list_survivors(_race_of, (size, rounds, number), tuple(CONTENDERS))
    mechanism = load(f"n_four_bar_{size}")
    tables["scaling_races"] += [_start(engine, size, number, mechanism) | failure.told for engine, failure in lost.items()]
    return tables


def _race_of(size: int, rounds: int, number: int, engines: Sequence[str], path: str) -> Tables:
    return scaling(size, rounds, number, engines, watching(path))


def scaling(size: int, rounds: int, number: int = 0, engines: Sequence[str] = (), watch: Watch = id) -> Tables:
    """Rows of some engines, or of all, at a size; what cannot be had leaves a row with a status and the reason."""
    rows, blocks = enter(right(size), size, number, engines or tuple(CONTENDERS), watch)
    samples: dict[Any, list[float]] = {block.entry: [] for block in blocks}
    for block, _, seconds in interleave(blocks, rounds, watch=watch):
        samples[block.entry].append(seconds)
    places = {(r["quantity"], r["engine"]): k for k, r in enumerate(rows)}
    for key, x in samples.items():
        rows[places[key.quantity, key.engine]] |= spread("seconds", np.array(x))
    return {"scaling_races": rows}


def right(size: int) -> Right:
    """The N-four-bar of a size."""
    mechanism = load(f"n_four_bar_{size}")
    motion = closed_form(mechanism, [MOMENT])
    assert motion is not None
    return Right(mechanism, *(np.array(x[0], dtype=float) for x in (motion.q, motion.v, motion.a)))


def _start(engine: str, size: int, number: int, mechanism: Mechanism) -> Row:
    start: Row = {"engine": engine, "quantity": "", "size": size, "process": number, "n": mechanism.n}
    return start | {"status": "ok", "message": ""}


def enter(wanted: Right, size: int, number: int, engines: Sequence[str], watch: Watch) -> tuple[Rows, list[Block]]:
    """A row for each of some engines and way to ask it, and the blocks to be timed."""
    rows: list[Row] = []
    blocks: list[Block] = []
    for engine in engines:
        start, build = _start(engine, size, number, wanted.mechanism), CONTENDERS[engine]
        watch(Key("", engine))
        most, reason = TOO_LONG.get(engine.partition(",")[0], (size, ""))
        try:
            if size > most:
                raise RunFailure(Status.SKIP, reason)
            contender = build(wanted)
        except (RunFailure, KernelError, ImportError) as failure:
            rows.append(start | {"status": str(getattr(failure, "status", "skip")), "message": str(failure)})
            continue
        costs = {
            "generate_seconds": contender.generate_seconds,
            "compile_seconds": contender.compile_seconds,
            "error": contender.error,
        }
        for quantity, block in contender.blocks.items():
            block.entry = Key(quantity, engine)
            blocks.append(block)
            rows.append(start | {"quantity": quantity} | costs)
    return rows, blocks


def _compile(formulation: str) -> Callable[[Right], Contender]:
    def build(wanted: Right) -> Contender:
        kernel = compile_kernel(wanted.mechanism, formulation, cache=False)
        blocks = _own(kernel, wanted)
        error = wanted.error(kernel.acceleration(wanted.q, wanted.v))
        return Contender(blocks, error, kernel.generate_seconds, kernel.compile_seconds)

    return build


def _own(kernel: Kernel, wanted: Right) -> dict[str, Block]:
    steps = lasting(None, lambda: kernel.rollout(wanted.q, wanted.v, STEP, LOOPED), 4 * LOOPED)
    return {"in its own loop": steps, "called from Python": lasting(None, lambda: kernel.acceleration(wanted.q, wanted.v))}


def _library(asked: Asked, quantity: str = "called from Python") -> Callable[[Right], Contender]:

    def build(wanted: Right) -> Contender:
        start = time.perf_counter()
        prepared = asked(wanted.mechanism, wanted.q, wanted.v)
        seconds = time.perf_counter() - start
        block = lasting(None, prepared.call) if prepared.count == 1 else Block(None, prepared.ready, prepared.call, prepared.count)
        return Contender({quantity: block}, wanted.error(prepared.acceleration), seconds, 0.0)

    return build


CONTENDERS: dict[str, Callable[[Right], Contender]] = {
    **{f"{formulation}-native": _compile(formulation) for formulation in ("gauss", "lagrange")},
    **{f"pinocchio, {way}": _library(asked) for way, asked in pinocchio.CALLS.items()},
    **{f"mujoco, {way}": _library(asked) for way, asked in mujoco.CALLS.items()},
    **{f"exudyn, {way}": _library(asked, "one implicit step") for way, asked in exudyn.CALLS.items()},
}


def over_races(races: Rows) -> Rows:
    """A row for each engine, way to ask and size: its time over the processes that timed it, or why none did."""
    ended = [r for r in races if r["status"] == Status.OK]
    timed_engines = {(r["engine"], r["size"]) for r in ended}
    told = []
    for rows in _group(ended, "engine", "quantity", "size").values():
        found = spread("seconds", np.array([[r["seconds"]] for r in rows]))
        first = {k: x for k, x in rows[0].items() if k != "process" and not k.startswith("seconds")}
        built = {k: statistics.median(r[k] for r in rows) for k in ("generate_seconds", "compile_seconds")}
        times = {"seconds": found["seconds"], "low": found["seconds_low"], "high": found["seconds_high"]}
        if len(rows) == 1:
            times |= {end: rows[0][f"seconds_{end}"] for end in ("low", "high")}
        told.append(first | built | times | {"error": max(r["error"] for r in rows), "processes": len(rows)})
    lost = [r for r in races if r["status"] != Status.OK and (r["engine"], r["size"]) not in timed_engines]
    for rows in _group(lost, "engine", "size").values():
        told.append({k: x for k, x in rows[0].items() if k != "process"} | {"processes": 0})
    return told


def exponents(races: Rows, large: int) -> Rows:
    """Exponents by which time grows with size from `large` on, of everything timed at two such sizes or more.

    An exponent is that of the medians over the processes; its spread follows from those of the single processes.
    """
    ended = [r for r in races if r["status"] == Status.OK and r["size"] >= large]
    told = []
    for (engine, quantity), rows in _group(ended, "engine", "quantity").items():
        by_size = {size: [r["seconds"] for r in some] for (size,), some in _group(rows, "size").items()}
        if len(by_size) > 1:
            found = exponent(list(by_size), [statistics.median(x) for x in by_size.values()])
            by_process = _group(rows, "process").values()
            single = [exponent([r["size"] for r in x], [r["seconds"] for r in x]) for x in by_process if len(x) == len(by_size)]
            low, high = (np.log(foreseen(np.exp(single))).tolist()) if len(single) > 1 else (math.nan, math.nan)
            names = {"engine": engine, "quantity": quantity, "sizes": len(by_size), "from": large, "processes": len(single)}
            told.append(names | {"exponent": found, "exponent_low": low, "exponent_high": high})
    return told


def _group(rows: Rows, *columns: str) -> dict[tuple[Any, ...], Rows]:
    groups: dict[tuple[Any, ...], Rows] = {}
    for r in rows:
        groups.setdefault(tuple(r[x] for x in columns), []).append(r)
    return groups


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """p of seconds ~ size^p, by least squares of the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
