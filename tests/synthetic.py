"""Clocks, engines and kernels whose costs and errors are known, so that what a measurement makes of them is known too."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gauss_bench.bench import survived
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, Model
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs import apart
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory

NANO = 1e-9


class Clock:
    """The processor's time as code reads it: what was spent, and IDLE where nothing was spent since the last reading."""

    IDLE = 5e-3  # [s] longer than a block, so that work of no known cost is done once

    def __init__(self) -> None:
        self.now, self.spent, self.stopped = 0, False, False
        self.slower = 1.0  # times as long as everything takes

    def spend(self, seconds: float) -> None:
        self.now, self.spent = self.now + round(self.slower * seconds / NANO), True

    def read(self) -> int:
        """Nanoseconds."""
        self.now += 0 if self.spent or self.stopped else round(self.IDLE / NANO)
        self.spent = False
        return self.now


class Here:
    """What stands in for a worker: its work is done in this process."""

    def __enter__(self) -> "Here":
        return self

    def __exit__(self, *_: object) -> None: ...

    def call(self, function: Callable[..., Any], arguments: tuple[Any, ...], limit: float, longest: float) -> Any:
        return function(*arguments)


def clocked(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """A clock in the place of the processor's, in this process, where races are run too."""
    clock = Clock()
    monkeypatch.setattr(survived, "Worker", Here)
    monkeypatch.setattr(time, "process_time_ns", clock.read)
    monkeypatch.setattr(time, "process_time", lambda: clock.read() * NANO)
    return clock


def charge(monkeypatch: pytest.MonkeyPatch, clock: Clock, owner: type, method: str, cost: Callable[..., float]) -> None:
    """Let every call of owner.method also spend cost(*arguments) seconds; the call itself takes no time."""
    true = getattr(owner, method)

    def charged(self: Any, *arguments: Any, **options: Any) -> Any:
        found = true(self, *arguments, **options)
        clock.spend(cost(*arguments, **options))
        return found

    monkeypatch.setattr(owner, method, charged)


def rolled(per_step: float) -> Callable[..., float]:
    """The cost of kernel.rollout(q, v, h, steps, ...): `per_step` [s] for each step of each trajectory."""
    return lambda q, v, h, n, *rest, **options: n * len(np.atleast_2d(q)) * per_step


@dataclass(frozen=True)
class Costs:
    """Seconds of a synthetic engine: to build, for a step from Python and in its own loop, an acceleration, and an empty call."""

    build: float = 5e-3
    step: float = 7e-6
    native_step: float = 3e-6
    acceleration: float = 2e-6
    call: float = 0.5e-6


class SyntheticModel:
    """Stays at its start at known costs, or runs another model and errs by known amounts.

    Attributes:
        true: whose motion is told; none stays at the start.
        off_acceleration: relative, on every acceleration at a given state.
        off_position: [rad] of the crank at every sample, times (step / 1e-3 s) to the power of `order`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        choice: Choice,
        clock: Clock,
        costs: Costs,
        true: Model | None = None,
        off_acceleration: float = 0.0,
        off_position: float = 0.0,
        order: float = 0.0,
    ):
        self.mechanism, self.choice, self.clock, self.costs, self.true = mechanism, choice, clock, costs, true
        self.off_acceleration, self.off_position = off_acceleration, off_position * (choice.step / 1e-3) ** order

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        self.clock.spend(self.costs.acceleration)
        return (1 + self.off_acceleration) * self.true.acceleration(t, q, v) if self.true else np.zeros_like(q)

    def prepare(self, times: Array, native: bool = True) -> None:
        self.times, self.native = times, native
        if self.true:
            self.true.prepare(times, native)

    def run(self) -> None:
        self.steps = round((self.times[-1] - self.times[0]) / self.choice.step)
        if self.true:
            self.true.run()
        self.clock.spend(self.steps * (self.costs.native_step if self.native else self.costs.step))

    def read(self) -> Trajectory:
        still = np.tile(self.mechanism.q0, (len(self.times), 1))
        found = self.true.read() if self.true else Trajectory(self.times, still, 0 * still, 0 * still, self.steps)
        q = found.q.copy()
        q[1:, 3 * (self.mechanism.crank or 0) + 2] += self.off_position
        return Trajectory(found.t, q, found.v, found.a, self.steps)

    def batch(self, q: Array, v: Array, count: int) -> Callable[[], Array]:
        def go() -> Array:
            self.clock.spend(len(q) * count * self.costs.native_step)
            return np.zeros((len(q), 2, q.shape[1]))

        return go

    def bare_calls(self) -> tuple[Callable[[], Array], Callable[[], Array]]:
        nothing = np.zeros(self.mechanism.n)

        def spending(seconds: float) -> Callable[[], Array]:
            def go() -> Array:
                self.clock.spend(seconds)
                return nothing

            return go

        return spending(self.costs.acceleration), spending(self.costs.call)


def replace_engine(monkeypatch: pytest.MonkeyPatch, name: str, clock: Clock, costs: Costs = Costs(), **errors: Any) -> None:
    """Let an engine build synthetic models; with truth=NAME they move as that engine's do, but for the errors given."""
    truth, true = errors.pop("truth", None), type(get(name)).build

    def build(self: Any, mechanism: Mechanism, choice: Choice) -> Model:
        if self.name != name:  # an engine of the same class
            return true(self, mechanism, choice)
        clock.spend(costs.build)
        same = Choice("default", "rk4", choice.stabilization, choice.step)
        return SyntheticModel(mechanism, choice, clock, costs, get(truth).build(mechanism, same) if truth else None, **errors)

    monkeypatch.setattr(type(get(name)), "build", build)
    monkeypatch.setattr(apart, "is_isolated", lambda _: False)  # what stands in for it is known in this process alone
