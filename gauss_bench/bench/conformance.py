"""Check that an engine keeps the contract of its interface (`../engines/base.py`), by runs in a worker process.

    conformance("my_engine")                     an installed plug-in, or one of the built-in engines
    conformance("my_package.adapter:Engine")     a class that is not installed as a plug-in

This file checks the form of runs: times, start, repetition, counts. `agreement` checks accelerations and motions.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from gauss_bench.bench.agreement import MEASURED
from gauss_bench.bench.measure import mechanism_of
from gauss_bench.bench.subject import EVERY_STEP, PLAIN, STEP, Check, Subject, check_failed_run, check_fault
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import build_first
from gauss_bench.runs.offers import offers
from gauss_bench.runs.one_run import Run
from gauss_bench.runs.questions import accelerations, run_before
from gauss_bench.runs.worker import get_worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

ODD = np.array([0.0, 0.0137, 0.02, 0.0555, 0.1])  # [s] times, some of which are not multiples of a millisecond
START = 1e-9  # allowed error of the first sample: of positions [m, rad], and of velocities relative to the largest one
# allowed median difference, relative to the largest value, of velocities from difference quotients of positions, and of
# accelerations from those of velocities
DERIVED = 0.02
LATE = 0.75  # [steps] allowed delay of rates: those of first-order methods are half a step late or early
PARTS = (2, 4)  # divisors of the step, in the runs that show whether a method is of first order
# limits of the ratio of the changes that the first and the second halving of the step make: 2 for first order, 4 for second
FIRST_ORDER = (1.5, 3.0)


def conformance(name: str, told: Callable[[str], None] = lambda sentence: None) -> list[Check]:
    """Return the results of all checks of an engine, given by name or as MODULE:CLASS; `told` is called before each check.

    Raises:
        KeyError: there is no engine of that name.
    """
    offer = offers([name])[0]
    described = Check("describes itself", offer.usable, offer.reason)
    if not offer.usable:
        return [described]
    build_first(name, offer.settings, told)
    worker = get_worker(name)  # its process has imported the engine already
    try:
        subject, checks = Subject(offer, worker, told), [described]
        for check in CHECKS:
            told(check.__doc__ or "")
            checks += check(subject)
        return checks
    finally:
        worker.stop()


def _check_runs(
    subject: Subject, name: str, find_fault: Callable[[Mechanism, Trajectory], str], times: Array | None = None
) -> Iterator[Check]:
    """Yield one check for each linkage and scenario in PLAIN.

    Args:
        find_fault: function that returns the fault of a trajectory in a sentence, or an empty text.
        times: sample times [s] of the run; if not given, there is a sample at every step.
    """
    for linkage, scenario in PLAIN:
        run = subject.plain_runs[linkage] if times is None else subject.run(linkage, scenario, times)
        title = f"{name} ({linkage})"
        if run.trajectory is None:
            yield check_failed_run(title, run)
        else:
            yield check_fault(title, find_fault(mechanism_of(linkage, scenario), run.trajectory))


def _check_times(subject: Subject) -> Iterator[Check]:
    """Check that samples are at the times asked for."""
    # a run has a trajectory only if its samples are at these times
    yield from _check_runs(subject, "samples are at the times asked for", lambda mechanism, trajectory: "", ODD)


def _check_start(subject: Subject) -> Iterator[Check]:
    """Check that the first sample is the start of the scenario."""

    def find_wrong_start(m: Mechanism, x: Trajectory) -> str:
        """Return a sentence if the first sample is too far off; velocity errors are relative to the largest velocity or 1."""
        gap = max(np.abs(x.q[0] - m.q0).max(), np.abs(x.v[0] - m.v0).max() / max(1.0, np.abs(m.v0).max()))
        if gap <= START:
            return ""
        return f"it is {gap:.1e} off (m, rad, or of the largest speed); possible causes: units, order of links, a step too many"

    yield from _check_runs(subject, "the first sample is the start", find_wrong_start)


def _check_derivatives(subject: Subject) -> Iterator[Check]:
    """Check that velocities are the time derivatives of positions, and accelerations those of velocities."""
    for linkage, scenario in PLAIN:
        run = subject.plain_runs[linkage]
        title = f"velocities and accelerations are derivatives ({linkage})"
        if run.trajectory is None:
            yield check_failed_run(title, run)
            continue
        fault, is_shifted = rates_fault(run.trajectory)
        if is_shifted:  # rates of a method of first order may be shifted, by less time with shorter steps
            shorter_steps = [replace(subject.usual, step=STEP / k) for k in PARTS]
            finer = [subject.perform(mechanism_of(linkage, scenario), choice, EVERY_STEP).trajectory for choice in shorter_steps]
            if explains_lateness(run.trajectory, *finer):
                yield Check(title, True, f"{fault}, less with shorter steps: a method of first order")
                continue
        yield check_fault(title, fault)


def rates_fault(x: Trajectory) -> tuple[str, bool]:
    """Return the fault of a run's velocities or accelerations, or an empty text, and whether the fault is a shift in time.

    Velocities and accelerations are compared with central differences of positions and velocities. They are shifted if they belong
    to a slightly later or earlier time than their sample.
    """
    for low, high, words in ((x.q, x.v, "velocities"), (x.v, x.a, "accelerations")):
        slope = (low[2:] - low[:-2]) / (x.t[2:] - x.t[:-2])[:, None]  # central differences (k - 2, n)
        reported = high[1:-1]  # (k - 2, n)
        apart = np.median(np.abs(slope - reported).max(axis=1)) / max(np.abs(slope).max(), 1e-12)
        if apart > DERIVED:
            fault = f"{words} and difference quotients differ by {apart:.1%}: units, link order, reference point, or another time"
            return fault, False
        if abs(late := lateness(slope, reported)) > LATE:
            return f"{words} are {abs(late):.2g} steps {'late' if late > 0 else 'early'}", True
    return "", False


def explains_lateness(x: Trajectory, half: Trajectory | None, quarter: Trajectory | None) -> bool:
    """Tell whether a first-order integrator explains why a run's rates belong to later or earlier times than its samples.

    If so, halving the step changes the velocities, and halving it again changes them half as much (within FIRST_ORDER), and the run
    with the shortest step no longer has the fault. An engine that shifts its samples by whole steps does so at every step size, and
    with a method of higher order the second change is less than half the first. `half` and `quarter` are the repetitions with the
    step divided by PARTS; None if one failed.
    """
    if half is None or quarter is None or rates_fault(quarter)[0]:
        return False
    change, next_change = (float(np.abs(longer.v - shorter.v).max()) for longer, shorter in ((x, half), (half, quarter)))
    least, most = FIRST_ORDER
    return least * next_change < change < most * next_change


def lateness(slope: Array, reported: Array) -> float:
    """Return the delay of reported rates (k, n) relative to the difference quotients `slope` (k, n), in samples.

    A rate that is d samples late equals slope - d * change, where `change` is the difference of the slope from one sample to the
    next; d follows by least squares.
    """
    change = (slope[2:] - slope[:-2]) / 2
    scale = float((change * change).sum())
    return float(((slope - reported)[1:-1] * change).sum()) / scale if scale else 0.0


def _check_repetition(subject: Subject) -> Iterator[Check]:
    """Check that a repeated run returns the same numbers, bit for bit."""
    (linkage, scenario), title = PLAIN[0], "a run repeats bit by bit"
    first, second = subject.plain_runs[linkage], subject.run(linkage, scenario, EVERY_STEP)
    after_a_run = subject.run(linkage, scenario, EVERY_STEP, partial(run_before, EVERY_STEP))  # by a model that has run before
    for run in (first, second, after_a_run):
        if run.trajectory is None:
            yield check_failed_run(title, run)
            return
    yield check_fault(title, "" if _agree(first, second) else "two runs differ")
    fault = "" if _agree(first, after_a_run) else "a model that has run before gives another motion: prepare must reset everything"
    yield check_fault("a model can run again", fault)


def _check_undisturbed(subject: Subject) -> Iterator[Check]:
    """Check that asking for an acceleration does not change the run."""
    (linkage, scenario), title = PLAIN[0], "asking for an acceleration changes nothing"
    m = mechanism_of(linkage, scenario)
    question = partial(accelerations, np.zeros(1), m.q0[None], m.v0[None])  # at the start
    plain, asked = subject.plain_runs[linkage], subject.run(linkage, scenario, EVERY_STEP, question, m.n)
    for run in (plain, asked):
        if run.trajectory is None:
            yield check_failed_run(title, run)
            return
    fault = "" if asked.answer is not None and np.isfinite(np.asarray(asked.answer, dtype=float)).all() else "it is not finite"
    yield check_fault("an acceleration is a finite number for each coordinate", fault)
    yield check_fault(title, "" if _agree(plain, asked) else "asking at its start changes the run")


def _check_step_counts(subject: Subject) -> Iterator[Check]:
    """Check that the engine reports the correct number of steps, if it counts its steps."""
    title, wanted = "steps are counted", len(EVERY_STEP) - 1  # these sample times are one step apart
    if subject.offer.integrators[0] in subject.offer.adaptive:
        yield Check(title, None, "its first integrator chooses its own steps")
    elif all(run.trajectory is not None and run.trajectory.steps is None for run in subject.plain_runs.values()):
        yield Check(title, None, "it does not count its steps")
    else:

        def find_wrong_count(m: Mechanism, x: Trajectory) -> str:
            """Return a sentence if the number of counted steps is not the number that was asked for, else an empty text."""
            return "" if x.steps == wanted else f"{x.steps} steps are counted, {wanted} of {STEP:g} s were asked for"

        yield from _check_runs(subject, title, find_wrong_count)


def _agree(one: Run, other: Run) -> bool:
    """Tell whether the samples of two complete runs are identical, bit for bit."""
    return all(np.array_equal(getattr(one.trajectory, x), getattr(other.trajectory, x)) for x in ("t", "q", "v", "a"))


CHECKS = (_check_times, _check_start, _check_derivatives, _check_repetition, _check_undisturbed, _check_step_counts, *MEASURED)
