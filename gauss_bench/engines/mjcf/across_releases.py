"""The differences between MuJoCo's releases; only this file deals with them.

up to 3.9:      The arguments of mj_fullM are the matrix and data.qM; in later releases they are the data and the matrix.
before 3.7:     Stiffness and damping are numbers; in later releases they are coefficients of polynomials.
before 4.0:     There is no integrator `discrete`.
before 3.3.1:   Elements of a specification do not know their index in the model.
before 3.2.7:   There is no MjSpec, or elements are added to it without properties, so only MJCF documents can be read.
before 3.1:     A diverging run is always reset to its start, because no flag prevents that.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status


def new_spec(mujoco: Any) -> Any:
    """Return an empty MjSpec whose angles are in radians; a RunFailure if the release has no such MjSpec."""
    # the first releases with MjSpec, whose elements are added without properties, have no attribute `compiler`
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
    """Return the member of mjtIntegrator for the name of an integrator, such as rk4 or Euler; a RunFailure if there is none."""
    member = f"mjINT_{name.upper()}"
    if not hasattr(mujoco.mjtIntegrator, member):
        raise RunFailure(Status.SKIP, f"MuJoCo {mujoco.__version__} has no {member}")
    return getattr(mujoco.mjtIntegrator, member)


def disable(mujoco: Any, model: Any, flags: Iterable[str]) -> None:
    """Disable features, members of mjtDisableBit; those that a release does not have are left out."""
    for name in flags:
        if hasattr(mujoco.mjtDisableBit, name):
            model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, name))
