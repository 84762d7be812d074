"""The judge decides for all commands whether a finished run is valid, from numbers that this package computes from the trajectory.

A run is valid if the judge has no objection:
- it has all samples, and begins at the start of the scenario;
- its loops stay closed and its energy balances;
- its accelerations are those of the linkage, and its velocities and accelerations are the rates of its positions and velocities;
- it agrees with the reference or, if there is none, with a repetition at half the step or at a tighter tolerance.

The limits decide whether the run is still a motion of this linkage, not how exact a valid run is.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.terms import Array, largest
from gauss_bench.trajectory import Reference, Trajectory, finite, in_a_sentence

# Limits are fractions of the linkage's size for lengths, radians for angles, and fractions of the largest speed for speeds.
OFF_TIME = 1e-9  # [s] distance of a sample from its time: far more than rounding, far less than a step
OFF_START = 1e-5  # gap between the first sample and the start: single precision and assembly by an engine are more exact
OFF_DRIFT = 1e-2  # gap of open loops, at most 1e-2 m or rad: a larger gap makes another linkage
OFF_ENERGY = 1e-2  # fraction of `Evidence.energy_scale`: corresponds to 0.5 % of all speeds; small steps lose less
OFF_ACCELERATION = 1e-2  # fraction of the largest acceleration: an engine 1 % off at the same state solves another problem
OFF_MOTION = 5e-2  # error of positions and angles: a link turned by this angle has its far end off by 5 % of its length
HUGE = 1e100  # a larger number counts as not finite: products of a few such numbers overflow
OFF_RATES = OFF_MOTION / 2  # gap between positions or velocities and the integrals of their rates (`metrics.RateGaps`)
SHARED = 2.0  # times the change at half the step, which is half of the gap that a first-order method leaves
MOST_SHARED = 2.0  # a limit grows by at most this multiple of itself; otherwise oscillating samples would widen it without bound
FEWEST = 2.0  # steps in a period of the fastest mode or force: fewer samples show a slower oscillation in its place (aliasing)
DIGITS = 1e-9  # relative difference of two formulations' accelerations above which `remark` reports lost digits
LIMITS = {"drift": OFF_DRIFT, "energy": OFF_ENERGY, "acceleration": OFF_ACCELERATION, "motion": OFF_MOTION}


class Subject(StrEnum):
    """The subjects of objections."""

    COMPLETENESS = "completeness"
    NUMBERS = "numbers"
    START = "start"
    MODEL = "model"
    LOOPS = "loops"
    ENERGY = "energy"
    MOTION = "motion"
    STIFFNESS = "stiffness"
    STEP = "step"
    RATES = "rates"
    REPETITION = "repetition"


@dataclass(frozen=True)
class Objection:
    """A possible reason not to use a run: it applies if `value` exceeds `limit` or is not a number.

    Attributes:
        subject: part of the run to which the judge objects.
        value: number computed from the run, in the unit that the sentence names.
        limit: largest value of a valid run, in the same unit.
        sentence: says what is wrong.
    """

    subject: Subject
    value: float
    limit: float
    sentence: str


@dataclass(frozen=True)
class Judgement:
    """The judge's verdict on a run that has ended."""

    objections: tuple[Objection, ...] = ()

    @property
    def valid(self) -> bool:
        """True if there is no objection, so that the results of the run may be used."""
        return not self.objections

    @property
    def sentence(self) -> str:
        """All objections as one sentence, or an empty text."""
        return "; ".join(x.sentence for x in self.objections)


@dataclass(frozen=True, eq=False)
class Evidence:
    """The numbers that the judge compares with limits, computed from a complete trajectory of k samples; None if unknown.

    Attributes:
        size: size of the linkage [m].
        energy: (k,) energy gained beyond the work done [J]; energy_bar: error bar of this work [J].
        energy_scale: largest kinetic energy of the run, or the range of the potential energy if larger [J].
        energy_floor: change of the energy that rounding can cause [J].
        seen: (k,) `energy` without losses between samples too far apart to resolve damping; None if `energy` itself is judged.
        acceleration_error: median relative error of the engine's accelerations at the same states.
        rates, rates_again: gaps between the motion and the integrals of its rates, of the run and of its repetition.
        start: gap between the first sample and the start of the scenario.
        duration: time from the first sample to the last [s].
        halving: difference of the run and its repetition with finer steps; None without a repetition.
        finer: how the repetition was made: "half the step" or "a tighter tolerance".
        unrepeated: why there is neither a reference nor a repetition; empty if there is one of them.
        steps_a_period, steps_a_forcing: steps in a period of the fastest mode and of the fastest force that oscillates with time.
        disagreement: relative difference between the accelerations by two formulations, at the states of the run.
    """

    size: float
    drift: metrics.Drift
    energy: Array
    energy_bar: float
    energy_scale: float
    errors: metrics.Errors | None = None
    acceleration_error: float | None = None
    halving: metrics.Errors | None = None
    steps_a_period: float | None = None
    disagreement: float | None = None
    seen: Array | None = None
    rates: metrics.RateGaps | None = None
    rates_again: metrics.RateGaps | None = None
    start: metrics.MotionGap | None = None
    duration: float = 0.0
    finer: str = "half the step"
    unrepeated: str = ""
    steps_a_forcing: float | None = None
    energy_floor: float = 0.0


