"""Run an engine once: sample times -> build -> prepare -> run -> read -> check. Every command runs engines with this module.

The engine's code is called in `perform`, and the samples that it returns are checked in `receive`, possibly in another process.

Samples lie at multiples of the step. If a sample is wanted at another time, such as the end of the run, one shorter step ends
there, and the note of the run reports the shorter step.
"""

import hashlib
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss_bench import judge
from gauss_bench.engines import get, not_installed
from gauss_bench.engines.base import Choice, Engine, Model
from gauss_bench.integrate.fixed_step import step_counts
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import relative_acceleration_error
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, in_a_sentence

SAMPLING = 1e-3  # [s] spacing of the samples for energy and drift, unless the step is longer
JUDGED = 20  # samples whose accelerations are compared with Gauss's principle: a wrong model is wrong at nearly all states


@dataclass(frozen=True, eq=False)
class Sampling:
    """The sample times of a run, and its steps.

    Attributes:
        times: (k,) [s], from 0, increasing.
        step: the step that is asked for [s].
        count: number of steps between the first sample and the last.
        shortened: number of steps that are shorter, to reach a time that is not a multiple of the step.
    """

    times: Array
    step: float
    count: int
    shortened: int

    @property
    def note(self) -> str:
        """A remark for the user if some steps are shorter than the step that was asked for, else an empty text."""
        if not self.shortened:
            return ""
        return f"{self.shortened} of {self.count} steps are shorter than {self.step:g} s, to meet times that whole steps miss"


def sampling(step: float, t_end: float, meet: Sequence[float] | Array = (), spacing: float = SAMPLING) -> Sampling:
    """Return sample times from 0 to t_end, about `spacing` [s] apart, and each time in `meet` that is a multiple of the step.

    The end time is always a sample time; if it is not a multiple of the step, the last step is shorter.
    """
    # the factor accepts a time that exceeds the end by rounding
    reached = [x for x in np.asarray(meet, dtype=float) if x <= t_end * (1 + 1e-12) and _is_multiple(x, step)]
    return _sample(step, _grid(step, t_end, spacing), [*reached, _whole_steps(step, t_end) * step, t_end])


def sampling_through(step: float, at: Sequence[float], spacing: float = SAMPLING) -> Sampling:
    """Return sample times about `spacing` [s] apart, and every time in `at`.

    A shorter step reaches a time in `at` that is not a multiple of the step. The multiples of the step before and after this time
    are sample times too, so that only the two steps between them are shorter.
    """
    last = max(at)
    neighbours = []  # the multiples of the step before and after each other time
    for x in at:
        if not _is_multiple(x, step):
            neighbours += [k * step for k in (np.floor(x / step), np.ceil(x / step)) if k * step <= last]
    return _sample(step, _grid(step, last, spacing), [*neighbours, *at])


def sampling_at(step: float, times: Sequence[float] | Array) -> Sampling:
    """Return a sampling at exactly these times, the first of which is the start; steps to times between multiples are shorter."""
    return _sample(step, np.asarray(times, dtype=float), [])


def _whole_steps(step: float, t_end: float) -> int:
    """Return the number of whole steps until a time, which may be short of a multiple of the step by rounding."""
    return int(np.floor(t_end / step * (1 + 1e-12)))


