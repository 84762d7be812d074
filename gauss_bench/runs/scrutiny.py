"""Checks of a run without a reference: a repeated run, the fastest vibration mode, and a second formulation.

A repetition at half the step, or at a tighter tolerance if the integrator chooses its steps, shows the error due to the step. The
eigenvalues of the linearised motion show whether the step resolves the fastest vibration mode. The difference between two
formulations of the same accelerations shows how many digits are lost to rounding because the equations are ill-conditioned.
"""

import re
from contextlib import suppress
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
from gauss_bench.runs.one_run import JUDGED, SAMPLING, Run, acceleration_error, ask_nothing, sampling_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, RunFailure, Trajectory, spread_evenly

LONGEST = 60.0  # [s] processor time of a repetition; only the first part of a longer run is repeated
LARGEST = 40  # degrees of freedom beyond which modes are not computed, because they would take too long
LOOKED_AT = 5  # states whose modes are computed; the median counts, because one state may be near a singular position
VAGUE = 0.1  # a reference cannot decide if its error bar exceeds this fraction of the error that the judge allows
RELATIVE = re.compile(r"rtol|reltol|relative_tolerance")  # names of options for the relative tolerance of an integrator
USUAL_TOLERANCE = 1e-6  # relative tolerance of an engine that states none
TIGHTER, SMALLEST_TOLERANCE = 100.0, 1e-14  # divisor of the relative tolerance for a repetition, and its least value
A_PERIOD = 8  # samples in a period: the integral of a sine through them has an error of 1e-3
LEAST = 100  # fewest samples of a run: motions may reverse as often in a short run as in a long one
MOST = 200_000  # most samples of a run with a spacing below SAMPLING: half a GiB for a large linkage
MOVED = 1e-6  # [rad, m] for difference quotients: large compared with rounding, small compared with curvature
FAILURES = (RunFailure, ArithmeticError, np.linalg.LinAlgError)


def sample_spacing(mechanism: Mechanism, t_end: float) -> float:
    """Return the largest spacing of samples [s] at which a run's power and rates can still be integrated over time accurately.

    A run has at least LEAST samples, and at least A_PERIOD in each period of the fastest sinusoidal force, of the fastest rise and
    fall of a force given by a table, and of the fastest mode (of vibration or decay) at the start. A spacing below SAMPLING is not
    made so small that the run has more than MOST samples.
    """
    start = Trajectory(np.zeros(1), mechanism.q0[None], mechanism.v0[None], np.zeros((1, mechanism.n)), 0)
    rates = [float(np.abs(eigenvalues).max(initial=0.0)) for eigenvalues in modes_along(mechanism, start)]  # [1/s]
    periods = [2 * np.pi / rate for rate in rates if rate > 0]  # [s]
    if (period := mechanism.forcing_period) is not None:
        periods.append(period)
    periods += [2 * float(np.diff(x).min()) for x in reversal_times(mechanism) if len(x) > 1]
    wanted = min(SAMPLING, t_end / LEAST, *(period / A_PERIOD for period in periods))
    return max(wanted, min(SAMPLING, t_end / MOST))


def reversal_times(mechanism: Mechanism) -> list[Array]:
    """Return for each force that is piecewise linear in time the times (k,) [s] at which it turns between rising and falling."""
    times = []
    for factor in (factor_of(x) for x in mechanism.varying):
        if factor is not None and factor.kinks:
            slopes = np.array([0.0, *(slope for _, slope in factor.lines[1:])])  # of the line before the first kink, and after each
            steep = np.flatnonzero(slopes)  # lines along which the force is not constant
            is_turn = np.diff(np.sign(slopes[steep])) != 0  # whether the slopes of a steep line and the next one differ in sign
            times.append(np.array(factor.kinks)[steep[1:][is_turn] - 1])  # line k begins at kink k - 1
    return times


def repeat_finer(request: Request, offer: Offer, seconds: float, times: Array, longest: float = LONGEST) -> Request:
    """Return the request for a repetition of a run: at half the step, or at a tighter tolerance and with closer samples.

    Args:
        seconds: the time that the run took [s]; times: sample times (k,) of the run [s].
        longest: largest time of a repetition [s]; if the whole run would take longer, only the first part of it is repeated.
    """
    part, choice = first_part(times, seconds, longest), request.choice
    if choice.integrator not in offer.adaptive:
        choice = replace(choice, step=choice.step / 2)
    else:
        choice = replace(choice, tolerance=finer_tolerance(offer, choice))
        # a step ends at each sample: with the same samples, a tighter tolerance might have no effect
        part = np.sort(np.concatenate([part, (part[1:] + part[:-1]) / 2]))
    # the model is asked nothing before the run
    return replace(request, choice=choice, wanted=sampling_at(choice.step, part), ask=ask_nothing, answers=0)


