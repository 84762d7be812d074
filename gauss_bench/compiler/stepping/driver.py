"""Continuation of trajectories that a guard has stopped: by another program, or by single steps with a rank decision."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from gauss_bench.compiler.stepping.programs import Batch, Outcome, Programs, Stop, integrate
from gauss_bench.integrate.legs import legs
from gauss_bench.terms import Array

Numbers = Callable[[float], Array]  # time [s] -> all open numbers (k, n_p) there

STRIDE = 1e-4  # size of an adaptive step past a singular position, relative to the duration
INTEGRATORS = ("rk4", "semi_implicit_euler", "dop853_fixed", "gauss_legendre")


class ByRank(Protocol):
    """Single steps of a mechanism with the numbers of its file; the rank of its rows is determined at each step."""

    def step(self, integrator: str, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]: ...
    def project(self, t: float, q: Array, v: Array) -> tuple[Array, Array]: ...


@dataclass
class Tally:
    """Counts of exceptional events: changes of the program, steps by rank decision, lost trajectories."""

    switches: int = 0
    fallbacks: int = 0
    lost: int = 0


class Driver:
    """Steps trajectories to their end, and changes the program where a guard fails; a lost trajectory is NaN from there on.

    Attributes:
        by_rank: steps by rank decision, for states at which no program is usable.
        projected: whether samples must lie on the constraints.
        given: number of open numbers that a user may change. The further ones follow from time, and the rank decision knows them.
        tally: counts of the last rollout.
    """

    def __init__(self, programs: Programs, by_rank: ByRank, projected: bool, given: int):
        self.programs, self.by_rank, self.projected, self.given = programs, by_rank, projected, given
        self.tally = Tally()

    def nominal(self, p: Array) -> bool:
        """Tell whether open numbers p (..., n_p) have the values of the file: rank decisions are only possible for these."""
        return not self.given or bool((p[..., : self.given] == self.programs.values[: self.given]).all())

    @property
    def drifting(self) -> bool:
        """True if each program drops redundant rows of its own, and no projection removes the error of the dropped rows."""
        return bool(self.programs.dropped) and not self.projected

    def best(self, t: float, state: Array, p: Array, without: set[int]) -> int | None:
        """Return the index of the program with the largest margin at a state (2n,), or None if none is usable there.

        The programs with the indices in `without` are left out.
        """
        if not np.isfinite(state).all() or (self.drifting and not self.nominal(p)):
            return None
        while True:
            margins = {k: self.programs.margin(k, t, state, p) for k in range(len(self.programs)) if k not in without}
            usable = [k for k, margin in margins.items() if margin >= 1.0]
            if usable:
                return max(usable, key=lambda k: margins[k])
            if not self.programs.further():
                return None

    def _switch(self, t: float, state: Array, p: Array, without: set[int]) -> tuple[int, Array] | None:
        """Return the index of another program and the state (2n,) from which it continues, or None if no program is usable.

        Without projection the error of a dropped row has grown by the inverse of the smallest pivot. The state is therefore first
        projected onto the rows that the new program keeps, or by a rank decision if that fails.
        """
        k, n = self.best(t, state, p, without), self.programs.n
        if k is None:
            return None
        self.tally.switches += 1
        if not self.drifting:
            return k, state
        settled = self.programs.settled(k, t, state, p)
        return k, np.concatenate(self.by_rank.project(t, state[:n], state[n:])) if settled is None else settled

    def _step(self, integrator: str, t: float, state: Array, p: Array, h: float) -> Array:
        """Return the state (2n,) after one step by rank decision, or NaN if it is lost; with h = 0 the state is only projected."""
        self.tally.fallbacks += 1
        q, v = np.split(state, 2)
        if self.nominal(p) and np.isfinite(state).all():
            if not h:
                return np.concatenate(self.by_rank.project(t, q, v)) if self.projected else state
            try:
                with np.errstate(all="ignore"):
                    return np.concatenate(self.by_rank.step(integrator, t, q, v, h))
            except np.linalg.LinAlgError:  # the state has overflowed, and is lost
                pass
        return np.full_like(state, np.nan)

    def advance(self, batch: Batch, integrator: str, threads: int = 1) -> Outcome:
        """Step all trajectories of a batch to their end."""
        return self.resume(batch, self.programs.runner(0, integrator).run(batch, threads), integrator)

    def resume(self, batch: Batch, outcome: Outcome, integrator: str) -> Outcome:
        """Step the trajectories that stopped early to their end, one by one, and store them in the outcome."""
        for row in np.flatnonzero(~outcome.complete).tolist():
            at = int(outcome.done[row])
            samples = self._continue(batch, integrator, outcome.states[row].copy(), batch.parameters[row], at)
            for slot, sample in enumerate(samples, count_before(at, batch.every)):
                outcome.samples[row, slot:] = sample  # also the later slots, which stay NaN if the trajectory is lost
            outcome.states[row] = outcome.samples[row, -1]
            outcome.complete[row] = np.isfinite(outcome.states[row]).all()
            self.tally.lost += not outcome.complete[row]
        return outcome

    def _continue(self, batch: Batch, integrator: str, state: Array, p: Array, at: int) -> Iterator[Array]:
        """Yield the remaining samples (2n,) of a trajectory that the first program stopped at step `at`; NaN last if it is lost."""
        n = self.programs.n
        used, tried, stopped = 0, {0}, True  # index of the program in use; those that have failed here; whether it has stopped
        for slot in range(count_before(at, batch.every), batch.slots):
            goal, there = min((slot + 1) * batch.every, batch.n), False  # step of the next sample, and whether it is reached
            while not there:
                t = batch.t0 + at * batch.h
                found = self._switch(t, state, p, tried) if stopped else (used, state)
                if found is None:
                    # no program is usable here: take one step by rank decision, after which all programs may be tried again
                    there = at == goal  # the state of the sample itself is only projected
                    state = self._step(integrator, t, state, p, 0.0 if there else batch.h)
                    if not np.isfinite(state).all():
                        yield np.full_like(state, np.nan)
                        return
                    at, tried, stopped = at + (not there), set(), False
                    continue
                used, state = found
                end = self.programs.runner(used, integrator).run_one(state[:n], state[n:], p, t, batch.h, goal - at)
                stopped = isinstance(end, Stop)
                if isinstance(end, Stop):
                    # a program that took steps is excluded alone; one that took none is excluded with those tried before
                    state, at, tried = end.state, at + end.done, {used} if end.done else tried | {used}
                else:
                    state, at, there = end, goal, True
            yield state

    def integrate(self, state: Array, p: Array, times: Array, tolerances: tuple[float, float]) -> tuple[Array, int, int]:
        """Integrate one trajectory with step size control; return states (k, 2n) at times (k,), and counts of steps.

        The counts are those of accepted and of attempted steps.
        """
        samples, accepted, attempted = np.full((len(times), len(state)), np.nan), 0, 0
        stored, t, used, tried = 0, float(times[0]), 0, set[int]()
        while True:
            again = int(stored > 0)  # after a stop the course begins between samples, and its first state is not stored
            part = np.append(t, times[stored:]) if again else times
            course = integrate(self.programs.adaptive(used), state, p, part, tolerances)
            new = course.samples[again:]
            samples[stored : stored + len(new)], stored = new, stored + len(new)
            accepted, attempted = accepted + course.taken, attempted + course.tried
            if stored == len(times):
                return samples, accepted, attempted
            tried = {used} if course.taken else tried | {used}
            state, t = course.state, course.t
            found = self._switch(t, state, p, tried)
            if found is not None:
                used, state = found
                continue
            # no program is usable here: take a short step by rank decision, after which all programs may be tried again
            h = min(float(times[stored]) - t, STRIDE * float(times[-1] - times[0]))
            state, t, tried = self._step("dop853_fixed", t, state, p, h), t + h, set()
            if np.isfinite(state).all() and t >= times[stored]:
                samples[stored], stored = state, stored + 1
            if stored == len(times) or not np.isfinite(state).all():
                self.tally.lost += stored < len(times)
                return samples, accepted, attempted

    def advance_over(self, batch: Batch, numbers: Numbers, kinks: Sequence[float], integrator: str, threads: int) -> Outcome:
        """Step all trajectories to their end as `advance` does, with open numbers that change at the kinks of forces."""
        samples = np.full((len(batch.states), batch.slots, batch.states.shape[1]), np.nan)
        states = batch.states.copy()
        for leg in legs(batch.t0, batch.h, batch.n, batch.every, kinks):
            going = np.flatnonzero(np.isfinite(states).all(axis=1))
            if not len(going):
                break
            part = Batch(states[going], numbers(leg.middle)[going], leg.t, leg.h, leg.n, leg.every)
            outcome = self.advance(part, integrator, threads)
            states[going] = outcome.samples[:, -1]
            begin, end = leg.slots
            samples[going, begin:end] = outcome.samples[:, : end - begin]  # a leg that ends between samples has one more
        complete = np.asarray(np.isfinite(states).all(axis=1))
        return Outcome(states, samples, np.where(complete, batch.n, 0), complete)

    def integrate_over(
        self, state: Array, numbers: Numbers, times: Array, tolerances: tuple[float, float], kinks: Sequence[float]
    ) -> tuple[Array, int, int]:
        """Integrate one trajectory as `integrate` does, restarted at each kink with the open numbers of the next interval."""
        begin, end = float(times[0]), float(times[-1])
        samples, accepted, attempted = np.full((len(times), len(state)), np.nan), 0, 0
        for a, b in pairwise([begin, *(x for x in kinks if begin < x < end), end]):
            inside = np.flatnonzero((times > a) & (times <= b))
            part = np.unique([a, *times[inside], b])
            states, *counts = self.integrate(state, numbers((a + b) / 2)[0], part, tolerances)
            accepted, attempted = accepted + counts[0], attempted + counts[1]
            samples[inside], state = states[1 : 1 + len(inside)], states[-1]
            if a == begin:
                samples[0] = states[0]
            if not np.isfinite(state).all():
                break
        return samples, accepted, attempted


def count_before(step: int, every: int) -> int:
    """Return the number of positive multiples of `every` that are smaller than `step`."""
    return max(0, -(-step // every) - 1)
