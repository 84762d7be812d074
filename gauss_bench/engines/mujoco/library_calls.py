"""One evaluation of the right-hand side by MuJoCo alone: mj_forward, with sparse and with dense Jacobians.

The closures have MuJoCo's default softness, which causes most of the error of the accelerations. Features that the model does not
use are off. The tree has the least depth: with a deep tree, the cost of a chain of N loops grows with N^2 instead of N.
"""

from functools import partial

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.adapter import MujocoModel
from gauss_bench.engines.shared import LibraryCall
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array


def prepare_forward(jacobian: str, mechanism: Mechanism, q: Array, v: Array) -> LibraryCall:
    """Return a call of mj_forward at a state q, v (n,), with sparse or dense matrices (`jacobian` "SPARSE" or "DENSE")."""
    built = MujocoModel(mechanism, Choice("lean/rk4", "rk4"))
    mujoco, model = built.mujoco, built.model
    model.opt.jacobian = getattr(mujoco.mjtJacobian, f"mjJAC_{jacobian}")
    data = mujoco.MjData(model)
    y, dy = built.tree.relative(q, v)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = y, dy, built.torque
    mujoco.mj_forward(model, data)
    return LibraryCall(lambda: mujoco.mj_forward(model, data), built.tree.absolute(y, dy, np.array(data.qacc)).a)


CALLS = {"sparse": partial(prepare_forward, "SPARSE"), "dense": partial(prepare_forward, "DENSE")}
