"""Simulate samples of a sweep by an engine: a batch in one call of the native kernel, or one sample after the other.

Every sample gives a row. If its numbers make no valid linkage, or its start cannot be assembled, or the engine fails, the row's
message has the reason.
"""

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
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.engines import require
from gauss_bench.engines.base import Choice
from gauss_bench.engines.compiled import FORMULATIONS
from gauss_bench.judge import Evidence, Subject, judge, remark
from gauss_bench.linkage.errors import LinkageError
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.one_run import sampling_at
from gauss_bench.runs.scrutiny import measurable_gain
from gauss_bench.runs.worker import get_worker
from gauss_bench.sweep.errors import SweepError
from gauss_bench.sweep.family import Family, describe
from gauss_bench.sweep.figures import figures, units
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory

SAMPLES = 400  # largest number of samples of a motion, from which extremes and energies are found
TOGETHER = 64  # number of motions that are evaluated at once and fit into the processor's cache
CHUNK = 4096  # number of states that are evaluated at once and fit into the processor's cache
NOT_ASSEMBLED = "not_assembled"
Numbers = NDArray[np.intp]
Rows = dict[str, Any]  # name of a column -> numbers (k,) or a list of k texts


@dataclass(frozen=True)
class SweepCase:
    """The data that all samples of a sweep share, as plain values that can be sent to processes and compared.

    Attributes:
        text: the linkage document with one scenario, as JSON.
        scenario, source: name of the scenario, and path of the linkage file.
        until: end of each motion [s].
        choices: name and setting of every engine.
        paths: paths in the linkage file of the d numbers that vary, such as `links.rod.mass`.
        limit: longest time of one sample in a worker [s].
        jobs: number of threads of a call of the kernel, on which no row depends.
    """

    text: str
    scenario: str
    source: str
    paths: tuple[str, ...]
    until: float
    choices: tuple[tuple[str, Choice], ...]
    limit: float
    jobs: int = field(compare=False)

    def choice(self, engine: str) -> Choice:
        """Return the setting of an engine."""
        return dict(self.choices)[engine]


@dataclass(frozen=True, eq=False)
class Grid:
    """The steps of a motion.

    Attributes:
        h, count: length [s] and number of the steps.
        every: number of steps from one sample to the next.
        t: (k,) times of the samples [s].
    """

    h: float
    count: int
    every: int
    t: Array

    def refine(self, parts: int) -> "Grid":
        """Return the grid with every step divided into `parts` steps; the times of the samples stay."""
        return Grid(self.h / parts, self.count * parts, self.every * parts, self.t)


