"""Execution of routines: as native code in groups of lanes on several threads, or as Python on arrays of numpy.

A `Stepper` steps trajectories with one program and one integrator. When a trajectory stops, `driver.py` decides how it continues.
Without a compiler, numpy computes every sine from scratch. Guards, projection and the order of operations are those of the native
code, so that results agree to rounding.

The independent coordinates of a program are usable only where its pivots are far enough from zero: the crank of a crank-slider is a
usable coordinate everywhere, but its slider is not at the dead centres.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.machine.code import Code, Program, read_code
from gauss_bench.compiler.machine.native_code import Flags, Loaded, Target, in_lanes, in_plain_c, out_of_lanes, share
from gauss_bench.compiler.machine.routine import Routine
from gauss_bench.compiler.stepping.rollout import acceleration, adaptive, bodies, plain_body, rollout, settling
from gauss_bench.compiler.stepping.steps import reaches
from gauss_bench.terms import Array


@dataclass(frozen=True, eq=False)
class Batch:
    """Trajectories to be stepped.

    Attributes:
        states: (k, 2n) q and v at the start.
        parameters: (k, n_p) open numbers of each trajectory.
        t0, h: time of the start, and step size [s].
        n: number of steps.
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
    """The outcome of a batch.

    Attributes:
        states: (k, 2n) last states; of a trajectory that stopped early, the state before the failed step.
        samples: (k, slots, 2n); of a trajectory that stopped early, those after the failed step are NaN.
        done: (k,) numbers of accepted steps.
        complete: (k,) whether all steps were accepted.
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
        samples: (k, 2n) states at the times that were reached, projected if the code projects.
        state: (2n,) last state, at the time t [s].
        taken, tried: numbers of accepted and of attempted steps.
    """

    samples: Array
    state: Array
    t: float
    taken: int
    tried: int


class Stepper:
    """Steps trajectories by a routine `rollout` for the shortest reach (`steps.Reach`).

    The routine `further`, if there is one, has the longer reaches too, and takes longer to compile. It replaces the first routine
    as soon as a step has exceeded the shortest reach.

    Attributes:
        compiled: the routines in use so far.
    """

    def __init__(self, loaded: Loaded, further: Loaded | None = None):
        self.loaded, self.further = loaded, further
        self.native, self.compiled = loaded.target.backend == "llvm", [loaded]

    def extend(self) -> None:
        """Switch to the routine for steps of every reach."""
        if self.further is not None:
            self.loaded, self.further = self.further, None
            self.compiled.append(self.loaded)

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        """Step all trajectories of a batch until they end or a guard fails."""
        count = len(batch.states)
        lanes = self.loaded.lanes(count)
        y, p = in_lanes(batch.states.copy(), lanes), in_lanes(batch.parameters, lanes)  # copied, as one lane would be a view
        groups, rows = y.shape[:2]
        samples, report = np.full((groups, batch.slots * rows, lanes), np.nan), np.empty((groups, 3, lanes))
        call = self.loaded.call(lanes)

        def part(low: int, high: int) -> None:
            arrays = self.loaded.given([y[low:high], p[low:high], samples[low:high], report[low:high]])
            call(*arrays, batch.h, batch.t0, batch.n, batch.every, batch.slots, high - low)

        share(part, groups, threads)
        done, complete, far = out_of_lanes(report, count).T
        if far.any() and self.further is not None:
            self.extend()
            return self.run(batch, threads)
        stored = out_of_lanes(samples.reshape(groups, batch.slots, rows, lanes), count)
        return Outcome(out_of_lanes(y, count), stored, done.astype(int), complete > 0)

    def run_one(self, q: Array, v: Array, parameters: Array, t0: float, h: float, n: int) -> Array | Stop:
        """Return the state (2n,) after n steps of one trajectory, or its early stop; a call has the least possible overhead."""
        if not self.native:
            outcome = self.run(Batch(np.concatenate([q, v], dtype=float)[None], parameters[None], t0, h, n, max(1, n)))
            return outcome.samples[0, -1] if outcome.complete[0] else Stop(outcome.states[0], int(outcome.done[0]))
        one = self.loaded.singles.one or self.loaded.single(2 * len(q), len(parameters), 2 * len(q), 3)
        arrays, numbers, counts, report = one.arrays, one.numbers, one.counts, one.arrays[-1]
        one.q[...], one.v[...] = q, v
        if len(parameters):
            arrays[1][:] = parameters
        numbers[0], numbers[1] = h, t0
        counts[0], counts[1] = n, n or 1  # steps, and steps between samples: the end is the only sample
        one.run()
        if report[1]:  # all steps were done
            return arrays[-2].copy()
        if report[2] and self.further is not None:  # only the reach was exceeded
            self.extend()
            return self.run_one(q, v, parameters, t0, h, n)
        return Stop(arrays[0].copy(), int(report[0]))


