"""How the cost of one right-hand side grows with the number of loops: N-four-bars of N windows, own kernels against engines.

Everything is asked for the accelerations of the same state, half a second after the start, where they are known in closed form
(reference/exact.py). Of the engines the bare call is timed, without the translation of coordinates around it:

    pinocchio  constraintDynamics at the settings "default"; lcaba (Sathya and Carpentier, Constrained articulated body dynamics
               algorithms, 2024) at a penalty and an accuracy that are the best trade found: tighter ones cost more and gain nothing
    mujoco     mj_forward as shipped, with sparse and with dense Jacobians; its closures are soft, which is most of its error
    exudyn     one step of generalized-alpha with its sparse solver, which takes at least one solution of its equations; error of
               its own initial accelerations, which are differences

Own kernels are timed in their own loop, a quarter of a step of Runge and Kutta, and called from Python for one state. All of a size
are timed in one interleaved run.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.bench.clock import Block, interleaved, lasting
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.exact import closed_form
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

SIZES = (1, 4, 16, 64)
MOMENT = "0.5"  # [s] of the closed form
STEP = 1e-6  # [s] of own kernels: so short that they stay near the state
EXUDYN_STEP = 1e-3  # [s]
LOOPED = 1000  # of them in one call: what calling costs no longer counts
EXUDYN_STEPS = 20  # in one call
ROUNDS = 15
LCABA = {"mu": 1e-4, "accuracy": 1e-10, "iterations": 20}
TOO_LONG = {  # the largest size that is built, and what takes long beyond it
    "straight line": (64, "generating and compiling straight-line code takes more than half a minute"),
    "pinocchio": (64, "building and checking the model takes more than a minute"),
}

Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Task:
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


def scaling(sizes: Sequence[int] = SIZES) -> dict[str, list[Row]]:
    """Rows of every engine at every size, {"scaling": rows}.

    Columns: engine, quantity, size (windows), n (coordinates), seconds (lower quartile of the rounds), low, high (their 5 % and
    95 % points), generate_seconds, compile_seconds (of engines: to build the model, and 0), error (relative, of the accelerations),
    status, message. What cannot be had leaves a row with a status and the reason.
    """
    rows: list[Row] = []
    for size in sizes:
        rows += _of_size(size)
    return {"scaling": rows}


def task(size: int) -> Task:
    """The N-four-bar of a size."""
    mechanism = load(f"n_four_bar_{size}")
    motion = closed_form(mechanism, [MOMENT])
    assert motion is not None
    return Task(mechanism, *(np.array(x[0], dtype=float) for x in (motion.q, motion.v, motion.a)))


def _of_size(size: int) -> list[Row]:
    wanted = task(size)
    rows: list[Row] = []
    blocks: list[Block] = []
    for engine, build in CONTENDERS.items():
        start: Row = {"engine": engine, "quantity": "", "size": size, "n": wanted.mechanism.n, "status": "ok", "message": ""}
        most, reason = TOO_LONG.get(engine.partition(",")[0], (size, ""))
        try:
            if size > most:
                raise RunFailure(Status.SKIP, reason)
            found = build(wanted)
        except (RunFailure, KernelError, ImportError) as failure:
            rows.append(start | {"status": str(getattr(failure, "status", "skip")), "message": str(failure)})
            continue
        costs = {"generate_seconds": found.generate_seconds, "compile_seconds": found.compile_seconds, "error": found.error}
        for quantity, block in found.blocks.items():
            block.entry = len(rows)
            blocks.append(block)
            rows.append(start | {"quantity": quantity} | costs)
    _time(rows, blocks)
    return rows


def _time(rows: list[Row], blocks: list[Block]) -> None:
    samples: dict[Any, list[float]] = {block.entry: [] for block in blocks}
    for block, _, seconds in interleaved(blocks, ROUNDS):
        samples[block.entry].append(seconds)
    for k, x in samples.items():
        rows[k] |= dict(zip(("seconds", "low", "high"), map(float, np.quantile(x, (0.25, 0.05, 0.95))), strict=True))


def _compiled(form: str, formulation: str) -> Callable[[Task], Contender]:
    def build(wanted: Task) -> Contender:
        kernel = compile_kernel(wanted.mechanism, formulation, cache=False, form=form)
        blocks = _own(kernel, wanted)
        error = wanted.error(kernel.acceleration(wanted.q, wanted.v))
        return Contender(blocks, error, kernel.generate_seconds, kernel.compile_seconds)

    return build


def _own(kernel: Kernel, wanted: Task) -> dict[str, Block]:
    steps = lasting(None, lambda: kernel.rollout(wanted.q, wanted.v, STEP, LOOPED), 4 * LOOPED)
    return {"in its own loop": steps, "called from Python": lasting(None, lambda: kernel.acceleration(wanted.q, wanted.v))}


def _pinocchio(solver: str) -> Callable[[Task], Contender]:
    def build(wanted: Task) -> Contender:
        start = time.perf_counter()
        model: Any = get("pinocchio").build(wanted.mechanism, Choice())
        y, dy = model.tree.relative(wanted.q, wanted.v)
        call = model.plain.bare(y, dy) if solver == "constraintDynamics" else _lcaba(model, y, dy)
        a = model.tree.absolute(y, dy, np.array(call()))[2]
        return Contender({"called from Python": lasting(None, call)}, wanted.error(a), time.perf_counter() - start, 0.0)

    return build


def _lcaba(model: Any, y: Array, dy: Array) -> Callable[[], Array]:
    """A call of lcaba, with data of its own: those that constraintDynamics has used lead it astray."""
    pin, tree, rows = model.pin, model.plain.model, model.plain.rows
    data, row_data = tree.createData(), pin.StdVec_RigidConstraintData()
    for row in rows:
        row_data.append(row.createData())
    pin.computeJointMinimalOrdering(tree, data, rows)
    prox = pin.ProximalSettings(LCABA["accuracy"], LCABA["accuracy"], LCABA["mu"], int(LCABA["iterations"]))
    tau = np.ascontiguousarray(model.forces(y, dy))
    return lambda: pin.lcaba(tree, data, y, dy, tau, rows, row_data, prox)


def _mujoco(jacobian: str) -> Callable[[Task], Contender]:
    def build(wanted: Task) -> Contender:
        start = time.perf_counter()
        built: Any = get("mujoco").build(wanted.mechanism, Choice(integrator="rk4"))
        mujoco, model = built.mujoco, built.model
        model.opt.jacobian = getattr(mujoco.mjtJacobian, f"mjJAC_{jacobian.upper()}")
        data = mujoco.MjData(model)
        y, dy = built.tree.relative(wanted.q, wanted.v)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = y, dy, built.torque
        block = lasting(None, lambda: mujoco.mj_forward(model, data))
        error = wanted.error(built.tree.absolute(y, dy, np.array(data.qacc))[2])
        return Contender({"called from Python": block}, error, time.perf_counter() - start, 0.0)

    return build


def _exudyn(wanted: Task) -> Contender:
    start = time.perf_counter()
    model: Any = get("exudyn").build(wanted.mechanism, Choice("tuned", "generalized_alpha", "none", EXUDYN_STEP))
    model.simulation.linearSolver.solverType = model.exu.LinearSolverType.EigenSparse
    error = wanted.error(model.built_in(wanted.q, wanted.v))
    times = np.array([0.0, EXUDYN_STEPS * EXUDYN_STEP])
    block = Block(None, lambda: model.prepare(times), model.run, EXUDYN_STEPS)
    return Contender({"one implicit step": block}, error, time.perf_counter() - start, 0.0)


CONTENDERS: dict[str, Callable[[Task], Contender]] = {
    "loops, gauss": _compiled("looped", "gauss"),
    "loops, lagrange": _compiled("looped", "lagrange"),
    "straight line, gauss": _compiled("straight line", "gauss"),
    "pinocchio, constraintDynamics": _pinocchio("constraintDynamics"),
    "pinocchio, lcaba": _pinocchio("lcaba"),
    "mujoco, sparse": _mujoco("sparse"),
    "mujoco, dense": _mujoco("dense"),
    "exudyn, sparse": _exudyn,
}


def growth(rows: Sequence[Row], engine: str, quantity: str, smallest: int = 16) -> float:
    """Exponent p of seconds ~ size^p over the sizes from `smallest` on, by least squares of the logarithms."""
    chosen = [x for x in rows if (x["engine"], x["quantity"]) == (engine, quantity) and x["size"] >= smallest]
    sizes, seconds = (np.log([x[key] for x in chosen]) for key in ("size", "seconds"))
    return float(np.polyfit(sizes, seconds, 1)[0])
