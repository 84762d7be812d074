"""Adapters that each break one rule of engines; the rest is our own formulation."""

import os
import pickle
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gauss_bench.diagnosis.checks import alter
from gauss_bench.engines.base import Choice, Model
from gauss_bench.engines.interpreted import Interpreted, InterpretedModel
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles
from gauss_bench.metrics import joint_forces
from gauss_bench.terms import Array, Terms
from gauss_bench.trajectory import RunFailure, Status, Trajectory


def same(x: Any) -> Any:
    return x


class Sound:
    """An adapter that keeps every rule; subclasses spoil the linkage that it models, the terms that it solves or its trajectory."""

    integrators, stabilizations, settings = ("rk4",), ("none", "projection"), {"default": dict[str, Any]()}
    native_loop, python_loop = False, True
    modelled: Callable[[Mechanism], Mechanism] = staticmethod(same)
    terms: Callable[[Terms], Terms] = staticmethod(same)
    told: Callable[[Trajectory], Trajectory] = staticmethod(same)

    def __init__(self) -> None:
        self.name = type(self).__name__

    def version(self) -> str:
        return f"{self.name} 1"

    def skip(self, mechanism: Mechanism, choice: Choice) -> str | None:
        return None

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        model = InterpretedModel("gauss", self.modelled(mechanism), choice)
        plain = model.evaluator.terms
        model.evaluator.terms = lambda t, q, v: self.terms(plain(t, q, v))  # type: ignore[method-assign]
        return Wrapped(self, model)

    def asked(self, model: Any, t: float, q: Array, v: Array) -> Array:
        return np.asarray(model.acceleration(t, q, v))


class Wrapped:
    """A model whose adapter may change its accelerations and its trajectory."""

    def __init__(self, adapter: Sound, model: Model, choice: Choice | None = None) -> None:
        self.adapter, self.model, self.choice, self.ran = adapter, model, choice, 0

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
    """Every run adds an error to the positions of later runs."""


def in_degrees(x: Trajectory) -> Trajectory:
    q = x.q.copy()
    angles(q)[...] = np.degrees(angles(q))
    return replace(x, q=q)


def with_links(mechanism: Mechanism, **factors: float) -> Mechanism:
    links = (replace(x, **{key: getattr(x, key) * factor for key, factor in factors.items()}) for x in mechanism.links)
    return replace(mechanism, links=tuple(links))


def with_entry(terms: Terms) -> Terms:
    """Return terms with one entry of the Jacobian a thousandth too large."""
    J = terms.J.copy()
    J[1, 2] *= 1.001
    return replace(terms, J=J)


SPOILT: dict[str, dict[str, Callable[[Any], Any]]] = {
    "Degrees": {"told": in_degrees},
    "Late": {"told": lambda x: replace(x, v=np.vstack([x.v[:1], x.v[:-1]]))},  # velocities are those of the step before
    "Short": {"told": lambda x: replace(x, t=x.t[:-1], q=x.q[:-1], v=x.v[:-1], a=x.a[:-1])},
    "Weightless": {"modelled": lambda x: replace(x, forces=())},  # no force but gravity acts
    "OneInertia": {"modelled": lambda x: alter(x, of=x.links[0].name, inertia=1.01)},
    "AllInertias": {"modelled": partial(with_links, inertia=1.01)},
    "AllMasses": {"modelled": partial(with_links, mass=1.01)},
    "Gravity": {"modelled": partial(alter, gravity=9.80665 / 9.81)},
    "Gamma": {"terms": lambda x: replace(x, gamma=1.01 * x.gamma)},
    "Entry": {"terms": with_entry},
    "Fixed": {  # the inertia of one link stands in the code, as it is in one file
        "modelled": lambda x: replace(x, links=tuple(replace(y, inertia=0.023) if y.name == "rod" else y for y in x.links))
    },
}
globals().update({name: type(name, (Sound,), {k: staticmethod(x) for k, x in parts.items()}) for name, parts in SPOILT.items()})


class Unsure(Sound):
    """Has no accelerations at given states."""

    def asked(self, model: Any, t: float, q: Array, v: Array) -> Array:
        return np.full_like(q, np.nan)


class Excused(Sound):
    """Declares its rigid loops soft, to hide wrong inertias."""

    modelled = staticmethod(partial(with_links, inertia=1.01))
    soft: ClassVar = {"default": "an excuse that is long enough to be read"}


class Regular(Sound):
    """Regularises constraint forces, J a = gamma + e lambda, and does not declare it."""

    def asked(self, model: Any, t: float, q: Array, v: Array) -> Array:
        terms = model.evaluator.terms(t, q, v)
        K = np.block([[terms.M, terms.J.T], [terms.J, -0.01 * np.eye(len(terms.J))]])
        return np.asarray(np.linalg.solve(K, np.concatenate([terms.Q, terms.gamma]))[: len(q)])


