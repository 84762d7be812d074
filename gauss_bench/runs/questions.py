"""Questions that are asked of a model in its own process, before it runs (`Request.ask`).

They are sent by name to the process of an engine, whose environment may have numpy alone: nothing here imports more.
"""

import numpy as np

from gauss_bench.engines.base import Model, ask
from gauss_bench.integrate.fixed_step import Tableau, explicit_step
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure

FINER = 5  # steps between two times of `follow_accelerations`, where no loop is stiff


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


def follow_accelerations(tableau: Tableau, times: Array, q0: Array, v0: Array, model: Model, finer: int = FINER) -> Array:
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
