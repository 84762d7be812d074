"""Adapters that each break one rule of engines; the rest is our own formulation."""

from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, Model
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Trajectory


class Sound:
    """An adapter that keeps every rule, to be spoilt."""

    integrators, stabilizations, settings = ("rk4",), ("none", "projection"), {"default": dict[str, Any]()}
    native_loop, python_loop = False, True

    def __init__(self) -> None:
        self.name = type(self).__name__

    def version(self) -> str:
        return f"{self.name} 1"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return None

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        return Wrapped(self, Interpreted("gauss").build(self.modelled(mechanism), choice))

    def modelled(self, mechanism: Mechanism) -> Mechanism:
        return mechanism

    def told(self, x: Trajectory) -> Trajectory:
        return x

    def asked(self, model: Model, t: float, q: Array, v: Array) -> Array:
        return model.acceleration(t, q, v)


class Wrapped:
    """A model whose adapter may touch what goes out."""

    def __init__(self, adapter: Sound, model: Model) -> None:
        self.adapter, self.model, self.ran = adapter, model, 0

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self.adapter.asked(self.model, t, q, v)

    def prepare(self, times: Array, native: bool = True) -> None:
        self.model.prepare(times, native)

    def run(self) -> None:
        self.ran += 1
        self.model.run()

    def read(self) -> Trajectory:
        x = self.adapter.told(self.model.read())
        return replace(x, q=x.q + 1e-6 * (self.ran - 1)) if isinstance(self.adapter, Remembers) else x


class Remembers(Sound):
    """A run begins where the last one left something."""


class Degrees(Sound):
    def told(self, x: Trajectory) -> Trajectory:
        q = x.q.copy()
        q[:, 2::3] = np.degrees(q[:, 2::3])
        return replace(x, q=q)


class Late(Sound):
    """Velocities are those of the step before."""

    def told(self, x: Trajectory) -> Trajectory:
        return replace(x, v=np.vstack([x.v[:1], x.v[:-1]]))


class Short(Sound):
    def told(self, x: Trajectory) -> Trajectory:
        return replace(x, t=x.t[:-1], q=x.q[:-1], v=x.v[:-1], a=x.a[:-1])


class Weightless(Sound):
    """No force but gravity acts."""

    def modelled(self, mechanism: Mechanism) -> Mechanism:
        return replace(mechanism, forces=())


class Unsure(Sound):
    """Asked for accelerations, it has none."""

    def asked(self, model: Model, t: float, q: Array, v: Array) -> Array:
        return np.full_like(q, np.nan)
