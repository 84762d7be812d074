"""Check that an engine keeps the contract, by runs in a worker whose answers are verified.

    conformance("my_engine")          an installed plug-in, or one of the built-in engines
    conformance("my_package.adapter:Engine")     a class that is not installed as a plug-in yet

This file checks the form of runs: times, start, repetition, counts. `agreement` checks accelerations and motions.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from gauss_bench.bench.agreement import MEASURED
from gauss_bench.bench.measure import mechanism_of
from gauss_bench.bench.subject import EVERY_STEP, PLAIN, STEP, Check, Subject
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import build_first
from gauss_bench.runs.offers import offers
from gauss_bench.runs.one_run import Asked, nothing
from gauss_bench.runs.questions import accelerations, run_before
from gauss_bench.runs.worker import keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory

ODD = (0.0, 0.0137, 0.02, 0.0555, 0.1)  # [s] times that a step of a millisecond misses
START = 1e-9  # of the first sample, relative to the linkage's size and speed
DERIVED = 0.02  # of velocities against differences of positions, and accelerations of velocities: the median, of the largest
LATE = 0.75  # steps: first-order methods put rates half a step beside the differences of what they integrate
PARTS = (2, 4)  # parts of a step, in the runs that show of which order a method is
FIRST_ORDER = (1.5, 3.0)  # times: what half the step changes less of velocities; 2 in theory, 4 for a method of second order


def conformance(name: str, told: Callable[[str], None] = lambda sentence: None) -> list[Check]:
    """Run all checks of an engine, given by name or as MODULE:CLASS; `told` is called with each before it runs.

    Raises:
        KeyError: there is no engine of that name.
    """
    offer = offers([name])[0]
    described = Check("describes itself", offer.usable, offer.reason)
    if not offer.usable:
        return [described]
    build_first(name, offer.settings, told)
    worker = keep(name)  # which has described it already
    try:
        subject, checks = Subject(offer, worker, told), [described]
        for check in CHECKS:
            told(check.__doc__ or "")
            checks += check(subject)
        return checks
    finally:
        worker.stop()


def _judge(
    subject: Subject, name: str, look: Callable[[Mechanism, Trajectory], str], times: Array | None = None
) -> Iterator[Check]:
    """Yield a check on each linkage; `look` says what is wrong with a trajectory, at every step or these times, or nothing."""
    for linkage, scenario in PLAIN:
        run = subject.whole[linkage] if times is None else subject.run(linkage, scenario, times)
        title = f"{name} ({linkage})"
        if run.trajectory is None:
            yield Check(title, None if run.status is Status.SKIP else False, run.message)
        else:
            message = look(mechanism_of(linkage, scenario), run.trajectory)
            yield Check(title, not message, message)


def _times(subject: Subject) -> Iterator[Check]:
    """Check that samples are at the times asked for."""
    yield from _judge(subject, "samples are at the times asked for", lambda m, x: "", np.array(ODD))


def _start(subject: Subject) -> Iterator[Check]:
    """Check that the first sample is the start of the scenario."""

    def look(m: Mechanism, x: Trajectory) -> str:
        gap = max(np.abs(x.q[0] - m.q0).max(), np.abs(x.v[0] - m.v0).max() / max(1.0, np.abs(m.v0).max()))
        if gap <= START:
            return ""
        return f"it is {gap:.1e} (m, rad, or of the largest speed) away: units, order of links, or a step too many"

    yield from _judge(subject, "the first sample is the start", look)


def _derivatives(subject: Subject) -> Iterator[Check]:
    """Check that velocities are the rates of positions, and accelerations those of velocities."""
    for linkage, scenario in PLAIN:
        run = subject.whole[linkage]
        title = f"velocities and accelerations are derivatives ({linkage})"
        if run.trajectory is None:
            yield Check(title, None if run.status is Status.SKIP else False, run.message)
            continue
        fault, is_late = rates_fault(run.trajectory)
        if is_late:  # the steps of a method of first order may change accelerations by as much as this
            finer = [
                subject.perform(mechanism_of(linkage, scenario), replace(subject.usual, step=STEP / k), EVERY_STEP).trajectory
                for k in PARTS
            ]
            if explains_lateness(run.trajectory, *finer):
                fault = f"{fault}, and less the shorter the steps are: a method of first order"
                yield Check(title, True, fault)
                continue
        yield Check(title, not fault, fault)


def rates_fault(x: Trajectory) -> tuple[str, bool]:
    """Return what is wrong with the velocities or accelerations of a trajectory, and whether it is that they are late or early."""
    for low, high, words in ((x.q, x.v, "velocities"), (x.v, x.a, "accelerations")):
        slope, reported = (low[2:] - low[:-2]) / (x.t[2:] - x.t[:-2])[:, None], high[1:-1]
        apart = np.median(np.abs(slope - reported).max(axis=1)) / max(np.abs(slope).max(), 1e-12)
        if apart > DERIVED:
            fault = f"{words} and differences are {apart:.1%} apart: units, order of links, a reference point, or another time"
            return fault, False
        if abs(late := lateness(slope, reported)) > LATE:
            return f"{words} are {abs(late):.2g} steps {'late' if late > 0 else 'early'}", True
    return "", False


def explains_lateness(x: Trajectory, half: Trajectory | None, quarter: Trajectory | None) -> bool:
    """Tell whether rates that are late or early are so by a method of first order, from runs with the steps of PARTS.

    Then every halving of the step changes the velocities half as much, and the rates of the finest run are right at the samples. A
    shift by whole samples stays as it is, and the changes of a method of higher order fall faster.
    """
    if half is None or quarter is None or rates_fault(quarter)[0]:
        return False
    change, finer = (float(np.abs(one.v - other.v).max()) for one, other in ((x, half), (half, quarter)))
    return FIRST_ORDER[0] * finer < change < FIRST_ORDER[1] * finer


def lateness(slope: Array, reported: Array) -> float:
    """Return by how many samples the reported rates (k, n) lag behind the difference quotients `slope` (k, n), by least squares."""
    change = (slope[2:] - slope[:-2]) / 2
    scale = float((change * change).sum())
    return float(((slope - reported)[1:-1] * change).sum()) / scale if scale else 0.0


def _same_again(subject: Subject) -> Iterator[Check]:
    """Check that a repeated run returns the same bits."""
    for linkage, scenario in PLAIN[:1]:
        runs = [
            subject.whole[linkage],
            *(subject.run(linkage, scenario, EVERY_STEP, ask) for ask in (nothing, partial(run_before, EVERY_STEP))),
        ]
        first, second, third = (run.trajectory for run in runs)
        if first is None or second is None or third is None:
            fault = next(run.message for run in runs if run.trajectory is None)
            yield Check("a run repeats bit by bit", None if runs[0].status is Status.SKIP else False, fault)
            continue
        yield Check("a run repeats bit by bit", _equal(first, second), "" if _equal(first, second) else "two runs differ")
        fault = "" if _equal(first, third) else "a model that has run before gives another motion: prepare must reset everything"
        yield Check("a model can run again", not fault, fault)


def _is_undisturbed(subject: Subject) -> Iterator[Check]:
    """Check that asking for an acceleration does not change the run."""
    linkage, scenario = PLAIN[0]
    m = mechanism_of(linkage, scenario)
    plain, asked = subject.whole[linkage], subject.run(linkage, scenario, EVERY_STEP, asking(m), m.n)
    if plain.trajectory is None or asked.trajectory is None:
        yield Check("asking for an acceleration changes nothing", None if plain.status is Status.SKIP else False, asked.message)
        return
    fault = "" if asked.answer is not None and np.isfinite(np.asarray(asked.answer, dtype=float)).all() else "it is not finite"
    yield Check("an acceleration is a finite number for each coordinate", not fault, fault)
    fault = "" if _equal(plain.trajectory, asked.trajectory) else "a run goes another way after a question at its start"
    yield Check("asking for an acceleration changes nothing", not fault, fault)


def _steps(subject: Subject) -> Iterator[Check]:
    """Check that steps are counted right, by an engine that counts them."""
    if subject.offer.integrators[0] in subject.offer.adaptive:
        yield Check("steps are counted", None, "its first integrator chooses its own steps")
        return
    wanted = len(EVERY_STEP) - 1

    def look(m: Mechanism, x: Trajectory) -> str:
        return "" if x.steps == wanted else f"{x.steps} steps are told, {wanted} of {STEP:g} s were asked for"

    if all(run.trajectory is not None and run.trajectory.steps is None for run in subject.whole.values()):
        yield Check("steps are counted", None, "it does not count its steps")
        return
    yield from _judge(subject, "steps are counted", look)


def asking(m: Mechanism) -> Asked:
    """Return the question for the acceleration (1, n) at the start of a linkage, which is asked in the worker."""
    return partial(accelerations, np.zeros(1), m.q0[None], m.v0[None])


def _equal(one: Trajectory, other: Trajectory) -> bool:
    return all(np.array_equal(getattr(one, x), getattr(other, x)) for x in ("t", "q", "v", "a"))


CHECKS = (_times, _start, _derivatives, _same_again, _is_undisturbed, _steps, *MEASURED)
