"""The judge of finished runs, one for every verb: it decides from what our own code found in the trajectory.

A run is valid if the judge has no objection: it has every sample that was asked for, begins where the scenario does, its loops stay
closed, its energy balances, its accelerations are those of this linkage, its velocities and accelerations are the rates of its
positions and velocities, and it agrees with the reference, or, without one, with a repetition at half the step or at a tighter
tolerance. Each limit asks "is this still the motion of this linkage?"; valid runs are ranked by their errors.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Trajectory, in_a_sentence

OFF_TIME = 1e-9  # [s] a sample this far from its time is another sample: a million times rounding, a thousandth of any step
OFF_START = 1e-5  # of size, rad and largest speeds: single precision keeps more, and so does any assembly
OFF_DRIFT = 1e-2  # of the linkage's size, and never more than 1e-2 m or rad: a loop that opens by a hundredth is another linkage
OFF_ENERGY = 1e-2  # of the energy that moves: half a per cent of every speed, more than any integrator leaves that resolves them
OFF_ACCELERATION = 1e-2  # of the largest acceleration: an engine 1 % off at the same state solves another problem
OFF_MOTION = 5e-2  # [rad], and of the linkage's size: a link turned by so much has its far end off by 5 % of its length
HUGE = 1e100  # what is larger has no square, and counts as not finite
OFF_RATES = OFF_MOTION / 2  # of size, rad and largest speeds: how far rates may lead from what they are the rates of
SHARED = 2.0  # times what a repetition changes: of a method of first order, half the step leaves half of a gap
MOST_SHARED = 2.0  # limits: what samples and repetition allow, each; more, and samples that swing would allow themselves anything
FEWEST = 2.0  # steps in a period of the fastest mode or force: with fewer, samples of it are those of a slower one
DIGITS = 1e-9  # of an acceleration: two formulations that differ by more have lost digits that must be told
LIMITS = {"drift": OFF_DRIFT, "energy": OFF_ENERGY, "acceleration": OFF_ACCELERATION, "motion": OFF_MOTION}


class Subject(StrEnum):
    """The subjects of objections, in the order in which they are looked for."""

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


Check = tuple[Subject, float, float, str]  # what is looked at, its value, its limit, and what is said where it is larger


@dataclass(frozen=True)
class Objection:
    """One reason not to use a run.

    Attributes:
        subject: of the objection.
        value: found in the run; limit: that it broke, in the same unit, which the sentence names.
        sentence: names both.
    """

    subject: Subject
    value: float
    limit: float
    sentence: str


@dataclass(frozen=True)
class Judgement:
    """The verdict on a run that has ended."""

    objections: tuple[Objection, ...] = ()

    @property
    def valid(self) -> bool:
        """True if the run may be used."""
        return not self.objections

    @property
    def sentence(self) -> str:
        """Return all objections as one sentence, or an empty text."""
        return "; ".join(x.sentence for x in self.objections)


@dataclass(frozen=True, eq=False)
class Evidence:
    """The findings of our own code in a complete trajectory.

    Attributes:
        size: of the linkage [m].
        drift: metrics.Drift of every sample.
        energy: (k,) energy gained beyond the work done [J]; energy_bar: the error bar of that work; energy_scale: the energy that
            moves [J]; energy_floor: its rounding [J].
        seen: as `energy`, without what damping may have taken between samples that do not resolve it, or None where they do.
        errors: against the reference, or None where there is none.
        acceleration_error: median relative error of accelerations at the same states, or None where it could not be judged.
        rates: of the run; rates_again: of its repetition, at the same samples as far as it goes, or None.
        start: how far the first sample is from the start: places [m], angles [rad], their rates [m/s], [rad/s]; or None.
        duration: from the first sample to the last [s].
        halving: where no truth is known, what the run differs by from its repetition, or None.
        finer: how it was repeated: "half the step" or "a tighter tolerance".
        unrepeated: why there is neither a truth nor a repetition, or an empty text.
        steps_a_period: of the fastest mode, where the step is fixed and no truth is known, or None.
        steps_a_forcing: of the fastest force that swings with time, where the step is fixed, or None.
        disagreement: of two own formulations' accelerations at the run's states, relative, or None.
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
    start: tuple[float, float, float, float] | None = None
    duration: float = 0.0
    finer: str = "half the step"
    unrepeated: str = ""
    steps_a_forcing: float | None = None
    energy_floor: float = 0.0


