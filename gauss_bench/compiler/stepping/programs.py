"""Execution of routines: as native code in groups of lanes on several threads, or as Python on arrays of numpy.

A program is usable only at states where the pivots of its elimination are far enough from zero. For a crank-slider, the crank angle
is a usable independent coordinate everywhere; the slider's position is not usable at the dead centres.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.machine.code import Code, Program
from gauss_bench.compiler.machine.native_code import Flags, Loaded, Target, in_lanes, out_of_lanes, share
from gauss_bench.compiler.machine.routine import Routine
from gauss_bench.compiler.stepping.rollout import acceleration, adaptive, bodies, plain_body, rollout
from gauss_bench.compiler.stepping.steps import reaches
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Batch:
    """Trajectories that are to be computed with the same steps.

    Attributes:
        states: (k, 2n) q and v at the start.
        parameters: (k, n_p) number arguments of the code: the numbers of the linkage that are not constants in the code.
        t0, h, n: time at the start [s], size [s] and number of the steps.
        every: number of steps between samples, at least 1.
    """

    states: Array
    parameters: Array
    t0: float
    h: float
    n: int
    every: int

    @property
    def slots(self) -> int:
        """Number of samples of each trajectory: one after each `every` steps and after the last step."""
        return max(1, -(-self.n // self.every))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of a batch of k trajectories.

    Attributes:
        states: (k, 2n) last states; of a trajectory that stopped early, the state before the failed step.
        samples: (k, slots, 2n); of a trajectory that stopped early, those after the failed step are NaN.
        done: (k,) number of steps that were taken.
        complete: (k,) whether all steps were taken.
    """

    states: Array
    samples: Array
    done: NDArray[np.integer[Any]]
    complete: Flags


class Stop(NamedTuple):
    """The early stop of one trajectory: its last valid state (2n,) and the number of accepted steps."""

    state: Array
    done: int


@dataclass(frozen=True, eq=False)
class Course:
    """The outcome of one trajectory with step size control.

    Attributes:
        samples: (k, 2n) states at the k times that were reached, projected under the stabilisation "projection".
        state: (2n,) last state, at the time t [s].
        taken, tried: numbers of accepted and of attempted steps.
    """

    samples: Array
    state: Array
    t: float
    taken: int
    tried: int


class Stepper:
    """Computes trajectories by a routine `rollout`, with one program and one integrator.

    The code of a step is valid only if no link rotates in the step by more than a limit, called its reach (`steps.Reach`). The
    first routine contains only the code with the smallest reach. The routine `further`, if there is one, also contains code for
    larger rotations per step, and takes longer to compile; it replaces the first one as soon as a link exceeds the limit, and all
    trajectories of the call start again. `further` is None once it is in use.
    """

    def __init__(self, loaded: Loaded, further: Loaded | None = None):
        """Begin with the routine `loaded`, which `further` may replace."""
        self.loaded, self.further = loaded, further
        self.native, self.compiled = loaded.target.backend == "llvm", [loaded]

    def extend(self) -> None:
        """Replace the routine by `further`, which has code for larger rotations per step; do nothing if `further` is None."""
        if self.further is not None:
            self.loaded, self.further = self.further, None
            self.compiled.append(self.loaded)  # times to compile are reported for the old routine too

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        """Compute each trajectory of a batch until it ends or a guard fails."""
        count = len(batch.states)
        lanes = self.loaded.lanes(count)
        # arguments of the routine, see `rollout.py`: states, number arguments, samples, and a report of three rows
        y, p = in_lanes(batch.states.copy(), lanes), in_lanes(batch.parameters, lanes)  # copied: `in_lanes` may return a view
        groups, rows = y.shape[:2]
        samples, report = np.full((groups, batch.slots * rows, lanes), np.nan), np.empty((groups, 3, lanes))
        call = self.loaded.call(lanes)

        def compute(low: int, high: int) -> None:
            """Compute the groups of trajectories with the indices low to high - 1."""
            arrays = self.loaded.as_arguments([y[low:high], p[low:high], samples[low:high], report[low:high]])
            call(*arrays, batch.h, batch.t0, batch.n, batch.every, batch.slots, high - low)

        share(compute, groups, threads)
        # of each trajectory: number of steps done; 1 if all were done; 1 if the only fault was that a link rotated too far
        done, complete, too_far = out_of_lanes(report, count).T
        if too_far.any() and self.further is not None:
            self.extend()
            return self.run(batch, threads)
        stored = out_of_lanes(samples.reshape(groups, batch.slots, rows, lanes), count)
        return Outcome(out_of_lanes(y, count), stored, done.astype(int), complete > 0)

    def run_one(self, q: Array, v: Array, parameters: Array, t0: float, h: float, n: int) -> Array | Stop:
        """Return the state (2n,) after n steps of one trajectory, or its early stop, with the least possible overhead."""
        if not self.native:
            outcome = self.run(Batch(np.concatenate([q, v], dtype=float)[None], parameters[None], t0, h, n, max(1, n)))
            return outcome.samples[0, -1] if outcome.complete[0] else Stop(outcome.states[0], int(outcome.done[0]))
        # memory for the arguments, which each thread allocates in its first call: state, number arguments, sample, report
        single = self.loaded.of_thread.single or self.loaded.single(2 * len(q), len(parameters), 2 * len(q), 3)
        (y, p, sample, report), numbers, counts = single.arrays, single.numbers, single.counts
        single.q[...], single.v[...] = q, v  # views of y
        if len(parameters):
            p[:] = parameters
        numbers[0], numbers[1] = h, t0
        counts[0], counts[1] = n, n or 1  # steps, and steps between samples: the end is the only sample
        single.run()
        # report: number of steps done; 1 if all were done; 1 if the only fault was that a link rotated too far
        if report[1]:
            return sample.copy()
        if report[2] and self.further is not None:
            self.extend()
            return self.run_one(q, v, parameters, t0, h, n)
        return Stop(y.copy(), int(report[0]))


