"""Checks of a run without a reference: by a repetition, by the fastest mode, by a second formulation.

A run that agrees with nothing but itself is not trusted. Half the step shows the error of the step, in any engine; a tighter
tolerance shows that of an integrator with its own steps. The suite's linearisation shows whether a step of that length could follow
the motion, and two formulations of the same accelerations show how many digits the linkage leaves them.
"""

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gauss_bench import metrics
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.judge import FEWEST, OFF_MOTION, Evidence, Subject, examine, judge
from gauss_bench.linkage.closure import null_space
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism, factor_of
from gauss_bench.runs.apart import Request
from gauss_bench.runs.offers import Offer
from gauss_bench.runs.one_run import JUDGED, SAMPLING, Run, acceleration_error, nothing, sampling_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, RunFailure, Trajectory

LONGEST = 60.0  # [s] of processor time for a run at half the step: of a longer run a first part is repeated
LARGEST = 40  # freedoms beyond which no mode is looked for: half the step decides alone
LOOKED_AT = 5  # states, of whose fastest modes the median counts: next to a singular position one is anything
VAGUE = 0.1  # of what the judge allows: a reference with larger error bars tells too little of a run
RELATIVE = re.compile(r"rtol|reltol|relative_tolerance")  # options by which integrators are told their relative tolerance
USUAL_TOLERANCE = 1e-6  # relative, where an engine names none
FINER, SMALLEST_TOLERANCE = 100.0, 1e-14  # of a relative tolerance
A_PERIOD = 8  # samples: the integral of a sine through them is right to 1e-3
MOST = 200_000  # samples that are taken closer than SAMPLING: half a GiB of a large linkage
MOVED = 1e-6  # of 1 rad and 1 m: large for rounding, small for the curvature of any motion
FAILURES = (RunFailure, ArithmeticError, np.linalg.LinAlgError)


def sample_spacing(mechanism: Mechanism, t_end: float) -> float:
    """Return how far the samples of a run may lie apart [s] for its work and rates to be integrated through them.

    A period of the fastest force, of a table that rises and falls, and of the fastest mode at the start, has A_PERIOD samples; a
    run has no more than MOST of them.
    """
    start = Trajectory(np.zeros(1), mechanism.q0[None], mechanism.v0[None], np.zeros((1, mechanism.n)), 0)
    rates = [float(np.abs(x).max(initial=0.0)) for x in modes_along(mechanism, start)]
    periods = [2 * np.pi / x for x in rates if x > 0]
    if (period := mechanism.forcing_period) is not None:
        periods.append(period)
    periods += [2 * float(np.diff(x).min()) for x in turns(mechanism) if len(x) > 1]
    return max(min(SAMPLING, *(x / A_PERIOD for x in periods), SAMPLING), min(SAMPLING, t_end / MOST))


def turns(mechanism: Mechanism) -> list[Array]:
    """Return the times [s] at which each factor of lines turns from growing to falling, or back."""
    found = []
    for factor in filter(None, map(factor_of, mechanism.varying)):
        if factor.kinks:
            slopes = np.array([0.0, *(slope for _, slope in factor.lines[1:])])
            steep = np.flatnonzero(slopes)
            turned = steep[1:][np.diff(np.sign(slopes[steep])) != 0]
            found.append(np.array(factor.kinks)[turned - 1])
    return found


def repeat_finer(request: Request, offer: Offer, seconds: float, times: Array, longest: float = LONGEST) -> Request:
    """Return the run that tells whether to trust the one asked for: at half the step, or at a tighter tolerance and closer samples.

    Args:
        seconds: that the run took.
        times: (k,) [s] of its samples.
        longest: [s] of a repetition; of a longer run only the first part is repeated.
    """
    part, choice = first_part(times, seconds, longest), request.choice
    if choice.integrator not in offer.adaptive:
        choice = replace(choice, step=choice.step / 2)
    else:
        choice = replace(choice, tolerance=finer_tolerance(offer, choice))
        part = np.sort(np.concatenate([part, (part[1:] + part[:-1]) / 2]))  # where samples end steps, no tolerance decides
    return replace(request, choice=choice, wanted=sampling_at(choice.step, part), ask=nothing, answers=0)


def at_samples(finer: Run, times: Array) -> Run:
    """Return a repetition, cut to the sample times (k,) [s] of the run."""
    x = finer.trajectory
    if x is None:
        return finer
    both = metrics.common_times(x.t, times)[0]
    return replace(finer, trajectory=replace(x, t=x.t[both], q=x.q[both], v=x.v[both], a=x.a[both]))


