"""Questions that are asked of a model in its own process, before it runs (`Request.ask`).

They are sent by name to the process of an engine, whose environment may have numpy alone: nothing here imports more.
"""

import platform
from dataclasses import dataclass, replace
from functools import partial
from pkgutil import resolve_name

import numpy as np

from gauss_bench.engines.base import Model, ask
from gauss_bench.integrate.fixed_step import Tableau, explicit_step
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import SIZE
from gauss_bench.metrics import compare_joint_forces
from gauss_bench.runs.one_run import Asked
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, RunFailure, Trajectory, spread_evenly

SHIFT = 1e-14  # relative change of a start by which rounding is measured
FORCED = 20  # states at which an engine is asked for its own joint forces
SUBSTEPS = 5  # steps between two times of `follow_accelerations`, where no loop is stiff


def accelerations(t: Array, q: Array, v: Array, model: Model) -> Array:
    """Ask a model for accelerations (k, n) at states t (k,), q, v (k, n)."""
    return np.array([model.acceleration(*state) for state in zip(t, q, v, strict=True)])


def joint_forces(names: tuple[str, ...], t: Array, q: Array, v: Array, model: Model) -> Array:
    """Ask a model for its own joint forces (k, joints, 3) at states t (k,), q, v (k, n); NaN where it tells none.

    Of each joint they are fx, fy [N] on its second link, and the moment [N m] about its point.
    """
    found = np.full((len(t), len(names), 3), np.nan)
    for forces, *state in zip(found, t, q, v, strict=True):
        try:
            told = ask(model, "joint_forces")(*state)
        except RunFailure:
            continue
        for row, name in zip(forces, names, strict=True):
            if name in told:
                row[:] = told[name]
    return found


@dataclass(frozen=True, eq=False)
class ForceQuestion:
    """The question for an engine's own joint forces at some states of a motion, and the comparison of its answer.

    Attributes:
        mechanism: the linkage; states: of the motion, with the linkage's own accelerations.
    """

    mechanism: Mechanism
    states: Trajectory

    @property
    def ask(self) -> Asked:
        """The question, for `Request`."""
        names = tuple(joint.name for joint in self.mechanism.joints)
        return partial(joint_forces, names, self.states.t, self.states.q, self.states.v)

    @property
    def answers(self) -> int:
        """The count of numbers in the answer."""
        return SIZE * len(self.mechanism.joints) * len(self.states.t)

    def compare(self, answer: object) -> tuple[float, float]:
        """Return the largest error of the forces in an answer, and the largest force [N, N m]; NaN where the engine tells none."""
        shape = (len(self.states.t), len(self.mechanism.joints), 3)
        if not isinstance(answer, np.ndarray) or answer.shape != shape:
            return np.nan, np.nan
        return compare_joint_forces(Evaluator(self.mechanism), self.states, answer)


def ask_along(mechanism: Mechanism, reference: Reference) -> ForceQuestion:
    """Return the question at FORCED states of a reference, evenly spread over those whose accelerations it knows."""
    known = np.flatnonzero(np.isfinite(reference.a).all(axis=1))
    return ForceQuestion(mechanism, reference.samples[known[spread_evenly(len(known), FORCED)]])


def run_before(times: Array, model: Model) -> None:
    """Let a model run over the times (k,) before it is measured."""
    model.prepare(times)
    model.run()
    model.read()


def follow_accelerations(tableau: Tableau, times: Array, q0: Array, v0: Array, model: Model, finer: int = SUBSTEPS) -> Array:
    """Return the motion (3, k, n), q, v and a, at the times (k,) [s] by a model's own accelerations from the state q0, v0 (n,).

    Args:
        finer: number of steps between two consecutive times.
    """
    q, v, samples = q0, v0, []
    for t, end in zip(times.tolist(), [*times[1:].tolist(), None], strict=True):
        samples.append((q, v, model.acceleration(t, q, v)))
        if end is not None:
            h = (end - t) / finer
            for k in range(finer):
                q, v = explicit_step(tableau, model.acceleration, t + k * h, q, v, h)
    return np.array(samples).transpose(1, 0, 2)


def ask_room(place: str, *arguments: object) -> object:
    """Return what a function of an engine's folder answers; `place` is MODULE:FUNCTION, and the answer is plain data."""
    return resolve_name(place)(*arguments)


def describe_python() -> dict[str, str]:
    """Return the versions of this process's Python and numpy."""
    return {"python": platform.python_version(), "numpy": np.__version__}


def shift(x: Array, rng: np.random.Generator) -> Array:
    """Return numbers changed by up to SHIFT of the largest of them; zeros of a state at rest stay zero."""
    return np.asarray(x + SHIFT * np.abs(x).max(initial=0.0) * rng.uniform(-1.0, 1.0, x.shape) * (x != 0))


def shift_start(seed: int, mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose start is changed by SHIFT."""
    rng = np.random.default_rng(seed)
    return replace(mechanism, q0=shift(mechanism.q0, rng), v0=shift(mechanism.v0, rng))
