"""The one recipe of a run: sample times -> build -> prepare -> run -> read -> complete or not. Every verb runs engines through it.

A step is the step that is really taken. Samples lie where unbroken steps arrive; a time that they miss, such as the end of a run
that is no multiple of its step, is met by one shorter step and the run says so.
"""

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gauss_bench import judge
from gauss_bench.engines.base import Choice, Engine, Model
from gauss_bench.engines.extras import not_installed
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.integrate.fixed_step import step_counts
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import relative_acceleration_error
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, in_a_sentence

SAMPLING = 1e-3  # [s] samples that energy and drift are taken from, where the step is not longer
JUDGED = 20  # samples whose accelerations are held against Gauss's principle: a wrong model is wrong nearly everywhere


@dataclass(frozen=True, eq=False)
class Sampling:
    """When a run is sampled, and by which steps.

    Attributes:
        times: (k,) [s], from 0, increasing.
        step: the step asked for [s].
        count: steps between the first sample and the last.
        shortened: how many of them are shorter, to meet a time that whole steps miss.
    """

    times: Array
    step: float
    count: int
    shortened: int

    @property
    def note(self) -> str:
        """What must be said of the steps, or an empty text."""
        if not self.shortened:
            return ""
        return f"{self.shortened} of {self.count} steps are shorter than {self.step:g} s, to meet times that whole steps miss"


def sampling(step: float, t_end: float, meet: Sequence[float] | Array = ()) -> Sampling:
    """Samples from 0 to t_end about a millisecond apart, and at those of the times `meet` that whole steps reach.

    The end is always met, by a shorter last step where it is no multiple of the step.
    """
    whole = int(np.floor(t_end / step * (1 + 1e-12)))
    each = max(1, round(SAMPLING / step))
    spacing = each * step
    grid = np.arange(whole // each + 1) * spacing
    reached = [x for x in np.asarray(meet, dtype=float) if x <= t_end * (1 + 1e-12) and _on(x, step)]
    return _sampled(step, grid, [*reached, whole * step, t_end])


def sampling_through(step: float, at: Sequence[float]) -> Sampling:
    """Samples about a millisecond apart and at every time of `at`, each met by a shorter step where whole steps miss it."""
    last = max(at)
    rests = [k * step for x in at if not _on(x, step) for k in (np.floor(x / step), np.ceil(x / step)) if k * step <= last]
    each = max(1, round(SAMPLING / step))
    grid = np.arange(int(np.floor(last / step * (1 + 1e-12))) // each + 1) * (each * step)
    return _sampled(step, grid, [*rests, *at])


def _on(t: float, step: float) -> bool:
    return abs(t - round(t / step) * step) <= max(1e-9 * step, 1e-15 * t)


def _sampled(step: float, grid: Array, more: Sequence[float]) -> Sampling:
    """The grid and the further times that it does not have yet."""
    near = 1e-9 * min(step, 1.0)
    times = [*grid]
    for x in sorted(more):
        k = int(np.searchsorted(grid, x))
        if all(abs(x - y) > near + 1e-14 * x for y in [*grid[max(0, k - 1) : k + 1], times[-1]]):
            times.append(x)
    found = np.unique(times)
    counts = step_counts(found, step)
    short = sum(count for count, h in counts if h < step * (1 - 1e-6))
    return Sampling(found, step, sum(count for count, _ in counts), short)


@dataclass(frozen=True, eq=False)
class Run:
    """How one run ended.

    Attributes:
        status, message: OK and a remark, or what went wrong and a sentence.
        trajectory: complete and finite where the status is OK, else None.
        sampling: what was asked for.
        build_time: [s]; step_time: per step [s], samples included; NaN where it did not come so far.
    """

    status: Status
    message: str
    trajectory: Trajectory | None
    sampling: Sampling
    build_time: float = float("nan")
    step_time: float = float("nan")


def one_run(
    engine: Engine,
    mechanism: Mechanism,
    choice: Choice,
    wanted: Sampling,
    inspect: Callable[[Model], object] = lambda _: None,
) -> Run:
    """Build the mechanism in an engine and run it over the samples; what an engine cannot or does not do is a status.

    `inspect` is given the model before it runs, to ask it about single states.
    """
    built = stepped = float("nan")
    try:
        reason = engine.skip(mechanism, choice)
        if reason:
            return Run(Status.SKIP, in_a_sentence(reason), None, wanted)
        started = time.perf_counter()
        model = engine.build(mechanism, choice)
        built = time.perf_counter() - started
        inspect(model)
        model.prepare(wanted.times)
        ready = time.perf_counter()
        model.run()
        stepped = (time.perf_counter() - ready) / max(1, wanted.count)
        trajectory = model.read()
    except RunFailure as failure:
        return Run(failure.status, in_a_sentence(failure), None, wanted, built, stepped)
    except ImportError as error:
        return Run(Status.SKIP, f"{engine.name} is {not_installed(error)}", None, wanted, built, stepped)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {in_a_sentence(error)} ({Path(where.filename).name}:{where.lineno})"
        return Run(Status.ERROR, text, None, wanted, built, stepped)
    verdict = judge.completeness(trajectory, wanted.times, mechanism.n)
    if not verdict.valid:
        lost = verdict.objections[0].subject is judge.Subject.NUMBERS
        return Run(Status.NAN if lost else Status.INCOMPLETE, verdict.sentence, None, wanted, built, stepped)
    try:
        steps = int(trajectory.steps)
        evaluations = None if trajectory.evaluations is None else int(trajectory.evaluations)
    except (TypeError, ValueError) as error:
        return Run(Status.INCOMPLETE, f"the engine does not count its steps: {error}", None, wanted, built, stepped)
    notes = [in_a_sentence(trajectory.note or ""), wanted.note if steps == wanted.count else ""]
    q, v, a = (np.asarray(x, dtype=float) for x in (trajectory.q, trajectory.v, trajectory.a))
    plain = Trajectory(wanted.times, q, v, a, steps, evaluations, "; ".join(filter(None, notes)))
    return Run(Status.OK, plain.note, plain, wanted, built, stepped)


def acceleration_error(mechanism: Mechanism, trajectory: Trajectory) -> float | None:
    """Median relative error of a trajectory's own accelerations at some of its states, against Gauss's principle there.

    None where that cannot be told, such as friction on redundant rows.
    """
    chosen = np.unique(np.linspace(0, len(trajectory.t) - 1, JUDGED).round().astype(int))
    part = [x[chosen] for x in (trajectory.t, trajectory.q, trajectory.v, trajectory.a)]
    try:
        model = Interpreted("gauss").build(mechanism, Choice("default", "rk4"))
        true = np.array([model.acceleration(float(t), q, v) for t, q, v in zip(*part[:3], strict=True)])
    except (RunFailure, ArithmeticError, np.linalg.LinAlgError):
        return None
    return float(np.median(relative_acceleration_error(part[3], true)))