def finer_tolerance(offer: Offer, choice: Choice) -> float:
    """Return a hundredth of the relative tolerance that a run has; a hundred times it where no smaller one can be kept."""
    tolerance = choice.tolerance
    if tolerance is None:
        options = offer.resolve_settings(choice.settings)
        given = [x for name, x in options.items() if RELATIVE.search(name) and isinstance(x, float) and x > 0]
        tolerance = min(given, default=USUAL_TOLERANCE)
    finer = tolerance / FINER
    return finer if finer >= SMALLEST_TOLERANCE else tolerance * FINER


def has_sound_rates(mechanism: Mechanism, trajectory: Trajectory) -> bool:
    """Tell whether the judge accepts the rates of a motion as they are: with a reference, nothing else asks for a repetition."""
    evidence = examine(Evaluator(mechanism), trajectory)
    return all(x.subject is not Subject.RATES for x in judge(evidence).objections)


def is_same_run(one: Trajectory, other: Trajectory) -> bool:
    """Tell whether a repetition returned the very bits of a motion, as an engine does that takes no tolerance."""
    k = min(len(one.t), len(other.t))
    moves = bool(np.any(one.v[:k]) or np.any(one.a[:k]))
    return moves and np.array_equal(one.q[:k], other.q[:k]) and np.array_equal(one.v[:k], other.v[:k])


def depends_on_steps(mechanism: Mechanism, trajectory: Trajectory) -> bool:
    """Tell whether a motion's last bits must depend on its steps: it has free motion, and that is more than a parabola."""
    J = Evaluator(mechanism).constraints(trajectory.t[:1], trajectory.q[:1], trajectory.v[:1]).J[0]
    return bool(np.ptp(trajectory.a, axis=0).any()) and null_space(J, mechanism.n).shape[1] > 0


def first_part(times: Array, seconds: float, longest: float) -> Array:
    """Return the first times (k,) [s], as many as a run at half the step reaches within `longest` seconds."""
    if not seconds > longest / 2:  # nor where a failed run was not timed
        return times
    return times[: max(2, int(len(times) * longest / 2 / seconds))]


def warn_of_forcing(mechanism: Mechanism, choice: Choice, adaptive: bool) -> str:
    """Return a warning where a fixed step does not resolve a force that oscillates with time, else an empty text."""
    steps = steps_a_forcing(mechanism, choice, adaptive)
    if steps is None or steps >= FEWEST:
        return ""
    period = mechanism.forcing_period
    return f"a step of {choice.step:g} s does not resolve a force that swings with a period of {period:.3g} s"


def steps_a_forcing(mechanism: Mechanism, choice: Choice, adaptive: bool) -> float | None:
    """Return how many fixed steps the shortest period of a force has; None without such a force, or without fixed steps."""
    period = mechanism.forcing_period
    return None if period is None or adaptive else period / choice.step


def decides(truth: Reference, mechanism: Mechanism) -> bool:
    """Tell whether a reference is accurate enough to judge a run without a repetition."""
    return bool(truth.error_q.max(initial=0.0) <= VAGUE * OFF_MOTION * min(1.0, mechanism.size))


def evidence_of(
    mechanism: Mechanism,
    choice: Choice,
    trajectory: Trajectory,
    truth: Reference | None,
    finer: Run | None,
    acceleration_off: float | None = None,
    adaptive: bool = False,
    untried: str = "",
) -> tuple[Evidence, str]:
    """Return the evidence to judge a run by, and a sentence where the repetition does not cover the whole run.

    Args:
        finer: the repetition of the run, where no reference decides.
        acceleration_off: median relative error of its accelerations at given states; found at the run's own where not given.
        adaptive: whether the integrator chooses its own steps.
        untried: why there is no repetition where one is wanted.
    """
    off = acceleration_error(mechanism, trajectory) if acceleration_off is None else acceleration_off
    evidence = examine(Evaluator(mechanism), trajectory, truth, off)
    if truth is not None or (finer is not None and finer.trajectory is not None):  # else nothing would decide
        evidence = replace(evidence, seen=measurable_gain(mechanism, trajectory, evidence))
    if truth is None or not truth.certified:  # one that is not is as good as the equations that it shares with the run
        evidence = replace(evidence, disagreement=disagreement(mechanism, trajectory))
    evidence = replace(evidence, steps_a_forcing=steps_a_forcing(mechanism, choice, adaptive))
    if finer is None:
        return replace(evidence, unrepeated=untried if truth is None else ""), ""
    how = "a tighter tolerance" if adaptive else "half the step"
    if not adaptive:
        rate = fastest_rate(mechanism, trajectory)
        evidence = replace(evidence, steps_a_period=2 * np.pi / (rate * choice.step) if rate else None)
    why = ""
    if finer.trajectory is None:
        why = f"{how} gave no motion to compare with: {finer.status}, {finer.message}"
    elif is_same_run(trajectory, finer.trajectory) and (adaptive or depends_on_steps(mechanism, trajectory)):
        why = f"{choice.integrator} is not repeatable: {'another tolerance' if adaptive else how} gives the same bits"
    if why or finer.trajectory is None:
        return replace(evidence, unrepeated=why if truth is None else ""), ""
    other = as_truth(finer.trajectory)
    part = "" if len(other.t) == len(trajectory.t) else f"{how} was tried up to {other.t[-1]:.3g} s"
    halving, again = metrics.state_errors(mechanism, trajectory, other), metrics.rate_gaps(finer.trajectory)
    return replace(evidence, halving=halving, rates_again=again, finer=how), part


