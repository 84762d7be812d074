"""Runs samples of a sweep in an engine and returns rows: a batch in one call of the native kernel, or one by one.

Every sample gives a row, with a reason where its numbers are no valid linkage, its start does not close, or its engine fails.
"""

import atexit
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench import metrics
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import BAUMGARTE, Kernel, compile_kernel
from gauss_bench.engines import require
from gauss_bench.engines.base import Choice
from gauss_bench.engines.compiled import FORMULATIONS
from gauss_bench.judge import Evidence, Subject, judge, remark
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.mechanism.evaluate import Constraints, Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.one_run import sampling_at
from gauss_bench.runs.scrutiny import measurable_gain
from gauss_bench.runs.worker import Worker
from gauss_bench.sweep.errors import SweepError
from gauss_bench.sweep.family import Family, Varied, describe
from gauss_bench.sweep.figures import figures, units
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory

SAMPLES = 400  # of each motion: extremes and energies are taken from them
TOGETHER = 64  # motions that are evaluated at once: they stay in the processor's cache
CHUNK = 4096  # states of one evaluation: their numbers stay in the processor's cache
NOT_ASSEMBLED = "not_assembled"
Numbers = NDArray[np.intp]
Rows = dict[str, Any]  # by columns: numbers (k,), or a list of texts


@dataclass(frozen=True)
class Asked:
    """The data that all samples of a sweep share; plain, so that it can be sent to processes and identifies the sweep.

    Attributes:
        text: the document of one scenario, as JSON. source: the file. paths: of what varies. until: end [s].
        choices: engines and their choices. limit: [s] that one sample may take in a worker. jobs: threads that share a call of the
            kernel, which change no row.
    """

    text: str
    scenario: str
    source: str
    paths: tuple[str, ...]
    until: float
    choices: tuple[tuple[str, Choice], ...]
    limit: float
    jobs: int = field(default=1, compare=False)

    def choice(self, engine: str) -> Choice:
        return dict(self.choices)[engine]