LEAST = 1e-14  # shortest step, relative to the duration or the largest time, whichever is larger
LIMIT = 10**7  # largest number of steps of one call


def integrate(loaded: Loaded, state: Array, parameters: Array, times: Array, tolerances: tuple[float, float]) -> Course:
    """Integrate by a routine `integrate` (`rollout.adaptive`) from a state (2n,) at times[0] over the times (k,).

    If a guard fails (a pivot is too small), the routine stops early, at the last valid state.
    """
    # arrays of the routine have the shape (1 group, rows, 1 lane); two times are added, because the routine reads ahead
    y, p, at = state[None, :, None].copy(), parameters[None, :, None], np.append(times, [times[-1]] * 2)[None, :, None]
    samples, report = np.full((1, len(times) * len(state), 1), np.nan), np.zeros((1, 4, 1))
    span = float(times[-1] - times[0])
    least = LEAST * max(span, float(np.abs(times).max()))
    # rtol, atol, longest and shortest step, first step
    numbers = (*tolerances, span, least, min(span / 100, float(times[1] - times[0])))
    # then come integers: number of samples, largest number of steps, and one group; call(1) computes one trajectory
    loaded.call(1)(*loaded.as_arguments([y, p, at, samples, report]), *numbers, len(times), LIMIT, 1)
    # report: number of stored samples, of accepted and of attempted steps, and the time reached
    stored, taken, tried, t = report[0, :, 0].tolist()
    return Course(samples.reshape(len(times), -1)[: int(stored)], y[0, :, 0], t, int(taken), int(tried))