def at_samples(finer: Run, times: Array) -> Run:
    """Return the finer repetition of a run, but only its samples at the sample times (k,) [s] of the original run."""
    x = finer.trajectory
    return finer if x is None else replace(finer, trajectory=x[metrics.common_times(x.t, times)[0]])


def finer_tolerance(offer: Offer, choice: Choice) -> float:
    """Return the relative tolerance of a repetition of a run: that of the choice or of the engine's options, divided by TIGHTER.

    Below SMALLEST_TOLERANCE, where rounding exceeds the error of integration, the repetition has a looser tolerance instead.
    """
    tolerance = choice.tolerance
    if tolerance is None:
        options = offer.resolve_settings(choice.settings)
        given = [x for name, x in options.items() if RELATIVE.search(name) and isinstance(x, float) and x > 0]
        tolerance = min(given, default=USUAL_TOLERANCE)
    finer = tolerance / TIGHTER
    return finer if finer >= SMALLEST_TOLERANCE else tolerance * TIGHTER


def has_sound_rates(mechanism: Mechanism, trajectory: Trajectory) -> bool:
    """Tell, before a run is repeated, whether the judge accepts its velocities and accelerations as derivatives of positions."""
    evidence = examine(Evaluator(mechanism), trajectory)
    return all(x.subject is not Subject.RATES for x in judge(evidence).objections)


def is_same_run(one: Trajectory, other: Trajectory) -> bool:
    """Tell whether a moving run and its repetition have the same q and v, bit for bit, until the shorter one ends.

    If so, the engine ignores the tolerance or the step. The results of a linkage at rest are equal in any case.
    """
    k = min(len(one.t), len(other.t))
    moves = bool(np.any(one.v[:k]) or np.any(one.a[:k]))
    return moves and np.array_equal(one.q[:k], other.q[:k]) and np.array_equal(one.v[:k], other.v[:k])


def depends_on_steps(mechanism: Mechanism, trajectory: Trajectory) -> bool:
    """Tell whether other steps must change the last bits of a motion: it has degrees of freedom, and its accelerations vary."""
    J = Evaluator(mechanism).constraints(trajectory.t[:1], trajectory.q[:1], trajectory.v[:1]).J[0]
    return bool(np.ptp(trajectory.a, axis=0).any()) and null_space(J, mechanism.n).shape[1] > 0


def first_part(times: Array, seconds: float, longest: float) -> Array:
    """Return the sample times (k,) [s] of a run from the start up to the last that a repetition at half the step can reach.

    The repetition may take `longest` [s], and needs twice the time `seconds` [s] that the run took.
    """
    if not seconds > longest / 2:  # also true for NaN, the time of a failed run
        return times
    return times[: max(2, int(len(times) * longest / 2 / seconds))]


def warn_of_forcing(mechanism: Mechanism, choice: Choice, adaptive: bool) -> str:
    """Return a warning if a fixed step does not resolve a force that oscillates with time, else an empty text."""
    steps = steps_a_forcing(mechanism, choice, adaptive)
    if steps is None or steps >= FEWEST:
        return ""
    period = mechanism.forcing_period
    return f"a step of {choice.step:g} s does not resolve a force that oscillates with a period of {period:.3g} s"


def steps_a_forcing(mechanism: Mechanism, choice: Choice, adaptive: bool) -> float | None:
    """Return the number of fixed steps in the shortest period of a force; None without a periodic force or fixed steps."""
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
    """Return the evidence by which a run is judged, and a sentence if the repetition covers only a part of the run.

    `truth` and the repetition `finer` may be None; `untried` is the reason why there is no repetition. `acceleration_off` is the
    median relative error of the engine's accelerations at given states; if None, it is computed at states of the run.
    """
    # evidence from the run alone
    off = acceleration_error(mechanism, trajectory) if acceleration_off is None else acceleration_off
    evidence = examine(Evaluator(mechanism), trajectory, truth, off)
    # `seen`: the energy gained beyond the work done, as far as the samples are close enough to resolve the damping
    if truth is not None or (finer is not None and finer.trajectory is not None):  # without either, the run stays undecided
        evidence = replace(evidence, seen=measurable_gain(mechanism, trajectory, evidence))
    if truth is None or not truth.certified:  # an uncertified reference shares equations with the run
        evidence = replace(evidence, disagreement=disagreement(mechanism, trajectory))
    evidence = replace(evidence, steps_a_forcing=steps_a_forcing(mechanism, choice, adaptive))
    # evidence from the repetition; `unrepeated` is the reason why there is none, which counts only without a reference
    if finer is None:
        return replace(evidence, unrepeated=untried if truth is None else ""), ""
    how = "a tighter tolerance" if adaptive else "half the step"
    if not adaptive:
        rate = fastest_rate(mechanism, trajectory)
        evidence = replace(evidence, steps_a_period=2 * np.pi / (rate * choice.step) if rate else None)
    again = finer.trajectory
    if again is None:
        why = f"{how} gave no motion to compare with: {finer.status}, {finer.message}"
        return replace(evidence, unrepeated=why if truth is None else ""), ""
    if is_same_run(trajectory, again) and (adaptive or depends_on_steps(mechanism, trajectory)):
        why = f"{choice.integrator} is not repeatable: {'another tolerance' if adaptive else how} gives the same bits"
        return replace(evidence, unrepeated=why if truth is None else ""), ""
    part = "" if len(again.t) == len(trajectory.t) else f"{how} was tried up to {again.t[-1]:.3g} s"
    halving = metrics.state_errors(mechanism, trajectory, as_truth(again))  # difference of the run from its repetition
    return replace(evidence, halving=halving, rates_again=metrics.rate_gaps(again), finer=how), part