def completeness(trajectory: object, times: Array, n: int) -> Judgement:
    """Judge whether the object that an engine returned is a finite trajectory of n coordinates at the wanted times (k,) [s]."""

    def refused(subject: Subject, value: float, limit: float, sentence: str) -> Judgement:
        return Judgement((Objection(subject, value, limit, sentence),))

    if not isinstance(trajectory, Trajectory):
        return refused(Subject.COMPLETENESS, 0, len(times), f"the engine returned {type(trajectory).__name__}, not a trajectory")
    try:
        t, *levels = (copy_numbers(x) for x in (trajectory.t, trajectory.q, trajectory.v, trajectory.a))
    except (TypeError, ValueError) as error:
        return refused(Subject.COMPLETENESS, 0, len(times), f"the samples are not numbers: {in_a_sentence(error)}")
    if t.shape != times.shape:
        return refused(Subject.COMPLETENESS, t.size, len(times), f"{t.size} of {len(times)} samples that were asked for")
    off = largest(t - times) if np.isfinite(t).all() else float("nan")
    if not off <= OFF_TIME:  # true for NaN too
        return refused(Subject.COMPLETENESS, off, OFF_TIME, f"samples up to {off:.2g} s away from the times that were asked for")
    for x in levels:
        if x.shape != (len(times), n):
            text = f"samples of shape {x.shape} where ({len(times)}, {n}) was asked for"
            return refused(Subject.COMPLETENESS, x.shape[-1] if x.shape else 0, n, text)
    count = finite(*levels, below=HUGE)
    if count < len(times):
        first = float(times[count])
        return refused(Subject.NUMBERS, first, float(times[-1]), f"not finite at t = {first:.6g} s; a smaller step may help")
    return Judgement()


def cut_at_fault(trajectory: object, times: Array, n: int) -> Trajectory | None:
    """Return the trajectory before its first sample that is missing, at a wrong time or not finite; None if no sample is left.

    An engine may return any object: the result is also None for an object that is not a trajectory, has arrays other than of real
    numbers in n columns, or has invalid counts. `times` (k,) [s] are the requested times.
    """
    if not isinstance(trajectory, Trajectory):
        return None
    try:
        t, q, v, a = (copy_numbers(x) for x in (trajectory.t, trajectory.q, trajectory.v, trajectory.a))
        steps, evaluations = _count(trajectory.steps), _count(trajectory.evaluations)
    except (TypeError, ValueError, OverflowError):
        return None
    if t.ndim != 1 or any(x.ndim != 2 or x.shape[1] != n for x in (q, v, a)):
        return None
    k = min(len(x) for x in (times, t, q, v, a))
    is_off_time = np.abs(t[:k] - times[:k]) > OFF_TIME
    on_time = int(is_off_time.argmax()) if is_off_time.any() else k  # argmax: the first True
    k = min(on_time, finite(t[:k, None], q[:k], v[:k], a[:k], below=HUGE))
    return Trajectory(times[:k], q[:k], v[:k], a[:k], steps, evaluations, in_a_sentence(trajectory.note or "")) if k else None


def copy_numbers(x: object) -> Array:
    """Return a copy of an array of real numbers, which the engine cannot change later; masked entries become NaN.

    Raises:
        TypeError: the array is not of real numbers.
    """
    given = np.asarray(np.ma.filled(x, np.nan) if np.ma.isMaskedArray(x) else x)
    if given.dtype.kind not in "fiu":
        raise TypeError(f"{given.dtype}, not real numbers")
    return np.array(given, dtype=float)


def _count(x: Any) -> int | None:
    """Return the number of steps or evaluations that an engine reports; None if it does not count them.

    Raises:
        TypeError, ValueError, OverflowError: x is not a count.
    """
    if x is None:
        return None
    count = int(x)
    if not 0 <= count <= 1 << 53:  # a table stores it as a double, which is exact up to 2^53
        raise ValueError(f"{x} is not a count")
    return count


