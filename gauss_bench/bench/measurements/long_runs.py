"""Long runs with projection: loops must stay closed to rounding, and the error of the energy must fall with the integrator's order.

The scenarios are conservative. With the Runge-Kutta method the error of the energy grows with time; at half the step it must be
smaller by a factor of about 2^4 or more.

Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), section IX.8 (drift of the energy).
"""

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.clock import Row, row
from gauss_bench.bench.measurements.claim import FORMULATIONS
from gauss_bench.bench.tasks import Context, Tables, Task, place_of
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.compiled import FORMULATIONS as ENGINES
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.one_run import one_run, sampling_at
from gauss_bench.suites.schema import LongRuns, Suite
from gauss_bench.trajectory import Status

SAMPLING = 1e-2  # [s] spacing of samples
WINDOWS = 10  # equal parts of a run, each with its largest error of the energy


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    return context.each(suite.long_runs, "kernel_long", long_run)


def long_run(linkage: str, scenario: str, part: LongRuns) -> Tables:
    """Run both formulations with two step sizes; return one row for each run, and rows of the energy errors in its time windows."""
    mechanism = load(linkage, scenario)
    rows, windows = [], []
    for formulation in FORMULATIONS:
        coarse: Row = {}  # the row at twice the step
        for step in (part.step, part.step / 2):
            start: Row = place_of(mechanism) | {"formulation": formulation, "step": step}
            fine = row(start | {"t_end": part.duration}, measure, mechanism, formulation, step, part.duration)
            energy_errors = fine.pop("energies", [])
            rows.append(judge_row(fine, coarse, part))
            windows += [start | {"t": (k + 1) * part.duration / WINDOWS, "energy_error": x} for k, x in enumerate(energy_errors)]
            coarse = fine
    return {"kernel_long": rows, "kernel_energy": windows}


def measure(mechanism: Mechanism, formulation: str, step: float, duration: float) -> Row:
    """Run a linkage once; return the columns of its drift and of its energy errors [J] in the first time window, the last, and all.

    An energy error is the largest in a window. `energies` lists those of all windows; `energy` is the largest kinetic energy [J].

    Raises:
        RunFailure: the mechanism has no kernel, or the run ended too early.
    """
    engine = next(name for name, x in ENGINES.items() if x == formulation)
    wanted = sampling_at(step, np.arange(round(duration / SAMPLING) + 1) * SAMPLING)
    x = one_run(get(engine), mechanism, Choice("default", "rk4", "projection", step), wanted).complete()
    evaluator = Evaluator(mechanism)
    drift, energy_error = metrics.drift(evaluator, x), np.abs(metrics.energy_error(evaluator, x)[0])
    energy_errors = [float(part.max()) for part in np.array_split(energy_error[1:], WINDOWS)]
    kinetic = 0.5 * (evaluator.mass * x.v**2).sum(axis=-1)  # (k,) [J]
    return {
        "position_drift": float(drift.position.max()),
        "velocity_drift": float(drift.velocity.max()),
        "energy": float(kinetic.max()),
        "energy_first": energy_errors[0],
        "energy_last": energy_errors[-1],
        "energy_max": max(energy_errors),
        "energies": energy_errors,
    }


def judge_row(fine: Row, coarse: Row, part: LongRuns) -> Row:
    """Return the row `fine` of a run with the target for drift, and whether it meets the targets for drift and convergence order.

    The order is that of the energy error, computed from the row `coarse` at twice the step, if that run reached its end.
    """
    judged = fine | {"target": part.drift, "met": False}
    if fine["status"] == Status.OK:
        judged["met"] = max(fine["position_drift"], fine["velocity_drift"]) <= part.drift
        if coarse.get("status") == Status.OK:
            judged["order"] = float(np.log2(coarse["energy_max"] / fine["energy_max"])) if fine["energy_max"] > 0 else np.inf
            judged["met"] = judged["met"] and judged["order"] >= part.order - part.margin
    return judged
