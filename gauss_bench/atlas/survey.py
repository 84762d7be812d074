"""Run every engine with its settings along every axis, and find by bisection the hardest value that the engine passes.

Bisection assumes that the verdict never gets better from a value to a harder one; if this is wrong, it finds one of the values at
which the verdict changes. The first value is always run, and the last one if the first passes or is degraded. Every run takes place
in a worker process with a time limit, so that a crash or a hang counts as a failure. Verdicts depend on the speed of the computer
only if a time limit is reached.
"""

import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from gauss_bench.atlas.families import FAMILIES, SCENARIO, Axis
from gauss_bench.atlas.verdict import RunVerdict, Verdict, decide
from gauss_bench.engines import names
from gauss_bench.engines.base import Choice
from gauss_bench.exchange.toml import toml
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import ChoiceError, offers
from gauss_bench.runs.one_run import sampling, sampling_at
from gauss_bench.runs.worker import Worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference

BUDGET = 600.0  # [s] default of the time for a survey
LIMIT = 60.0  # [s] longest time of one run, including building the model
SAMPLES = 100  # largest number of samples that are compared with the reference
EXACT, NEARLY = 1e-12, 1e-10  # relative tolerances of the reference and of a second motion; their difference is the error bar
STABILIZED = ("none", "projection")  # stabilisations that are surveyed, if an engine offers them
LABELS = ("default", "tuned")  # names of settings that are surveyed, if an engine offers them

Tell = Callable[[str], object]


@dataclass(frozen=True)
class EngineSetting:
    """An engine with the settings, integrator and stabilisation with which it runs linkages."""

    engine: str
    settings: str
    integrator: str
    stabilization: str

    @property
    def name(self) -> str:
        """The name in tables and sentences, such as "mujoco tuned + projection"."""
        settings = f" {self.settings}" if self.settings != "default" else ""
        projection = " + projection" if self.stabilization == "projection" else ""
        return f"{self.engine}{settings}{projection}"


@dataclass(frozen=True)
class Reach:
    """The result of one engine with one setting along one axis: up to which value the engine passes.

    Attributes:
        setting, axis: engine and setting of the runs, and the name of the axis.
        passes_to: the hardest value on the axis with the verdict "pass"; None if even the easiest value does not pass.
        ends_at: the hardest value with the verdict "pass" or "degraded"; None if even the easiest value is neither.
        last: verdict on the hardest value that was run; OPEN if bisection met a value whose verdict is unknown.
        reason: why the first value beyond `passes_to` does not pass, or why a verdict is unknown.
        error: largest error at the value `passes_to`, relative to the linkage's size, or [rad]; NaN if no value has passed.
        runs: number of values at which the engine was run.
    """

    setting: EngineSetting
    axis: str
    passes_to: float | None
    ends_at: float | None
    last: Verdict
    reason: str
    error: float
    runs: int


def choose_settings(wanted: Sequence[str] | None) -> list[EngineSetting]:
    """Return the combinations of settings and stabilisation with which the engines `wanted` are run; None: all usable engines.

    An engine runs with its settings named in LABELS or, if it has none of these, with its first, and likewise with its
    stabilisations named in STABILIZED. The integrator is the engine's first one.

    Raises:
        KeyError: an engine is unknown.
        ChoiceError: a named engine cannot be used.
    """
    usable = []
    for offer in offers(list(wanted or names())):
        if wanted and not offer.usable:
            raise ChoiceError(f"{offer.name} cannot be used: {offer.reason}")
        if offer.usable:
            labels = [x for x in LABELS if x in offer.settings] or list(offer.settings)[:1]
            stabilizations = [x for x in STABILIZED if x in offer.stabilizations] or list(offer.stabilizations)[:1]
            usable += [EngineSetting(offer.name, x, offer.integrators[0], y) for x in labels for y in stabilizations]
    return usable


def choose_axes(wanted: Sequence[str] | None) -> list[Axis]:
    """Return the axes with the names `wanted`; None: all axes.

    Raises:
        ChoiceError: an axis is unknown.
    """
    for name in wanted or ():
        if name not in FAMILIES:
            raise ChoiceError(f"no axis {name!r}; there are {', '.join(FAMILIES)}")
    return [FAMILIES[name] for name in wanted or FAMILIES]


