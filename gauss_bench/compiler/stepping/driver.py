"""The driver of trajectories that a guard stops: another partition, and last a rank decision at each step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gauss_bench.integrate.legs import legs
from gauss_bench.terms import Array

Numbers = Callable[[float], Array]  # time [s] -> all open numbers (k, n_p) there

STRIDE = 1e-4  # of all times: a step past a singular position
IMPLICIT = "gauss_legendre"
INTEGRATORS = ("rk4", "semi_implicit_euler", "dop853_fixed", IMPLICIT)


@dataclass(frozen=True, eq=False)
class Batch:
    """A batch to be stepped.

    Attributes:
        states: (k, 2n) q and v.
        parameters: (k, n_p).
        t0, h: start and step [s]; n: steps; every: steps between samples, at least 1.
    """

    states: Array
    parameters: Array
    t0: float
    h: float
    n: int
    every: int

    @property
    def slots(self) -> int:
        """Samples of each trajectory: every `every` steps and the last."""
        return max(1, -(-self.n // self.every))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The outcome of a batch.

    Attributes:
        states: (k, 2n) last state; where a trajectory stopped early, the one it stopped at.
        samples: (k, slots, 2n); of a trajectory that stopped, those before the step it stopped at.
        done: (k,) steps that count.
        complete: (k,) whether that is all of them.
    """

    states: Array
    samples: Array
    done: NDArray[np.integer[Any]]
    complete: NDArray[np.bool_]


class Stop(NamedTuple):
    """An early stop of one trajectory: its state (2n,), and the steps that count."""

    state: Array
    done: int


@dataclass(frozen=True, eq=False)
class Course:
    """The outcome of one trajectory whose steps are its own choice.

    Attributes:
        samples: (k, 2n) at the times it came to; with projection, as they are to be seen.
        state: (2n,) where it stopped, at the time t.
        taken, tried: steps that count, and all.
    """

    samples: Array
    state: Array
    t: float
    taken: int
    tried: int


class Runner(Protocol):
    """Steps trajectories by one program and integrator."""

    def run(self, batch: Batch, threads: int = 1) -> Outcome:
        """All trajectories of a batch as far as their guards hold."""
        ...

    def run_one(self, q: Array, v: Array, parameters: Array, t0: float, h: float, n: int) -> Array | Stop:
        """The state (2n,) after n steps of one trajectory, or where it stopped: the shortest way into the code."""
        ...


class Programs(Protocol):
    """The programs of one mechanism, the best first; further ones are generated when they are asked for."""

    @property
    def n(self) -> int:
        """Coordinates."""
        ...

    @property
    def values(self) -> Array:
        """(n_p,) open numbers of the file."""
        ...

    @property
    def dropped(self) -> tuple[str, ...]:
        """Redundant rows that the first one leaves out; others leave out others."""
        ...

    def __len__(self) -> int: ...
    def further(self) -> bool:
        """Generate one more; False where there is none."""
        ...

    def margin(self, k: int, t: float, state: Array, p: Array) -> float:
        """The margin of one of them at a state before it fails; below 1 it does."""
        ...

    def settled(self, k: int, t: float, state: Array, p: Array) -> Array | None:
        """A state (2n,) taken back onto the rows that one of them keeps, or None where it cannot."""
        ...

    def runner(self, k: int, integrator: str) -> Runner:
        """The runner of equal steps by one program."""
        ...


class Adaptable(Programs, Protocol):
    """Programs that also step as they choose."""

    def adaptive(self, k: int) -> "Adapts":
        """The runner of adaptive steps by one program."""
        ...


class Adapts(Protocol):
    """Steps one trajectory by one program, as far as its guards hold."""

    def run(self, state: Array, parameters: Array, times: Array, tolerances: tuple[float, float]) -> Course: ...


