"""What is wrong with an engine on a linkage: its error against the reference, split, with a verdict in words.

The order of questions is that of what spoils the answers to the next: are the samples in order and do they move; did the state
jump; are they those of other times; then what smaller steps leave of the error, what of it leaves the constraints, and which
explanation predicts the accelerations that are off. A cause is named only where it accounts for most of what is seen.

**"No dominant cause"** is said where there is nothing to explain: the largest error of a position is below SMALL, or below three
times the error bar of the reference, and the accelerations that the engine tells are not off by more than OFF_TOLD at its own
states. What little error there is is split all the same.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.diagnosis import samples, split
from gauss_bench.diagnosis.causes import Cause, Part
from gauss_bench.diagnosis.dimensions import misplace
from gauss_bench.diagnosis.explanations import (
    Explained,
    Explanation,
    candidates,
    explain,
    of_all,
    of_constraints,
    of_numbers_of_constraints,
    of_parameters,
)
from gauss_bench.diagnosis.motion import OwnMotion, Truth
from gauss_bench.diagnosis.observations import FEWEST, Burst, Observed, Runner, burst, observe, sample
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.one_run import sampling_at
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, States, Status

SMALL = 1e-6  # [m, rad] of errors: a micrometre, which no drawing asks for
OFF_VELOCITIES = 0.1  # relative: a step of a tenth of a period leaves less
OFF_TOLD = 1e-3  # relative, median: a tenth of what the judge takes for another linkage
EXPLAINS = 0.9  # of the squared difference of accelerations that a named cause must account for
AS_GOOD = 3.0  # explanations that leave no more than this times what the best leaves cannot be told apart from it
MOST = 0.5  # of an error: what is more is dominant
SEEN = 1e-7  # relative: what accelerations are off by that is no rounding, though a thousand times what matters
OPEN = 0.3  # of the linkage's size: loops that are open by more are another linkage, whose accelerations explain nothing
NOISE = 1e-9  # relative, of accelerations at the same states: above it an engine's equations are others
SHORTER = 4.0  # times, that a run which fails before its first checkpoint is asked for again
NAMED = 8  # causes in a sentence; all of them are in `candidates`
OLD = 0.1  # steps: constraint data that are older than this by more than the integrator needs
NOTHING, SOUND = 0.02, 1e-5  # of an error that a map of time leaves, and relative, of accelerations: next to nothing
ORDERS = {"rk4": 4.0, "dop853_fixed": 8.0}  # of integrators by their names
LEAST_LATE, MOST_LATE = 0.2, 20.0  # steps, of a shift told by the first step
MEANT, MENDS = 0.2, 1 / 3  # of an error: what must leave the constraints, and what projection may leave, to call it drift
BETTER = 10.0  # times less that a second cause must leave of squares, to be believed beside the first


@dataclass(frozen=True)
class Numbers:
    """What was measured; m and rad where nothing else is said, NaN where it could not be told.

    Attributes:
        error: largest of a position, of the run that was asked for; at: [s] when; errors: of every run.
        bar: of the reference.
        steps: [s] of the runs; where the integrator chooses its own, their tolerances after the first are in `tolerances`.
        order: at which the motion converges when the step is halved.
        horizon: [s] until when errors are small enough to be split.
        limit_error, step_error: root mean squares of what is left without a step, and of what the step adds.
        closure: largest gap of every run; closure_early, closure_late: of the first run; closure_joint: where.
        closure_share: of the error, by how much it leaves the constraints.
        held: correlation of the gaps with the forces in them; compliance: gap over force [m/N].
        told: relative error of the accelerations told, median, of every run; moved: of those by which velocities change.
        step_exponent: k where what a step is off by is proportional to h^k: 0 for rounding, 1 for wrong accelerations, p + 1 for
            an integrator of order p.
        shift: [s] and rate: of a time map; jump_time: [s] of a jump.
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
    closure: tuple[float, ...]
    closure_early: float
    closure_late: float
    closure_joint: str
    closure_share: float
    held: float
    compliance: float
    told: tuple[float, ...]
    moved: tuple[float, ...]
    step_exponent: float
    shift: float = np.nan
    rate: float = np.nan
    jump_time: float = np.nan


