"""Functions that are called with an engine's model, in the engine's process, before the model runs (`Request.ask`).

The engine's process gets only the function's name and imports this file; it may have no package but numpy.
"""

import platform
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pkgutil import resolve_name

import numpy as np

from gauss_bench.engines.base import Model, ask
from gauss_bench.integrate.fixed_step import Tableau, explicit_step
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import compare_joint_forces
from gauss_bench.runs.one_run import Asked
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, RunFailure, Trajectory, spread_evenly

SHIFT = 1e-14  # relative change of a start, to show the effect of rounding errors
COMPONENTS = 3  # of a joint force: fx, fy and the moment
FORCED = 20  # states at which an engine is asked for its own joint forces
SUBSTEPS = 5  # steps between two times in `follow_accelerations`, enough unless loops are stiff


def accelerations(t: Array, q: Array, v: Array, model: Model) -> Array:
    """Return a model's accelerations (k, n) at states t (k,), q, v (k, n)."""
    return np.array([model.acceleration(*state) for state in zip(t, q, v, strict=True)])


def joint_forces(names: tuple[str, ...], t: Array, q: Array, v: Array, model: Model) -> Array:
    """Return the joint forces (k, joints, 3) that the engine's model itself reports at states t (k,), q, v (k, n).

    They are the forces fx, fy [N] on the joint's second link and the moment [N m] about its point; NaN if the model reports none.
    """
    forces = np.full((len(t), len(names), COMPONENTS), np.nan)
    for k, state in enumerate(zip(t, q, v, strict=True)):
        with suppress(RunFailure):
            reported = ask(model, "joint_forces")(*state)
            for joint, name in enumerate(names):
                if name in reported:
                    forces[k, joint] = reported[name]
    return forces


@dataclass(frozen=True, eq=False)
class ForceQuestion:
    """A question to an engine for the joint forces that it computes at some states of a motion, and the check of its answer.

    The `states` have the accelerations of the suite's own equations.
    """

    mechanism: Mechanism
    states: Trajectory

    @property
    def ask(self) -> Asked:
        """The function of the model that returns the forces, for `Request.ask`."""
        names = tuple(joint.name for joint in self.mechanism.joints)
        return partial(joint_forces, names, self.states.t, self.states.q, self.states.v)

    @property
    def answers(self) -> int:
        """The number of elements of the engine's answer, for `Request.answers`."""
        return COMPONENTS * len(self.mechanism.joints) * len(self.states.t)

    def compare(self, answer: object) -> tuple[float, float]:
        """Return the largest error of an answer's joint forces, and the largest true joint force [N, N m]; NaN if it has none."""
        shape = (len(self.states.t), len(self.mechanism.joints), COMPONENTS)
        if not isinstance(answer, np.ndarray) or answer.shape != shape:
            return np.nan, np.nan
        return compare_joint_forces(Evaluator(self.mechanism), self.states, answer)


def ask_along(mechanism: Mechanism, reference: Reference) -> ForceQuestion:
    """Return the question that asks an engine for its joint forces at some states of a reference motion.

    The states, at most FORCED, are evenly spread over those whose accelerations are known.
    """
    known = np.flatnonzero(np.isfinite(reference.a).all(axis=1))
    return ForceQuestion(mechanism, reference.samples[known[spread_evenly(len(known), FORCED)]])


def run_before(times: Array, model: Model) -> None:
    """Run a model over the times (k,) [s] once before its proper run, to check that a model can run again from its start."""
    model.prepare(times)
    model.run()
    model.read()


def follow_accelerations(tableau: Tableau, times: Array, q0: Array, v0: Array, model: Model, finer: int = SUBSTEPS) -> Array:
    """Return the motion that follows from a model's own accelerations: q, v and a (3, k, n) at the times (k,) [s].

    Args:
        tableau: of the explicit method that integrates the motion.
        q0, v0: the state (n,) at the first time.
        finer: number of steps between two consecutive times.
    """
    q, v = q0, v0
    samples = [(q, v, model.acceleration(float(times[0]), q, v))]
    for t, end in pairwise(times.tolist()):
        h = (end - t) / finer
        for k in range(finer):
            q, v = explicit_step(tableau, model.acceleration, t + k * h, q, v, h)
        samples.append((q, v, model.acceleration(end, q, v)))
    return np.array(samples).transpose(1, 0, 2)


def call_by_name(place: str, *arguments: object) -> object:
    """Call the function of an engine's folder that `place` names as MODULE:FUNCTION; return its result, which is plain data."""
    return resolve_name(place)(*arguments)


def describe_python() -> dict[str, str]:
    """Return the versions of this process's Python and numpy."""
    return {"python": platform.python_version(), "numpy": np.__version__}


def shift(x: Array, rng: np.random.Generator) -> Array:
    """Return x with each number changed at random by up to SHIFT times the largest |x|; zeros (a state at rest) stay zero."""
    return np.asarray(x + SHIFT * np.abs(x).max(initial=0.0) * rng.uniform(-1.0, 1.0, x.shape) * (x != 0))


def shift_start(seed: int, mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose start is changed at random by `shift`."""
    rng = np.random.default_rng(seed)
    return replace(mechanism, q0=shift(mechanism.q0, rng), v0=shift(mechanism.v0, rng))