class ByRank(Protocol):
    """Single steps of a mechanism with the numbers of its file, whatever the rank of its rows."""

    def step(self, integrator: str, t: float, q: Array, v: Array, h: float) -> tuple[Array, Array]: ...
    def project(self, t: float, q: Array, v: Array) -> tuple[Array, Array]: ...


@dataclass
class Tally:
    """Counts of one rollout beyond its first program: changes of partition, steps by rank decision, lost trajectories."""

    switches: int = 0
    fallbacks: int = 0
    lost: int = 0


class Driver:
    """Steps batches to their end by whatever serves.

    `projected` where samples are to lie on the constraints. Of the open numbers the first are a user's, as many as `given`; the
    others go with time, and the rank decision knows them.
    """

    def __init__(self, programs: Programs, by_rank: ByRank, projected: bool, given: int):
        self.programs, self.by_rank, self.projected, self.given = programs, by_rank, projected, given
        self.tally = Tally()

    def nominal(self, p: Array) -> bool:
        """Tell whether open parameters have the values of the file, for which alone the rank decision knows the mechanism."""
        return not self.given or bool((p[..., : self.given] == self.programs.values[: self.given]).all())

    @property
    def drifting(self) -> bool:
        """True if redundant rows are dropped, others by each program, and nothing takes away what they are off."""
        return bool(self.programs.dropped) and not self.projected

    def hand_over(self, k: int, t: float, state: Array, p: Array) -> Array:
        """A state (2n,) as program k is to go on from it.

        Where rows drift, what one that was dropped is off has grown by the inverse of the smallest pivot: the state is taken back
        onto the rows that the program keeps, which near it are all rows, or where that fails by a rank decision.
        """
        if not self.drifting:
            return state
        settled, n = self.programs.settled(k, t, state, p), self.programs.n
        return np.concatenate(self.by_rank.project(t, state[:n], state[n:])) if settled is None else settled

    def best(self, t: float, state: Array, p: Array, without: set[int]) -> int | None:
        """The program with the largest margin at a state, or None where none is usable there."""
        if self.drifting and not self.nominal(p):
            return None
        while True:
            margins = {k: self.programs.margin(k, t, state, p) for k in range(len(self.programs)) if k not in without}
            usable = [k for k, margin in margins.items() if margin >= 1.0]
            if usable:
                return max(usable, key=lambda k: margins[k])
            if not self.programs.further():
                return None

    def advance(self, batch: Batch, integrator: str, threads: int = 1) -> Outcome:
        """All trajectories to their end; a lost one is not a number from there on."""
        return self.resume(batch, self.programs.runner(0, integrator).run(batch, threads), integrator)

    def resume(self, batch: Batch, outcome: Outcome, integrator: str) -> Outcome:
        """Trajectories that stopped to their end, one by one."""
        self.tally = Tally()
        for k in np.flatnonzero(~outcome.complete):
            Continuation(self, batch, integrator, outcome, int(k)).finish()
        return outcome


def integrate(
    driver: Driver, programs: Adaptable, state: Array, p: Array, times: Array, tolerances: tuple[float, float]
) -> tuple[Array, int, int]:
    """States (k, 2n) of one trajectory at times (k,), steps that count, and all; not a number from where it is lost."""
    samples, taken, tried = np.full((len(times), len(state)), np.nan), 0, 0
    driver.tally = Tally()
    stored, t, used, without = 0, float(times[0]), 0, set[int]()
    while stored < len(times):
        again = stored > 0  # where it stopped is no sample
        part = times[stored:] if not again else np.append(t, times[stored:])
        course = programs.adaptive(used).run(state, p, part, tolerances)
        new = course.samples[int(again) :]
        samples[stored : stored + len(new)], stored = new, stored + len(new)
        taken, tried = taken + course.taken, tried + course.tried
        if stored == len(times):
            break
        without = {used} if course.taken else without | {used}
        state, t = course.state, course.t
        chosen = driver.best(t, state, p, without) if np.isfinite(state).all() else None
        if chosen is not None:
            driver.tally.switches, used, state = driver.tally.switches + 1, chosen, driver.hand_over(chosen, t, state, p)
            continue
        h = min(float(times[stored]) - t, STRIDE * float(times[-1] - times[0]))
        try:
            if not driver.nominal(p):
                raise np.linalg.LinAlgError("numbers of another linkage")
            n = driver.programs.n
            state = np.concatenate(driver.by_rank.step("dop853_fixed", t, state[:n], state[n:], h))
        except np.linalg.LinAlgError:
            driver.tally.lost += 1
            break
        driver.tally.fallbacks, t, without = driver.tally.fallbacks + 1, t + h, set()
        if t >= times[stored]:
            samples[stored], stored = state, stored + 1
    return samples, taken, tried


