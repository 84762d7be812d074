"""The differences between MuJoCo's releases; only this file deals with them.

up to 3.9:      The arguments of mj_fullM after the model are the matrix and data.qM; in later releases, data and the matrix.
before 4.0:     There is no integrator `discrete`.
before 3.2.7:   The equality `connect` joins bodies only, not sites.
before 3.1:     A diverging run is always reset to its start, because no flag prevents that.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status


def compile_document(mujoco: Any, text: str) -> Any:
    """Return the model of an MJCF document whose loops are closed between sites.

    Raises:
        RunFailure: MuJoCo cannot compile the document, or the release has no closures between sites (status SKIP).
    """
    try:
        return mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        if "attribute: 'site1'" in str(error):
            message = f"MuJoCo {mujoco.__version__} has no equality `connect` between sites, which closes loops here"
            raise RunFailure(Status.SKIP, message) from error
        raise RunFailure(Status.ERROR, f"MuJoCo cannot compile the model: {error}") from error


def mass_matrix(mujoco: Any, model: Any, data: Any) -> Array:
    """Return the mass matrix (n, n) at the state at which `data` was evaluated last."""
    M = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, M)
    except TypeError:  # a release up to 3.9
        mujoco.mj_fullM(model, M, data.qM)
    return M


def find_integrator(mujoco: Any, name: str) -> Any:
    """Return the member of mjtIntegrator for the name of an integrator, such as rk4 or Euler; a RunFailure if there is none."""
    member = f"mjINT_{name.upper()}"
    if not hasattr(mujoco.mjtIntegrator, member):
        raise RunFailure(Status.SKIP, f"MuJoCo {mujoco.__version__} has no {member}")
    return getattr(mujoco.mjtIntegrator, member)


def disable(mujoco: Any, model: Any, flags: Iterable[str]) -> None:
    """Disable features, given by members of mjtDisableBit; members that a release does not have are ignored."""
    for name in flags:
        if hasattr(mujoco.mjtDisableBit, name):
            model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, name))
