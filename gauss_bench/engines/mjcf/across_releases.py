"""The differences between MuJoCo's releases that the adapter must bridge; they stand here alone.

The adapter is written for the newest release. Older ones differ in this:

    up to 3.9      mj_fullM takes the matrix and data.qM; now it takes the data and the matrix
    before 3.7     stiffness and damping are numbers; now they are polynomials
    before 4.0     there is no integrator `discrete`
    before 3.3.1   elements of a specification do not know their index in the model
    before 3.2.7   there is no MjSpec, or one whose elements are added without properties: only documents can be read
    before 3.1     a diverging run is always reset to its start, as there is no flag against it
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status


def new_spec(mujoco: Any) -> Any:
    """Return an empty specification whose angles are in radians.

    Raises:
        RunFailure: the release has none whose elements can be added with their properties, which was new in 3.2.7 at the latest.
    """
    spec: Any = mujoco.MjSpec() if hasattr(mujoco, "MjSpec") else None
    if not hasattr(spec, "compiler"):
        raise RunFailure(Status.SKIP, f"MuJoCo {mujoco.__version__} has no MjSpec of the kind by which models are built here")
    spec.compiler.degree = False
    return spec


def index_of(mujoco: Any, model: Any, kind: str, element: Any) -> int:
    """Return the index of a named element in a compiled model; `kind` is a member of mjtObj."""
    return int(mujoco.mj_name2id(model, getattr(mujoco.mjtObj, kind), element.name))


def set_spring(item: Any, k: float, c: float) -> None:
    """Set the stiffness and damping of a joint or tendon; the higher coefficients of a polynomial are zero."""
    is_polynomial = np.ndim(item.stiffness) > 0
    item.stiffness, item.damping = ([k, 0.0, 0.0], [c, 0.0, 0.0]) if is_polynomial else (k, c)


def mass_matrix(mujoco: Any, model: Any, data: Any) -> Array:
    """Return the mass matrix (n, n) at the state that was evaluated last."""
    M = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, M)
    except TypeError:
        mujoco.mj_fullM(model, M, data.qM)
    return M


def find_integrator(mujoco: Any, name: str) -> Any:
    """Return an integrator of mjtIntegrator.

    Raises:
        RunFailure: the release does not have it.
    """
    return _find(mujoco, mujoco.mjtIntegrator, name)


def _find(mujoco: Any, kinds: Any, name: str) -> Any:
    found = getattr(kinds, name, None)
    if found is None:
        raise RunFailure(Status.SKIP, f"MuJoCo {mujoco.__version__} has no {name}")
    return found


def disable(mujoco: Any, model: Any, flags: Iterable[str]) -> None:
    """Disable features of a model, named as in mjtDisableBit; one that a release does not name cannot be disabled there."""
    for name in flags:
        if hasattr(mujoco.mjtDisableBit, name):
            model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, name))