def as_truth(trajectory: Trajectory) -> Reference:
    """Return a second run in the form of a reference, with error bars of 0."""
    none = np.zeros(len(trajectory.t))
    return Reference(trajectory.t, trajectory.q, trajectory.v, trajectory.a, none, none, none, none, none, none, "half the step")


def measurable_gain(mechanism: Mechanism, trajectory: Trajectory, evidence: Evidence) -> Array | None:
    """Energy gained beyond the work (k,) [J] as far as samples can tell it, where that changes what is said of it; else None.

    Samples further apart than the quickest damping takes to act do not see what it takes.
    """
    if not any(x.subject is Subject.ENERGY for x in judge(evidence).objections):
        return None
    modes = modes_along(mechanism, trajectory)
    fastest = max((float(-x.real.min(initial=0.0)) for x in modes), default=0.0)
    return metrics.without_loss(trajectory.t, evidence.energy, 1.0 / fastest) if fastest > 0 else None


def fastest_rate(mechanism: Mechanism, trajectory: Trajectory) -> float | None:
    """Angular frequency [rad/s] of the fastest oscillation that a linkage can make about its motion, or None if not to be told."""
    rates = [float(np.abs(x.imag).max(initial=0.0)) for x in modes_along(mechanism, trajectory)]
    return float(np.median(rates)) if rates else None


def modes_along(mechanism: Mechanism, trajectory: Trajectory) -> list[NDArray[np.complex128]]:
    """Eigenvalues [1/s] of small motions about some states of a motion; none where they cannot be told.

    At a state q, v with null space N of the constraint rows, a small motion N x obeys  x'' = N^T a_q N x + N^T a_v N x'.
    """
    model, evaluator = get("gauss").build(mechanism, Choice("default", "rk4")), Evaluator(mechanism)
    modes = []
    for k in np.unique(np.linspace(0, len(trajectory.t) - 1, LOOKED_AT).round().astype(int)):
        t, q, v = float(trajectory.t[k]), trajectory.q[k], trajectory.v[k]
        try:
            N = null_space(evaluator.constraints(t, q, v).J, mechanism.n)
            if N.shape[1] > LARGEST:
                return []
            a_q = [model.acceleration(t, q + MOVED * x, v) - model.acceleration(t, q - MOVED * x, v) for x in N.T]
            a_v = [model.acceleration(t, q, v + MOVED * x) - model.acceleration(t, q, v - MOVED * x) for x in N.T]
            k = N.shape[1]
            by_place, by_speed = (N.T @ np.reshape(x, (k, mechanism.n)).T / (2 * MOVED) for x in (a_q, a_v))
            system = np.block([[np.zeros((k, k)), np.eye(k)], [by_place, by_speed]])
            modes.append(np.linalg.eigvals(system).astype(complex))
        except FAILURES:
            continue
    return modes


def disagreement(mechanism: Mechanism, trajectory: Trajectory) -> float | None:
    """Median relative difference of the accelerations that two own formulations find at the run's own states; None if one cannot.

    One solves for the free directions, the other for the multipliers: they lose their digits in different places.
    """
    chosen = np.unique(np.linspace(0, len(trajectory.t) - 1, JUDGED).round().astype(int))
    states = [(float(trajectory.t[k]), trajectory.q[k], trajectory.v[k]) for k in chosen]
    try:
        models = [get(name).build(mechanism, Choice("default", "rk4")) for name in ("gauss", "lagrange")]
        first, second = (np.array([model.acceleration(*x) for x in states]) for model in models)
    except FAILURES:
        return None
    return float(np.median(metrics.relative_acceleration_error(first, second)))