@dataclass(frozen=True)
class Verdict:
    """What is said.

    Attributes:
        cause: that dominates; sentence: in words.
        parts: how much of the error [m, rad] each part accounts for.
        numbers: behind it, None where there was no run to look at.
        explanations: of accelerations that are off, the best first.
        runs: how each run ended: status and message.
        candidates: the explanations that reproduce the accelerations within their noise; none of them can be told from another.
    """

    cause: Cause
    sentence: str
    parts: dict[Part, float]
    numbers: Numbers | None
    explanations: tuple[Explained, ...]
    runs: tuple[tuple[Status, str], ...]
    candidates: tuple[Explained, ...] = ()


def diagnose_runs(
    run: Runner,
    mechanism: Mechanism,
    reference: Reference,
    choices: Sequence[Choice],
    until: float,
    adaptive: bool = False,
    projected: Choice | None = None,
    told: Callable[[str], object] = id,
) -> Verdict:
    """The verdict on an engine that `run` runs by each of the choices.

    Args:
        run: (choice, sampling) -> Run.
        mechanism: the linkage as it should be.
        reference: of it, from 0 to `until` [s].
        choices: the one that is asked for, and finer ones.
        until: [s].
        adaptive: whether the integrator chooses its own steps, so that the choices differ by tolerance.
        projected: the first choice with its steps projected, where the engine offers that.
        told: is told how far things are.

    Raises:
        ChoiceError: too few steps.
    """
    own = OwnMotion(mechanism)
    seen = observe(run, choices, until, told)
    ended = tuple((r.status, r.message) for r in seen.runs)
    while not seen.bursts and ended[0][0] is Status.NAN and until / SHORTER >= 2 * FEWEST * choices[0].step:
        until /= SHORTER
        seen = observe(run, choices, until, told)
    if not seen.bursts:
        status, message = ended[0]
        return Verdict(Cause.UNKNOWN, f"there is no run to look at: {status}: {message}", {}, None, (), ended)
    told("the differences")
    with np.errstate(all="ignore"):
        case = Case(run, own, Truth(own, reference), seen, choices, adaptive, projected)
        cause, sentence, explanations = case.verdict()
        numbers = case.numbers()
        failed = next((f"{status}: {message}" for status, message in ended if status is not Status.OK), "")
        sentence = f"{sentence} (a run ended early: {failed})" if failed else sentence
        alike = tuple(candidates(explanations, case.noise))
        return Verdict(cause, sentence, case.parts(cause, numbers), numbers, tuple(explanations), ended, alike)