class Linkages:
    """The linkages of all axes as files in a folder, with their references; each is made when it is first used."""

    def __init__(self, folder: Path):
        """Choose the engine that computes references: compiled if that is possible."""
        self.folder, self.engine = folder, "gauss-native" if find_spec("llvmlite") else "gauss"
        # (name of the axis, value) -> linkage, and reference or the reason why there is none
        self.prepared: dict[tuple[str, float], tuple[Mechanism, Reference | str]] = {}
        self.locks: defaultdict[tuple[str, float], threading.Lock] = defaultdict(threading.Lock)

    def prepare(self, axis: Axis, value: float, worker: Worker) -> tuple[Mechanism, Reference | str]:
        """Return the linkage for a value of an axis, and its reference or the reason why there is none.

        Each linkage is made only once, even if several threads call this. `worker` is the process that computes the reference.
        """
        key = (axis.name, value)
        with self.locks[key]:
            if key not in self.prepared:
                self.prepared[key] = self._make_linkage(axis, value, worker)
            return self.prepared[key]

    def _make_linkage(self, axis: Axis, value: float, worker: Worker) -> tuple[Mechanism, Reference | str]:
        """Write the linkage for a value of an axis as a file; return it, and its reference or the reason why there is none.

        The difference of the motions with the tolerances EXACT and NEARLY is the error bar of the reference.
        """
        document = axis.document(value)
        document["name"] = f"{axis.name}_{axis.values.index(value)}"
        path = self.folder / f"{document['name']}.toml"
        path.write_text(toml(document, ()), encoding="utf-8")
        mechanism, step = load(path, SCENARIO), axis.step(value)
        times = comparison_times(step, mechanism.duration)
        motions = []  # q, v, a (3, k, n) of the motion with the tolerance EXACT, and then of that with NEARLY
        for tolerance in (EXACT, NEARLY):
            if axis.truth is not None:
                motions.append(axis.truth(value, times, tolerance))
                continue
            choice = Choice("default", "dop853", "none", step, tolerance)
            request = Request(str(path), SCENARIO, self.engine, choice, sampling_at(step, times))
            run = run_apart(request, mechanism, LIMIT, worker)
            if run.trajectory is None:
                return mechanism, f"no reference: {run.message}"
            motions.append(np.array([run.trajectory.q, run.trajectory.v, run.trajectory.a]))
        q, v, a = motions[0]
        error_q, error_v, error_a = np.abs(motions[0] - motions[1]).max(axis=2)
        floor = np.zeros(len(times))  # rounding errors of q, v and a, which are taken as zero
        return mechanism, Reference(times, q, v, a, error_q, error_v, error_a, floor, floor, floor, "DOP853 at two tolerances")