def as_truth(trajectory: Trajectory) -> Reference:
    """Return a second run as a `Reference` with error bars of 0, so that a first run can be compared with it."""
    return Reference.with_one_bar(trajectory, "half the step")


def measurable_gain(mechanism: Mechanism, trajectory: Trajectory, evidence: Evidence) -> Array | None:
    """Return the energy (k,) [J] that a run gains beyond the work done on it, without losses that its samples cannot resolve.

    Losses between samples further apart than the time constant of the fastest damping are left out. The result is None if the run
    passes the judge's check of energy without this correction, or if no motion of the linkage decays by damping.
    """
    if not any(x.subject is Subject.ENERGY for x in judge(evidence).objections):
        return None
    modes = modes_along(mechanism, trajectory)  # eigenvalues [1/s]: a negative real part is the rate of a decay
    fastest = max((float(-eigenvalues.real.min(initial=0.0)) for eigenvalues in modes), default=0.0)
    return metrics.without_loss(trajectory.t, evidence.energy, 1.0 / fastest) if fastest > 0 else None


def fastest_rate(mechanism: Mechanism, trajectory: Trajectory) -> float | None:
    """Return the angular frequency [rad/s] of the fastest oscillation about a motion (median of some states); None if unknown."""
    rates = [float(np.abs(eigenvalues.imag).max(initial=0.0)) for eigenvalues in modes_along(mechanism, trajectory)]
    return float(np.median(rates)) if rates else None


def modes_along(mechanism: Mechanism, trajectory: Trajectory) -> list[NDArray[np.complex128]]:
    """Return the eigenvalues (2 dof,) [1/s] of small motions about LOOKED_AT states, without states at which FAILURES occur.

    At a state q, v with null space N (n, dof) of the constraint rows, a small motion N x obeys x'' = N^T a_q N x + N^T a_v N x',
    where a_q and a_v are the derivatives of the accelerations with respect to q and v. The list is empty beyond LARGEST degrees of
    freedom.
    """
    model, evaluator = get("gauss").build(mechanism, Choice("default", "rk4")), Evaluator(mechanism)
    modes = []
    for sample in spread_evenly(len(trajectory.t), LOOKED_AT):
        t, q, v = float(trajectory.t[sample]), trajectory.q[sample], trajectory.v[sample]
        with suppress(*FAILURES):
            N = null_space(evaluator.constraints(t, q, v).J, mechanism.n)
            dof = N.shape[1]
            if dof > LARGEST:
                return []
            # central differences along each free direction x, a column of N: lists of dof arrays (n,)
            a_q = [model.acceleration(t, q + MOVED * x, v) - model.acceleration(t, q - MOVED * x, v) for x in N.T]
            a_v = [model.acceleration(t, q, v + MOVED * x) - model.acceleration(t, q, v - MOVED * x) for x in N.T]
            by_place, by_speed = (N.T @ np.reshape(x, (dof, mechanism.n)).T / (2 * MOVED) for x in (a_q, a_v))
            system = np.block([[np.zeros((dof, dof)), np.eye(dof)], [by_place, by_speed]])
            modes.append(np.linalg.eigvals(system).astype(complex))
    return modes


def disagreement(mechanism: Mechanism, trajectory: Trajectory) -> float | None:
    """Return the median relative difference between the accelerations of two formulations at states of a run; None if one fails.

    Gauss's formulation solves for independent accelerations, Lagrange's also for multipliers, so that their rounding errors differ.
    """
    chosen = spread_evenly(len(trajectory.t), JUDGED)
    states = [(float(trajectory.t[k]), trajectory.q[k], trajectory.v[k]) for k in chosen]
    try:
        models = [get(name).build(mechanism, Choice("default", "rk4")) for name in ("gauss", "lagrange")]
        first, second = (np.array([model.acceleration(*x) for x in states]) for model in models)
    except FAILURES:
        return None
    return float(np.median(metrics.relative_acceleration_error(first, second)))