def grid(step: float, until: float) -> Grid:
    """Return equal steps up to the time `until` [s], of at most the length `step` [s], with at most about SAMPLES samples."""
    count = max(1, int(np.ceil(until / step * (1 - 1e-12))))  # rounding of the quotient adds no step
    every = max(1, -(-count // SAMPLES))  # -(-a // b) rounds a / b up
    steps = np.unique([*range(0, count + 1, every), count])
    return Grid(until / count, count, every, steps * (until / count))


def in_batches(engine: str) -> bool:
    """Tell whether an engine simulates many samples, a batch, in one call."""
    return engine in FORMULATIONS


_kernel_lock = threading.Lock()  # one thread uses a kernel at a time: a kernel has counters and may generate more code


@lru_cache(maxsize=4)
def family(case: SweepCase) -> Family:
    """Return the linkages of a sweep, which have one structure and different numbers, as a `Family`."""
    return Family(json.loads(case.text), case.scenario, case.paths, case.source)


@lru_cache(maxsize=4)
def kernel(case: SweepCase, engine: str) -> Kernel:
    """Return the kernel (the compiled program) with which this engine simulates all samples of the sweep.

    Raises:
        MissingExtra: there is no compiler.
        SweepError: a varied number cannot be an input of a kernel, or there is no kernel for the linkage.
    """
    require("llvmlite")
    linkages, choice = family(case), case.choice(engine)
    if reason := linkages.not_open:
        raise SweepError(f"--vary {reason}; take an engine that builds every sample anew, such as gauss")
    try:
        code = compile_kernel(linkages.nominal, FORMULATIONS[engine], choice.stabilization, linkages.open_numbers)
    except KernelError as error:
        raise SweepError(f"--engine {engine}: {error}") from error
    code.prepare(choice.integrator, many=True)
    return code


def rows_of(case: SweepCase, engine: str, numbers: Numbers, values: Array, parts: int = 1) -> Rows:
    """Return the rows of the sweep's table for k samples that an engine simulates.

    Args:
        numbers: (k,) indices of the k samples among all samples of the sweep.
        values: (k, d) values of the d varied numbers in the k samples.
        parts: number of equal parts into which each step of the engine's setting is divided.
    """
    run = _run_batch if in_batches(engine) else _run_one_by_one
    varied = {path: values[:, j] for j, path in enumerate(case.paths)}
    return {"sample": numbers, "engine": [engine] * len(values), **varied, **run(case, engine, values, parts)}


def _empty_rows(case: SweepCase, count: int) -> Rows:
    """Return the columns status, message and figures of `count` samples, filled with empty texts and NaN."""
    missing = {name: np.full(count, np.nan) for name in units(family(case).nominal)}
    return {"status": [""] * count, "message": [""] * count, **missing}


def _run_batch(case: SweepCase, engine: str, values: Array, parts: int) -> Rows:
    """Return the columns status, message and figures of k samples, which are simulated in one call of the compiled kernel."""
    code, linkages, choice = kernel(case, engine), family(case), case.choice(engine)
    steps = grid(choice.step, case.until).refine(parts)
    starts, rows = linkages.starts(values), _empty_rows(case, len(values))
    is_closed = np.isfinite(starts.q).all(axis=1)
    for k in np.flatnonzero(~is_closed).tolist():
        rows["status"][k], rows["message"][k] = NOT_ASSEMBLED, starts.reasons.get(k, "")
    closed = np.flatnonzero(is_closed)  # indices in the batch of the samples that run
    if not len(closed):
        return rows
    columns = {name: x[closed] for name, x in starts.columns.items()}  # inputs of the kernel, which are stacked in p
    p = np.stack(list(columns.values()), axis=-1) if columns else np.zeros((len(closed), 0))
    q0, v0 = starts.q[closed], starts.v[closed]
    with _kernel_lock, np.errstate(all="ignore"):
        q, v = code.rollout(
            q0, v0, steps.h, steps.count, parameters=p, every=steps.every, threads=case.jobs, integrator=choice.integrator
        )
    q, v = np.concatenate([q0[:, None], q], axis=1), np.concatenate([v0[:, None], v], axis=1)  # (closed, samples, n)
    is_finite = np.isfinite(q).all(axis=(1, 2)) & np.isfinite(v).all(axis=(1, 2))
    for k in np.flatnonzero(~is_finite).tolist():  # a motion ends with the last sample before the first that is not finite
        until = steps.t[max(0, int(np.isfinite(q[k]).all(axis=1).argmin()) - 1)]
        rows["status"][closed[k]] = str(Status.NAN)
        rows["message"][closed[k]] = f"the motion is not finite after {until:g} s: no choice of pivots is usable there"
    if not is_finite.any():
        return rows
    finite = np.flatnonzero(is_finite)  # indices in q and v, which have the closed samples alone
    for group in np.array_split(finite, -(-len(finite) // TOGETHER)):  # about TOGETHER motions; -(-a // b) rounds a / b up
        forces = _multipliers(code, steps.t, q[group], v[group], p[group])
        numbers, samples = {name: x[group] for name, x in columns.items()}, closed[group]
        q_group, v_group = (np.ascontiguousarray(x[group].swapaxes(0, 1)) for x in (q, v))  # (times, motions, n)
        by_name, evidences = figures(linkages.nominal, numbers, steps.t, q_group, v_group, forces)
        for name, x in by_name.items():
            rows[name][samples] = x
        for k, sample, evidence in zip(group, samples, evidences, strict=True):
            motion = Trajectory(steps.t, q[k], v[k], np.zeros_like(q[k]), steps.count)
            load_mechanism = partial(linkages.mechanism_of, values[sample])
            rows["status"][sample], rows["message"][sample] = _judge(evidence, load_mechanism, motion)
    return rows


def _judge(evidence: Evidence, load_mechanism: Callable[[], Mechanism], motion: Trajectory) -> tuple[str, str]:
    """Return status and message of a motion.

    `load_mechanism` takes long, and is called only if the verdict depends on energy that is lost to damping.
    """
    verdict = judge(evidence)
    if any(x.subject is Subject.ENERGY for x in verdict.objections):
        # the sample times may be too far apart to resolve the energy that damping takes between them: `without_loss` here removes
        # every loss of energy. If the judge then has fewer objections, the losses that the sample times resolve are computed
        lenient = replace(evidence, seen=metrics.without_loss(motion.t, evidence.energy, 0.0))
        if len(judge(lenient).objections) < len(verdict.objections):
            evidence = replace(evidence, seen=measurable_gain(load_mechanism(), motion, evidence))
            verdict = judge(evidence)
    message = "; ".join(filter(None, (verdict.sentence, remark(evidence))))
    return str(Status.OK if verdict.valid else Status.INVALID), message


def _multipliers(code: Kernel, t: Array, q: Array, v: Array, p: Array) -> Array:
    """Return multipliers (samples, batch, rows) of motions q, v (batch, samples, n) at times t, for kernel inputs p (batch, d)."""
    batch, k, n = q.shape
    # one row for each sample of each motion
    times, positions, velocities, inputs = np.tile(t, batch), q.reshape(-1, n), v.reshape(-1, n), np.repeat(p, k, axis=0)
    chunks = []
    with np.errstate(all="ignore"):
        for i in range(0, batch * k, CHUNK):
            rows = slice(i, i + CHUNK)
            chunks.append(code.forces(positions[rows], velocities[rows], times[rows], inputs[rows]))
    return np.concatenate(chunks).reshape(batch, k, -1).swapaxes(0, 1)


def _run_one_by_one(case: SweepCase, engine: str, values: Array, parts: int) -> Rows:
    """Return the columns status, message and figures of k samples, which are simulated one after the other."""
    rows = _empty_rows(case, len(values))
    for k, sample in enumerate(values):
        rows["status"][k], rows["message"][k], by_name = _run_single(case, engine, sample, parts)
        for name, x in by_name.items():
            rows[name][k] = np.ravel(x)[0]  # a figure of one sample is an array of one number
    return rows


def _run_single(case: SweepCase, engine: str, values: Sequence[float], parts: int) -> tuple[str, str, Mapping[str, Array]]:
    """Simulate one sample; return its status, its message, and name of a figure (a number of a row) -> array (1,) with its value.

    There are no figures if the sample has no motion.

    Args:
        values: (d,) values of the d varied numbers in the sample.
        parts: number of equal parts into which each step of the engine's setting is divided.
    """
    choice = case.choice(engine)
    try:
        mechanism = family(case).mechanism_of(values)
    except LinkageError as error:
        return NOT_ASSEMBLED, describe(error), {}
    steps = grid(choice.step, case.until)
    finer = replace(choice, step=steps.h / parts)
    request = Request(case.source, case.scenario, engine, finer, sampling_at(finer.step, steps.t))
    # each thread keeps a worker of its own for further samples of this engine
    run = run_of(request, mechanism, case.limit, get_worker(f"{engine} of thread {threading.get_ident()}"))
    if run.trajectory is None:
        return str(run.status), run.message, {}
    x = run.trajectory
    try:
        multipliers = metrics.reactions(Evaluator(mechanism), x)
    except (ArithmeticError, np.linalg.LinAlgError):
        multipliers = np.full((len(steps.t), mechanism.m), np.nan)
    # {}: no number of the mechanism is an array over many motions; [:, None]: a batch of one motion
    by_name, (evidence,) = figures(mechanism, {}, x.t, x.q[:, None], x.v[:, None], multipliers[:, None])
    evidence = replace(evidence, rates=metrics.rate_gaps(x), duration=float(x.t[-1] - x.t[0]))
    status, sentence = _judge(evidence, lambda: mechanism, x)
    return status, "; ".join(filter(None, (run.message, sentence))), by_name
