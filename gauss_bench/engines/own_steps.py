"""The suite's integrators around the accelerations of an engine, in whatever coordinates those have."""

from pkgutil import resolve_name
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.integrate import ADAPTIVE, StepFailure
from gauss_bench.integrate.fixed_step import EVALUATIONS, STEPS, held_back, step_counts, stretches
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory, finite


class OwnSteps:
    """A model that is stepped in Python: a subclass gives accelerations to be integrated, and what comes after a step.

    Attributes:
        start: coordinates and rates (n,) at the beginning.
        x, dx: (k, n) samples of both.
        stabilized: (t, x, dx) -> the acceleration (n,) that the integrator sees.
        tolerances: of steps that are chosen, where the choice names none.
    """

    mechanism: Mechanism
    choice: Choice
    start: tuple[Array, Array]
    tolerances: tuple[float, float]
    stabilized: Any
    steps = evaluations = 0

    def project(self, t: float, x: Array, dx: Array) -> tuple[Array, Array]:
        """The nearest state on the constraints."""
        raise NotImplementedError

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is no loop but that of Python, whatever `native` says."""
        self.times, self.steps, self.evaluations = times, 0, 0
        self.x, self.dx = np.full((2, len(times), len(self.start[0])), np.nan)
        self.x[0], self.dx[0] = self.start

    def run(self) -> None:
        with np.errstate(all="ignore"):  # what is not finite is found afterwards
            if self.choice.integrator not in ADAPTIVE:
                self._run_fixed()
            elif self.times[-1] != self.times[0]:
                try:
                    self.steps = self._adapt(*self.choice.tolerances(*self.tolerances))
                except StepFailure as error:
                    raise RunFailure(Status.NOT_CONVERGED, f"DOP853 could not continue: {error}") from error

    def _adapt(self, rtol: float, atol: float) -> int:
        """Fill the samples by steps of its own choice, and count those."""
        return resolve_name(ADAPTIVE[self.choice.integrator])(  # type: ignore[no-any-return]
            self.stabilized, self.times, self.x, self.dx, rtol, atol, kinks=self.mechanism.kinks
        )[0]

    def _run_fixed(self) -> None:
        x, dx = self.start
        for begin, count, h, last, row in stretches(self.times, self.choice.step, self.mechanism.kinks):
            x, dx = self._advance(begin, x, dx, h, count, last)
            if not np.isfinite(x).all():
                raise RunFailure(Status.NAN, f"not finite at t = {begin + count * h:.6g} s; a smaller step may help")
            if row is not None:
                self.x[row], self.dx[row] = x, dx
            self.steps += count

    def _advance(self, begin: float, x: Array, dx: Array, h: float, count: int, last: float) -> tuple[Array, Array]:
        """The state after `count` steps of h [s]; accelerations after `last` [s] are those of that time."""
        step, rate = STEPS[self.choice.integrator], held_back(self.stabilized, last)
        for i in range(count):
            t = begin + i * h
            x, dx = step(rate, t, x, dx, h)
            if self.choice.stabilization == "projection":
                x, dx = self.project(t + h, x, dx)
        return x, dx


class CompiledSteps:
    """A model that is stepped from sample to sample by compiled code, in place.

    Attributes:
        start: coordinates and rates (n,) at the beginning.
        note: a remark on every run.
    """

    choice: Choice
    start: tuple[Array, Array]
    note: str

    def advance(self, x: Array, dx: Array, t: float, h: float, count: int) -> None:
        """Take `count` steps of h [s] from t, in place."""
        raise NotImplementedError

    def motion(self, t: Array, x: Array, dx: Array) -> tuple[Array, Array, Array]:
        """q, v, a (k, n) of the linkage at states (k, n)."""
        raise NotImplementedError

    def prepare(self, times: Array, native: bool = True) -> None:
        """There is only the compiled loop, whatever `native` says."""
        self.times, self.plan = times, step_counts(times, self.choice.step)
        self.x, self.dx = np.full((2, len(times), len(self.start[0])), np.nan)
        self.x[0], self.dx[0] = self.start

    def run(self) -> None:
        for k, (count, h) in enumerate(self.plan):
            self.x[k + 1], self.dx[k + 1] = self.x[k], self.dx[k]
            self.advance(self.x[k + 1], self.dx[k + 1], float(self.times[k]), h, count)

    def read(self) -> Trajectory:
        reached = finite(self.x, self.dx)
        known = self.motion(self.times[:reached], self.x[:reached], self.dx[:reached])
        q, v, a = np.full((3, len(self.times), known[0].shape[1]), np.nan)
        q[:reached], v[:reached], a[:reached] = known
        steps = sum(count for count, _ in self.plan)
        return Trajectory(self.times, q, v, a, steps, EVALUATIONS[self.choice.integrator] * steps, self.note)