def completeness(trajectory: object, times: Array, n: int) -> Judgement:
    """Check that what an engine returned is a trajectory of n coordinates at exactly the times (k,) asked for, all of it finite."""

    def refused(subject: Subject, value: float, limit: float, sentence: str) -> Judgement:
        return Judgement((Objection(subject, value, limit, sentence),))

    if not isinstance(trajectory, Trajectory):
        return refused(Subject.COMPLETENESS, 0, len(times), f"the engine returned {type(trajectory).__name__}, not a trajectory")
    try:
        t, *levels = (copy_numbers(x) for x in (trajectory.t, trajectory.q, trajectory.v, trajectory.a))
    except (TypeError, ValueError) as error:
        return refused(Subject.COMPLETENESS, 0, len(times), f"the samples are not numbers: {in_a_sentence(error)}")
    if t.shape != times.shape:
        text = f"{t.size} of {len(times)} samples that were asked for"
        return refused(Subject.COMPLETENESS, t.size, len(times), text)
    if not np.isfinite(t).all() or (off := float(np.abs(t - times).max(initial=0.0))) > OFF_TIME:
        off = float("nan") if not np.isfinite(t).all() else off
        return refused(Subject.COMPLETENESS, off, OFF_TIME, f"samples up to {off:.2g} s away from the times that were asked for")
    wrong = [x.shape for x in levels if x.shape != (len(times), n)]
    if wrong:
        text = f"samples of shape {wrong[0]} where ({len(times)}, {n}) was asked for"
        return refused(Subject.COMPLETENESS, wrong[0][-1] if wrong[0] else 0, n, text)
    lost = ~np.all([(np.abs(x) < HUGE).all(axis=1) for x in levels], axis=0)
    if lost.any():
        first = float(times[int(np.flatnonzero(lost)[0])])
        return refused(Subject.NUMBERS, first, float(times[-1]), f"not finite at t = {first:.6g} s; a smaller step may help")
    return Judgement()