LEAST = 1e-14  # shortest step, relative to the duration or to the largest time
LIMIT = 10**7  # number of steps of one call


def integrate(loaded: Loaded, state: Array, parameters: Array, times: Array, tolerances: tuple[float, float]) -> Course:
    """Integrate by a routine `integrate` from a state (2n,) at times[0] over the times (k,), until a guard fails.

    The routine chooses its steps by the tolerances, relative and absolute.
    """
    # arrays of the routine have the shape (1 group, rows, 1 lane); it needs two more times
    y, p, at = state[None, :, None].copy(), parameters[None, :, None], np.append(times, [times[-1]] * 2)[None, :, None]
    samples, report = np.full((1, len(times) * len(state), 1), np.nan), np.zeros((1, 4, 1))
    span = float(times[-1] - times[0])
    least = LEAST * max(span, float(np.abs(times).max()))
    numbers = (*tolerances, span, least, min(span / 100, float(times[1] - times[0])))  # the last is the first step size
    loaded.call(1)(*loaded.given([y, p, at, samples, report]), *numbers, len(times), LIMIT, 1)
    stored, taken, tried, t = report[0, :, 0].tolist()
    return Course(samples.reshape(len(times), -1)[: int(stored)], y[0, :, 0], t, int(taken), int(tried))


