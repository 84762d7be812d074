"""Prescribed motion as an accuracy axis: the torque that drives a turn, by every engine that can, against pure geometry.

The reference needs no integration: positions, velocities and accelerations follow from the law, the torque from virtual work. An
engine's torque and joint forces are worked out here from its own accelerations, so that it cannot grade itself. Over a turn without
losses the mean torque is zero. Where rows are redundant the shortest joint forces are compared.
"""

from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.extras import not_installed
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import build_reference
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory

LINKAGES = ("crank_slider", "four_bar", "parallelogram", "six_bar", "shaper", "eight_bar")
STEP = 1e-3  # [s]
WAYS = (
    ("gauss", "default", "rk4", "projection"),
    ("lagrange", "default", "rk4", "projection"),
    ("pinocchio", "default", "rk4", "projection"),
    ("mujoco", "rigid", "rk4", "none"),
    ("mujoco", "tuned", "rk4", "none"),
    ("mujoco", "default", "rk4", "none"),
    ("exudyn", "tuned", "trapezoidal_index2", "none"),
    ("exudyn", "tuned", "generalized_alpha", "none"),
)


def driving(linkage: str) -> dict[str, Any]:
    """One row for each way to run a driven turn: {"driving": [...]}; a way that fails is a row with a reason."""
    mechanism = load(linkage, "driven")
    evaluator = Evaluator(mechanism)
    reference = build_reference(mechanism, mechanism.duration)
    exact = Trajectory(reference.t, reference.q, reference.v, reference.a, 0)
    forces = metrics.reactions(evaluator, exact)
    return {"driving": [_row(mechanism, evaluator, forces, *way) for way in WAYS]}


def _row(
    mechanism: Mechanism, evaluator: Evaluator, exact: Array, engine: str, settings: str, integrator: str, stabilization: str
) -> dict[str, Any]:
    row: dict[str, Any] = {"mechanism": mechanism.name, "engine": engine, "settings": settings}
    row |= {"integrator": integrator, "stabilization": stabilization, "status": str(Status.OK), "message": ""}
    choice = Choice(settings, integrator, stabilization, STEP)
    try:
        reason = get(engine).skip(mechanism, choice)
        if reason:
            raise RunFailure(Status.SKIP, reason)
        model = get(engine).build(mechanism, choice)
        model.prepare(np.arange(round(mechanism.duration / STEP) + 1) * STEP)
        model.run()
        found = metrics.reactions(evaluator, model.read())
    except RunFailure as failure:
        return row | {"status": str(failure.status), "message": str(failure)}
    except ImportError as error:
        return row | {"status": str(Status.SKIP), "message": not_installed(error)}
    every, driver = (len(found) - 1) // (len(exact) - 1), evaluator.constraints.joint_rows
    errors, largest = np.abs(found[::every] - exact).max(axis=0), np.abs(exact).max(axis=0)
    return row | {
        "torque_error": float(errors[driver] / largest[driver]),
        "mean_torque": float(abs(found[:-1, driver].mean()) / largest[driver]),
        "force_error": float(errors[:driver].max() / largest[:driver].max()),
    }