def leading(trajectory: object, times: Array, n: int) -> Trajectory | None:
    """Return the samples of n coordinates before the first that is missing, mistimed or not finite; None if there are none.

    An engine may return any object; whatever does not consist of numbers holds no sample.
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
    sound = np.abs(t[:k] - times[:k]) <= OFF_TIME
    for x in (q, v, a):
        sound &= (np.abs(x[:k]) < HUGE).all(axis=1)
    k = k if sound.all() else int(sound.argmin())
    return Trajectory(times[:k], q[:k], v[:k], a[:k], steps, evaluations, in_a_sentence(trajectory.note or "")) if k else None


def copy_numbers(x: object) -> Array:
    """Copy real numbers into an array of this process's own, which nobody else can change later; what is masked is no number.

    Raises:
        TypeError: complex numbers, truth values, texts or objects.
    """
    given = np.asarray(np.ma.filled(x, np.nan) if np.ma.isMaskedArray(x) else x)
    if given.dtype.kind not in "fiu":
        raise TypeError(f"{given.dtype} where real numbers are wanted")
    return np.array(given, dtype=float)


def _count(x: Any) -> int | None:
    """Return a count as it is told, None where there is none; more than a double can count is no count.

    Raises:
        TypeError, ValueError, OverflowError: it is no count.
    """
    if x is None:
        return None
    count = int(x)
    if not 0 <= count <= 1 << 53:
        raise ValueError(f"{x} is no count")
    return count


def examine(
    evaluator: Evaluator, trajectory: Trajectory, reference: Reference | None = None, acceleration_error: float | None = None
) -> Evidence:
    """Return the evidence of a complete trajectory, all of it from our own evaluation in absolute coordinates."""
    mechanism = evaluator.mechanism
    with np.errstate(all="ignore"):
        drift = metrics.drift(evaluator, trajectory)
        energy, bar = metrics.energy_error(evaluator, trajectory)
        scale = metrics.energy_scale(evaluator, trajectory)
        errors = metrics.state_errors(mechanism, trajectory, reference) if reference else None
        rates, start = metrics.rate_gaps(trajectory), metrics.start_gaps(mechanism, trajectory)
        floor = metrics.energy_rounding(evaluator.energy(trajectory.q, trajectory.v))
    duration = float(trajectory.t[-1] - trajectory.t[0])
    found = Evidence(mechanism.size, drift, energy, bar, scale, errors, acceleration_error, rates=rates, duration=duration)
    return replace(found, start=start, energy_floor=floor)


def judge(evidence: Evidence) -> Judgement:
    """Return every objection to a complete run; a figure that is not finite is an objection."""
    x = evidence
    checks = [*_check_model(x), *_check_motion(x), *_check_start(x), *_check_rates(x)]
    if x.unrepeated:
        checks.append((Subject.REPETITION, 1.0, 0.0, f"nothing says that it may be trusted: {x.unrepeated}"))
    return Judgement(tuple(Objection(*check) for check in checks if not check[1] <= check[2]))


def _check_model(x: Evidence) -> Iterator[Check]:
    """Compare accelerations, loops, energy and steps with the linkage's own limits."""
    two = "formulations of the same accelerations differ by {:.2g} (median): masses or lengths lie too far apart"
    own = "accelerations off by {:.2g} at the same state (median)"
    for off, said in ((x.acceleration_error, own), (x.disagreement, two)):
        if off is not None:
            yield Subject.MODEL, off, OFF_ACCELERATION, said.format(off)
    opened, gained = _largest(x.drift.position), _largest(x.energy if x.seen is None else x.seen)
    yield Subject.LOOPS, opened, OFF_DRIFT * min(1.0, x.size), f"the loops open by {opened:.2g} (m or rad)"
    limit = OFF_ENERGY * x.energy_scale
    allowed = limit + min(x.energy_bar, MOST_SHARED * limit + x.energy_floor)
    yield Subject.ENERGY, gained, allowed, f"energy off by {gained:.2g} J where {x.energy_scale:.2g} J move"
    for steps, what in ((x.steps_a_period, "oscillation"), (x.steps_a_forcing, "force")):
        if steps is not None:
            said = f"{steps:.2g} steps in a period of the fastest {what}, which {FEWEST:g} do not resolve yet"
            yield Subject.STIFFNESS, FEWEST, steps, said


def _check_motion(x: Evidence) -> Iterator[Check]:
    """Compare poses with the reference, or with a repetition, which shows half of the error of a first-order method."""
    if x.errors is not None:
        length, turn, beside = _largest(x.errors.length), _largest(x.errors.angle), "from where it should be"
        yield Subject.MOTION, length, OFF_MOTION * x.size, f"a link ends up {length:.2g} m {beside}"
        yield Subject.MOTION, turn, OFF_MOTION, f"a link ends up turned by {turn:.2g} rad {beside}"
    if x.halving is not None:
        length, turn = _largest(x.halving.length), _largest(x.halving.angle)
        # Halving the step removes half of a first-order error, so that the change may be half of the limit.
        yield Subject.STEP, length, OFF_MOTION / 2 * x.size, f"{x.finer} moves a link by {length:.2g} m"
        yield Subject.STEP, turn, OFF_MOTION / 2, f"{x.finer} turns a link by {turn:.2g} rad"