def examine(
    evaluator: Evaluator, trajectory: Trajectory, reference: Reference | None = None, acceleration_error: float | None = None
) -> Evidence:
    """Return the evidence about a complete trajectory; its `errors` are None without a reference."""
    mechanism = evaluator.mechanism
    with np.errstate(all="ignore"):  # a run may overflow; the judge objects to values that are not finite
        energy, bar = metrics.energy_error(evaluator, trajectory)
        return Evidence(
            size=mechanism.size,
            drift=metrics.drift(evaluator, trajectory),
            energy=energy,
            energy_bar=bar,
            energy_scale=metrics.energy_scale(evaluator, trajectory),
            energy_floor=metrics.energy_rounding(evaluator.energy(trajectory.q, trajectory.v)),
            errors=metrics.state_errors(mechanism, trajectory, reference) if reference else None,
            acceleration_error=acceleration_error,
            rates=metrics.rate_gaps(trajectory),
            start=metrics.start_gap(mechanism, trajectory),
            duration=float(trajectory.t[-1] - trajectory.t[0]),
        )


def judge(evidence: Evidence) -> Judgement:
    """Return every objection to a complete run; a value that is not a number is an objection too."""
    x = evidence
    possible = [*_check_model(x), *_check_motion(x), *_check_start(x), *_check_rates(x)]
    if x.unrepeated:
        possible.append(Objection(Subject.REPETITION, 1.0, 0.0, f"its error is not known: {x.unrepeated}"))
    # not `value > limit`, which is false for NaN
    return Judgement(tuple(objection for objection in possible if not objection.value <= objection.limit))


def _check_model(x: Evidence) -> Iterator[Objection]:
    """Yield the possible objections to accelerations, loops, energy and steps; `judge` keeps those with value > limit."""
    between_two = "formulations of the same accelerations differ by {:.2g} (median): masses or lengths have too different sizes"
    of_engine = "accelerations off by {:.2g} at the same state (median)"
    for off, sentence in ((x.acceleration_error, of_engine), (x.disagreement, between_two)):
        if off is not None:
            yield Objection(Subject.MODEL, off, OFF_ACCELERATION, sentence.format(off))
    # the limit is proportional to the size [m] of a linkage smaller than 1 m
    opened, gained = largest(x.drift.position), largest(x.energy if x.seen is None else x.seen)
    yield Objection(Subject.LOOPS, opened, OFF_DRIFT * min(1.0, x.size), f"the loops open by {opened:.2g} (m or rad)")
    limit = OFF_ENERGY * x.energy_scale
    allowed = limit + min(x.energy_bar, MOST_SHARED * limit + x.energy_floor)
    yield Objection(Subject.ENERGY, gained, allowed, f"energy off by {gained:.2g} J where {x.energy_scale:.2g} J move")
    for steps, oscillation in ((x.steps_a_period, "oscillation"), (x.steps_a_forcing, "force")):
        if steps is not None:
            sentence = f"{steps:.2g} steps in a period of the fastest {oscillation}, too few to resolve it"
            # numbers below FEWEST are faulty: value and limit change places
            yield Objection(Subject.STIFFNESS, FEWEST, steps, sentence)


def _check_motion(x: Evidence) -> Iterator[Objection]:
    """Yield the possible objections to positions and angles of links, against the reference or a repeated run."""
    if x.errors is not None:
        length, turn = largest(x.errors.length), largest(x.errors.angle)
        yield Objection(Subject.MOTION, length, OFF_MOTION * x.size, f"a link ends up {length:.2g} m from where it should be")
        yield Objection(Subject.MOTION, turn, OFF_MOTION, f"a link ends up turned by {turn:.2g} rad from where it should be")
    if x.halving is not None:
        length, turn = largest(x.halving.length), largest(x.halving.angle)
        # half the step removes half of a first-order error, so that the change may be half of the limit
        yield Objection(Subject.STEP, length, OFF_MOTION / 2 * x.size, f"{x.finer} moves a link by {length:.2g} m")
        yield Objection(Subject.STEP, turn, OFF_MOTION / 2, f"{x.finer} turns a link by {turn:.2g} rad")


def _check_start(x: Evidence) -> Iterator[Objection]:
    """Yield the possible objections to the first sample, which should be the start of the scenario."""
    if x.start is not None and x.rates is not None:
        # the largest speed is the scale; for a linkage at rest, the speed that covers its size within the run
        slow = x.size / x.duration if x.duration else x.size
        speed, spin = max(x.rates.fastest[0], slow), max(x.rates.fastest[1], slow / x.size)
        for gap, scale, unit in zip(x.start, (x.size, 1.0, speed, spin), ("m", "rad", "m/s", "rad/s"), strict=True):
            sentence = f"the first sample is {gap:.2g} {unit} off the scenario's start"
            yield Objection(Subject.START, gap, OFF_START * scale, sentence)