def evaluate_many(loaded: Loaded, t: Array, states: Array, parameters: Array) -> tuple[Array, Flags]:
    """Return accelerations (k, n) by a routine `accelerate` at states (k, 2n) and times (k,), and where all guards hold (k,)."""
    count = len(states)
    lanes = loaded.lanes(count)
    y, p, at = in_lanes(states, lanes), in_lanes(parameters, lanes), in_lanes(t[:, None], lanes)
    out = np.empty((len(y), y.shape[1] // 2 + 1, lanes))
    loaded.call(lanes)(*loaded.given([y, p, at, out]), len(y))
    rows = out_of_lanes(out, count)
    return rows[:, :-1], rows[:, -1] > 0


def evaluate_one(loaded: Loaded, t: float, q: Array, v: Array, parameters: Array, size: int) -> Array:
    """Evaluate a routine `accelerate` or `settle` in native code at one state.

    Return its results (size,), followed by 1 if the guards hold, else 0, in memory that the next call overwrites.
    """
    one = loaded.singles.one or loaded.single(2 * len(q), len(parameters), 1, size + 1)
    arrays = one.arrays
    one.q[...], one.v[...], arrays[-2][0] = q, v, t
    if len(parameters):
        arrays[1][:] = parameters
    one.run()
    return arrays[-1]


margin_routine = partial(acceleration, margin=True)


class Programs:
    """The programs of one mechanism, the best first; further ones are generated on demand.

    Attributes:
        plain: whether routines run as Python, because there is no compiler.
        codes: the programs so far.
        runners: (index of a program, integrator) -> its stepper.
        n: number of coordinates.
        values: (n_p,) open numbers as in the file.
        native: routine for accelerations by the first program.
        dropped: redundant rows that the first program leaves out; other programs may leave out different ones.
    """

    def __init__(self, programs: Iterator[Program], stabilization: str, target: Target):
        self.target, self.plain, self.stabilization = target, target.backend != "llvm", stabilization
        self._more = (read_code(x, stabilization) for x in programs)
        self.codes: list[Code] = []
        self.runners: dict[tuple[int, str], Stepper] = {}
        self._routines: dict[tuple[int, Callable[[Code], Routine]], Loaded] = {}
        self._integrate = partial(adaptive, plain=self.plain)
        self.further()
        first = self.codes[0].program
        self.n, self.values, self.dropped = first.n, first.values, first.dropped
        self.native = self._routine(0, "none", partial(acceleration, plain=self.plain))

    def __len__(self) -> int:
        return len(self.codes)

    def further(self) -> bool:
        """Generate one more program; return False if there are no more."""
        code = next(self._more, None)
        if code is None:
            return False
        self.codes.append(code)
        return True

    def runner(self, k: int, integrator: str) -> Stepper:
        """Return the stepper of program k, which is compiled on first use."""
        return self.runners.get((k, integrator)) or self._make(k, integrator)

    def _make(self, k: int, integrator: str) -> Stepper:
        """Make the stepper of program k."""
        code = self.codes[k]
        every = reaches(code, integrator)

        def load(count: int) -> Loaded:
            """Return the routine with the first `count` reaches; their bodies are built once, for one lane and for many."""
            made = cache(lambda: bodies(code, integrator, every[:count]))
            return Loaded(lambda many: rollout(made(), many), self.target)

        if self.plain:
            stepper = Stepper(Loaded(lambda many: rollout([plain_body(code, integrator)], many), self.target))
        else:
            stepper = Stepper(load(1), load(len(every)) if len(every) > 1 else None)
        self.runners[k, integrator] = stepper
        return stepper

    def adaptive(self, k: int) -> Loaded:
        """Return the routine `integrate` of program k."""
        return self._routine(k, self.stabilization, self._integrate)

    def _routine(self, k: int, stabilization: str, make: Callable[[Code], Routine]) -> Loaded:
        """Return the routine that `make` writes for program k; it is compiled on first use."""
        if (k, make) not in self._routines:
            code = read_code(self.codes[k].program, stabilization)
            self._routines[k, make] = Loaded(lambda many: make(code), self.target)
        return self._routines[k, make]

    def margins(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Array]:
        """Return accelerations (k, n) by program k, and the smallest ratio (k,) of a pivot to its threshold."""
        program = self.codes[k].program
        a, guard = program.acceleration(t[:, None], q, v, p)
        with np.errstate(invalid="ignore"):
            margin = np.abs(guard) / program.thresholds
        return a, np.nan_to_num(margin.min(axis=1, initial=np.inf), nan=0.0, posinf=np.inf)

    def margin(self, k: int, t: float, state: Array, p: Array) -> float:
        """Return the smallest ratio of a pivot of program k to its threshold at a state (2n,); below 1 a guard fails."""
        if self.plain:
            return float(self.margins(k, np.array([t]), state[None, : self.n], state[None, self.n :], p[None])[1][0])
        routine = self._routine(k, "none", margin_routine)
        return float(evaluate_one(routine, t, state[: self.n], state[self.n :], p, self.n)[-1])

    def settled(self, k: int, t: float, state: Array, p: Array) -> Array | None:
        """Project a state (2n,) onto the rows that program k keeps; return None if its guards or Newton's method fail."""
        if self.plain:
            return None
        out = evaluate_one(self._routine(k, "projection", settling), t, state[: self.n], state[self.n :], p, 2 * self.n)
        return out[:-1].copy() if out[-1] else None

    def accelerations(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Return accelerations (k, n) by program k, and where its guards hold (k,)."""
        if k == 0 and not self.plain:
            return evaluate_many(self.native, t, np.concatenate([q, v], axis=1), p)
        a, margin = self.margins(k, t, q, v, p)
        return a, margin >= 1.0

    def acceleration(self, t: float, q: Array, v: Array, p: Array) -> Array | None:
        """Return the acceleration (n,) at one state with the least overhead, or None if the first program is not usable there."""
        out = None if self.plain else evaluate_one(self.native, t, q, v, p, self.n)
        return out[:-1].copy() if out is not None and out[-1] else None

    def multipliers(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Flags]:
        """Return multipliers (k, rows) by program k, and where its guards hold (k,)."""
        return self.codes[k].program.multipliers(t[:, None], q, v, p)[0], self.margins(k, t, q, v, p)[1] >= 1.0

    @property
    def partitions(self) -> tuple[tuple[int, ...], ...]:
        """Independent coordinates of every program generated so far."""
        return tuple(code.program.independent for code in self.codes)

    def c_source(self, integrator: str) -> str:
        """Return the first program as C source with the functions `accelerate` and `rollout`."""
        first = self.codes[0]
        steps = rollout([plain_body(first, integrator)], many=False)
        return in_plain_c(acceleration(read_code(first.program, "none"), plain=True), steps)

    def loaded(self) -> list[tuple[float, bool]]:
        """Return for each piece of machine code so far the seconds to compile or load it, and whether it was in the cache."""
        routines = [*self._routines.values()]
        for runner in self.runners.values():
            routines += runner.compiled
        return [(code.seconds, code.from_cache) for routine in routines for code in routine.codes.values()]

    def prepare(self, integrator: str, many: bool, extended: bool = True) -> None:
        """Compile ahead all code that steps of one state, or of many, may need; without `extended`, only for the shortest reach."""
        if integrator == "dop853":
            self.adaptive(0).call(1)
            return
        runner = self.runner(0, integrator)
        if extended:
            runner.extend()
        runner.loaded.call(self.target.lanes if many else 1)