def _grid(step: float, t_end: float, spacing: float) -> Array:
    """Return the times [s] from 0 to at most `t_end` that are multiples of the step, about `spacing` [s] apart."""
    steps_a_sample = max(1, round(spacing / step))
    return np.arange(_whole_steps(step, t_end) // steps_a_sample + 1) * (steps_a_sample * step)


def _is_multiple(t: float, step: float) -> bool:
    """Tell whether a time is a multiple of the step, up to rounding."""
    return abs(t - round(t / step) * step) <= max(1e-9 * step, 1e-15 * t)


def _sample(step: float, grid: Array, more: Sequence[float]) -> Sampling:
    """Return the sampling at the times in `grid` and `more` [s]; a time that equals another one up to rounding counts once."""
    near = 1e-9 * min(step, 1.0)  # [s] times that are closer than this, or than their rounding, count as equal
    times = [*grid]
    for x in sorted(more):
        k = int(np.searchsorted(grid, x))
        neighbours = [*grid[max(0, k - 1) : k + 1], times[-1]]  # the grid's times before and after x, and the time added last
        if all(abs(x - y) > near + 1e-14 * x for y in neighbours):
            times.append(x)
    distinct = np.unique(times)
    counts = step_counts(distinct, step)
    shortened = sum(count for count, h in counts if h < step * (1 - 1e-6))
    return Sampling(distinct, step, sum(count for count, _ in counts), shortened)


Asked = Callable[[Model], object]  # a function that is called with a model before its run, to ask it for accelerations or loads
Build = Callable[[Mechanism, Choice], Model]


def ask_nothing(model: Model) -> None:
    """Ask the model nothing before its run."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of a run in an engine, before any check.

    Attributes:
        status, message: OK and an empty text, or the kind of failure and a sentence.
        returned: the samples that the engine returned, or reached before a failure; an object of any type, which is not checked
            yet.
        answer: the result of the function `ask`, which was called with the model before the run.
        build_time, seconds: processor time of building the model and of running it [s]; NaN if the run failed before.
    """

    status: Status
    message: str
    returned: object = None
    answer: object = None
    build_time: float = float("nan")
    seconds: float = float("nan")


@dataclass(frozen=True, eq=False)
class Run:
    """A run that has ended.

    Attributes:
        status, message: OK and a remark, or the kind of failure and a sentence.
        trajectory: complete and finite if the status is OK, else None.
        reached: the samples before a failure; None if there are no such samples, or if the status is OK.
        sampling: the sample times and the steps that were asked for.
        answer, build_time, seconds: as in Outcome.
    """

    status: Status
    message: str
    trajectory: Trajectory | None
    reached: Trajectory | None
    sampling: Sampling
    answer: object = None
    build_time: float = float("nan")
    seconds: float = float("nan")

    @property
    def samples(self) -> Trajectory | None:
        """The samples of the run; of a failed run, those before its failure."""
        return self.trajectory or self.reached

    @property
    def step_time(self) -> float | None:
        """Processor time per step [s], with the time to store samples; None if the engine does not count its steps."""
        samples = self.samples
        return None if samples is not None and samples.steps is None else self.seconds / max(1, self.sampling.count)

    def complete(self) -> Trajectory:
        """Return the complete trajectory.

        Raises:
            RunFailure: there is none; the exception has the status, the message and the samples before the failure.
        """
        if self.trajectory is None:
            raise RunFailure(self.status, self.message, self.reached)
        return self.trajectory


def one_run(
    engine: Engine,
    mechanism: Mechanism,
    choice: Choice,
    wanted: Sampling,
    ask: Asked = ask_nothing,
    shortest: float = 0.0,
    build: Build | None = None,
) -> Run:
    """Build the mechanism in an engine and run it over the samples; a refusal or a failure becomes a status.

    Args:
        ask: function that is called with the model before the run; its result is the run's `answer`.
        shortest: a run that takes less time [s] is repeated and timed again, because the caches are cold in the first run.
        build: function that builds the model instead of the engine's own function `build`.
    """
    return receive(perform(engine, mechanism, choice, wanted, ask, shortest, build), wanted, mechanism.n)


@np.errstate(all="ignore")  # a motion that diverges is reported by the later check of its samples
def perform(
    engine: Engine, mechanism: Mechanism, choice: Choice, wanted: Sampling, ask: Asked, shortest: float, build: Build | None
) -> Outcome:
    """Carry out the part of `one_run` that calls the engine's code; a failure becomes an Outcome with the reason."""
    built = seconds = float("nan")
    answer: object = None
    running: Model | None = None  # the model during its run, whose samples are read if the run is broken off
    try:
        if reason := engine.skip(mechanism, choice):
            return Outcome(Status.SKIP, in_a_sentence(reason))
        started = time.process_time()
        model = (build or engine.build)(mechanism, choice)
        built = time.process_time() - started
        answer = ask(model)
        model.prepare(wanted.times)
        running = model
        seconds = measure_seconds(model.run)
        if seconds < shortest:
            model.prepare(wanted.times)
            seconds = measure_seconds(model.run)
        running = None  # the run is complete: if `read` fails, it is not called again
        return Outcome(Status.OK, "", model.read(), answer, built, seconds)
    except RunFailure as failure:
        # the status that an engine raises may be any object; if it is not the status of a failure, it becomes ERROR
        status = next((x for x in Status if x == failure.status and x not in (Status.OK, Status.INVALID)), Status.ERROR)
        message, reached = in_a_sentence(failure), failure.reached
    except ImportError as error:
        return Outcome(Status.SKIP, f"{engine.name} is {not_installed(error)}", None, answer, built, seconds)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        status, reached = Status.ERROR, None
        message = f"{type(error).__name__}: {in_a_sentence(error)} ({Path(where.filename).name}:{where.lineno})"
    return Outcome(status, message, reached or _read(running), answer, built, seconds)


def _read(model: Model | None) -> object:
    """Return the samples that a model reached before its run was broken off; None without a model, or if it cannot return them."""
    try:
        return None if model is None else model.read()
    except RunFailure as failure:
        return failure.reached
    except Exception:
        return None


def receive(outcome: Outcome, wanted: Sampling, n: int) -> Run:
    """Check an engine's samples of n coordinates, and return the run: complete, or with the samples that it reached."""
    costs = (outcome.answer, outcome.build_time, outcome.seconds)
    reached = judge.cut_at_fault(outcome.returned, wanted.times, n)
    if outcome.status is not Status.OK:
        return Run(outcome.status, outcome.message, None, reached, wanted, *costs)  # no complete trajectory
    verdict = judge.completeness(outcome.returned, wanted.times, n)
    if not verdict.valid:
        status = Status.NAN if verdict.objections[0].subject is judge.Subject.NUMBERS else Status.INCOMPLETE
        message = "; ".join(filter(None, (verdict.sentence, reached.note if reached else "")))
        return Run(status, message, None, reached, wanted, *costs)
    if reached is None:  # the samples are complete, so that only a count can be wrong
        return Run(Status.INCOMPLETE, "the engine's count of steps is no number", None, None, wanted, *costs)
    # `wanted.note` reports shortened steps; it does not apply if the integrator has chosen other steps
    notes = (reached.note, wanted.note if reached.steps == wanted.count else "")
    whole = replace(reached, note="; ".join(filter(None, notes)))
    return Run(Status.OK, whole.note, whole, None, wanted, *costs)


def draw_samples(trajectory: Trajectory) -> NDArray[np.intp]:
    """Return the indices of at most JUDGED random samples.

    The seed is computed from the samples, so that no engine can foresee which samples will be checked.
    """
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in (trajectory.q, trajectory.v, trajectory.a)))
    random = np.random.default_rng(int.from_bytes(digest.digest()[:8], "big"))
    return np.sort(random.permutation(len(trajectory.t))[:JUDGED])


def acceleration_error(mechanism: Mechanism, trajectory: Trajectory) -> float | None:
    """Return the median relative error of a trajectory's accelerations against Gauss's formulation, at some of its states.

    The result is None if the accelerations are not determined, as with friction on redundant rows.
    """
    chosen = draw_samples(trajectory)
    t, q, v, given = (x[chosen] for x in (trajectory.t, trajectory.q, trajectory.v, trajectory.a))
    try:
        with np.errstate(all="ignore"):
            model = get("gauss").build(mechanism, Choice("default", "rk4"))
            true = np.array([model.acceleration(float(at), *state) for at, *state in zip(t, q, v, strict=True)])
            return float(np.median(relative_acceleration_error(given, true)))
    except (RunFailure, ArithmeticError, np.linalg.LinAlgError):
        return None


def measure_seconds(go: Callable[[], object]) -> float:
    """Return the processor time [s] of a call, in all threads of this process; all costs are measured by this function."""
    start = time.process_time_ns()
    go()
    return (time.process_time_ns() - start) * 1e-9
