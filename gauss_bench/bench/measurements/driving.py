"""Compute errors of the torque that drives a linkage through one turn by a prescribed law.

The reference motion needs no integration, and its torque follows from virtual work. The torque and the joint forces of an engine
are computed here from its accelerations. Without losses, the mean torque over one turn of the crank is zero. If rows are redundant,
the joint forces of least norm are compared.
"""

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.clock import Row, row
from gauss_bench.bench.tasks import LIMIT, Context, Tables, Task
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.reference.build import build_reference
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.one_run import sampling
from gauss_bench.suites.schema import Driving, Method, Suite
from gauss_bench.trajectory import RunFailure, Status


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    return context.each(suite.driving, "driving", driving)


def driving(linkage: str, scenario: str, part: Driving) -> Tables:
    """Return one row for each engine and setting of `part.ways`: errors of torque and joint forces, or why the run failed."""
    mechanism = load(linkage, scenario)
    evaluator = Evaluator(mechanism)
    reference = build_reference(mechanism, mechanism.duration)
    exact = metrics.reactions(evaluator, reference.samples)  # (k, m) forces and moments of joints, then the torque
    driver = evaluator.constraints.joint_rows  # index of the torque
    wanted = sampling(part.step, mechanism.duration, reference.t)

    def compare(method: Method) -> Row:
        """Run an engine with a setting; return the columns of errors, or raise RunFailure if it has no motion or joint forces."""
        choice = Choice(method.settings, method.integrator, method.stabilization, part.step)
        x = run_of(Request(linkage, scenario, method.engine, choice, wanted), mechanism, LIMIT).complete()
        try:
            reactions = metrics.reactions(evaluator, x)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise RunFailure(Status.ERROR, f"no joint forces: {error}") from error
        own_rows, reference_rows = metrics.common_times(x.t, reference.t)  # indices of common times
        errors = np.abs(reactions[own_rows] - exact[reference_rows]).max(axis=0)  # (m,)
        largest = np.abs(exact).max(axis=0)  # (m,)
        return {
            "torque_error": float(errors[driver] / largest[driver]),
            "mean_torque": float(abs(reactions[:-1, driver].mean()) / largest[driver]),  # the last sample repeats the first
            "force_error": float(errors[:driver].max() / largest[:driver].max()),
        }

    return {"driving": [row({"mechanism": mechanism.name, **way.model_dump()}, compare, way) for way in part.ways]}
