"""A long run with projection: loops stay closed to rounding, and the energy drifts as the integrator's order says, no faster.

Nothing is taken from or given to the conservative scenarios, so that the energy is known for ever. Runge-Kutta's error of the
energy grows with time; at half the step it must be about 2^4 times smaller at least. Drift and energy are the suite's own, not the
kernel's. Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), section IX.8 (drift of the energy).
"""

from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.kernel_timing import Missing, Row, row
from gauss_bench.bench.measurements.steps import FORMULATIONS
from gauss_bench.bench.targets import DRIFT, ORDER, ORDER_MARGIN
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.kernel import Kernel, compile_kernel
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory

SCENARIO = "conservative"
STEP = 1e-3  # [s], and half of it
SAMPLING = 1e-2  # [s]
WINDOWS = 10  # in which the largest error of the energy is taken


def long_run(linkage: str, duration: float) -> dict[str, Any]:
    """Rows of both formulations at two steps, {"kernel_long": [...], "kernel_energy": [...]}."""
    mechanism = load(linkage, SCENARIO)
    rows: list[Row] = []
    windows: list[Row] = []
    for formulation in FORMULATIONS:
        coarse: Row = {}
        for step in (STEP, STEP / 2):
            start: Row = {"mechanism": mechanism.name, "scenario": SCENARIO, "formulation": formulation, "step": step}
            energies: list[float] = []
            found = row(start | {"t_end": duration}, measured, mechanism, formulation, step, duration, energies)
            rows.append(judged(found, coarse))
            windows += [start | {"t": (k + 1) * duration / WINDOWS, "energy_error": x} for k, x in enumerate(energies)]
            coarse = found
    return {"kernel_long": rows, "kernel_energy": windows}


def measured(mechanism: Mechanism, formulation: str, step: float, duration: float, energies: list[float]) -> Row:
    """Drift and energy of one run; the largest errors of the energy [J] in each window are put into `energies`.

    Raises:
        Missing: the mechanism has no kernel, or the run did not end.
    """
    try:
        trajectory = run(compile_kernel(mechanism, formulation, "projection"), step, duration)
    except KernelError as error:
        raise Missing(Status.ERROR, str(error)) from error
    if not np.isfinite(trajectory.q).all():
        raise Missing(Status.NAN, f"the run ended before {duration:g} s")
    evaluator = Evaluator(mechanism)
    drift, energy = metrics.drift(evaluator, trajectory), np.abs(metrics.energy_error(evaluator, trajectory)[0])
    energies += [float(x.max()) for x in np.array_split(energy[1:], WINDOWS)]
    kinetic = 0.5 * (evaluator.mass * trajectory.v**2).sum(axis=-1)
    return {
        "position_drift": float(drift.position.max()),
        "velocity_drift": float(drift.velocity.max()),
        "energy": float(kinetic.max()),
        "energy_first": energies[0],
        "energy_last": energies[-1],
        "energy_max": max(energies),
    }


def run(kernel: Kernel, step: float, duration: float) -> Trajectory:
    """Samples of the whole run, without accelerations."""
    mechanism, every = kernel.mechanism, round(SAMPLING / step)
    q, v = kernel.rollout(mechanism.q0, mechanism.v0, step, round(duration / step), every=every)
    q, v = (np.vstack([start, x]) for start, x in ((mechanism.q0, q), (mechanism.v0, v)))
    t: Array = np.arange(len(q)) * SAMPLING
    return Trajectory(t, q, v, np.zeros_like(q), round(duration / step))


def judged(found: Row, coarse: Row) -> Row:
    """The row with the order of the energy's error, from the run at twice the step, and whether drift and order are as wanted."""
    if found["status"] != Status.OK:
        return found | {"target": DRIFT, "met": False}
    met = max(found["position_drift"], found["velocity_drift"]) <= DRIFT
    if coarse.get("status") != Status.OK:
        return found | {"target": DRIFT, "met": met}
    order = float(np.log2(coarse["energy_max"] / found["energy_max"])) if found["energy_max"] > 0 else np.inf
    return found | {"order": order, "target": DRIFT, "met": met and order >= ORDER - ORDER_MARGIN}