class Continuation:
    """One trajectory that stopped, followed to its end; writes into the outcome of its batch."""

    def __init__(self, driver: Driver, batch: Batch, integrator: str, outcome: Outcome, row: int):
        self.driver, self.batch, self.integrator, self.outcome, self.row = driver, batch, integrator, outcome, row
        self.state, self.p = outcome.states[row].copy(), batch.parameters[row]
        self.at = int(outcome.done[row])
        self.stored = before(self.at, batch.every)
        self.used = 0
        self.tried: set[int] = set()

    @property
    def t(self) -> float:
        return self.batch.t0 + self.at * self.batch.h

    def finish(self) -> None:
        """Choose, run, and choose again until all samples are there."""
        outcome, row, slots = self.outcome, self.row, self.batch.slots
        self._choose()
        while self.stored < slots:
            self._run()
        outcome.states[row], outcome.done[row] = outcome.samples[row, -1], self.at
        outcome.complete[row] = bool(np.isfinite(outcome.states[row]).all())

    def _run(self) -> None:
        """Run by the chosen code: to the end where samples fall into step, else to the next sample."""
        batch, whole = self.batch, self.at == self.stored * self.batch.every
        goal = batch.n if whole else min((self.stored + 1) * batch.every, batch.n)
        count = goal - self.at
        every = batch.every if whole else max(1, count)
        runner, n = self.driver.programs.runner(self.used, self.integrator), self.driver.programs.n
        if count <= every:  # one sample
            end = runner.run_one(self.state[:n], self.state[n:], self.p, self.t, batch.h, count)
            complete = not isinstance(end, Stop)
            self.state, moved = end if isinstance(end, Stop) else (end, count)
            if complete:
                self.outcome.samples[self.row, self.stored] = self.state
            stored = int(complete)
        else:
            outcome = runner.run(Batch(self.state[None], self.p[None], self.t, batch.h, count, every))
            complete, moved, self.state = bool(outcome.complete[0]), int(outcome.done[0]), outcome.states[0]
            samples = outcome.samples[0] if complete else outcome.samples[0, : before(moved, every)]
            self.outcome.samples[self.row, self.stored : self.stored + len(samples)] = samples
            stored = len(samples)
        self.stored += stored
        self.at += moved
        if moved:
            self.tried.clear()
        if not complete:
            self._choose()

    def _choose(self) -> None:
        """Another program, or a step without one."""
        driver = self.driver
        self.tried.add(self.used)
        k = driver.best(self.t, self.state, self.p, self.tried)
        if k is None:
            self._step()
            self.tried.clear()
            k = driver.best(self.t, self.state, self.p, set())
        if k is not None and k != self.used:
            driver.tally.switches += 1
            self.used, self.state = k, driver.hand_over(k, self.t, self.state, self.p)

    def _step(self) -> None:
        """One step by rank decision; at a sample that is due, the projection alone."""
        driver, batch = self.driver, self.batch
        n, due = driver.programs.n, self.at > 0 and self.at == min((self.stored + 1) * batch.every, batch.n)
        driver.tally.fallbacks += 1
        q, v = self.state[:n], self.state[n:]
        if not (driver.nominal(self.p) and np.isfinite(self.state).all()):
            self._lose()
        elif due:
            self.state = np.concatenate(driver.by_rank.project(self.t, q, v) if driver.projected else (q, v))
            self.outcome.samples[self.row, self.stored] = self.state
            self.stored += 1
        else:
            try:
                with np.errstate(all="ignore"):
                    self.state = np.concatenate(driver.by_rank.step(self.integrator, self.t, q, v, batch.h))
                self.at += 1
            except np.linalg.LinAlgError:  # numbers beyond all bounds
                self._lose()
            if not np.isfinite(self.state).all():
                self._lose()

    def _lose(self) -> None:
        """Write NaN from here on: a motion that cannot go on has no number rather than a wrong one."""
        self.driver.tally.lost += self.stored < self.batch.slots
        self.outcome.samples[self.row, self.stored :] = np.nan
        self.stored = self.batch.slots


