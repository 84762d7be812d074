"""What happens when a guard stops a trajectory: another reach, another partition, and last a rank decision at each step.

A partition is usable where its pivots stay away from zero; which ones do changes along the motion (the crank of a slider-crank
always serves, its slider not at the dead centres). Programs for further partitions are generated when they are first needed.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from gauss_bench.compiler.elimination.program import Program, generate, partitions
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.stepping.arrays import NumpyRunner, on_arrays
from gauss_bench.compiler.stepping.library import Library
from gauss_bench.compiler.stepping.runners import Batch, NativeRunner, Outcome, Runner
from gauss_bench.compiler.stepping.steps import REACHES, Code, read_code
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

MARGIN = 1.2  # on the way of the angles in a step, when the reach is chosen


@dataclass(frozen=True)
class Options:
    """How a mechanism becomes code; see kernel.compile."""

    formulation: str
    stabilization: str
    open_parameters: tuple[str, ...]
    independent: tuple[int, ...] | None
    baumgarte: tuple[float, float]
    backend: str
    lanes: int
    cache: bool


known_program = lru_cache(maxsize=32)(generate)  # the same mechanism is often compiled under several stabilisations


class Choices:
    """The programs of one mechanism: the best first, further ones when asked for.

    Attributes:
        codes: generated so far.
    """

    def __init__(self, mechanism: Mechanism, options: Options):
        self.mechanism, self.options = mechanism, options
        self.codes: list[Code] = []
        self._evaluate: list[Callable[..., list[Array]]] = []
        self._more = self._generated()
        self.further()

    def _generated(self) -> Iterator[Program]:
        o = self.options
        damping = o.baumgarte if o.stabilization == "baumgarte" else None
        first = known_program(self.mechanism, o.formulation, o.open_parameters, o.independent, damping)
        yield first
        others: list[tuple[str, tuple[int, ...] | None]] = [
            ("gauss", p) for p in partitions(self.mechanism) if p != first.independent
        ]
        for formulation, independent in [*others, *([("lagrange", None)] if first.formulation != "lagrange" else [])]:
            try:
                yield known_program(self.mechanism, formulation, o.open_parameters, independent, damping)
            except KernelError:
                continue  # not every partition can be eliminated everywhere; the first one could

    def further(self) -> bool:
        """Generate one more program; False where there is none."""
        program = next(self._more, None)
        if program is None:
            return False
        code = read_code(program, self.options.stabilization)
        self.codes.append(code)
        self._evaluate.append(on_arrays(program.acceleration))
        return True

    def accelerations(self, k: int, t: Array, q: Array, v: Array, p: Array) -> tuple[Array, Array]:
        """Accelerations (k, n) by one program, and how many times above their thresholds its smallest pivots are (k,)."""
        a, guard = self._evaluate[k](t[:, None], q, v, p)
        with np.errstate(invalid="ignore"):
            margin = np.abs(guard) / self.codes[k].program.thresholds
        return a, np.nan_to_num(margin.min(axis=1, initial=np.inf), nan=0.0, posinf=np.inf)

    def best(self, t: float, state: Array, p: Array, without: set[int]) -> int | None:
        """The program with the largest margin at a state, or None where none is usable there."""
        n = self.mechanism.n
        at = np.array([t]), state[None, :n], state[None, n:], p[None]
        while True:
            margins = {k: float(self.accelerations(k, *at)[1][0]) for k in range(len(self.codes)) if k not in without}
            usable = [k for k, margin in margins.items() if margin >= 1.0]
            if usable:
                return max(usable, key=lambda k: margins[k])
            if not self.further():
                return None


@dataclass
class Tally:
    """What was needed beyond the first program in one rollout: changes of partition, steps by rank decision, lost trajectories."""

    switches: int = 0
    fallbacks: int = 0
    lost: int = 0


class Driver:
    """Steps batches to their end by whatever serves."""

    def __init__(self, mechanism: Mechanism, options: Options):
        self.mechanism, self.options = mechanism, options
        self.choices = Choices(mechanism, options)
        self.runners: dict[tuple[int, str, int], Runner] = {}
        self.tally = Tally()
        self._angles = list(self.choices.codes[0].angles)

    @cached_property
    def library(self) -> Library:
        return Library(self.mechanism, self.options.baumgarte if self.options.stabilization == "baumgarte" else None)

    def nominal(self, p: Array) -> bool:
        """Whether open parameters have the values of the file, for which alone the rank decision knows the mechanism."""
        return bool((p == self.choices.codes[0].program.values).all())

    def level(self, integrator: str, h: float, v: Array) -> int:
        """The shortest reach that the speeds v (..., n) allow."""
        reaches = REACHES[integrator]
        if self.options.backend != "llvm":
            return len(reaches) - 1
        turning = np.asarray(v[..., self._angles])
        way = MARGIN * abs(h) * (math.hypot(*turning) if turning.ndim == 1 else np.hypot.reduce(turning, axis=-1).max(initial=0.0))
        return next((k for k, reach in enumerate(reaches) if way <= reach.step), len(reaches) - 1)

    def runner(self, k: int, integrator: str, level: int) -> Runner:
        """The code of one program and reach, made when it is first asked for."""
        key = (k, integrator, level)
        if key not in self.runners:
            code, o = self.choices.codes[k], self.options
            match o.backend:
                case "llvm":
                    self.runners[key] = NativeRunner(code, integrator, REACHES[integrator][level], o.lanes, o.cache)
                case _:
                    self.runners[key] = NumpyRunner(code, integrator)
        return self.runners[key]

    def advance(self, batch: Batch, integrator: str, threads: int = 1) -> Outcome:
        """All trajectories to their end; a lost one is not a number from there on."""
        level = self.level(integrator, batch.h, batch.states[:, self.mechanism.n :])
        found = self.runner(0, integrator, level).run(batch, threads)
        last = len(REACHES[integrator]) - 1
        while len(batch.states) > 1 and level < last and (found.far & ~found.complete).any():
            level += 1  # together and from the start: quicker than to finish each alone
            found = self._again(batch, found, integrator, level, threads)
        return self.resume(batch, found, integrator, level)

    def resume(self, batch: Batch, found: Outcome, integrator: str, level: int) -> Outcome:
        """Trajectories that stopped to their end, one by one."""
        self.tally = Tally()
        for k in np.flatnonzero(~found.complete):
            Course(self, batch, integrator, found, int(k), level).finish()
        return found

    def _again(self, batch: Batch, found: Outcome, integrator: str, level: int, threads: int) -> Outcome:
        """Run those that went too far with a longer reach."""
        rows = np.flatnonzero(found.far & ~found.complete)
        part = replace(batch, states=batch.states[rows], parameters=batch.parameters[rows])
        new = self.runner(0, integrator, level).run(part, threads)
        for old, more in zip(vars(found).values(), vars(new).values(), strict=True):
            old[rows] = more
        return found


class Course:
    """One trajectory that stopped, followed to its end; writes into the outcome of its batch."""

    def __init__(self, driver: Driver, batch: Batch, integrator: str, found: Outcome, row: int, level: int):
        self.driver, self.batch, self.integrator, self.found, self.row = driver, batch, integrator, found, row
        self.state, self.p = found.states[row].copy(), batch.parameters[row]
        self.at = int(found.done[row])
        self.stored = before(self.at, batch.every)
        self.used, self.level = 0, level
        self.tried: set[int] = set()
        self.far = bool(found.far[row])

    @property
    def t(self) -> float:
        return self.batch.t0 + self.at * self.batch.h

    def finish(self) -> None:
        """Choose, run, and choose again until all samples are there."""
        found, row, slots = self.found, self.row, self.batch.slots
        self._choose()
        while self.stored < slots:
            self._run()
        found.states[row], found.done[row] = found.samples[row, -1], self.at
        found.complete[row] = bool(np.isfinite(found.states[row]).all())

    def _run(self) -> None:
        """Run by the chosen code: to the end where samples fall into step, else to the next sample."""
        batch, whole = self.batch, self.at == self.stored * self.batch.every
        goal = batch.n if whole else min((self.stored + 1) * batch.every, batch.n)
        count = goal - self.at
        every = batch.every if whole else max(1, count)
        part = Batch(self.state[None], self.p[None], self.t, batch.h, count, every)
        outcome = self.driver.runner(self.used, self.integrator, self.level).run(part)
        complete, moved = bool(outcome.complete[0]), int(outcome.done[0])
        samples = outcome.samples[0] if complete else outcome.samples[0, : before(moved, every)]
        self.found.samples[self.row, self.stored : self.stored + len(samples)] = samples
        self.stored += len(samples)
        self.at += moved
        self.state, self.far = outcome.states[0], bool(outcome.far[0])
        if moved:
            self.tried.clear()
        if not complete:
            self._choose()

    def _choose(self) -> None:
        """The next reach, or another program, or a step without one."""
        driver, reaches = self.driver, REACHES[self.integrator]
        if self.far and self.level < len(reaches) - 1:
            self.level += 1
            return
        self.tried.add(self.used)
        found = driver.choices.best(self.t, self.state, self.p, self.tried)
        if found is None:
            self._step()
            self.tried.clear()
            found = driver.choices.best(self.t, self.state, self.p, set())
        if found is not None:
            driver.tally.switches += found != self.used
            self.used = found
        self.level = driver.level(self.integrator, self.batch.h, self.state[driver.mechanism.n :])

    def _step(self) -> None:
        """One step by rank decision; at a sample that is due, the projection alone."""
        driver, batch = self.driver, self.batch
        n, due = driver.mechanism.n, self.at > 0 and self.at == min((self.stored + 1) * batch.every, batch.n)
        driver.tally.fallbacks += 1
        q, v = self.state[:n], self.state[n:]
        if not (driver.nominal(self.p) and np.isfinite(self.state).all()):
            self._lose()
        elif due:
            self.state = np.concatenate(
                driver.library.project(self.t, q, v) if driver.options.stabilization == "projection" else (q, v)
            )
            self.found.samples[self.row, self.stored] = self.state
            self.stored += 1
        else:
            try:
                with np.errstate(all="ignore"):
                    self.state = np.concatenate(driver.library.step(self.integrator, self.t, q, v, batch.h))
                self.at += 1
            except np.linalg.LinAlgError:  # numbers beyond all bounds
                self._lose()
            if not np.isfinite(self.state).all():
                self._lose()

    def _lose(self) -> None:
        """What cannot go on is not a number from here, rather than a wrong one."""
        self.driver.tally.lost += self.stored < self.batch.slots
        self.found.samples[self.row, self.stored :] = np.nan
        self.stored = self.batch.slots


def before(step: int, every: int) -> int:
    """How many multiples of `every`, from the first, lie strictly before a step."""
    return max(0, -(-step // every) - 1)
