"""A reference for any motion within seconds: runs with equal steps, which are halved until the motion changes little.

An integrator of order eight solves the equations of the suite's own formulation, first in numpy and, if more steps are needed, as
compiled code. Of a pair of runs with a step and with half the step, the finer run is the reference, and the difference between both
is its error bar. Accelerations are compared with those in numpy, which reveals an error in the compiled equations, and the motion
with its certificate, if there is one. Between samples, positions are polynomials of degree five.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np

from gauss_bench.advice.answer import format_errors
from gauss_bench.bench.ways import Run
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.metrics import drift, joint_force_errors, relative_acceleration_error, state_errors
from gauss_bench.reference.absolute import AbsoluteCoordinates
from gauss_bench.reference.certificate import find_certified
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.one_run import Sampling
from gauss_bench.runs.worker import Worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Trajectory

MORE = "a larger --budget helps"  # the end of the reason of a failure that more time would have prevented
METHOD = "dop853_fixed"  # Dormand and Prince's method of order eight, with equal steps
PLAIN, NATIVE = 100, 1600  # steps of the coarser run of the first pair, in numpy and compiled
LOOK = 0.2  # share of the budget for the first pair of runs, in numpy
COMPILED = 0.6  # share of the budget at which compiled runs end (the first run may compile); the rest is for numpy
MOST = 400_000  # largest number of steps of the coarser run of a pair
SAMPLES = 3200  # largest number of samples of the reference
AGREEMENT = 1e-6  # allowed relative difference of accelerations from those in numpy: rounding leaves 1e-9, a wrong term about 1
ERROR_GROWTH = 16.0  # interpolation of order six through every second sample has 2^6 = 64 times the error; 16 leaves a margin of 4
SHORTER, ATTEMPTS = 4.0, 3  # divisor of a duration without a reference, and number of durations that are tried

Told = Callable[[str], object]  # a function that is called with each sentence of progress


class NoTruth(ArithmeticError):
    """No reference is accurate enough."""


@dataclass(frozen=True, eq=False)
class Truth:
    """A reference motion, with which runs are compared.

    Attributes:
        reference: the motion in equally spaced samples.
        bars: kind of error -> error bar of the reference [m], [rad], [N]; without forces if redundant constraints leave them
            undetermined.
        halving: kind of error -> change of the result when the steps are halved [m], [rad], [N].
        steps: number of steps of the coarser run of the pair; the reference took twice as many.
        certified: whether a certificate confirms the motion.
        description: one line on how the reference was made.
    """

    reference: Reference
    bars: Mapping[str, float]
    halving: Mapping[str, float]
    steps: int
    certified: bool
    description: str

    def at(self, run: Run, times: Array) -> Reference:
        """Return the reference motion, with accelerations, at any times (k,) [s] within the run."""
        q, v = interpolate(self.reference, times)
        a = AbsoluteCoordinates(run.mechanism).acceleration(times, q, v)
        return Reference.with_one_bar(Trajectory(times, q, v, a, None), self.reference.method, self.bar)

    @property
    def bar(self) -> float:
        """The error bar of positions [m] and angles [rad]: the larger of the two."""
        return max(self.bars["position"], self.bars["angle"])


def shorten(until: float) -> Iterator[float]:
    """Yield a duration [s], a quarter and a sixteenth of it, because a chaotic motion has a reference over a short time only."""
    for k in range(ATTEMPTS):
        yield until / SHORTER**k


def interpolate(known: Reference | Trajectory, times: Array) -> tuple[Array, Array]:
    """Return q and v (k, n) at times (k,) [s] between equally spaced samples, by quintic Hermite polynomials of q.

    In an interval, in which s runs from 0 to 1, q(s) = p + u s + b s^2 / 2 + c3 s^3 + c4 s^4 + c5 s^5. p, u and b are q and its
    derivatives by s at s = 0. P, U and B are q and its derivatives at s = 1, less those of the first three terms, and determine
    c3, c4 and c5.
    """
    h = float(known.t[1] - known.t[0])
    k = np.clip(np.floor(times / h + 1e-9).astype(int), 0, len(known.t) - 2)  # interval of each time
    s = ((times - known.t[k]) / h)[:, None]
    p, u, b = known.q[k], h * known.v[k], h * h * known.a[k]
    P, U, B = known.q[k + 1] - p - u - b / 2, h * known.v[k + 1] - u - b, h * h * known.a[k + 1] - b
    c3, c4, c5 = 10.0 * P - 4.0 * U + B / 2, -15.0 * P + 7.0 * U - B, 6.0 * P - 3.0 * U + B / 2
    q = p + s * (u + s * (b / 2 + s * (c3 + s * (c4 + s * c5))))
    return q, (u + s * (b + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h


def compute_reference(run: Run, wanted: Mapping[str, float], left: Callable[[], float], worker: Worker, told: Told) -> Truth:
    """Return a reference whose error bars are within `wanted`, or as small as time and rounding allow.

    One pair of runs with few steps is tried first, in numpy, then compiled runs until the share COMPILED of the budget is used, and
    last runs with more steps in numpy.

    Args:
        wanted: kind of error -> largest error bar [m], [rad], [N].
        left: function that returns the seconds that are left of the budget.
        worker: process that runs the compiled formulation and keeps its compiled model.
        told: function that is called with each sentence of progress.

    Raises:
        NoTruth: no pair of runs was completed, or a run contradicts the linkage's equations or the certificate.
    """
    budget = left()
    reasons: dict[str, str] = {}
    references: list[Truth] = []

    def try_steps(engine: str, where: Worker, reserved: float, first: int, most: float = math.inf) -> bool:
        """Run an engine in pairs of n and 2 n steps, n from `first` to `most`; return whether a finer run is accurate enough.

        The finer runs are added to `references`, and the reason of a failure to `reasons`. `reserved` is the share of the budget
        that is left for later attempts.
        """
        try:
            for reference in halve_steps(run, engine, where, lambda: left() - reserved * budget, first, most):
                bars = format_errors(reference.bars, wanted, ", ")
                told(f"reference: {2 * reference.steps} steps by {engine}, known to {bars}")
                references.append(reference)
                if all(reference.bars.get(k, 0.0) <= x for k, x in wanted.items()):
                    return True
        except NoTruth as failure:
            reasons[engine] = str(failure)
            told(f"reference: {engine}: {failure}")
        return False

    with np.errstate(all="ignore"), Worker() as numpy_worker:
        is_accurate = try_steps("gauss", numpy_worker, 1 - LOOK, PLAIN, PLAIN)
        if not is_accurate and find_spec("llvmlite") and not run.mechanism.has_friction:
            is_accurate = try_steps("gauss-native", worker, 1 - COMPILED, NATIVE)
        is_accurate = is_accurate or try_steps("gauss", numpy_worker, 0.0, 2 * PLAIN)
        if not references:
            why = [*dict.fromkeys(reasons.values())]
            if left() <= 0:
                raise NoTruth("; ".join([f"no reference within {budget:.3g} s, its share of the budget; {MORE}", *why]))
            raise NoTruth(f"the motion cannot be followed: {'; '.join(why)}")
        best = references[-1]
        if not is_accurate:  # the reference with the smallest error bars relative to `wanted`
            best = min(references, key=lambda x: max(x.bars.get(k, 0.0) / y for k, y in wanted.items()))
        return _certify(run, best)


def halve_steps(
    run: Run, engine: str, worker: Worker, left: Callable[[], float], steps: int = PLAIN, most: float = math.inf
) -> Iterator[Truth]:
    """Yield references that one engine computes, each with half the step of the one before.

    A reference is the finer run of a pair with n and 2 n steps; n doubles from `steps` to `most`. The generator ends when left(),
    the remaining time [s], is used up, or when the error bars no longer shrink, because of rounding.

    Raises:
        NoTruth: the run with the smallest steps failed, or accelerations of a run do not satisfy the linkage's equations.
    """
    judge, failed = Evaluator(run.mechanism), ""
    best: Truth | None = None
    fine: Trajectory | str = ""  # the last run, or why it failed; it is the coarser run of the next pair
    while steps <= min(most, MOST) and left() > 0:
        coarse = fine if isinstance(fine, Trajectory) else _run(run, engine, steps, left(), worker)
        if left() <= 0:
            break
        fine, failed = _run(run, engine, 2 * steps, left(), worker), ""
        if isinstance(coarse, str) or isinstance(fine, str):
            failed = fine if isinstance(fine, str) else str(coarse)
        elif left() > 0:
            reference = _compare(run, judge, coarse, fine, steps, engine)
            if best is not None and all(reference.bars[k] >= best.bars[k] for k in ("position", "angle")):
                return  # rounding: smaller steps improve nothing
            best = reference
            yield reference
        steps *= 2
    if failed:
        raise NoTruth(failed)


def _run(run: Run, engine: str, steps: int, limit: float, worker: Worker) -> Trajectory | str:
    """Run an engine with `steps` equal steps for at most `limit` seconds; return the trajectory, or the reason why there is none.

    The trajectory has at most about SAMPLES equally spaced samples.
    """
    every = max(1, math.ceil(steps / SAMPLES))  # steps between two samples
    intervals = steps // every
    times = run.until / intervals * np.arange(intervals + 1)
    choice = Choice("default", METHOD, "none", run.until / steps)
    request = Request(run.linkage, run.mechanism.scenario, engine, choice, Sampling(times, choice.step, count=steps, shortened=0))
    ran = run_apart(request, run.mechanism, limit, worker, keep_model=True)
    return ran.trajectory or ran.message


def _compare(run: Run, judge: Evaluator, coarse: Trajectory, fine: Trajectory, steps: int, engine: str) -> Truth:
    """Return the run `fine` as a reference, whose error bar is its difference from the run `coarse` with `steps` steps.

    The error bars of positions and angles also include the interpolation error and the largest gap of a joint.

    Raises:
        NoTruth: the accelerations that the engine reported do not satisfy the linkage's equations of motion.
    """
    every = (len(fine.t) - 1) // (len(coarse.t) - 1)  # samples of the finer run for each of the coarser one
    samples = fine[::every]  # at the times of the coarser run
    true = AbsoluteCoordinates(run.mechanism).acceleration(samples.t, samples.q, samples.v)
    error = float(np.median(relative_acceleration_error(samples.a, true)))
    if not error <= AGREEMENT:  # also if it is NaN
        raise NoTruth(f"accelerations of {engine} differ from those of the linkage by {error:.1e} of their size")
    how = f"step-halved ({2 * steps} and {steps} steps of order eight by {engine})"
    reference = Reference.with_one_bar(replace(samples, a=true), how)
    bars = state_errors(run.mechanism, coarse, reference).largest
    force = float(joint_force_errors(judge, coarse, reference).max())
    halving = bars | ({} if math.isnan(force) else {"force": force})
    # the odd samples, interpolated from the even ones, have 64 times the interpolation error between all samples
    even, between_samples = reference.samples[::2], {"position": math.inf, "angle": math.inf}
    if len(even.t) > 1:
        missed = np.abs(interpolate(even, reference.t[1:-1:2])[0] - reference.q[1:-1:2]) / ERROR_GROWTH  # (k, n)
        between_samples = {"position": float(places(missed).max(initial=0.0)), "angle": float(angles(missed).max(initial=0.0))}
    gaps = float(drift(judge, fine).position.max())  # largest gap of a joint [m]
    bars = {kind: x + between_samples[kind] + gaps for kind, x in bars.items()}
    # for positions and angles `bars` replaces the smaller error bar in `halving`
    return Truth(reference, bars=halving | bars, halving=halving, steps=steps, certified=False, description=how)


def _certify(run: Run, truth: Truth) -> Truth:
    """Return a reference that was compared with the certificate of the motion; without a certificate, the unchanged reference.

    The new error bars include the difference from the certificate.

    Raises:
        NoTruth: the reference differs from the certificate by more than a thousand error bars.
    """
    certificate = find_certified(run.mechanism, run.until)
    if certificate is None:
        return truth
    q, v = interpolate(truth.reference, certificate.t)
    errors = state_errors(run.mechanism, replace(certificate.samples, q=q, v=v), certificate).largest
    certified_error = float(np.fmax(certificate.error_q, certificate.floor_q).max())
    if max(errors.values()) > 1e3 * max(truth.bar, certified_error):
        raise NoTruth(f"the motion found and the certified one differ by {max(errors.values()):.1e}")
    # at order eight, the error of the finer run is 1/2^8 = 1/256 of the difference from the coarser one
    bars = {kind: max(x, truth.bars[kind] / 256) + certified_error for kind, x in errors.items()}
    how = f"certified to {certified_error:.0e}, which the motion found here confirms: {truth.description}"
    return replace(truth, bars={**truth.bars, **bars}, certified=True, description=how)