def _check_start(x: Evidence) -> Iterator[Check]:
    """Compare the first sample with the start of the scenario."""
    if x.start is not None and x.rates is not None:
        # A linkage at rest has no speed to compare with; then the speed that crosses its size within the run counts.
        slow = x.size / x.duration if x.duration else x.size
        speed, spin = max(x.rates.fastest[0], slow), max(x.rates.fastest[1], slow / x.size)
        for gap, scale, unit in zip(x.start, (x.size, 1.0, speed, spin), ("m", "rad", "m/s", "rad/s"), strict=True):
            yield Subject.START, gap, OFF_START * scale, f"the first sample is {gap:.2g} {unit} off the scenario's start"


def _check_rates(x: Evidence) -> Iterator[Check]:
    """Compare positions with the integral of velocities, and velocities with that of accelerations.

    Two things widen a limit, each at most as far as MOST_SHARED limits: the error of the integral, which is estimated by leaving
    out every second sample, and the part of the gap that a finer run removes. That part comes from the method (some methods store
    rates half a step beside the positions); a gap that stays means another motion.
    """
    if x.rates is None:
        return
    slow = OFF_RATES * x.size / x.duration if x.duration else 0.0  # so slow that no link leaves its place by it
    limits = {
        "place": (OFF_RATES * x.size, "m", "positions", "velocities"),
        "turn": (OFF_RATES, "rad", "angles", "angular velocities"),
        "speed": (max(OFF_RATES * x.rates.fastest[0], slow), "m/s", "velocities", "accelerations"),
        "spin": (max(OFF_RATES * x.rates.fastest[1], slow / x.size), "rad/s", "angular velocities", "angular accelerations"),
    }
    for bar, (name, (limit, unit, what, rates)) in zip(x.rates.bars, limits.items(), strict=True):
        # Gaps that a finer run reduces come from the method, and widen the limit within bounds.
        gaps: Array = getattr(x.rates, name)
        allowed = limit + min(SHARED * bar, MOST_SHARED * limit)
        if x.rates_again is not None:
            again: Array = getattr(x.rates_again, name)
            common = min(len(gaps), len(again))
            changed = _largest(gaps[:common] - again[:common])
            allowed += min(SHARED * changed, MOST_SHARED * limit)
        largest = _largest(gaps)
        yield Subject.RATES, largest, allowed, f"{what} are {largest:.2g} {unit} off the integral of their {rates}"


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))


def remark(evidence: Evidence) -> str:
    """Return the remark that a valid run needs, or an empty text."""
    lost, told = evidence.disagreement, []
    if evidence.seen is not None:
        gap = _largest(evidence.energy - evidence.seen)
        if gap > 0.0:
            told.append(f"its energy is not decidable: {gap:.2g} J are lost between samples too far apart to see damping take them")
    if lost is not None and DIGITS < lost <= OFF_ACCELERATION:
        digits = int(-np.log10(lost))
        told.append(f"accelerations keep about {digits} digits: formulations differ by {lost:.1e} at the same states")
    return "; ".join(told)


def trusted_until(
    evaluator: Evaluator, trajectory: Trajectory, reference: Reference | None = None, finer: Reference | None = None
) -> float:
    """Return the last time [s] up to which loops, energy and motion are valid, found by bisection to one sample.

    `reference` and `finer`, the repetition, are used where they are known.
    """
    good, bad = 0, len(trajectory.t)
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
    """Return advice on how to make an invalid run valid, or an empty text."""
    subjects = {x.subject for x in objections}
    if Subject.MODEL in subjects:
        smaller = "a tighter tolerance" if adaptive else f"a step smaller than {step:g} s"
        mended = f"{smaller} mends accelerations that an engine takes from its steps"
        return f"do not trust it; {mended}; else look for another engine or setting"
    if not subjects & {Subject.LOOPS, Subject.ENERGY, Subject.STIFFNESS, Subject.STEP}:
        return "do not trust it" if subjects & {Subject.START, Subject.RATES, Subject.REPETITION} else ""
    smaller = "ask for a tighter tolerance" if adaptive else f"take a step smaller than {step:g} s"
    project = Subject.LOOPS in subjects and not stabilized
    return f"do not trust it; {smaller}, or stabilization projection" if project else f"do not trust it; {smaller}"