class Springs(Regular):
    """Regularises constraint forces, declares it, and runs by these accelerations."""

    stabilizations = ("none",)
    soft: ClassVar = {"default": "constraint forces are regularised by half a kilogram"}

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        wrapped = super().build(mechanism, choice)
        wrapped.model.stabilized = partial(self.asked, wrapped.model)
        return wrapped


class Gammaless(Sound):
    """Leaves out the velocity term of its constraints, and declares soft loops."""

    terms = staticmethod(lambda x: replace(x, gamma=0.0 * x.gamma))
    soft: ClassVar = {"default": "an excuse that is long enough to be read"}


class Hasty(Sound):
    """Declares that its only settings stop before the end."""

    unfinished: ClassVar = {"default": "there is no time for more than a guess"}


class Trap(Sound):
    """Sound under its defaults; the second settings negate accelerations, the second integrator raises."""

    integrators = ("rk4", "other")
    settings: ClassVar = {"default": dict[str, Any](), "tuned": {"x": 1}}

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        model = Interpreted("gauss").build(mechanism, replace(choice, settings="default", integrator="rk4"))
        return Trapped(self, model, choice)


class Trapped(Wrapped):
    choice: Choice

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return super().acceleration(t, q, v) * (-1 if self.choice.settings == "tuned" else 1)

    def run(self) -> None:
        if self.choice.integrator == "other":
            raise AttributeError("no such method")
        super().run()


class TwoFaced(Sound):
    """Returns the accelerations of the given linkage, and runs another linkage."""

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        runs = super().build(with_links(mechanism, inertia=1.01), choice)
        runs.acceleration = Interpreted("gauss").build(mechanism, choice).acceleration
        return runs


class Deaf(Sound):
    """Chooses its steps by a tolerance of its own, and ignores the tolerance of the choice."""

    integrators, stabilizations = ("dop853",), ("none",)

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        return super().build(mechanism, replace(choice, tolerance=1e-4))


class Uncounted(Sound):
    """Sound, but does not count its steps."""

    told = staticmethod(lambda x: replace(x, steps=None))


class Chooser(Uncounted):
    """Chooses its steps, and does not count them."""

    integrators, stabilizations = ("dop853",), ("none",)


class Reacting(Sound):
    """Returns the forces of its joints."""

    sign = 1.0

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        wrapped = super().build(mechanism, choice)
        wrapped.joint_forces = partial(self.react, wrapped)
        return wrapped

    def react(self, model: Any, t: float, q: Array, v: Array) -> dict[str, Array]:
        states = Trajectory(np.array([t]), q[None], v[None], model.acceleration(t, q, v)[None], None)
        found = joint_forces(model.model.evaluator, states)
        return {name: self.sign * np.array([x["fx"][0], x["fy"][0], x["moment"][0]]) for name, x in found.items()}


class Opposed(Reacting):
    """Returns the forces on the first links of its joints, not those on the second links."""

    sign = -1.0


class Dice(Reacting):
    """Returns zero for the forces of its joints, and adds other noise below 1e-9 to the samples of each run."""

    sign = 0.0
    told = staticmethod(lambda x: replace(x, q=x.q + 1e-9 * np.random.default_rng().random()))


class Unprojected(Sound):
    """Sound, without projection: one run is enough for what follows."""

    stabilizations = ("none",)


class Judges(Unprojected):
    """Stands still where it should move, and makes all that it can reach say that the run is good."""

    told = staticmethod(lambda x: replace(x, q=0 * x.q + x.q[0], v=0 * x.v, a=0 * x.a))

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        from gauss_bench import judge, metrics
        from gauss_bench.bench import measure

        good = judge.Judgement()
        for room in (judge, measure):
            vars(room).update(judge=lambda evidence: good, examine=lambda *arguments: None)
        vars(judge).update(completeness=lambda *arguments: good, OFF_DRIFT=np.inf, OFF_ENERGY=np.inf, OFF_MOTION=np.inf)
        nothing = dict.fromkeys(("state_errors", "drift"), lambda *arguments: None)
        vars(metrics).update(nothing, energy_error=lambda evaluator, x: (0 * x.t, 0.0))
        return super().build(mechanism, choice)


class Sender:
    """In the place of what writes answers in the worker: it sends these bytes instead."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        vars(sys.modules["__main__"]).update(json=self, LENGTH=self)

    def dumps(self, item: Any, default: Any) -> "Sender":
        return self

    def encode(self) -> bytes:
        return self.content

    def pack(self, length: int) -> bytes:
        return b""


class Harms:
    """An object whose pickle leaves a file where it is read."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (Path(os.environ["MARK"]),)


class Pickles(Unprojected):
    """Sends a pickle in the place of its answer."""

    def told(self, x: Trajectory) -> Trajectory:
        Sender(pickle.dumps(("ok", Harms())))
        return x


class Floods(Unprojected):
    """Sends 128 MB in the place of its answer."""

    def told(self, x: Trajectory) -> Trajectory:
        Sender(bytes(1 << 27))
        return x


class Fine(Unprojected):
    """Says that it failed well, and has nothing to show."""

    def told(self, x: Trajectory) -> Trajectory:
        raise RunFailure(Status.OK, "all is well")
