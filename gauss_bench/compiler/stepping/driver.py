"""Continuation of trajectories that a guard has stopped, because a pivot of the program's elimination is too small at a state.

A program is the code generated for one choice of pivots. Another program, with other pivots, continues from this state if one is
usable. If no program is, a single step is taken by dense linear algebra, which decides the rank of the constraint rows at each
state of the step.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from gauss_bench.compiler.stepping.programs import Batch, Outcome, Programs, Stop, integrate
from gauss_bench.integrate.legs import legs
from gauss_bench.terms import Array

# time [s] -> the number arguments (k, n_p) of the code at this time, for k trajectories
Numbers = Callable[[float], Array]

STRIDE = 1e-4  # size of a step by dense linear algebra under step size control, relative to the duration
INTEGRATORS = ("rk4", "semi_implicit_euler", "dop853_fixed", "gauss_legendre")


class ByRank(Protocol):
    """Steps by dense linear algebra, which determines the rank of the constraint rows, with the parameters of the linkage file."""

    def step(self, integrator: str, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]:
        """Return q, v (n,) after one step of h [s] from the time t."""
        ...

    def project(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q, v (n,) projected onto the constraints at the time t."""
        ...


@dataclass
class Tally:
    """Counts of exceptional events in a rollout.

    Attributes:
        switches: number of changes to another program.
        fallbacks: number of steps by dense linear algebra.
        lost: number of trajectories that could not be continued to their end.
    """

    switches: int = 0
    fallbacks: int = 0
    lost: int = 0


