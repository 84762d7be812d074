"""One case becomes one row: build, run, read, and judge by metrics alone."""

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.cases import Case
from gauss_bench.bench.context import Alteration, unaltered
from gauss_bench.engines import get
from gauss_bench.engines.base import Model
from gauss_bench.formulations import CONTROLS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import States, random_states
from gauss_bench.reference.store import stored_reference
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, RunFailure, Status, Trajectory

SERIES = 100  # points per curve in the report
SAMPLING = 1e-3  # [s] samples that energy and drift are taken from, where the step is not longer
OFF_ACCELERATION = 1e-2  # an engine that is 1 % off at the same state solves another problem, whatever its trajectory
OFF_DRIFT = 1e-2  # [m, rad] a loop that opens by a centimetre is not this linkage
OFF_MOTION = 1.0  # [m, rad] a link that is a radian away is somewhere else, however well the loops are closed


@lru_cache(maxsize=8)
def mechanism_of(linkage: str, scenario: str) -> Mechanism:
    return load(linkage, scenario or None)


@lru_cache(maxsize=4)
def states_of(linkage: str, scenario: str) -> States:
    return random_states(mechanism_of(linkage, scenario))


@lru_cache(maxsize=4)
def reference_of(linkage: str, scenario: str, t_end: float, store: str) -> Reference:
    return stored_reference(mechanism_of(linkage, scenario), t_end, Path(store))


def sample_times(case: Case) -> Array:
    """Samples on the step's own grid, dense enough for the energy balance, through every 1e-2 s of the reference."""
    spacing = max(case.step, SAMPLING)
    return np.arange(round(case.t_end / spacing) + 1) * spacing


def measure(case: Case, store: str, alter: Alteration = unaltered) -> dict[str, Any]:
    """The row of a case and the curves of its report, {"row": ..., "series": [...]}.

    `alter` is applied to the mechanism the engine is given, never to the one it is judged by: a planted fault.
    """
    mechanism = mechanism_of(case.linkage, case.scenario)
    row: dict[str, Any] = {"status": str(Status.OK), "message": "", "control": case.engine in CONTROLS}
    try:
        engine = get(case.engine)
        reason = engine.skip(mechanism, case.choice)
        if reason:
            raise RunFailure(Status.SKIP, reason)
        model = engine.build(alter(mechanism), case.choice)
        row |= acceleration_errors(model, states_of(case.linkage, case.scenario))
        model.prepare(sample_times(case))
        model.run()
        trajectory = model.read()
    except RunFailure as failure:
        return {"row": row | {"status": str(failure.status), "message": str(failure)}, "series": []}
    except ImportError as error:
        return {"row": row | {"status": str(Status.SKIP), "message": f"not installed: {error}"}, "series": []}
    reference = reference_of(case.linkage, case.scenario, case.t_end, store)
    judged, series = judge(mechanism, trajectory, reference)
    row |= judged | {"steps": trajectory.steps, "evaluations": trajectory.evaluations, "note": trajectory.note}
    row["flag"] = flag(row)
    row["valid"] = not row["flag"]
    return {"row": row, "series": series}


def acceleration_errors(model: Model, states: States) -> dict[str, float]:
    """Relative error at the same states: median and worst."""
    found = np.array([model.acceleration(*s) for s in zip(states.t, states.q, states.v, strict=True)])
    error = metrics.relative_acceleration_error(found, states.a)
    return {"acceleration_error_median": float(np.median(error)), "acceleration_error_max": float(error.max())}


def judge(mechanism: Mechanism, trajectory: Trajectory, reference: Reference) -> tuple[dict[str, Any], list[dict[str, float]]]:
    """The columns that need the whole trajectory, and its curves."""
    evaluator = Evaluator(mechanism)
    with np.errstate(all="ignore"):
        drift = metrics.drift(evaluator, trajectory)
        energy, energy_bar = metrics.energy_error(evaluator, trajectory)
        errors = metrics.state_errors(mechanism, trajectory, reference)
    row: dict[str, Any] = {
        "position_error": float(errors.position.max()),
        "velocity_error": float(errors.velocity.max()),
        "position_error_bar": float(errors.position_bar.max()),
        "velocity_error_bar": float(errors.velocity_bar.max()),
        "position_drift": float(drift.position.max()),
        "velocity_drift": float(drift.velocity.max()),
        "acceleration_residual": float(drift.acceleration.max()),
        "energy_error": float(np.abs(energy).max()),
        "energy_error_bar": energy_bar,
    }
    for t in metrics.CHECKPOINTS:
        at = np.flatnonzero(np.abs(errors.t - t) < 1e-9)
        row[f"crank_error_t{t:g}".replace(".", "")] = float(errors.crank[at[0]]) if len(at) else np.nan
        row[f"crank_error_bar_t{t:g}".replace(".", "")] = float(errors.position_bar[at[0]]) if len(at) else np.nan
    per_link = zip(mechanism.links, errors.position.max(axis=0), errors.velocity.max(axis=0), strict=True)
    row["link_errors"] = json.dumps({link.name: {"position": float(p), "velocity": float(v)} for link, p, v in per_link})
    near = np.searchsorted(trajectory.t, errors.t - 1e-9)
    shown = slice(None, None, max(1, len(errors.t) // SERIES))
    curves = (errors.t, errors.crank, drift.position[near], drift.velocity[near], energy[near])
    names = ("t", "crank_error", "position_drift", "velocity_drift", "energy_error")
    series = [dict(zip(names, map(float, point), strict=True)) for point in zip(*(c[shown] for c in curves), strict=True)]
    return row, series


def flag(row: dict[str, Any]) -> str:
    """Why a finished run counts for nothing, or an empty text: the validity gate."""
    if not np.isfinite([row["position_error"], row["position_drift"], row["velocity_error"]]).all():
        return "not finite"
    if row["acceleration_error_median"] > OFF_ACCELERATION:
        return f"accelerations off by {row['acceleration_error_median']:.2g} at the same state (median)"
    if row["position_drift"] > OFF_DRIFT:
        return f"the loops open by {row['position_drift']:.2g} (m or rad)"
    if row["position_error"] > OFF_MOTION:
        return f"a link ends up {row['position_error']:.2g} (m or rad) from where it should be"
    return ""
