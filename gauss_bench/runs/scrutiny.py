"""What can be found out of a run without knowing the truth: by half the step, by the fastest mode, by a second formulation.

A run that agrees with nothing but itself is not trusted. Half the step shows what the step spoils, whatever the engine; the own
linearisation shows whether any step of that length could follow the motion; two formulations of the same accelerations show how
many digits the linkage leaves them.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gauss_bench import metrics
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.judge import OFF_MOTION, Evidence, Subject, examine, judge
from gauss_bench.mechanism.evaluate import RANK_TOLERANCE, Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Request
from gauss_bench.runs.one_run import JUDGED, Run, acceleration_error, nothing, sampling_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, RunFailure, Trajectory

LONGEST = 60.0  # [s] of processor time for a run at half the step: of a longer run a first part is repeated
LARGEST = 40  # freedoms beyond which no mode is looked for: half the step decides alone
LOOKED_AT = 5  # states, of whose fastest modes the median counts: next to a singular position one is anything
VAGUE = 0.1  # of what the judge allows: a reference with larger error bars tells too little of a run
MOVED = 1e-6  # of 1 rad and 1 m: large for rounding, small for the curvature of any motion
FAILURES = (RunFailure, ArithmeticError, np.linalg.LinAlgError)


def at_half_the_step(request: Request, seconds: float, times: Array, longest: float = LONGEST) -> Request:
    """The run asked for again at half the step and these times (k,); of one that took too many seconds, the first part of it."""
    if seconds > longest / 2:
        times = times[: max(2, int(len(times) * longest / 2 / seconds))]
    step = request.choice.step / 2
    return replace(request, choice=replace(request.choice, step=step), wanted=sampling_at(step, times), ask=nothing, answers=0)


def decides(truth: Reference, mechanism: Mechanism) -> bool:
    """Whether a reference is known so well that no second run is needed to tell whether a run may be used."""
    return bool(truth.error_q.max(initial=0.0) <= VAGUE * OFF_MOTION * min(1.0, mechanism.size))


def evidence_of(
    mechanism: Mechanism,
    choice: Choice,
    trajectory: Trajectory,
    truth: Reference | None,
    finer: Run | None,
    acceleration_off: float | None = None,
) -> tuple[Evidence, str]:
    """What there is to judge a run by, and a sentence where half the step does not decide.

    Args:
        finer: the same run at half the step, where no truth decides.
        acceleration_off: median relative error of its accelerations at given states; found at the run's own where not given.
    """
    off = acceleration_error(mechanism, trajectory) if acceleration_off is None else acceleration_off
    evidence = examine(Evaluator(mechanism), trajectory, truth, off)
    if truth is not None or (finer is not None and finer.trajectory is not None):  # else nothing would decide
        evidence = replace(evidence, seen=seen(mechanism, trajectory, evidence))
    if truth is None or not truth.certified:  # one that is not is as good as the equations that it shares with the run
        evidence = replace(evidence, disagreement=disagreement(mechanism, trajectory))
    if finer is None:
        return evidence, ""
    rate = fastest_rate(mechanism, trajectory)
    evidence = replace(evidence, steps_a_period=2 * np.pi / (rate * choice.step) if rate else None)
    if finer.trajectory is None:
        return evidence, f"half the step does not decide whether to trust it: {finer.status}, {finer.message}"
    other = as_truth(finer.trajectory)
    part = "" if len(other.t) == len(trajectory.t) else f"half the step was tried up to {other.t[-1]:.3g} s"
    return replace(evidence, halving=metrics.state_errors(mechanism, trajectory, other)), part


def as_truth(trajectory: Trajectory) -> Reference:
    """A second run in the place of a truth, without error bars of its own."""
    none = np.zeros(len(trajectory.t))
    return Reference(trajectory.t, trajectory.q, trajectory.v, trajectory.a, none, none, none, none, none, none, "half the step")


def seen(mechanism: Mechanism, trajectory: Trajectory, evidence: Evidence) -> Array | None:
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
            N = _free(evaluator.constraints(t, q, v).J, mechanism.n)
            if N.shape[1] > LARGEST:
                return []
            a_q = [model.acceleration(t, q + MOVED * x, v) - model.acceleration(t, q - MOVED * x, v) for x in N.T]
            a_v = [model.acceleration(t, q, v + MOVED * x) - model.acceleration(t, q, v - MOVED * x) for x in N.T]
            parts = [N.T @ np.array(x).T / (2 * MOVED) for x in (a_q, a_v)] if N.size else [np.zeros((0, 0))] * 2
            modes.append(_modes(*parts))
        except FAILURES:
            continue
    return modes


def _free(J: Array, n: int) -> Array:
    """(n, k) orthonormal directions that constraint rows (m, n) leave free."""
    if not len(J):
        return np.eye(n)
    _, sizes, rows = np.linalg.svd(J)
    return np.asarray(rows[int((sizes > RANK_TOLERANCE * sizes.max(initial=0.0)).sum()) :].T)


def _modes(by_place: Array, by_speed: Array) -> NDArray[np.complex128]:
    """The eigenvalues of x'' = K x + C x'."""
    k = len(by_place)
    system = np.block([[np.zeros((k, k)), np.eye(k)], [by_place, by_speed]])
    return np.linalg.eigvals(system).astype(complex)


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