def evaluate_many(loaded: Loaded, t: Array, states: Array, parameters: Array) -> tuple[Array, Flags]:
    """Return accelerations (k, n) by a routine `accelerate` at states (k, 2n) and times (k,), and whether all guards hold (k,)."""
    count = len(states)
    lanes = loaded.lanes(count)
    y, p, at = in_lanes(states, lanes), in_lanes(parameters, lanes), in_lanes(t[:, None], lanes)
    out = np.empty((len(y), y.shape[1] // 2 + 1, lanes))
    loaded.call(lanes)(*loaded.as_arguments([y, p, at, out]), len(y))
    rows = out_of_lanes(out, count)
    return rows[:, :-1], rows[:, -1] > 0


def evaluate_one(loaded: Loaded, t: float, q: Array, v: Array, parameters: Array) -> Array:
    """Evaluate a routine `accelerate` in native code at one state.

    Return an array (n + 1,): the accelerations, and one number that tells whether they are valid. The last number is 1 if all
    guards are satisfied, else 0; a routine that was made with `margin` gives the smallest ratio of a pivot to its threshold
    instead. The next call overwrites the array.
    """
    # memory for the arguments, which each thread allocates in its first call
    single = loaded.of_thread.single or loaded.single(2 * len(q), len(parameters), 1, len(q) + 1)
    _, p, time, out = single.arrays  # the first array has q and v
    single.q[...], single.v[...], time[0] = q, v, t
    if len(parameters):
        p[:] = parameters
    single.run()
    return out


# defined once, because `Programs` finds a routine again by the function that makes it
margin_routine = partial(acceleration, margin=True)


class Programs:
    """The programs of one mechanism, the preferred one first; more are generated when they are needed.

    Attributes:
        plain: whether routines run as Python functions on numpy arrays, because there is no compiler.
        codes: the programs generated so far; "program k" has the index k.
        values: (n_p,) number arguments of the code, with the values of the linkage file.
        native: routine for accelerations by program 0, which runs in numpy if `plain`.
        dropped: names of redundant constraint rows that program 0 leaves out; other programs may leave out different rows.
    """

    def __init__(self, programs: Iterator[Program], stabilization: str, target: Target):
        """Generate the first of the programs; the generator `programs` makes each further one when it is needed."""
        self.target, self.plain, self.stabilization = target, target.backend != "llvm", stabilization
        self._more = (Code(x, stabilization) for x in programs)  # generator of the programs that are not needed yet
        self.codes: list[Code] = []
        self.runners: dict[tuple[int, str], Stepper] = {}
        self._routines: dict[tuple[int, Callable[[Code], Routine]], Loaded] = {}
        self._integrate = partial(adaptive, plain=self.plain)  # one object, because `_routine` finds routines by `make`
        self.generate_next()
        first = self.codes[0].program
        self.n, self.values, self.dropped = first.n, first.values, first.dropped
        self.native = self._routine(0, "none", partial(acceleration, plain=self.plain))

    def generate_next(self) -> bool:
        """Generate one more program, as the last of `codes`; return False if there are no more."""
        code = next(self._more, None)
        if code is None:
            return False
        self.codes.append(code)
        return True

    def runner(self, k: int, integrator: str) -> Stepper:
        """Return the stepper of program k with an integrator, which is made on first use."""
        if (k, integrator) in self.runners:
            return self.runners[k, integrator]
        code = self.codes[k]
        all_reaches = reaches(code, integrator)  # largest rotations per step for which there is code, the smallest first

        def load(count: int) -> Loaded:
            """Return the routine that contains code for the `count` smallest of `all_reaches`."""
            build = cache(lambda: bodies(code, integrator, all_reaches[:count]))  # once, for one lane and for many
            return Loaded(lambda many: rollout(build(), many), self.target)

        if self.plain:
            stepper = Stepper(Loaded(lambda many: rollout([plain_body(code, integrator)], many), self.target))
        else:
            # first code for the smallest rotations per step; when it no longer suffices, the routine for all rotations replaces it
            stepper = Stepper(load(1), load(len(all_reaches)) if len(all_reaches) > 1 else None)
        self.runners[k, integrator] = stepper
        return stepper

    def adaptive(self, k: int) -> Loaded:
        """Return the routine `integrate` of program k, which integrates with step size control."""
        return self._routine(k, self.stabilization, self._integrate)

    def _routine(self, k: int, stabilization: str, make: Callable[[Code], Routine]) -> Loaded:
        """Return the routine that `make` builds for program k; its code is compiled on first use.

        A routine is stored under the key (k, make) without the stabilisation, because each `make` has a single stabilisation.
        """
        if (k, make) not in self._routines:
            code = Code(self.codes[k].program, stabilization)
            self._routines[k, make] = Loaded(lambda many: make(code), self.target)
        return self._routines[k, make]

    def margins(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Array]:
        """Return accelerations (states, n) by program k, and its margins (states,), evaluated in numpy.

        A margin is the smallest ratio of a pivot to its threshold, or 0 if this ratio is NaN.
        """
        program = self.codes[k].program
        a, guard = program.acceleration(t[:, None], q, v, p)
        with np.errstate(invalid="ignore"):
            margin = np.abs(guard) / program.thresholds
        return a, np.nan_to_num(margin.min(axis=1, initial=np.inf), nan=0.0, posinf=np.inf)

    def margin(self, k: int, t: float, state: Array, p: Array) -> float:
        """Return the margin of program k at a state (2n,): the smallest ratio of a pivot to its threshold, below 1 if unusable."""
        if self.plain:
            _, margins = self.margins(k, np.array([t]), state[None, : self.n], state[None, self.n :], p[None])
            return float(margins[0])
        routine = self._routine(k, "none", margin_routine)
        return float(evaluate_one(routine, t, state[: self.n], state[self.n :], p)[-1])  # the last number is the margin

    def accelerations(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Return accelerations (states, n) by program k, and flags (states,): True where all of its pivots are large enough."""
        if k == 0 and not self.plain:  # only program 0 has compiled code for this
            return evaluate_many(self.native, t, np.concatenate([q, v], axis=1), p)
        a, margin = self.margins(k, t, q, v, p)
        return a, margin >= 1.0

    def acceleration(self, t: float, q: Array, v: Array, p: Array) -> Array | None:
        """Return the acceleration (n,) at one state by program 0, the preferred one, with the least overhead.

        Return None if a pivot is too small at this state, or if there is no compiler.
        """
        out = None if self.plain else evaluate_one(self.native, t, q, v, p)
        return out[:-1].copy() if out is not None and out[-1] else None  # out[-1] is 1 if all pivots are large enough

    def multipliers(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Return multipliers (states, rows) by program k, and flags (states,): True where all of its pivots are large enough."""
        (multipliers,) = self.codes[k].program.multipliers(t[:, None], q, v, p)
        _, margins = self.margins(k, t, q, v, p)
        return multipliers, margins >= 1.0

    def loaded(self) -> list[tuple[float, bool]]:
        """Return for all machine code made so far the times [s] to compile or load it, each with whether it was in the cache."""
        routines = [*self._routines.values()]
        for runner in self.runners.values():
            routines += runner.compiled
        return [(code.seconds, code.from_cache) for routine in routines for code in routine.codes.values()]