def advance_over(driver: Driver, batch: Batch, numbers: Numbers, kinks: Sequence[float], integrator: str, threads: int) -> Outcome:
    """All trajectories of a batch to their end, as `Driver.advance`; its open numbers are given by time."""
    samples = np.full((len(batch.states), batch.slots, batch.states.shape[1]), np.nan)
    states, tally = batch.states.copy(), Tally()
    for leg in legs(batch.t0, batch.h, batch.n, batch.every, kinks):
        going = np.flatnonzero(np.isfinite(states).all(axis=1))
        if not len(going):
            break
        part = Batch(states[going], numbers(leg.middle)[going], leg.t, leg.h, leg.n, leg.every)
        outcome = driver.advance(part, integrator, threads)
        tally = _sum(tally, driver.tally)
        states[going] = outcome.samples[:, -1]
        begin, end = leg.slots
        samples[going, begin:end] = outcome.samples[:, : end - begin]
    driver.tally = tally
    complete = np.asarray(np.isfinite(states).all(axis=1))
    return Outcome(states, samples, np.where(complete, batch.n, 0), complete)


def integrate_over(
    driver: Driver,
    programs: Adaptable,
    state: Array,
    numbers: Numbers,
    times: Array,
    tolerances: tuple[float, float],
    kinks: Sequence[float],
) -> tuple[Array, int, int]:
    """One trajectory by steps of its own choice, as `integrate`, started anew at each kink; its open numbers are given by time."""
    begin, end = float(times[0]), float(times[-1])
    samples, taken, tried, tally = np.full((len(times), len(state)), np.nan), 0, 0, Tally()
    samples[0] = state
    for a, b in pairwise([begin, *(x for x in kinks if begin < x < end), end]):
        inside = np.flatnonzero((times > a) & (times <= b))
        part = np.array([a, *times[inside], *([] if len(inside) and times[inside[-1]] == b else [b])])
        states, count, all_of_them = integrate(driver, programs, state, numbers((a + b) / 2)[0], part, tolerances)
        tally, taken, tried = _sum(tally, driver.tally), taken + count, tried + all_of_them
        samples[inside], state = states[1 : 1 + len(inside)], states[-1]
        if a == begin:
            samples[0] = states[0]
        if not np.isfinite(state).all():
            break
    driver.tally = tally
    return samples, taken, tried


def _sum(a: Tally, b: Tally) -> Tally:
    return Tally(a.switches + b.switches, a.fallbacks + b.fallbacks, a.lost + b.lost)


def stop_at(stop: Stop) -> Outcome:
    """One trajectory that stopped before its only sample."""
    return Outcome(stop.state[None], np.full((1, 1, len(stop.state)), np.nan), np.array([stop.done]), np.zeros(1, bool))


def before(step: int, every: int) -> int:
    """Count the multiples of `every`, from the first, that lie strictly before a step."""
    return max(0, -(-step // every) - 1)
