"""Prescribed motion as an accuracy axis: the torque that drives a turn, by every engine that can, against pure geometry.

The reference needs no integration: positions, velocities and accelerations follow from the law, the torque from virtual work. An
engine's torque and joint forces are worked out here from its own accelerations, so that it cannot grade itself. Over a turn without
losses the mean torque is zero. Where rows are redundant the shortest joint forces are compared.
"""

from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.context import Context
from gauss_bench.bench.tasks import Tables, Task
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.extras import not_installed
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import build_reference
from gauss_bench.suites.schema import Method, Suite
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status, Trajectory


def exact(suite: Suite, context: Context) -> list[Task]:
    """One task for each linkage."""
    return [
        context.task("driving", driving, (*place, part.step, part.ways), *place)
        for part in suite.driving
        for place in part.linkages.items()
    ]


def driving(linkage: str, scenario: str, step: float, ways: tuple[Method, ...]) -> Tables:
    """One row for each way to run a driven turn; a way that fails is a row with a reason."""
    mechanism = load(linkage, scenario)
    evaluator = Evaluator(mechanism)
    reference = build_reference(mechanism, mechanism.duration)
    true = Trajectory(reference.t, reference.q, reference.v, reference.a, 0)
    forces = metrics.reactions(evaluator, true)
    return {"driving": [_row(mechanism, evaluator, forces, way, step) for way in ways]}


def _row(mechanism: Mechanism, evaluator: Evaluator, exact: Array, way: Method, step: float) -> dict[str, Any]:
    row: dict[str, Any] = {"mechanism": mechanism.name, **way.model_dump(), "status": str(Status.OK), "message": ""}
    choice, engine = Choice(way.settings, way.integrator, way.stabilization, step), way.engine
    try:
        reason = get(engine).skip(mechanism, choice)
        if reason:
            raise RunFailure(Status.SKIP, reason)
        model = get(engine).build(mechanism, choice)
        model.prepare(np.arange(round(mechanism.duration / step) + 1) * step)
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