def times(step: float, until: float) -> tuple[float, int, int, Array]:
    """Return the step taken [s], the number of steps, the steps between samples, and the times of the samples.

    The step is at most the one asked for, and a whole part of the time.
    """
    count = max(1, int(np.ceil(until / step * (1 - 1e-12))))
    every = max(1, -(-count // SAMPLES))
    steps = np.unique([*range(0, count + 1, every), count])
    return until / count, count, every, steps * (until / count)


def in_batches(engine: str) -> bool:
    """Tell whether an engine takes a batch in one call."""
    return engine in FORMULATIONS


_stepping = threading.Lock()  # a kernel counts what it does, and may have to generate more code


@lru_cache(maxsize=4)
def family(asked: Asked) -> Family:
    """The family of a sweep."""
    return Family(json.loads(asked.text), asked.scenario, asked.paths, asked.source)


@lru_cache(maxsize=4)
def kernel(asked: Asked, engine: str) -> Kernel:
    """The kernel that all samples share.

    Raises:
        MissingExtra: there is no compiler.
        SweepError: what varies cannot be left open, or the linkage has no kernel.
    """
    require("llvmlite")
    some, choice = family(asked), asked.choice(engine)
    if reason := some.closed_to_kernels:
        raise SweepError(f"--vary {reason}; take an engine that builds every sample anew, such as gauss")
    try:
        code = compile_kernel(some.nominal, FORMULATIONS[engine], choice.stabilization, some.open_numbers, baumgarte=BAUMGARTE)
    except KernelError as error:
        raise SweepError(f"--engine {engine}: {error}") from error
    code.prepare(choice.integrator, many=True)
    return code


def rows_of(asked: Asked, engine: str, numbers: Numbers, values: Array, parts: int = 1) -> Rows:
    """The rows of samples of these numbers (k,) and values (k, d), by columns; every step is cut into so many parts."""
    told = (_native if in_batches(engine) else _one_by_one)(asked, engine, values, parts)
    varied = {path: values[:, j] for j, path in enumerate(asked.paths)}
    return {"sample": numbers, "engine": [engine] * len(values), **varied, **told}


def _empty(asked: Asked, count: int) -> Rows:
    """So many rows that say nothing yet."""
    none = {name: np.full(count, np.nan) for name in units(family(asked).nominal)}
    return {"status": [""] * count, "message": [""] * count, **none}


def _native(asked: Asked, engine: str, values: Array, parts: int) -> Rows:
    code, some, choice = kernel(asked, engine), family(asked), asked.choice(engine)
    h, count, every, t = times(choice.step, asked.until)
    h, count, every = h / parts, count * parts, every * parts
    starts, rows = some.starts(values), _empty(asked, len(values))
    closed = np.isfinite(starts.q).all(axis=1)
    for k in np.flatnonzero(~closed).tolist():
        rows["status"][k], rows["message"][k] = NOT_ASSEMBLED, starts.reasons.get(k, "")
    there = np.flatnonzero(closed)
    if not len(there):
        return rows
    columns = {name: x[there] for name, x in starts.columns.items()}
    p = np.stack(list(columns.values()), axis=-1) if columns else np.zeros((len(there), 0))
    q0, v0 = starts.q[there], starts.v[there]
    with _stepping, np.errstate(all="ignore"):
        q, v = code.rollout(q0, v0, h, count, parameters=p, every=every, threads=asked.jobs, integrator=choice.integrator)
    q, v = (np.concatenate([x0[:, None], x], axis=1) for x0, x in ((q0, q), (v0, v)))
    good = np.isfinite(q).all(axis=(1, 2)) & np.isfinite(v).all(axis=(1, 2))
    for k in np.flatnonzero(~good).tolist():
        until = t[max(0, int(np.isfinite(q[k]).all(axis=1).argmin()) - 1)]
        rows["status"][there[k]] = str(Status.NAN)
        rows["message"][there[k]] = f"the motion is lost after {until:g} s: no partition of the kernel serves there"
    if not good.any():
        return rows
    for part in np.array_split(np.flatnonzero(good), -(-int(good.sum()) // TOGETHER)):
        own = {name: x[part] for name, x in columns.items()}
        forces = _multipliers(code, t, q[part], v[part], p[part])
        some_q, some_v = (np.ascontiguousarray(x[part].swapaxes(0, 1)) for x in (q, v))
        by_name, evidence = figures(Varied(some.nominal, own, some_q, some_v), t, forces)
        for name, x in by_name.items():
            rows[name][there[part]] = x
        for k, one in zip(part.tolist(), evidence, strict=True):
            motion = Trajectory(t, q[k], v[k], np.zeros_like(q[k]), count)
            rows["status"][there[k]], rows["message"][there[k]] = _judge(
                one, partial(some.mechanism_of, values[there[k]].tolist()), motion
            )
    return rows


def _judge(evidence: Evidence, mechanism: Callable[[], Mechanism], motion: Trajectory) -> tuple[str, str]:
    """Return status and message of a motion; its linkage is read only if damping between samples must be accounted for."""
    verdict = judge(evidence)
    if any(x.subject is Subject.ENERGY for x in verdict.objections):
        lenient = replace(evidence, seen=metrics.without_loss(motion.t, evidence.energy, 0.0))
        if len(judge(lenient).objections) < len(verdict.objections):
            evidence = replace(evidence, seen=measurable_gain(mechanism(), motion, evidence))
            verdict = judge(evidence)
    said = "; ".join(filter(None, (verdict.sentence, remark(evidence))))
    return str(Status.OK if verdict.valid else Status.INVALID), said


def _multipliers(code: Kernel, t: Array, q: Array, v: Array, p: Array) -> Array:
    """Multipliers (samples, batch, rows) of motions q, v (batch, samples, n) of linkages with numbers p (batch, d)."""
    batch, k, n = q.shape
    states = [np.tile(t, batch), q.reshape(-1, n), v.reshape(-1, n), np.repeat(p, k, axis=0)]
    parts = [[x[i : i + CHUNK] for x in states] for i in range(0, batch * k, CHUNK)]
    with np.errstate(all="ignore"):
        multipliers = np.concatenate([code.forces(q, v, t, p) for t, q, v, p in parts])
    return multipliers.reshape(batch, k, -1).swapaxes(0, 1)


def _one_by_one(asked: Asked, engine: str, values: Array, parts: int) -> Rows:
    rows = _empty(asked, len(values))
    for k, one in enumerate(values):
        rows["status"][k], rows["message"][k], by_name = _single(asked, engine, one, parts)
        for name, x in by_name.items():
            rows[name][k] = np.ravel(x)[0]
    return rows


def _single(asked: Asked, engine: str, values: Sequence[float], parts: int) -> tuple[str, str, Mapping[str, Array]]:
    """Return status, message and figures of one sample."""
    choice = asked.choice(engine)
    try:
        mechanism = family(asked).mechanism_of(values)
    except LinkageError as error:
        return NOT_ASSEMBLED, describe(error), {}
    h, _, _, t = times(choice.step, asked.until)
    taken = replace(choice, step=h / parts)
    request = Request(asked.source, asked.scenario, engine, taken, sampling_at(taken.step, t))
    run = run_of(request, mechanism, asked.limit, _worker(engine))
    if run.trajectory is None:
        return str(run.status), run.message, {}
    x = run.trajectory
    try:
        multipliers = metrics.reactions(Evaluator(mechanism), x)
    except (ArithmeticError, np.linalg.LinAlgError):
        multipliers = np.full((len(t), Constraints(mechanism).m), np.nan)
    by_name, (evidence,) = figures(Varied(mechanism, {}, x.q[:, None], x.v[:, None]), x.t, multipliers[:, None])
    evidence = replace(evidence, rates=metrics.rate_gaps(x), duration=float(x.t[-1] - x.t[0]))
    status, sentence = _judge(evidence, lambda: mechanism, x)
    return status, "; ".join(filter(None, (run.message, sentence))), by_name


_here = threading.local()


def _worker(engine: str) -> Worker:
    """The worker that this thread keeps for an engine, until the process ends."""
    kept: dict[str, Worker] = _here.__dict__.setdefault("workers", {})
    if engine not in kept:
        kept[engine] = Worker()
        atexit.register(kept[engine].stop)
    return kept[engine]


def columns_of(mechanism: Mechanism, paths: Sequence[str]) -> dict[str, str]:
    """Names and units of a row's numbers: what varies, then the figures."""
    return {**dict.fromkeys(paths, ""), **units(mechanism)}
