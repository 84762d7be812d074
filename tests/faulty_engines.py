"""Adapters that each break one rule of engines; the rest is our own formulation."""

from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from gauss_bench.engines.base import Choice, Model
from gauss_bench.engines.interpreted import Interpreted, InterpretedModel
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, Terms
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


class Altered(Sound):
    """What is solved is not what the linkage says: an adapter that spoils the terms at a state, or the linkage that is modelled."""

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        model = InterpretedModel("gauss", self.modelled(mechanism), choice)
        plain = model.evaluator.terms
        model.evaluator.terms = lambda t, q, v: self.terms(plain(t, q, v))  # type: ignore[method-assign]
        return Wrapped(self, model)

    def terms(self, terms: Terms) -> Terms:
        return terms


def with_links(mechanism: Mechanism, **factors: float) -> Mechanism:
    links = (replace(x, **{key: getattr(x, key) * factor for key, factor in factors.items()}) for x in mechanism.links)
    return replace(mechanism, links=tuple(links))


class OneInertia(Altered):
    def modelled(self, mechanism: Mechanism) -> Mechanism:
        first, *others = mechanism.links
        return replace(mechanism, links=(replace(first, inertia=1.01 * first.inertia), *others))


class AllInertias(Altered):
    def modelled(self, mechanism: Mechanism) -> Mechanism:
        return with_links(mechanism, inertia=1.01)


class AllMasses(Altered):
    def modelled(self, mechanism: Mechanism) -> Mechanism:
        return with_links(mechanism, mass=1.01)


class Gravity(Altered):
    """9.80665 where a file says 9.81, and in proportion where it says another."""

    def modelled(self, mechanism: Mechanism) -> Mechanism:
        return replace(mechanism, gravity=mechanism.gravity * (9.80665 / 9.81))


class Gamma(Altered):
    def terms(self, terms: Terms) -> Terms:
        return replace(terms, gamma=1.01 * terms.gamma)


class Entry(Altered):
    """One entry of the Jacobian, a thousandth too large."""

    def terms(self, terms: Terms) -> Terms:
        J = terms.J.copy()
        J[1, 2] *= 1.001
        return replace(terms, J=J)


class Excused(AllInertias):
    """Declares its loops soft, which they are not, to hide inertias."""

    soft: ClassVar = {"default": "an excuse that is long enough to be read"}


class Regular(Altered):
    """Constraint forces are regularised, J a = gamma + e lambda, and nothing says so."""

    def asked(self, model: Any, t: float, q: Array, v: Array) -> Array:
        return compliant(model.evaluator.terms(t, q, v))


class Springs(Regular):
    """The same, as declared; it runs by these accelerations."""

    stabilizations = ("none",)
    soft: ClassVar = {"default": "constraint forces are regularised by half a kilogram"}

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        wrapped = super().build(mechanism, choice)
        wrapped.model.stabilized = partial(self.asked, wrapped.model)
        return wrapped


def compliant(terms: Terms) -> Array:
    n, m = terms.J.shape[1], len(terms.J)
    K = np.block([[terms.M, terms.J.T], [terms.J, -0.01 * np.eye(m)]])
    return np.asarray(np.linalg.solve(K, np.concatenate([terms.Q, terms.gamma]))[:n])


class Hasty(Sound):
    """Declares that its only settings stop before the end."""

    unfinished: ClassVar = {"default": "there is no time for more than a guess"}


class Trap(Sound):
    """Sound under its defaults; the second settings negate accelerations, the second integrator raises."""

    integrators = ("rk4", "other")
    settings: ClassVar = {"default": dict[str, Any](), "tuned": {"x": 1}}

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        return Trapped(self, Interpreted("gauss").build(mechanism, replace(choice, settings="default", integrator="rk4")), choice)


class Trapped(Wrapped):
    def __init__(self, adapter: Sound, model: Model, choice: Choice):
        super().__init__(adapter, model)
        self.choice = choice

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return super().acceleration(t, q, v) * (-1 if self.choice.settings == "tuned" else 1)

    def run(self) -> None:
        if self.choice.integrator == "other":
            raise AttributeError("no such method")
        super().run()


class TwoFaced(Sound):
    """Answers for the linkage that is asked about, and runs another."""

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        runs = super().build(with_links(mechanism, inertia=1.01), choice)
        answers = Interpreted("gauss").build(mechanism, choice)
        runs.acceleration = answers.acceleration
        return runs


class Deaf(Sound):
    """Chooses its steps by a tolerance of its own, whatever is asked for."""

    integrators, stabilizations = ("dop853",), ("none",)

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        return super().build(mechanism, replace(choice, tolerance=1e-4))


class Fixed(Altered):
    """The inertia of one link stands in the code, as it is in one file."""

    def modelled(self, mechanism: Mechanism) -> Mechanism:
        return replace(mechanism, links=tuple(replace(x, inertia=0.023) if x.name == "rod" else x for x in mechanism.links))
