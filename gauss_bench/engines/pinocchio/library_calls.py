"""One right-hand side by Pinocchio alone: its two algorithms for constrained trees.

constraintDynamics runs at the settings "default". lcaba is of Sathya and Carpentier, Constrained articulated body dynamics
algorithms (2024); its penalty and accuracy are the best trade found: tighter ones cost more and gain nothing.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice
from gauss_bench.engines.pinocchio.adapter import PinocchioModel
from gauss_bench.engines.shared import LibraryCall
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array

LCABA = {"mu": 1e-4, "accuracy": 1e-10, "iterations": 20}


def constraint_dynamics(mechanism: Mechanism, q: Array, v: Array) -> LibraryCall:
    model = PinocchioModel(mechanism, Choice())
    y, dy = model.tree.relative(q, v)
    return _asked(model, y, dy, model.plain.bare(y, dy))


def lcaba(mechanism: Mechanism, q: Array, v: Array) -> LibraryCall:
    """With data of its own: those that constraintDynamics has used lead it astray."""
    model = PinocchioModel(mechanism, Choice())
    y, dy = model.tree.relative(q, v)
    pin, tree, rows = model.pin, model.plain.model, model.plain.rows
    data, row_data = tree.createData(), pin.StdVec_RigidConstraintData()
    for row in rows:
        row_data.append(row.createData())
    pin.computeJointMinimalOrdering(tree, data, rows)
    prox = pin.ProximalSettings(LCABA["accuracy"], LCABA["accuracy"], LCABA["mu"], int(LCABA["iterations"]))
    tau = np.ascontiguousarray(model.forces(y, dy))
    return _asked(model, y, dy, lambda: pin.lcaba(tree, data, y, dy, tau, rows, row_data, prox))


def _asked(model: PinocchioModel, y: Array, dy: Array, call: Callable[[], Any]) -> LibraryCall:
    return LibraryCall(call, model.tree.absolute(y, dy, np.array(call()))[2])


CALLS = {"constraintDynamics": constraint_dynamics, "lcaba": lcaba}
