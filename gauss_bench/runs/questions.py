"""Questions that are asked of a model in its own process, before it runs (`Request.ask`).

They are sent by name to the process of an engine, whose environment may have numpy alone: nothing here imports more.
"""

import platform
from dataclasses import replace
from pkgutil import resolve_name

import numpy as np

from gauss_bench.engines.base import Model, ask
from gauss_bench.integrate.fixed_step import Tableau, explicit_step
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure

SHIFT = 1e-14  # relative change of a start by which rounding is measured
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


def run_before(times: Array, model: Model) -> None:
    """Let a model run over the times (k,) before it is measured."""
    model.prepare(times)
    model.run()
    model.read()


def follow_accelerations(tableau: Tableau, times: Array, q0: Array, v0: Array, model: Model, finer: int = SUBSTEPS) -> Array:
    """Return the motion (3, k, n), q, v and a, at the times (k,) [s] by a model's own accelerations from the state q0, v0 (n,).

    Args:
        finer: number of steps from time to time.
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