def comparison_times(step: float, until: float) -> Array:
    """Return the times (k,) [s], at most about SAMPLES, at which a run up to `until` is compared with the reference.

    They are multiples of the step [s], at least about a millisecond apart.
    """
    count = int(np.floor(until / step * (1 + 1e-9)))  # number of steps; rounding of the quotient removes none
    each = max(1, round(1e-3 / step), -(-count // SAMPLES))  # steps from one time to the next; -(-a // b) rounds a / b up
    return np.arange(count // each + 1) * (each * step)


def find_reach(setting: EngineSetting, axis: Axis, linkages: Linkages, worker: Worker, remaining: Callable[[], float]) -> Reach:
    """Find the hardest value of an axis at which an engine with a setting passes, by runs in the worker.

    `remaining` returns the time [s] that is left for the whole survey.
    """
    runs: dict[int, RunVerdict] = {}  # index of a value -> its verdict

    def judge_value(i: int) -> RunVerdict:
        """Return the verdict on the run at value number i of the axis; only the first call for an i runs the engine."""
        if i not in runs:
            runs[i] = judge_run(setting, axis, axis.values[i], linkages, worker, remaining())
        return runs[i]

    def count_by_bisection(*accepted: Verdict) -> int:
        """Return the number of values, counted from the easiest, whose verdict is one of `accepted`."""
        last = len(axis.values) - 1
        if judge_value(0).verdict not in accepted:
            return 0
        if judge_value(last).verdict in accepted:
            return last + 1
        good, bad = 0, last
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if judge_value(middle).verdict in accepted else (good, middle)
        return bad

    passing = count_by_bisection(Verdict.PASS)  # number of values with the verdict PASS
    ending = max(passing, count_by_bisection(Verdict.PASS, Verdict.DEGRADED))  # and of those with PASS or DEGRADED
    # verdict on the easiest value whose outcome is unknown, None if every outcome is known
    unknown = next((x for _, x in sorted(runs.items()) if x.verdict is Verdict.OPEN), None)
    if unknown is not None:  # bisection may be wrong, so that only values that were run count
        passing = max((i + 1 for i, x in runs.items() if x.verdict is Verdict.PASS), default=0)
        ending = max((i + 1 for i, x in runs.items() if x.verdict in (Verdict.PASS, Verdict.DEGRADED)), default=0)
    beyond = unknown or runs.get(passing)  # why the setting does not pass at harder values
    return Reach(
        setting,
        axis.name,
        passes_to=axis.values[passing - 1] if passing else None,
        ends_at=axis.values[ending - 1] if ending else None,
        last=Verdict.OPEN if unknown is not None else runs[max(runs)].verdict,
        reason=beyond.reason if beyond else "",
        error=runs[passing - 1].error if passing else float("nan"),
        runs=len(runs),
    )


def judge_run(setting: EngineSetting, axis: Axis, value: float, linkages: Linkages, worker: Worker, time_left: float) -> RunVerdict:
    """Run an engine with a setting on the linkage for one value of an axis, and return the verdict on the run.

    The verdict is OPEN if the survey has no time left (`time_left` [s]), or if there is no reference.
    """
    if time_left <= 0:
        return RunVerdict(Verdict.OPEN, reason="not reached within the budget")
    mechanism, reference = linkages.prepare(axis, value, worker)
    if isinstance(reference, str):
        return RunVerdict(Verdict.OPEN, reason=reference)
    choice = Choice(setting.settings, setting.integrator, setting.stabilization, axis.step(value))
    request = Request(mechanism.source, SCENARIO, setting.engine, choice, sampling(choice.step, mechanism.duration, reference.t))
    return decide(mechanism, run_apart(request, mechanism, LIMIT, worker), reference)


def survey(settings: Sequence[EngineSetting], axes: Sequence[Axis], budget: float, jobs: int, tell: Tell) -> list[Reach]:
    """For each axis and each engine with its setting, find the hardest value at which the engine passes.

    Args:
        budget: time for all runs together [s].
        jobs: number of threads, each with a worker process of its own.
        tell: function that is called with each sentence of progress.
    """
    end, done, interrupted = time.monotonic() + budget, 0, threading.Event()
    of_thread = threading.local()  # its attribute `worker` is the worker process of the thread
    workers: list[Worker] = []
    reporting = threading.Lock()  # one thread at a time reports its progress
    with tempfile.TemporaryDirectory() as folder:
        linkages = Linkages(Path(folder))

        def remaining() -> float:
            """Return the seconds that are left, or 0 after an interrupt."""
            return 0.0 if interrupted.is_set() else end - time.monotonic()

        def stop() -> None:
            """End the worker processes of all threads."""
            for worker in workers:
                worker.stop()

        def survey_pair(pair: tuple[Axis, EngineSetting]) -> Reach:
            """Run one engine with its setting along one axis, in this thread's worker process; report and return the result."""
            nonlocal done
            axis, setting = pair
            if not hasattr(of_thread, "worker"):
                of_thread.worker = Worker()
                workers.append(of_thread.worker)
            reach = find_reach(setting, axis, linkages, of_thread.worker, remaining)
            with reporting:
                done += 1
                if not interrupted.is_set():
                    tell(f"{done}/{len(pairs)} {setting.name}, {axis.title}: {describe(reach)}")
            return reach

        pairs = [(axis, setting) for axis in axes for setting in settings]
        tell(f"settings of engines: {len(settings)}; axes: {len(axes)}")
        try:
            with ThreadPoolExecutor(jobs) as pool:
                try:
                    return list(pool.map(survey_pair, pairs))
                except BaseException:  # an interrupt: begin no other run, and stop the workers
                    interrupted.set()
                    stop()
                    raise
        finally:
            stop()


def describe(reach: Reach) -> str:
    """Return a sentence with the hardest value of an axis at which an engine passes, and the reason why it goes no further."""
    axis = FAMILIES[reach.axis]
    unit = f" {axis.unit}" if axis.unit else ""
    if reach.passes_to is None:  # not even the easiest value passes
        return f"{reach.last}: {reach.reason}"
    if reach.passes_to == axis.values[-1]:
        return f"passes all values, to {reach.passes_to:g}{unit}"
    ends = f", degraded to {reach.ends_at:g}{unit}" if reach.ends_at != reach.passes_to else ""
    then = f"{reach.last}: " if reach.last in (Verdict.CANNOT, Verdict.OPEN) else ""
    return f"passes to {reach.passes_to:g}{unit}{ends}; then {then}{reach.reason}"