class Case:
    """One engine on one linkage, with everything that was measured."""

    def __init__(
        self,
        run: Runner,
        own: OwnMotion,
        truth: Truth,
        seen: Observed,
        choices: Sequence[Choice],
        adaptive: bool,
        projected: Choice | None,
    ):
        self.run, self.own, self.truth, self.choices, self.adaptive, self.projected = run, own, truth, choices, adaptive, projected
        most = OPEN * own.mechanism.size
        self.first: Burst = seen.bursts[0]
        self.true, self.off = split.errors_of(truth, self.first)
        self.errors = tuple(_largest(b.at.q - truth.at(b.at.t).q) for b in seen.bursts)
        self.bar = float(truth.bar(self.first.at.t).max())
        shortest = min(len(b.at) for b in seen.bursts)
        self.bursts = tuple(b[np.arange(len(b.at)) < shortest] for b in seen.bursts)
        self.steps = split.by_steps(self.bursts, self.true[slice(0, shortest)], adaptive)
        h = self.steps.horizon
        self.closure = split.closure_of(own, self.bursts, self.off[:h])
        chosen = [split.usable(own, b, most) for b in self.bursts]
        self.sound = tuple(b[c] for b, c in zip(self.bursts, chosen, strict=True))
        self.local = tuple(split.local(own, b) if len(b.at) else None for b in self.sound)
        self.noise = self._noise()
        self.map: samples.TimeMap | None = None
        self.jumped: samples.Jump | None = None

    @property
    def error(self) -> float:
        return self.errors[0]

    def verdict(self) -> tuple[Cause, str, list[Explained]]:
        """Cause, sentence and the explanations that were tried."""
        matters = not self.error <= max(SMALL, 3 * self.bar)
        if not matters:
            return self._small()
        for asked in (self._turns, self._order, self._still, self._jump, self._velocities):
            if answer := asked():
                return (*answer, [])
        exact = self._reproduced()
        if exact and (self._rounds() or not self._step_dominates()):
            return exact
        for asked in (self._length, self._other_times):
            if answer := asked():
                return (*answer, [])
        cause, sentence, explanations = self._by_steps()
        return cause, sentence, explanations or (exact[2] if exact else [])

    def _noise(self) -> float:
        """The relative difference that sound accelerations may have: ten times that of two ways of the suite to solve for them."""
        states = self.sound[-1]
        if not len(states.at) or self.own.evaluator.friction:
            return NOISE
        a, other = self.own.accelerations(states.at), self.own.absolute.acceleration(states.at.t, states.at.q, states.at.v)
        apart = float(np.linalg.norm(a - other) / max(float(np.linalg.norm(a)), 1e-300))
        return max(NOISE, 10 * apart) if np.isfinite(apart) else NOISE

    def _reproduced(self) -> tuple[Cause, str, list[Explained]] | None:
        """The causes each of which, planted by its own amount, gives the very accelerations that the engine tells."""
        last = self.local[-1]
        if last is None or not last.relative_told > SEEN:
            return None
        explanations = self._explained(last.told, self.sound[-1])
        alike = candidates(explanations, self.noise)
        if not alike:
            return None
        named = ", or ".join(x.sentence for x in alike[:NAMED])
        more = f", or one of {len(alike) - NAMED} more" if len(alike) > NAMED else ""
        size = f"accelerations are off by {last.relative_told:.1e} at the same states"
        each = "each of these" if len(alike) > 1 else "this"
        return alike[0].cause, f"{named}{more}: {size}, and {each} reproduces them to {self.noise:.0e}", explanations

    def _small(self) -> tuple[Cause, str, list[Explained]]:
        limit = max(SMALL, 3 * self.bar)
        said = f"no dominant cause: the largest error, {self.error:.1e} (m, rad), is below {limit:.0e}"
        if other := self._velocities():
            return (*other, [])
        if exact := self._reproduced():
            return exact
        last = self.local[-1]
        if last is None or not last.relative_told > OFF_TOLD:
            return Cause.NONE, said + self._what_there_is(), []
        explanations = self._explained(last.told, self.sound[-1])
        wrong = f"the motion is right to {self.error:.1e} (m, rad), but the accelerations told are off by {last.relative_told:.1e}"
        if explanations and explanations[0].share >= EXPLAINS:
            return explanations[0].cause, f"{wrong}: {explanations[0].sentence}", explanations
        if self.closure.held > 0.8:
            return Cause.SOFTNESS, f"{wrong}, as forces are that yield in soft constraints", explanations
        return Cause.ACCELERATIONS, f"{wrong}, which no parameter explains", explanations

    def _what_there_is(self) -> str:
        return f"; it falls with the step by order {self.steps.order:.1f}" if self.steps.converges else ""

    def _turns(self) -> tuple[Cause, str] | None:
        """Angles that an engine has brought back into one turn."""
        turns = samples.whole_turns(self.off)
        if not turns.any():
            return None
        k = int(turns.any(axis=1).argmax())
        link = int(np.abs(turns[k]).argmax())
        by, name = turns[k, link], self.own.mechanism.links[link].name
        said = f"angles are told in other turns than the motion's: {name} by {by:+.0f} from t = {self.first.at.t[k]:.3g} s on"
        return Cause.WRAPPED, f"{said}; but for whole turns they are right"

    def _order(self) -> tuple[Cause, str] | None:
        early = slice(0, max(3, len(self.first.at) // 3))
        start = self.first.start
        told = States(*(np.concatenate(x) for x in zip(_arrays(start), _arrays(self.first.at[early]), strict=True)))
        true = self.truth.at(told.t)
        order = samples.order(self.own.mechanism, true, told)
        return None if order is None else (Cause.ORDER, f"{order.sentence}; in order, {order.left:.1%} of the error is left")

    def _velocities(self) -> tuple[Cause, str] | None:
        """Velocities that are not those by which the positions told move from step to step."""
        b = self.bursts[-1]
        moved = (b.after.q - b.before.q) / (b.after.t - b.before.t)[:, None]
        off, factor, left = samples.other_velocities(moved, b.at.v)
        if not (off > OFF_VELOCITIES and _largest(b.at.v - moved) * b.at.t[-1] > SMALL):
            return None
        what = f"they are {factor:.4g} times those" if left <= samples.LEFT else "no factor explains it"
        return Cause.VELOCITIES, f"the velocities told are off by {off:.1e} of those by which the positions told move: {what}"

    def _still(self) -> tuple[Cause, str] | None:
        if samples.stands_still(self.true, self.first.at):
            last = self.local[-1]
            if self.own.mechanism.drivers and last is not None:  # an engine may stand still because it knows of no acceleration
                explanations = self._explained(last.told, self.sound[-1])
                if explanations and explanations[0].share >= EXPLAINS and explanations[0].cause is Cause.SECOND_RATE:
                    return Cause.SECOND_RATE, f"{explanations[0].sentence}, so that the linkage stands still"
            return Cause.STATIONARY, "the samples stand still while the linkage moves"
        return None

    def _jump(self) -> tuple[Cause, str] | None:
        """Look again at every step of the one stretch between two checkpoints that could hold a jump."""
        start = States(*(np.concatenate(x) for x in zip(_arrays(self.first.start), _arrays(self.first.at), strict=True)))
        a = np.vstack([self.own.accelerations(self.first.start), self.first.a])
        k = samples.suspicious_window(start, a)
        if k is None or self.adaptive:
            return None
        h = self.first.step
        lower, upper = round(start.t[k] / h), round(start.t[k + 1] / h)
        run = self.run(self.choices[0], sampling_at(h, np.unique([0, *range(lower, upper + 1)]) * h))
        if run.trajectory is None:
            return None
        dense = States(run.trajectory.t, run.trajectory.q, run.trajectory.v)
        self.jumped = samples.jump(self.own, dense)
        if self.jumped is None:
            return None
        where = "back to its start" if self.jumped.to_start else "elsewhere"
        said = f"the state jumps {where} at t = {self.jumped.t:.6g} s, by {self.jumped.size:.2g} (m, rad) in one step"
        return Cause.RESET, f"{said}, as an engine does that resets itself after an error"

    def _length(self) -> tuple[Cause, str] | None:
        """A pin elsewhere than in the file: gaps that turn with its link, whatever the step."""
        if len(self.bursts) < 2 or not self.closure.opened[-1] > SMALL / 10:
            return None
        pin = misplace(self.own, self.bursts[0].at, self.bursts[-1].at)
        if pin is None or self.closure.held**2 >= pin.share:
            return None
        gap = f"loops stay open by {self.closure.opened[-1]:.1e} (m, rad) by the file's dimensions, whatever the step"
        return Cause.LENGTH, f"{pin.sentence}: {gap}; that explains {share_words(pin.share)} of it"

    def _other_times(self) -> tuple[Cause, str] | None:
        """A start that is another, or samples of other times: both with steps that are sound."""
        h = self.first.step
        for stretch in (False, True):
            time_map = samples.time_map(self.truth, self.first.at, stretch)
            if time_map is None or not (self._as_steps_go(time_map, stretch) and self._steps_are_sound(time_map)):
                continue
            left = f"so read, {time_map.left:.1%} of the error is left"
            if not stretch and abs(time_map.shift) > 1e-3 * h:
                self.map, when = time_map, "later" if time_map.shift > 0 else "earlier"
                said = f"the samples are those of {abs(time_map.shift):.3g} s {when} ({abs(time_map.shift) / h:.3g} steps)"
                return Cause.SHIFT, f"{said}; {left}"
            if stretch and abs(time_map.rate - 1) > 1e-6:
                self.map = time_map
                return Cause.STRETCH, f"the samples are those of {time_map.rate:.6g} times their time; {left}"
        if by := self._late_from_the_first_step():
            said = f"the first step leads {abs(by):.3g} s too {'far' if by > 0 else 'short'} and no other does"
            return Cause.SHIFT, f"{said}: later samples are those of {abs(by) / h:.3g} steps {'later' if by > 0 else 'earlier'}"
        start = self.first.start
        off = max(_largest(start.q - self.own.mechanism.q0), _largest((start.v - self.own.mechanism.v0) * self.first.at.t[-1]))
        if off > MOST * self.error / 10 and off > SMALL:
            return Cause.START, f"the run begins at another state, {off:.1e} (m, rad, or as much a second times the run) off"
        return None

    def _as_steps_go(self, time_map: samples.TimeMap, stretch: bool) -> bool:
        """Tell whether a finer run is off in time as much as a map says, or by as many steps; an integrator is not."""
        finest = self.bursts[-1]
        if self.adaptive or finest.step == self.first.step:
            return True
        again = samples.time_map(self.truth, finest.at, stretch)
        if again is None:
            return False
        if stretch:
            return abs(again.rate - 1) > abs(time_map.rate - 1) / 2
        return abs(again.shift) > 0.8 * abs(time_map.shift) * finest.step / self.first.step

    def _late_from_the_first_step(self) -> float:
        """The shift [s] of all samples but the start, told by the first step of every run; 0 where there is none.

        It shows where the integrator's error hides it from a map of time: a first step that leads too far, and no other.
        """
        shifts = []
        for b, x in zip(self.bursts, self.local, strict=True):
            if self.adaptive or x is None or not len(b.stepped):
                return 0.0
            expected = self.own.moved(b.start, np.array([b.step]))
            slope = np.concatenate([expected.v[0] * b.step, self.own.accelerations(expected)[0] * b.step**2])
            off = np.concatenate([b.stepped.q[0] - expected.q[0], (b.stepped.v[0] - expected.v[0]) * b.step])
            steps = float(off @ slope) / max(float(slope @ slope), 1e-300)
            left = float(np.linalg.norm(off - steps * slope)) / max(float(np.linalg.norm(off)), 1e-300)
            if not (LEAST_LATE < abs(steps) < MOST_LATE and left < MOST and x.relative_moved < abs(steps) / 5):
                return 0.0
            shifts.append(steps * b.step)
        same = abs(shifts[-1]) > 0.8 * abs(shifts[0]) * self.bursts[-1].step / self.bursts[0].step
        return shifts[0] if same else 0.0

    def _steps_are_sound(self, time_map: samples.TimeMap) -> bool:
        """Tell whether nothing speaks for wrong accelerations: they are the linkage's, and steps differ by the rate alone.

        Where time enters the linkage itself, other times are other accelerations; there the map must leave next to nothing.
        """
        last = self.local[-1]
        if time_map.left < NOTHING or last is None:
            return time_map.left < NOTHING
        by_rate = abs(time_map.rate - 1)
        return last.relative_told < SOUND and (last.relative_moved < SOUND or abs(last.relative_moved - by_rate) < by_rate / 2)

    def _by_steps(self) -> tuple[Cause, str, list[Explained]]:
        """Divide the rest without a step by what the step adds."""
        limit, by_step = split.size(self.steps.limit), split.size(self.steps.by_step)
        if self._rounds():
            said = "the error does not fall with the step, and a step is off by as much however short it is: round-off"
            return Cause.ROUND_OFF, f"{said} ({self._steps_in_words()})", []
        return self._of_step(by_step) if self._step_dominates() else self._without_step(limit)

    def _step_dominates(self) -> bool:
        """Tell whether the step adds more than smaller steps leave."""
        return split.size(self.steps.limit) <= split.size(self.steps.by_step) and (self.steps.converges or self.adaptive)

    def _steps_in_words(self) -> str:
        return ", ".join(f"{e:.1e} by {b.step:.3g} s" for e, b in zip(self.errors, self.bursts, strict=False))

    def exponent(self) -> float:
        """k of what a step is off by, h^k, of the two smallest steps."""
        if self.adaptive or len(self.local) < 2:
            return np.nan
        (one, other), steps = self.local[-2:], [b.step for b in self.sound[-2:]]
        if one is None or other is None:
            return np.nan
        sizes = split.size(one.moved) * steps[0], split.size(other.moved) * steps[1]
        return float(np.log(sizes[0] / sizes[1]) / np.log(steps[0] / steps[1])) if all(sizes) else np.nan

    def _rounds(self) -> bool:
        return bool(self.errors[-1] > self.error / 2 ** (len(self.errors) - 1) and self.exponent() < 0.5)

    def _without_step(self, limit: float) -> tuple[Cause, str, list[Explained]]:
        """An error that smaller steps leave: wrong accelerations, or loops that are not held."""
        last, states = self.local[-1], self.sound[-1]
        if last is None:
            return Cause.UNKNOWN, "the loops are wide open everywhere: there are no states to look at", []
        y = last.told if last.relative_told > 0.3 * last.relative_moved else last.moved
        explanations = self._explained(y, states)
        if explanations and explanations[0].share >= EXPLAINS:
            share = share_words(explanations[0].share)
            said = f"{explanations[0].sentence}; that explains {share} of its wrong accelerations{self._alike(explanations)}"
            return explanations[0].cause, said, explanations
        stays = f"{limit:.1e} (m, rad) of error stay however short the step is"
        if self.closure.stays and self.closure.opened[-1] > SMALL / 10:
            gap = f"the loops stay open by {self.closure.opened[-1]:.1e} (m, rad) at {self.closure.joint} however short the step is"
            yields = f", yielding {self.closure.compliance:.1e} m/N" if self.closure.held > 0.8 else ""
            return Cause.SOFTNESS, f"soft constraints: {gap}{yields}", explanations
        off = f"accelerations are off by {max(last.relative_told, last.relative_moved):.1e} at the same states"
        several = self._several(y, states)
        if several >= EXPLAINS:
            said = f"several parameters together explain {share_words(several)} of it, none alone"
            return Cause.SEVERAL, f"{stays}: {off}; {said}", explanations
        return Cause.ACCELERATIONS, f"{stays}: {off}, which no parameter of the linkage explains", explanations

    def _alike(self, explanations: list[Explained]) -> str:
        left = max(1 - explanations[0].share, 1e-12)
        others = [x.sentence for x in explanations[1:] if 1 - x.share <= AS_GOOD * left][:3]
        return f" (this motion does not tell it from: {'; '.join(others)})" if others else ""

    def _explained(self, y: Array, b: Burst) -> list[Explained]:
        count = len(b.at)
        start = States(np.zeros(count), *(np.tile(x, (count, 1)) for x in (self.own.mechanism.q0, self.own.mechanism.v0)))

        def some() -> Iterator[Explanation]:
            yield from of_parameters(self.own, b.at)
            yield from of_constraints(self.own, b.at, b.before, start)
            yield from of_all(self.own, b.at)
            yield from of_numbers_of_constraints(self.own, b.at)

        found = explain(y, self.own.evaluator.mass, some(), self.own.accelerations(b.at), self.noise)
        return found[: max(NAMED, len(candidates(found, self.noise)))]

    def _several(self, y: Array, b: Burst) -> float:
        """Share that all parameters explain together, each by its own amount."""
        root = np.sqrt(self.own.evaluator.mass)
        columns = [(x.effect(1e-3) * root).ravel() for x in of_parameters(self.own, b.at) if not x.once]
        A = np.array([x / np.linalg.norm(x) for x in columns if np.isfinite(x).all() and x.any()]).T
        target = (y * root).ravel()
        if not A.size or not target.any():
            return 0.0
        left = target - A @ np.linalg.lstsq(A, target, rcond=1e-8)[0]
        return 1.0 - float(left @ left) / float(target @ target)

    def _of_step(self, by_step: float) -> tuple[Cause, str, list[Explained]]:
        """An error that falls with the step: old constraint data, soft constraints tied to the step, drift, or the integrator."""
        if old := self._stale():
            return Cause.STALE, old.sentence, [old]
        c = self.closure
        falls = "falls with the tolerance" if self.adaptive else f"falls with the step by order {self.steps.order:.1f}"
        if (c.held > 0.8 and c.share > 0.02 and not c.grows) or self._yields():
            gap = f"the loops open by {c.opened[0]:.1e} (m, rad) at {c.joint}, following the force there ({c.compliance:.1e} m/N)"
            return Cause.SOFTNESS, f"soft constraints, which these settings tie to the step: {gap}; it {falls}", []
        mended = self._mended() if c.share > MEANT and c.grows else 1.0
        if mended < MENDS:
            gap = f"the loops open, by {c.early:.1e} early and {c.late:.1e} (m, rad) late"
            left = f"with steps projected {mended:.0%} of the error is left"
            return Cause.DRIFT, f"drift off the constraints: {gap}; {left}; it {falls}", []
        share = by_step / max(by_step, split.size(self.off[: self.steps.horizon]))
        said = f"the integrator: {share:.0%} of the error {falls}"
        return Cause.INTEGRATOR, f"{said}{self._beside()}", []

    def _lost_order(self) -> bool:
        """Tell whether the motion converges at a lower order than the integrator's name says."""
        return bool(self.steps.order < ORDERS.get(self.choices[0].integrator, np.nan) - 1)

    def _yields(self) -> bool:
        """Tell whether forces that yield, not the integrator, make the error: accelerations stay wrong, and the order is lower."""
        first, last = self.local[0], self.local[-1]
        if first is None or last is None or not self._lost_order():
            return False
        return last.relative_told > max(OFF_TOLD / 10, first.relative_told / 2) and self.closure.held > 0.5

    def _beside(self) -> str:
        """Name the fault beside the error of the step, which hides it: the end of a sentence, empty where nothing is."""
        last, limit = self.local[-1], split.size(self.steps.limit)
        if last is not None and last.relative_told > SOUND:
            explanations = self._explained(last.told, self.sound[-1])
            if explanations and explanations[0].share >= EXPLAINS:
                return f"; beside it, {explanations[0].sentence}"
        if limit > max(SMALL, split.size(self.steps.by_step) / 10):
            return f"; {limit:.1e} (m, rad) would stay however short the step is"
        return ""

    def _mended(self) -> float:
        """The share of the error left when the engine's steps are projected; 1 where it offers no projection."""
        if self.projected is None:
            return 1.0
        at = self.first.at.t[: self.steps.horizon]
        trajectory = self.run(self.projected, sample(self.first.step, at)).trajectory
        if trajectory is None:
            return 1.0
        b = burst(self.projected, at, trajectory)
        return split.size(b.at.q - self.truth.at(b.at.t).q) / split.size(self.off[: self.steps.horizon])

    def _stale(self) -> Explained | None:
        """Constraint data older than the integrator's own."""
        last, b = self.local[-1], self.sound[-1]
        if last is None or self.adaptive:
            return None
        count = len(b.at)
        start = States(np.zeros(count), *(np.tile(x, (count, 1)) for x in (self.own.mechanism.q0, self.own.mechanism.v0)))
        mass = self.own.evaluator.mass
        root = np.sqrt(mass)
        for y, moving in ((last.told, False), (last.moved, True)):
            if not (last.relative_moved if moving else last.relative_told) > SEEN:
                continue
            euler = [last.euler] if moving and not self._lost_order() else []
            alone = _rest_without(y, euler, root)
            for one in of_constraints(self.own, b.at, b.before, start):
                if one.cause is not Cause.STALE or one.once:
                    continue
                column = one.effect(1.0)
                amounts, both = _fit(y, [*euler, column], root)
                amount = float(amounts[-1])
                if both * BETTER < alone and OLD < amount < 5 and both < (1 - EXPLAINS) * float(np.sum((y * root) ** 2)):
                    share = 1 - both / float(np.sum((y * root) ** 2))
                    said = f"{one.sentence(amount)}, which explains {share_words(share)} of what accelerations are off by"
                    return Explained(Cause.STALE, one.what, amount, share, said)
        return None

    def numbers(self) -> Numbers:
        c, s = self.closure, self.steps
        worst = int(np.abs(self.off).max(axis=1).argmax())
        return Numbers(
            error=self.error,
            at=float(self.first.at.t[worst]),
            errors=self.errors,
            bar=self.bar,
            steps=tuple(b.step for b in self.bursts),
            tolerances=tuple(b.tolerance for b in self.bursts),
            order=s.order,
            horizon=float(self.first.at.t[s.horizon - 1]),
            limit_error=split.size(s.limit),
            step_error=split.size(s.by_step),
            closure=c.opened,
            closure_early=c.early,
            closure_late=c.late,
            closure_joint=c.joint,
            closure_share=c.share,
            held=c.held,
            compliance=c.compliance,
            told=tuple(np.nan if x is None else x.relative_told for x in self.local),
            moved=tuple(np.nan if x is None else x.relative_moved for x in self.local),
            step_exponent=self.exponent(),
            shift=np.nan if self.map is None else self.map.shift,
            rate=np.nan if self.map is None else self.map.rate,
            jump_time=np.nan if self.jumped is None else self.jumped.t,
        )

    def parts(self, cause: Cause, numbers: Numbers) -> dict[Part, float]:
        """The error within the horizon [m, rad], by parts.

        What the step adds is drift as far as it leaves the constraints, else the integrator's; what is left without a step belongs
        to the cause found, else to the model. Samples of other times, and round-off, are the whole error or none of it.
        """
        by_part = dict.fromkeys(Part, 0.0)
        whole = split.size(self.off[: self.steps.horizon])
        if cause.part in (Part.SAMPLING, Part.ROUND_OFF) or cause in (
            Cause.RESET,
            Cause.ORDER,
            Cause.START,
            Cause.STALE,
            Cause.LENGTH,
        ):
            part = cause.part or Part.MODEL
            left = self.map.left if self.map and cause.part is Part.SAMPLING else 0.0
            by_part[part], by_part[Part.INTEGRATOR] = whole * (1 - left), whole * left
            return by_part
        drift = min(self.closure.share * whole, numbers.step_error) if not self.closure.stays else 0.0
        by_part[Part.DRIFT] = drift
        by_part[Part.INTEGRATOR] = float(np.sqrt(max(0.0, numbers.step_error**2 - drift**2)))
        if cause is Cause.SOFTNESS and numbers.step_error > numbers.limit_error:
            by_part[Part.SOFTNESS], by_part[Part.INTEGRATOR], by_part[Part.DRIFT] = numbers.step_error, 0.0, 0.0
        rest = Part.SOFTNESS if cause is Cause.SOFTNESS else Part.MODEL
        told = max(3 * numbers.bar, numbers.step_error / 4)  # less than this is what Richardson's extrapolation leaves
        if cause not in (Cause.NONE, Cause.INTEGRATOR, Cause.DRIFT) or numbers.limit_error > told:
            by_part[rest] += numbers.limit_error
        return by_part


def _arrays(x: States) -> tuple[Array, Array, Array]:
    return x.t, x.q, x.v


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))


def _fit(y: Array, columns: list[Array], root: Array) -> tuple[Array, float]:
    """Amounts of columns (k, n) in y (k, n), and the squares that are left."""
    b = (y * root).ravel()
    if not columns:
        return np.zeros(0), float(b @ b)
    A = np.array([(c * root).ravel() for c in columns]).T
    amounts = np.linalg.lstsq(A, b, rcond=None)[0]
    left = b - A @ amounts
    return amounts, float(left @ left)


def _rest_without(y: Array, columns: list[Array], root: Array) -> float:
    return _fit(y, columns, root)[1]


def share_words(share: float) -> str:
    """A share in words that do not round to all."""
    return f"{share:.0%}" if share < 0.995 else f"{100 * share:.4g} %" if share < 0.99995 else "all"