def _check_rates(x: Evidence) -> Iterator[Objection]:
    """Yield the possible objections: positions differ from integrated velocities, or velocities from integrated accelerations.

    Two contributions widen a limit, each by at most MOST_SHARED times the limit: the error of the numerical integral, and the part
    of the gap that disappears when the run is repeated with finer steps, because a method may store rates half a step away from the
    positions.
    """
    if x.rates is None:
        return
    # least limit of speeds: at this speed a link moves by the limit of positions within the whole run
    slow = OFF_RATES * x.size / x.duration if x.duration else 0.0
    limits = {  # gap of `RateGaps` -> limit, unit, level, rate
        "place": (OFF_RATES * x.size, "m", "positions", "velocities"),
        "turn": (OFF_RATES, "rad", "angles", "angular velocities"),
        "speed": (max(OFF_RATES * x.rates.fastest[0], slow), "m/s", "velocities", "accelerations"),
        "spin": (max(OFF_RATES * x.rates.fastest[1], slow / x.size), "rad/s", "angular velocities", "angular accelerations"),
    }
    for bar, (name, (limit, unit, level, rate)) in zip(x.rates.bars, limits.items(), strict=True):
        gaps: Array = getattr(x.rates, name)
        allowed = limit + min(SHARED * bar, MOST_SHARED * limit)
        if x.rates_again is not None:
            again: Array = getattr(x.rates_again, name)
            common = min(len(gaps), len(again))
            changed = largest(gaps[:common] - again[:common])
            allowed += min(SHARED * changed, MOST_SHARED * limit)
        gap = largest(gaps)
        sentence = f"{level} are {gap:.2g} {unit} off the integral of their {rate}"
        yield Objection(Subject.RATES, gap, allowed, sentence)


def remark(evidence: Evidence) -> str:
    """Return the remarks on a valid run, joined by "; ", or an empty text."""
    remarks = []
    lost = 0.0 if evidence.seen is None else largest(evidence.energy - evidence.seen)
    if lost > 0.0:
        remarks.append(f"its energy is not decidable: {lost:.2g} J are lost between samples too far apart to resolve damping")
    off = evidence.disagreement
    if off is not None and DIGITS < off <= OFF_ACCELERATION:
        digits = int(-np.log10(off))
        remarks.append(f"accelerations keep about {digits} digits: formulations differ by {off:.1e} at the same states")
    return "; ".join(remarks)


def trusted_until(
    evaluator: Evaluator, trajectory: Trajectory, reference: Reference | None = None, finer: Reference | None = None
) -> float:
    """Return the time [s] of the last sample up to which the judge has no objection, found by bisection.

    The run is compared with the true motion `reference` and with the repetition `finer`, if they are given. Bisection assumes that
    an invalid run stays invalid if it is continued.
    """
    good, bad = 0, len(trajectory.t)  # indices of samples: the run is valid up to `good`, and not up to `bad`
    while bad - good > 1:
        middle = (good + bad) // 2
        until = slice(middle + 1)
        part = trajectory[until]
        evidence = examine(evaluator, part, reference)
        if finer is not None:
            halving, again = metrics.state_errors(evaluator.mechanism, part, finer), metrics.rate_gaps(finer.samples[until])
            evidence = replace(evidence, halving=halving, rates_again=again)
        good, bad = (middle, bad) if judge(evidence).valid else (good, middle)
    return float(trajectory.t[good])


def advice(objections: tuple[Objection, ...], step: float, stabilized: bool, adaptive: bool = False) -> str:
    """Return advice on how to make an invalid run valid; `step` [s] is that of a run with equal steps.

    It is empty if the objections say all: missing samples or numbers, or a motion that is off but for no reason found here.
    """
    subjects = {x.subject for x in objections}
    if Subject.MODEL in subjects:
        finer = "a tighter tolerance" if adaptive else f"a step smaller than {step:g} s"
        remedy = f"{finer} corrects accelerations that an engine computes from its steps"
        return f"do not trust it; {remedy}; else take another engine or setting"
    if not subjects & {Subject.LOOPS, Subject.ENERGY, Subject.STIFFNESS, Subject.STEP}:
        return "do not trust it" if subjects & {Subject.START, Subject.RATES, Subject.REPETITION} else ""
    remedy = "ask for a tighter tolerance" if adaptive else f"take a step smaller than {step:g} s"
    may_project = Subject.LOOPS in subjects and not stabilized
    return f"do not trust it; {remedy}, or stabilization projection" if may_project else f"do not trust it; {remedy}"
