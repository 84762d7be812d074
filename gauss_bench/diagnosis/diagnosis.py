"""Diagnose an engine on a linkage: split its error against the reference into parts, and give a verdict in words.

The questions are asked in such an order that no fault falsifies the answer to a later question. A cause is named only if it
accounts for most of the error. Two kinds of accelerations are compared with correct ones at the engine's own states: those that the
engine reports, and the implied accelerations, which are the change of velocities in a step divided by the step.

The verdict is "no dominant cause" if the largest error of a position is at most SMALL or BARS times the error bar of the reference,
reported velocities are correct, and reported accelerations are wrong by at most OFF_REPORTED and reproduced by no known fault. The
parts of such an error are computed too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gauss_bench.diagnosis import samples, split
from gauss_bench.diagnosis.causes import Cause, Part
from gauss_bench.diagnosis.explanations import Explained, candidates, constraint_explanations, every_explanation, explain, tell
from gauss_bench.diagnosis.motion import OwnMotion, TrueMotion
from gauss_bench.diagnosis.observations import FEWEST, Burst, Runner, burst, observe, sample
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.runs.one_run import sampling_at
from gauss_bench.terms import Array, largest
from gauss_bench.trajectory import Reference, States, Status

BARS = 3.0  # errors below BARS times the error bar of the reference are not explained
SMALL = 1e-6  # [m, rad] smaller errors are not explained: they are below the tolerances of drawings
OFF_VELOCITIES = 0.1  # relative error above which reported velocities are wrong; steps of a tenth of a period cause a smaller one
OFF_REPORTED = 1e-3  # relative error (median) of reported accelerations: a tenth of the limit of the judge
EXPLAINS = 0.9  # share of the squared acceleration error that a named cause must account for
AS_GOOD = 3.0  # an explanation that leaves up to AS_GOOD times the squared error of the best cannot be distinguished from the best
MOST = 0.5  # share of an error that counts as most of the error
SEEN = 1e-7  # relative error of accelerations that is too large for round-off
OPEN = 0.3  # largest gap of a loop, relative to the linkage's size, with which accelerations can be compared
NOISE = 1e-9  # relative difference of accelerations at equal states above which the equations differ
STILL = 1e-3  # largest travel of samples that count as standing still, relative to the true travel
BESIDE_TURNS = 1e-3  # [rad, m] largest error that is left after whole turns are removed
SHORTER = 4.0  # factor by which a run is shortened if it fails before its first checkpoint
NAMED = 8  # largest number of causes in a sentence; `candidates` has all of them
OLD, OLDEST = 0.1, 5.0  # [steps] least and largest age of constraint data that is reported
NEGLIGIBLE, SOUND = 0.02, 1e-5  # negligible share of an error; relative error below which accelerations are correct
ORDERS = {"rk4": 4.0, "dop853_fixed": 8.0}  # integrator -> order of convergence
LEAST_LATE, MOST_LATE = 0.2, 20.0  # [steps] limits of a time shift found from the first step
MIN_VIOLATING = 0.2  # an error may be drift if a larger share of it violates the constraints
MAX_PROJECTED = 1 / 3  # the error is drift if projection of the steps leaves less than this share
BETTER = 10.0  # factor by which a second cause must reduce the squared residual
MIN_CORRELATION = 0.8  # correlation of gap and constraint force (`Closure.held`) above which a constraint is compliant
TINY_GAP = SMALL / 10  # [m, rad] smaller gaps of loops are not explained
UNDIVIDED = (Cause.RESET, Cause.ORDER, Cause.START, Cause.STALE, Cause.LENGTH)  # causes that explain the whole error or none of it


@dataclass(frozen=True)
class Numbers(split.Closure):
    """The measured figures of a diagnosis, including the gaps of the loops; NaN stands for a figure that could not be determined.

    Attributes:
        error: largest position error of the run with the requested step [m, rad].
        at: time of this error [s].
        errors: largest position error of every run [m, rad].
        bar: error bar of the reference [m, rad].
        steps: step of every run [s].
        tolerances: relative tolerance of every run, if the integrator chooses its steps; otherwise None for every run.
        order: order of convergence of the motion when the step is reduced.
        horizon: time until which errors are small enough to be split into parts [s].
        limit_error: root mean square of the error extrapolated to step zero [m, rad].
        step_error: root mean square of the part of the error that the step causes [m, rad].
        told: median relative error of the accelerations that the engine reports, for every run.
        moved: median relative error of the accelerations that follow from the change of velocities in a step, for every run.
        step_exponent: exponent k if the error of one step is proportional to h^k: 0 for round-off, 1 for wrong accelerations,
            p + 1 for an integrator of order p.
        shift: shift b [s] of the fitted map of time, by which a sample reported at t is the true state at b + rate t.
        rate: the factor `rate` of this time map.
        jump_time: time of a jump of the state [s].
    """

    error: float
    at: float
    errors: tuple[float, ...]
    bar: float
    steps: tuple[float, ...]
    tolerances: tuple[float | None, ...]
    order: float
    horizon: float
    limit_error: float
    step_error: float
    told: tuple[float, ...]
    moved: tuple[float, ...]
    step_exponent: float
    shift: float = np.nan
    rate: float = np.nan
    jump_time: float = np.nan


@dataclass(frozen=True)
class Ended:
    """The end of a run.

    Attributes:
        status: how the run ended; message: reason for this status, or a remark on the run.
    """

    status: Status
    message: str


@dataclass(frozen=True, eq=False)
class Verdict:
    """The result of a diagnosis.

    Attributes:
        cause: dominant cause of the error.
        verdict: the diagnosis in one sentence.
        parts: name of a part of the error -> size of this part [m, rad].
        numbers: figures that were measured in the runs; None if no run reached a checkpoint.
        explanations: possible explanations of wrong accelerations, the best first.
        runs: status and message of each run of the engine.
        candidates: those explanations that reproduce the engine's accelerations within their noise.
    """

    cause: Cause
    verdict: str
    parts: dict[Part, float]
    numbers: Numbers | None
    explanations: tuple[Explained, ...]
    runs: tuple[Ended, ...]
    candidates: tuple[Explained, ...] = ()


def without_run(*ended: Ended) -> Verdict:
    """Return the verdict of a diagnosis in which no run has reached a checkpoint; `ended` tells how each run ended."""
    first = ended[0]
    why = first.message if first.status is Status.SKIP else f"{first.status}: {first.message}"
    return Verdict(Cause.UNKNOWN, f"no run can be diagnosed: {why}", {}, None, (), ended)


class Answer(NamedTuple):
    """The answer to one question of the diagnosis: a cause of the error, a sentence on it, and the fitted explanations."""

    cause: Cause
    sentence: str
    explanations: Sequence[Explained] = ()


def diagnose_runs(
    run: Runner,
    mechanism: Mechanism,
    reference: Reference,
    choices: Sequence[Choice],
    until: float,
    adaptive: bool = False,
    projected: Choice | None = None,
    told: Callable[[str], object] = lambda _: None,
) -> Verdict:
    """Diagnose an engine from its runs with several steps or tolerances.

    Args:
        run: function that runs the engine on the linkage with a setting and a sampling.
        reference: true motion of the linkage from 0 to `until`.
        choices: the requested setting, followed by the same setting with smaller steps or tolerances.
        until: end of the runs [s].
        adaptive: whether the integrator chooses its own steps, so that the settings differ by tolerance.
        projected: the first setting with projected steps, or None if the engine does not offer projection.
        told: called with each sentence of progress.

    Raises:
        ChoiceError: a run up to the time `until` has fewer steps than a diagnosis needs.
    """
    own = OwnMotion(mechanism)
    bursts, runs = observe(run, choices, until, told)
    ended = tuple(Ended(r.status, r.message) for r in runs)
    # a motion that diverges before its first checkpoint is observed over a shorter time
    while not bursts and ended[0].status is Status.NAN and until / SHORTER >= 2 * FEWEST * choices[0].step:
        until /= SHORTER
        bursts, _ = observe(run, choices, until, told)
    if not bursts:
        return without_run(*ended)
    told("comparing the motions")
    with np.errstate(all="ignore"):
        case = Case(run, own, TrueMotion(own, reference), bursts, choices, adaptive, projected)
        cause, sentence, explanations = case.verdict()
        failed = [x for x in ended if x.status is not Status.OK]
        if failed:
            sentence += f" (a run ended early: {failed[0].status}: {failed[0].message})"
        alike = tuple(candidates([*explanations], case.noise))  # explanations that fit equally well
        return Verdict(cause, sentence, case.parts(cause), case.numbers(), tuple(explanations), ended, alike)


class Case:
    """The measurements of one engine on one linkage, and the questions that lead to the verdict.

    The methods `_find_...` answer one question each; they return None if they do not find the fault that they look for.

    Attributes:
        first: the burst of the run with the requested setting; true: reference states at its checkpoints.
        position_errors: (k, n) errors of this run at its checkpoints [m, rad].
        bursts: bursts of all runs, at the checkpoints that every run reached; the run with the smallest step comes last.
        errors: largest position error of every run [m, rad].
        limit, by_step, whole: root mean squares of both parts of `steps`, and of the whole error [m, rad].
        sound: the samples in `bursts`, without the checkpoints at which a loop is wide open or a value is not finite.
        local: for every run, the errors of accelerations in its samples `sound`, or None without such samples.
        start: the start state, repeated for each state of the last run in `sound`.
        noise: relative error that correct accelerations may have.
        map, jump_time: the fitted map of time, and the time of a jump [s]; NaN until they are found.
    """

    def __init__(
        self,
        run: Runner,
        own: OwnMotion,
        truth: TrueMotion,
        bursts: tuple[Burst, ...],
        choices: Sequence[Choice],
        adaptive: bool,
        projected: Choice | None,
    ):
        self.run, self.own, self.truth, self.choices, self.adaptive, self.projected = run, own, truth, choices, adaptive, projected
        self.first: Burst = bursts[0]
        self.true = truth.at(self.first.at.t)
        self.position_errors = self.first.at.q - self.true.q
        self.errors = tuple(largest(b.at.q - truth.at(b.at.t).q) for b in bursts)
        self.error, self.bar = self.errors[0], float(truth.bar(self.first.at.t).max())
        shortest = min(len(b.at) for b in bursts)
        self.bursts = tuple(b[np.arange(len(b.at)) < shortest] for b in bursts)
        self.steps = split.by_steps(self.bursts, self.true[slice(0, shortest)], adaptive)
        self.limit, self.by_step = split.size(self.steps.limit), split.size(self.steps.by_step)
        self.whole = split.size(self.position_errors[: self.steps.horizon])
        self.closure = split.closure_of(own, self.bursts, self.position_errors[: self.steps.horizon])
        self.sound = tuple(b[split.usable(own, b, OPEN * own.mechanism.size)] for b in self.bursts)
        self.local = tuple(split.measure_local_errors(own, b) if len(b.at) else None for b in self.sound)
        count = len(self.sound[-1].at)
        self.start = States(np.zeros(count), *(np.tile(x, (count, 1)) for x in (own.mechanism.q0, own.mechanism.v0)))
        self.noise = self._acceleration_noise()
        self.map = samples.TimeMap(np.nan, np.nan, left=0.0)
        self.jump_time = np.nan

    def verdict(self) -> Answer:
        """Return the dominant cause of the error: the answer to the first question that finds one.

        A fault of the model that reproduces the reported accelerations is the cause if most of the error remains at smaller steps,
        or if the error is rounding. Otherwise the fault is listed with the other cause, if that cause has no explanation.
        """
        if self.error <= max(SMALL, BARS * self.bar):
            return self._explain_small_error()
        for question in (self._find_turns, self._find_order, self._find_standstill, self._find_jump, self._find_velocities):
            if answer := question():
                return answer
        fault = self._reproduce()
        if fault and (self._is_round_off() or not self._step_dominates()):
            return fault
        answer = self._find_length() or self._find_other_times() or self._explain_by_steps()
        if fault and not answer.explanations:
            return answer._replace(explanations=fault.explanations)
        return answer

    def _acceleration_noise(self) -> float:
        """Return the relative error that correct accelerations may have: NOISE, or 10 times the difference of solvers if larger."""
        states = self.sound[-1].at
        if not len(states) or self.own.evaluator.friction:
            return NOISE  # with friction `own` uses the second solver itself, so that the difference would be zero
        a, other = self.own.accelerations(states), self.own.absolute.acceleration(states.t, states.q, states.v)
        difference = float(np.linalg.norm(a - other) / max(float(np.linalg.norm(a)), 1e-300))
        return max(NOISE, 10 * difference) if np.isfinite(difference) else NOISE

    def _explain(self, y: Array) -> list[Explained]:
        """Return the possible faults that explain acceleration errors y (k, n) of the run with the smallest step, the best first.

        All faults that fit to within the numerical noise are among them, and in any case the best NAMED faults.
        """
        finest = self.sound[-1]
        tried = every_explanation(self.own, finest.at, finest.before, self.start)
        fits = explain(y, self.own.evaluator.mass, tried, self.own.accelerations(finest.at), self.noise)
        return fits[: max(NAMED, len(candidates(fits, self.noise)))]

    def _reproduce(self) -> Answer | None:
        """Name the faults that each reproduce the reported accelerations to within the numerical noise; None if there are none."""
        last = self.local[-1]  # of the run with the smallest step
        if last is None or not last.relative_reported > SEEN:  # `not >` is also true for NaN
            return None
        explanations = self._explain(last.reported)
        alike = candidates(explanations, self.noise)
        if not alike:
            return None
        named = ", or ".join(x.sentence for x in alike[:NAMED])
        more = f", or one of {len(alike) - NAMED} more" if len(alike) > NAMED else ""
        size = f"accelerations are off by {last.relative_reported:.1e} at the same states"
        each = "each of these" if len(alike) > 1 else "this"
        return Answer(alike[0].cause, f"{named}{more}: {size}, and {each} reproduces them to {self.noise:.0e}", explanations)

    def _explain_small_error(self) -> Answer:
        """Return the cause of wrong velocities or accelerations in a run whose positions are correct, or no dominant cause."""
        if answer := self._find_velocities() or self._reproduce():
            return answer
        last = self.local[-1]
        if last is None or not last.relative_reported > OFF_REPORTED:
            limit = max(SMALL, BARS * self.bar)
            sentence = f"no dominant cause: the largest error, {self.error:.1e} (m, rad), is below {limit:.0e}"
            falls = f"; it falls with the step by order {self.steps.order:.1f}" if self.steps.converges else ""
            return Answer(Cause.NONE, sentence + falls)
        explanations = self._explain(last.reported)
        positions = f"positions are right to {self.error:.1e} (m, rad)"
        wrong = f"{positions}, but reported accelerations are off by {last.relative_reported:.1e}"
        if explanations and explanations[0].share >= EXPLAINS:
            return Answer(explanations[0].cause, f"{wrong}: {explanations[0].sentence}", explanations)
        if self.closure.held > MIN_CORRELATION:
            return Answer(Cause.SOFTNESS, f"{wrong}, as they are with soft constraints", explanations)
        return Answer(Cause.ACCELERATIONS, f"{wrong}, which no parameter explains", explanations)

    def _find_turns(self) -> Answer | None:
        """Detect angles that an engine has wrapped into one turn: all but BESIDE_TURNS of the errors are whole turns of angles."""
        rest, turns = self.position_errors.copy(), np.round(angles(self.position_errors) / (2 * np.pi))  # turns (k, links)
        angles(rest)[...] -= 2 * np.pi * turns
        if not turns.any() or not largest(rest) <= BESIDE_TURNS:
            return None
        k = int(turns.any(axis=1).argmax())  # the first wrong checkpoint
        link = int(np.abs(turns[k]).argmax())
        by, name = turns[k, link], self.own.mechanism.links[link].name
        sentence = f"reported angles are off by whole turns: {name} by {by:+.0f} from t = {self.first.at.t[k]:.3g} s on"
        return Answer(Cause.WRAPPED, f"{sentence}; apart from whole turns they are right")

    def _find_order(self) -> Answer | None:
        """Detect from the first part of the run whether the engine reports its links or joint coordinates in a wrong order."""
        # the start and the first third of the checkpoints (at least three), before integration errors have grown
        reported = _join_states(self.first.start, self.first.at[slice(0, max(3, len(self.first.at) // split.PERIODS))])
        reordered = samples.find_order(self.own.mechanism, self.truth.at(reported.t), reported)
        if reordered is None:
            return None
        wrong_order, left = reordered
        return Answer(Cause.ORDER, f"{wrong_order}; in the right order, {left:.1%} of the error is left")

    def _find_velocities(self) -> Answer | None:
        """Detect velocities that disagree with the change of positions from step to step."""
        finest = self.bursts[-1]
        implied = (finest.after.q - finest.before.q) / (finest.after.t - finest.before.t)[:, None]
        reported = finest.at.v
        square, norm = float(np.sum((reported - implied) ** 2)), max(float(np.sum(implied**2)), 1e-300)
        error = float(np.sqrt(square / norm))
        factor = float(np.sum(reported * implied)) / norm  # the reported velocities are about `factor` times the implied ones
        # share of the error that the factor leaves
        left = float(np.sqrt(float(np.sum((reported - factor * implied) ** 2)) / max(square, 1e-300)))
        # a wrong velocity counts only if it would displace links by more than SMALL until the last checkpoint
        if not (error > OFF_VELOCITIES and largest(reported - implied) * finest.at.t[-1] > SMALL):
            return None
        how = f"they are {factor:.4g} times as large" if left <= samples.LEFT else "no factor explains the difference"
        sentence = f"reported velocities differ by {error:.1e} from the rate at which reported positions change: {how}"
        return Answer(Cause.VELOCITIES, sentence)

    def _find_standstill(self) -> Answer | None:
        """Detect samples that stand still while the true motion moves.

        A linkage that starts at rest may do so if the engine leaves out the second derivative of a driver's law.
        """
        travel, true_travel = (float(np.abs(x.q - x.q[0]).max()) for x in (self.first.at, self.true))
        if not travel <= STILL * true_travel:
            return None
        last = self.local[-1]
        if self.own.mechanism.drivers and last is not None:
            best = next(iter(self._explain(last.reported)), None)
            if best and best.share >= EXPLAINS and best.cause is Cause.SECOND_RATE:
                return Answer(Cause.SECOND_RATE, f"{best.sentence}, so that the linkage stands still")
        return Answer(Cause.STATIONARY, "the samples stand still while the linkage moves")

    def _find_jump(self) -> Answer | None:
        """Detect a jump of the state between two checkpoints: a displacement that velocities and accelerations do not explain.

        A second run, sampled at every step between these checkpoints, shows the step with the jump. The steps of an integrator that
        chooses them itself cannot be sampled, and the answer is None.
        """
        # from the start on, because the state may jump before the first checkpoint
        reported = _join_states(self.first.start, self.first.at)
        k = samples.find_suspicious_interval(reported, np.vstack([self.own.accelerations(self.first.start), self.first.a]))
        if k is None or self.adaptive:
            return None
        h = self.first.step
        steps = np.unique([0, *range(round(reported.t[k] / h), round(reported.t[k + 1] / h) + 1)])
        x = self.run(self.choices[0], sampling_at(h, steps * h)).trajectory
        jump = samples.find_jump(self.own, States(x.t, x.q, x.v)) if x else None
        if jump is None:
            return None
        self.jump_time, size, to_start = jump
        where = "back to its start" if to_start else "elsewhere"
        sentence = f"the state jumps {where} at t = {self.jump_time:.6g} s, by {size:.2g} (m, rad) in one step"
        return Answer(Cause.RESET, f"{sentence}: the engine seems to reset itself after an error")

    def _find_length(self) -> Answer | None:
        """Detect a pin that the engine has at another place of a link than the file.

        Except for a constant, the gap of such a pin is fixed in the frame of the link, for any step.
        """
        opened = self.closure.closure[-1]
        if len(self.bursts) < 2 or not opened > TINY_GAP:
            return None
        pin = split.find_displaced_pin(self.own, self.bursts[0].at, self.bursts[-1].at)
        # the squared correlation of gap and force is the share of the squared gap that a compliant constraint would explain
        if pin is None or self.closure.held**2 >= pin.share:
            return None
        gap = f"with the file's dimensions loops stay open by {opened:.1e} (m, rad), whatever the step"
        return Answer(Cause.LENGTH, f"{pin.sentence}: {gap}; this explains {format_share(pin.share)} of the gaps")

    def _find_other_times(self) -> Answer | None:
        """Test whether the steps are correct, but states are reported at shifted or scaled times, or the start is wrong."""
        h = self.first.step
        for stretch in (False, True):  # first a shift alone, then a shift and a factor on time
            fit = samples.fit_time_map(self.truth, self.first.at, stretch)
            if fit is None or not (self._scales_with_step(fit, stretch) and self._steps_are_sound(fit)):
                continue
            left = f"at those times {fit.left:.1%} of the error is left"
            if not stretch and abs(fit.shift) > 1e-3 * h:
                self.map, when = fit, "later" if fit.shift > 0 else "earlier"
                sentence = f"the samples show the motion {abs(fit.shift):.3g} s {when} ({abs(fit.shift) / h:.3g} steps)"
                return Answer(Cause.SHIFT, f"{sentence}; {left}")
            if stretch and abs(fit.rate - 1) > 1e-6:
                self.map = fit
                return Answer(Cause.STRETCH, f"each sample shows the motion at {fit.rate:.6g} times its time; {left}")
        if by := self._shift_of_first_step():
            length, when = ("long", "later") if by > 0 else ("short", "earlier")
            sentence = f"only the first step is {abs(by):.3g} s too {length}"
            return Answer(Cause.SHIFT, f"{sentence}: all other samples show the motion {abs(by) / h:.3g} steps {when}")
        start, mechanism = self.first.start, self.own.mechanism
        # an error of velocities counts by the displacement that it causes until the last checkpoint
        displaced = max(largest(start.q - mechanism.q0), largest((start.v - mechanism.v0) * self.first.at.t[-1]))
        # the error of a wrong start may grow during the run, so a twentieth of the largest error (MOST / 10) suffices at the start
        if displaced > MOST * self.error / 10 and displaced > SMALL:
            return Answer(Cause.START, f"the run begins at another state, which displaces links by {displaced:.1e} (m, rad)")
        return None

    def _scales_with_step(self, time_map: samples.TimeMap, stretch: bool) -> bool:
        """Tell whether a map of time depends on the step like a fault of the sampling, not like an integration error.

        A fault of the sampling delays all runs by the same time, or by the same number of their own steps. With `stretch`, the rate
        differs from 1 with the smallest step still by more than half as much as with the first. The result is also True if there is
        no smaller step to compare.
        """
        finest = self.bursts[-1]
        if self.adaptive or finest.step == self.first.step:
            return True
        fit = samples.fit_time_map(self.truth, finest.at, stretch)
        if fit is None:
            return False
        if stretch:
            return abs(fit.rate - 1) > abs(time_map.rate - 1) / 2
        # 0.8 allows for errors of the fit
        return abs(fit.shift) > 0.8 * abs(time_map.shift) * finest.step / self.first.step

    def _shift_of_first_step(self) -> float:
        """Return the time shift [s] of all samples but the start, found from the first step of every run; 0 if there is none.

        The first step shows the shift even if integration errors of later steps are too large for a fit to all samples.
        """
        shifts = []
        for b, x in zip(self.bursts, self.local, strict=True):
            if self.adaptive or x is None or not len(b.stepped):
                return 0.0
            true = self.own.flow(b.start, np.array([b.step]))
            # error of the state (positions, and velocities times the step) after the first step; change of the state in a step
            error = np.concatenate([b.stepped.q[0] - true.q[0], (b.stepped.v[0] - true.v[0]) * b.step])
            slope = np.concatenate([true.v[0] * b.step, self.own.accelerations(true)[0] * b.step**2])
            steps = float(error @ slope) / max(float(slope @ slope), 1e-300)  # the shift in steps that explains the error best
            unexplained = float(np.linalg.norm(error - steps * slope)) / max(float(np.linalg.norm(error)), 1e-300)
            if not (LEAST_LATE < abs(steps) < MOST_LATE and unexplained < MOST and x.relative_implied < abs(steps) / 5):
                return 0.0
            shifts.append(steps * b.step)
        # a shift decreases at most like the step, an integration error faster; 0.8 allows for other errors
        is_shift = abs(shifts[-1]) > 0.8 * abs(shifts[0]) * self.bursts[-1].step / self.bursts[0].step
        return shifts[0] if is_shift else 0.0

    def _steps_are_sound(self, time_map: samples.TimeMap) -> bool:
        """Tell whether the steps are correct: both the reported accelerations and the implied ones.

        Implied accelerations may be wrong by the factor `rate` of the map of time.
        """
        # if forces or drivers depend on time, correct states at wrong times have other accelerations
        if time_map.left < NEGLIGIBLE:  # share of the error that the map does not explain
            return True
        last, by_rate = self.local[-1], abs(time_map.rate - 1)  # by_rate: relative error of implied accelerations due to the rate
        if last is None:
            return False
        implied = last.relative_implied
        return last.relative_reported < SOUND and (implied < SOUND or abs(implied - by_rate) < by_rate / 2)

    def _explain_by_steps(self) -> Answer:
        """Attribute the error to round-off, to the step, or to a fault that remains with smaller steps."""
        if self._is_round_off():
            sentence = "the error does not fall with the step, and the error of one step does not depend on its length: round-off"
            errors = ", ".join(f"{e:.1e} with {b.step:.3g} s" for e, b in zip(self.errors, self.bursts, strict=True))
            return Answer(Cause.ROUND_OFF, f"{sentence} ({errors})")
        return self._explain_step_error() if self._step_dominates() else self._explain_remaining_error()

    def _step_dominates(self) -> bool:
        """Tell whether the step causes at least as much error as remains at step zero; False if fixed steps do not converge."""
        return self.limit <= self.by_step and (self.steps.converges or self.adaptive)

    def step_exponent(self) -> float:
        """Return the exponent k if the velocity error of a single step h is proportional to h^k; NaN if it cannot be determined.

        It follows from the two runs with the smallest steps, whose single steps begin at states of the engine itself.
        """
        runs = zip(self.local[-2:], self.sound[-2:], strict=True)
        # the velocity error of one step is the error of the mean acceleration in it, times the step
        errors_and_steps = [(split.size(x.implied) * b.step, b.step) for x, b in runs if x is not None]
        if self.adaptive or len(errors_and_steps) < 2 or not all(error for error, _ in errors_and_steps):
            return np.nan
        (coarse_error, coarse_step), (fine_error, fine_step) = errors_and_steps
        return float(np.log(coarse_error / fine_error) / np.log(coarse_step / fine_step))

    def _is_round_off(self) -> bool:
        """Tell whether the error falls more slowly than the step, and the error of one step hardly depends on the step."""
        return bool(self.errors[-1] > self.error / 2 ** (len(self.errors) - 1) and self.step_exponent() < 0.5)

    def _explain_remaining_error(self) -> Answer:
        """Explain an error that remains with smaller steps by wrong accelerations, or by loops that stay open at any step."""
        last, closure = self.local[-1], self.closure
        if last is None:
            return Answer(Cause.UNKNOWN, "the loops are wide open at all checkpoints: no state can be compared")
        # the implied accelerations are explained only if the reported ones have at most 0.3 of their error
        explanations = self._explain(last.reported if last.relative_reported > 0.3 * last.relative_implied else last.implied)
        if explanations and explanations[0].share >= EXPLAINS:
            best = explanations[0]
            sentence = f"{best.sentence}; this explains {format_share(best.share)} of the error of accelerations"
            left = AS_GOOD * max(1 - best.share, 1e-12)  # explanations that leave as little of the error are named as alternatives
            others = [x.sentence for x in explanations[1:] if 1 - x.share <= left][:3]
            alike = f" (in this motion it cannot be distinguished from: {'; '.join(others)})" if others else ""
            return Answer(best.cause, sentence + alike, explanations)
        if closure.closure_stays and closure.closure[-1] > TINY_GAP:
            gap = f"the loops stay open by {closure.closure[-1]:.1e} (m, rad) at {closure.closure_joint} however short the step is"
            yields = f", with a compliance of {closure.compliance:.1e} m/N" if closure.held > MIN_CORRELATION else ""
            return Answer(Cause.SOFTNESS, f"soft constraints: {gap}{yields}", explanations)
        stays = f"an error of {self.limit:.1e} (m, rad) remains at any step"
        off = f"accelerations are off by {max(last.relative_reported, last.relative_implied):.1e} at the same states"
        return Answer(Cause.ACCELERATIONS, f"{stays}: {off}, which no parameter of the linkage explains", explanations)

    def _explain_step_error(self) -> Answer:
        """Explain an error that decreases with the step: old constraint data, soft constraints, drift, or the integrator.

        The causes are tested in this order. The test of drift makes a further run.
        """
        if old := self._find_stale_data():
            return Answer(Cause.STALE, old.sentence, [old])
        closure = self.closure
        falls = "falls with the tolerance" if self.adaptive else f"falls with the step by order {self.steps.order:.1f}"
        # gaps of solvers that correct velocities are proportional to the forces too, but they decrease with the square of the step,
        # while the error of the steps decreases by order 1
        follows_force = closure.held > MIN_CORRELATION and closure.closure_share > NEGLIGIBLE
        gap_is_elastic = follows_force and not closure.grows and not closure.falls_faster(self.steps.order)
        if gap_is_elastic or self._constraints_are_compliant():
            gap = f"the loops open by {closure.closure[0]:.1e} (m, rad) at {closure.closure_joint}"
            sentence = f"soft constraints, whose stiffness depends on the step: {gap}, in proportion to the force there"
            return Answer(Cause.SOFTNESS, f"{sentence} ({closure.compliance:.1e} m/N); the error {falls}")
        may_drift = closure.closure_share > MIN_VIOLATING and closure.grows
        left_share = self._share_after_projection() if may_drift else 1.0  # needs a further run, with projection
        if left_share < MAX_PROJECTED:
            gap = f"the loops open by {closure.closure_early:.1e} early and by {closure.closure_late:.1e} (m, rad) late"
            left = f"with projected steps {left_share:.0%} of the error is left"
            return Answer(Cause.DRIFT, f"drift off the constraints: {gap}; {left}; the error {falls}")
        share = self.by_step / max(self.by_step, self.whole)  # by_step is extrapolated and may exceed the whole error
        return Answer(Cause.INTEGRATOR, f"the integrator: {share:.0%} of the error {falls}{self._name_hidden_fault()}")

    def _loses_order(self) -> bool:
        """Tell whether the motion's order is lower than the integrator's by more than 1; False if the latter is not known."""
        return bool(self.steps.order < ORDERS.get(self.choices[0].integrator, np.nan) - 1)

    def _constraints_are_compliant(self) -> bool:
        """Tell whether the accelerations show that compliant constraints cause the error.

        The order of convergence is then too low for the integrator, smaller steps do not halve the error of the reported
        accelerations, and the largest gap correlates with its constraint force by more than 0.5.
        """
        first, last = self.local[0], self.local[-1]  # runs with the largest and the smallest step
        if first is None or last is None or not self._loses_order():
            return False
        stays_wrong = last.relative_reported > max(OFF_REPORTED / 10, first.relative_reported / 2)
        return stays_wrong and self.closure.held > 0.5

    def _name_hidden_fault(self) -> str:
        """Return a clause on a second fault, whose error is smaller than that of the step; an empty text if there is none."""
        last = self.local[-1]
        if last is not None and last.relative_reported > SOUND:
            best = next(iter(self._explain(last.reported)), None)
            if best and best.share >= EXPLAINS:
                return f"; besides, {best.sentence}"
        stays = self.limit > max(SMALL, self.by_step / 10)
        return f"; an error of {self.limit:.1e} (m, rad) remains at any step" if stays else ""

    def _share_after_projection(self) -> float:
        """Return the size of the position error with projected steps, divided by that of the first run without projection.

        Return 1 if the engine does not offer projection, or if the run with projection fails.
        """
        if self.projected is None:
            return 1.0
        at = self.first.at.t[: self.steps.horizon]
        trajectory = self.run(self.projected, sample(self.first.step, at)).trajectory
        if trajectory is None:
            return 1.0
        reached = burst(self.projected, at, trajectory).at
        return split.size(reached.q - self.truth.at(reached.t).q) / self.whole

    def _find_stale_data(self) -> Explained | None:
        """Detect that an engine uses constraint data (Jacobian, bias) of an earlier state than the integrator's present state.

        The age of the data in steps is fitted to the errors of the reported accelerations, and then to those of the implied ones.
        With the latter, the error of an explicit Euler step is fitted too, unless the motion's order is too low. The fit must
        explain EXPLAINS of the squared error, and leave less than 1 / BETTER of the residual of a fit without old data.
        """
        last, finest, root = self.local[-1], self.sound[-1], np.sqrt(self.own.evaluator.mass)
        if last is None or self.adaptive:
            return None
        # accelerations implied by a correct step of explicit Euler have this error; a motion that has lost its order has others
        euler = [] if self._loses_order() else [last.euler]
        # error of accelerations (k, n), its relative size, and the known errors that are fitted too
        for error, relative, known in ((last.reported, last.relative_reported, []), (last.implied, last.relative_implied, euler)):
            if not relative > SEEN:
                continue
            _, residual_without = _fit(error, known, root)
            square = float(np.sum((error * root) ** 2))
            for x in constraint_explanations(self.own, finest.at, finest.before, self.start):
                if x.cause is not Cause.STALE or x.once:  # `once`: data of the start, which have no age in steps
                    continue
                age, residual_with = _fit(error, [*known, x.effect_of(1.0)], root)  # age in steps
                explains = residual_with * BETTER < residual_without and residual_with < (1 - EXPLAINS) * square
                if explains and OLD < age < OLDEST:
                    share = 1 - residual_with / square
                    sentence = f"{tell(x.template, age)}, which explains {format_share(share)} of the error of accelerations"
                    return Explained(Cause.STALE, x.what, age, share, sentence)
        return None

    def numbers(self) -> Numbers:
        """Return the measured figures; those of a run without usable checkpoints are NaN."""
        worst = int(np.abs(self.position_errors).max(axis=1).argmax())  # index of the checkpoint with the largest error
        return Numbers(
            **vars(self.closure),
            error=self.error,
            at=float(self.first.at.t[worst]),
            errors=self.errors,
            bar=self.bar,
            steps=tuple(b.step for b in self.bursts),
            tolerances=tuple(b.tolerance for b in self.bursts),
            order=self.steps.order,
            horizon=float(self.first.at.t[self.steps.horizon - 1]),
            limit_error=self.limit,
            step_error=self.by_step,
            told=tuple(np.nan if x is None else x.relative_reported for x in self.local),
            moved=tuple(np.nan if x is None else x.relative_implied for x in self.local),
            step_exponent=self.step_exponent(),
            shift=self.map.shift,
            rate=self.map.rate,
            jump_time=self.jump_time,
        )

    def parts(self, cause: Cause) -> dict[Part, float]:
        """Return the size of each part of the error [m, rad], given the cause that was found.

        The error that decreases with the step is drift as far as it violates the constraints, and otherwise the integrator's. The
        error that remains at step zero belongs to soft constraints if they are the cause, and otherwise to the model. The sampling
        of the output, round-off and the causes UNDIVIDED explain the whole error.
        """
        by_part = dict.fromkeys(Part, 0.0)
        if cause.part in (Part.SAMPLING, Part.ROUND_OFF) or cause in UNDIVIDED:
            left = self.map.left if cause.part is Part.SAMPLING else 0.0  # share of the error that the fitted map of time leaves
            return by_part | {cause.part or Part.MODEL: self.whole * (1 - left), Part.INTEGRATOR: self.whole * left}
        owner = Part.SOFTNESS if cause is Cause.SOFTNESS else Part.MODEL  # of the error at step zero
        # gaps that do not decrease with the step (`closure_stays`) are not drift
        drift = 0.0 if self.closure.closure_stays else min(self.closure.closure_share * self.whole, self.by_step)
        # drift leads off the constraints and the rest of the error along them: they are about perpendicular, and their squares add
        by_part |= {Part.DRIFT: drift, Part.INTEGRATOR: float(np.sqrt(max(0.0, self.by_step**2 - drift**2)))}
        if cause is Cause.SOFTNESS and self.by_step > self.limit:
            by_part |= {Part.SOFTNESS: self.by_step, Part.INTEGRATOR: 0.0, Part.DRIFT: 0.0}
        # by_step / 4 stands for the error of Richardson's extrapolation
        resolved = max(BARS * self.bar, self.by_step / 4)
        if cause not in (Cause.NONE, Cause.INTEGRATOR, Cause.DRIFT) or self.limit > resolved:
            by_part[owner] += self.limit
        return by_part


def _join_states(early: States, late: States) -> States:
    """Return the states `early` followed by the states `late`."""
    return States(*(np.concatenate([getattr(early, x), getattr(late, x)]) for x in "tqv"))


def _fit(y: Array, columns: list[Array], root: Array) -> tuple[float, float]:
    """Fit a linear combination of columns, each (k, n), to y (k, n) by least squares with the square roots `root` (n,) of weights.

    Return the coefficient of the last column (0 without columns), and the squared weighted residual. The columns before the last
    are known errors.
    """
    b = (y * root).ravel()
    if not columns:
        return 0.0, float(b @ b)
    A = np.array([(c * root).ravel() for c in columns]).T
    coefficients = np.linalg.lstsq(A, b, rcond=None)[0]
    residual = b - A @ coefficients
    return float(coefficients[-1]), float(residual @ residual)


def format_share(share: float) -> str:
    """Return a share as a percentage: in whole percent below 99.5 %, with four digits above, and as "all" from 99.995 % on."""
    if share < 0.995:
        return f"{share:.0%}"
    return f"{100 * share:.4g} %" if share < 0.99995 else "all"