class Driver:
    """Computes trajectories to their end, and changes to another program at a state where a pivot of the present one is too small.

    A trajectory is lost if it cannot be continued; its later states are NaN.

    Attributes:
        by_rank: takes steps by dense linear algebra at states where no generated program is usable.
        projected: whether samples must lie on the constraints.
        open_count: number of open parameters: numbers of the linkage that each call may change. The number arguments of the code
            are first the open parameters, then functions of time, which `by_rank` evaluates by itself.
    """

    def __init__(self, programs: Programs, by_rank: ByRank, projected: bool, open_count: int):
        """Prepare to compute trajectories with the programs of a mechanism; the class explains the other arguments."""
        self.programs, self.by_rank, self.projected, self.open_count = programs, by_rank, projected, open_count
        self.tally = Tally()

    def has_nominal_values(self, p: Array) -> bool:
        """Tell whether the open parameters have the values of the linkage file; only then can `by_rank` take steps."""
        return bool((p[..., : self.open_count] == self.programs.values[: self.open_count]).all())

    @property
    def drifts(self) -> bool:
        """True if programs leave out redundant constraint rows, and no projection removes the error of these rows."""
        return bool(self.programs.dropped) and not self.projected

    def best(self, t: float, state: Array, p: Array, without: set[int]) -> int | None:
        """Return the index of the program with the largest margin at a state (2n,), or None if no program is usable there.

        The margin of a program is the smallest ratio of one of its pivots to the pivot's threshold. A program is usable if its
        margin is at least 1. If none is, further programs are generated. Programs in `without` are not considered.
        """
        # if programs leave out redundant rows, a change of the program needs a projection by dense linear algebra (see
        # `_switch`), which is possible only with the parameter values of the linkage file
        if not np.isfinite(state).all() or (self.drifts and not self.has_nominal_values(p)):
            return None
        while True:
            margins = {k: self.programs.margin(k, t, state, p) for k in range(len(self.programs.codes)) if k not in without}
            usable = [k for k, margin in margins.items() if margin >= 1.0]
            if usable:
                return max(usable, key=lambda k: margins[k])
            if not self.programs.generate_next():
                return None

    def _switch(self, t: float, state: Array, p: Array, without: set[int]) -> tuple[int, Array] | None:
        """Return the index of a usable program that is not in `without`, and the state (2n,) from which it continues.

        Return None if no program is usable. If the old program left out redundant rows and did not project, the errors of the
        omitted rows are about the errors of the kept rows divided by the smallest pivot of the old program. The state is therefore
        first projected onto all constraints, by dense linear algebra, which decides the rank.
        """
        k, n = self.best(t, state, p, without), self.programs.n
        if k is None:
            return None
        self.tally.switches += 1
        return k, np.concatenate(self.by_rank.project(t, state[:n], state[n:])) if self.drifts else state

    def _step_by_rank(self, integrator: str, t: float, state: Array, p: Array, h: float) -> Array:
        """Return the state (2n,) after one step by dense linear algebra, for a state at which no program is usable.

        If h = 0, no step is taken: the state is projected onto the constraints if samples must lie on them, and returned unchanged
        if not. The result is NaN if the state overflows, or if the open parameters (the first entries of p) differ from the values
        in the linkage file.
        """
        self.tally.fallbacks += 1
        q, v = np.split(state, 2)
        if self.has_nominal_values(p) and np.isfinite(state).all():
            if not h:
                return np.concatenate(self.by_rank.project(t, q, v)) if self.projected else state
            try:
                with np.errstate(all="ignore"):
                    return np.concatenate(self.by_rank.step(integrator, t, q, v, h))
            except np.linalg.LinAlgError:  # the state has overflowed, and is lost
                pass
        return np.full_like(state, np.nan)

    def advance(self, batch: Batch, integrator: str, threads: int = 1) -> Outcome:
        """Compute all trajectories of a batch to their end."""
        return self.resume(batch, self.programs.runner(0, integrator).run(batch, threads), integrator)

    def resume(self, batch: Batch, outcome: Outcome, integrator: str) -> Outcome:
        """Continue the trajectories that stopped early to their end, one by one, and store their states in the outcome."""
        for row in np.flatnonzero(~outcome.complete).tolist():
            done = int(outcome.done[row])  # number of steps
            samples = self._continue(batch, integrator, outcome.states[row].copy(), batch.parameters[row], done)
            for slot, sample in enumerate(samples, count_before(done, batch.every)):
                outcome.samples[row, slot:] = sample  # also the later slots, which stay NaN if the trajectory is lost
            outcome.states[row] = outcome.samples[row, -1]
            outcome.complete[row] = np.isfinite(outcome.states[row]).all()
            self.tally.lost += not outcome.complete[row]
        return outcome

    def _continue(self, batch: Batch, integrator: str, state: Array, p: Array, done: int) -> Iterator[Array]:
        """Yield the missing samples (2n,) of a trajectory that a guard of the first program stopped after `done` steps.

        `state` (2n,) is the state after these steps. If the trajectory cannot be continued to its end, the last sample that is
        yielded is NaN.
        """
        n = self.programs.n
        used, failed = 0, {0}  # index of the program in use, and those that have failed at the present state
        stopped = True  # whether the program in use has stopped at the present state
        for slot in range(count_before(done, batch.every), batch.slots):
            goal, reached = min((slot + 1) * batch.every, batch.n), False  # step of the next sample, and whether it is reached
            while not reached:
                t = batch.t0 + done * batch.h
                switched = self._switch(t, state, p, failed) if stopped else (used, state)
                if switched is None:
                    # no program is usable here: take one step by dense linear algebra, after which all programs may be tried again
                    reached = done == goal  # the state of the sample itself is only projected
                    state = self._step_by_rank(integrator, t, state, p, 0.0 if reached else batch.h)
                    if not np.isfinite(state).all():
                        yield np.full_like(state, np.nan)
                        return
                    done += 0 if reached else 1
                    failed, stopped = set(), False
                    continue
                used, state = switched
                end = self.programs.runner(used, integrator).run_one(state[:n], state[n:], p, t, batch.h, goal - done)
                stopped = isinstance(end, Stop)
                if isinstance(end, Stop):
                    state, done = end.state, done + end.done
                    # if steps were taken, the state is new, and only this program has failed there
                    failed = {used} if end.done else failed | {used}
                else:
                    state, done, reached = end, goal, True
            yield state

    def integrate(self, state: Array, p: Array, times: Array, tolerances: tuple[float, float]) -> tuple[Array, int, int]:
        """Integrate one trajectory from times[0] with step size control and (relative, absolute) `tolerances`.

        Where a pivot is too small, another program continues, or one short step is taken by dense linear algebra.

        Returns:
            The states (k, 2n) at the times, NaN after the trajectory cannot be continued; the number of accepted steps; the number
            of attempted steps.
        """
        samples, accepted, attempted = np.full((len(times), len(state)), np.nan), 0, 0
        stored, t = 0, float(times[0])  # number of samples so far, and time of the state
        used, failed = 0, set[int]()  # index of the program in use, and those that have failed at the present state
        while True:
            extra = int(stored > 0)  # 1 after a stop: the state is then between samples, and is not stored
            ahead = np.append(t, times[stored:]) if extra else times
            course = integrate(self.programs.adaptive(used), state, p, ahead, tolerances)
            new = course.samples[extra:]
            samples[stored : stored + len(new)], stored = new, stored + len(new)
            accepted, attempted = accepted + course.taken, attempted + course.tried
            if stored == len(times):
                return samples, accepted, attempted
            # the program stopped early, at course.state; if it took steps, only this program has failed there
            failed = {used} if course.taken else failed | {used}
            state, t = course.state, course.t
            switched = self._switch(t, state, p, failed)
            if switched is not None:
                used, state = switched
                continue
            # no program is usable here: take a short step by dense linear algebra, after which all programs may be tried again
            h = min(float(times[stored]) - t, STRIDE * float(times[-1] - times[0]))
            state, t, failed = self._step_by_rank("dop853_fixed", t, state, p, h), t + h, set()
            if np.isfinite(state).all() and t >= times[stored]:
                samples[stored], stored = state, stored + 1
            if stored == len(times) or not np.isfinite(state).all():
                self.tally.lost += stored < len(times)
                return samples, accepted, attempted

    def advance_over(self, batch: Batch, numbers: Numbers, kinks: Sequence[float], integrator: str, threads: int) -> Outcome:
        """Compute all trajectories to their end as `advance` does, with number arguments that change at the times `kinks` [s].

        At the times `kinks`, forces or their derivatives jump. The code's number arguments at the middle of a leg,
        `numbers(leg.middle)`, are used for the whole leg (`integrate/legs.py`), a run of equal steps without a kink inside.
        """
        samples = np.full((len(batch.states), batch.slots, batch.states.shape[1]), np.nan)
        states = batch.states.copy()
        for leg in legs(batch.t0, batch.h, batch.n, batch.every, kinks):
            going = np.flatnonzero(np.isfinite(states).all(axis=1))  # trajectories that are not lost
            if not len(going):
                break
            on_leg = Batch(states[going], numbers(leg.middle)[going], leg.t, leg.h, leg.n, leg.every)
            outcome = self.advance(on_leg, integrator, threads)
            states[going] = outcome.samples[:, -1]
            begin, end = leg.slots
            # the last sample of `outcome` is the end of the leg, and is left out if the leg ends between samples of the batch
            samples[going, begin:end] = outcome.samples[:, : end - begin]
        complete = np.asarray(np.isfinite(states).all(axis=1))
        return Outcome(states, samples, np.where(complete, batch.n, 0), complete)

    def integrate_over(
        self, state: Array, numbers: Numbers, times: Array, tolerances: tuple[float, float], kinks: Sequence[float]
    ) -> tuple[Array, int, int]:
        """Integrate one trajectory as `integrate` does, but restart at each kink [s] of a force, where number arguments change."""
        begin, end = float(times[0]), float(times[-1])
        samples, accepted, attempted = np.full((len(times), len(state)), np.nan), 0, 0
        for a, b in pairwise([begin, *(x for x in kinks if begin < x < end), end]):
            inside = np.flatnonzero((times > a) & (times <= b))
            # the number arguments of the one trajectory are row 0
            states, taken, tried = self.integrate(state, numbers((a + b) / 2)[0], np.unique([a, *times[inside], b]), tolerances)
            accepted, attempted = accepted + taken, attempted + tried
            samples[inside], state = states[1 : 1 + len(inside)], states[-1]
            if a == begin:
                samples[0] = states[0]
            if not np.isfinite(state).all():
                break
        return samples, accepted, attempted


def count_before(step: int, every: int) -> int:
    """Return the number of positive multiples of `every` that are smaller than `step`."""
    return max(0, -(-step // every) - 1)
