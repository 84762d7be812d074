"""Errors of the torque that drives a linkage through one turn by a prescribed law.

The reference needs no integration: positions, velocities and accelerations follow from the law, and the torque from virtual work.
The torque and the joint forces of an engine are computed here from its accelerations, not taken from the engine. Over a turn
without losses the mean torque is zero. With redundant rows, the joint forces of least norm are compared.
"""

from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.tasks import LIMIT, Context, Tables, Task
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import build_reference
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.one_run import sampling
from gauss_bench.suites.schema import Driving, Method, Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Status, Trajectory


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return one task for each linkage."""
    return context.each(suite.driving, "driving", driving)


def driving(linkage: str, scenario: str, part: Driving) -> Tables:
    """Return one row for each engine and setting of the part; a run that fails has a row with the reason."""
    mechanism = load(linkage, scenario)
    evaluator = Evaluator(mechanism)
    reference = build_reference(mechanism, mechanism.duration)
    true = Trajectory(reference.t, reference.q, reference.v, reference.a, 0)
    forces = metrics.reactions(evaluator, true)
    return {"driving": [_row(linkage, mechanism, evaluator, reference, forces, way, part.step) for way in part.ways]}


def _row(
    linkage: str, mechanism: Mechanism, evaluator: Evaluator, reference: Reference, exact: Array, way: Method, step: float
) -> dict[str, Any]:
    row: dict[str, Any] = {"mechanism": mechanism.name, **way.model_dump(), "status": str(Status.OK), "message": ""}
    choice = Choice(way.settings, way.integrator, way.stabilization, step)
    wanted = sampling(step, mechanism.duration, reference.t)
    run = run_of(Request(linkage, mechanism.scenario, way.engine, choice, wanted), mechanism, LIMIT)
    if run.trajectory is None:
        return row | {"status": str(run.status), "message": run.message}
    try:
        reactions = metrics.reactions(evaluator, run.trajectory)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        return row | {"status": str(Status.ERROR), "message": f"no joint forces: {error}"}
    at, met = metrics.common_times(run.trajectory.t, reference.t)
    errors, largest = np.abs(reactions[at] - exact[met]).max(axis=0), np.abs(exact).max(axis=0)
    driver = evaluator.constraints.joint_rows
    return row | {
        "torque_error": float(errors[driver] / largest[driver]),
        "mean_torque": float(abs(reactions[:-1, driver].mean()) / largest[driver]),
        "force_error": float(errors[:driver].max() / largest[:driver].max()),
    }
