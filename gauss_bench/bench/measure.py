"""Run one case and compute its row. Foreign engines run in a process of their own, and every run is judged in this process."""

import json
from contextlib import suppress
from dataclasses import asdict, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.bench.cases import Case
from gauss_bench.bench.poses import poses
from gauss_bench.bench.tasks import CASE_LIMIT, Tables, place_of
from gauss_bench.formulations import CONTROLS
from gauss_bench.judge import Evidence, judge, remark
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import random_states
from gauss_bench.reference.build import sample_times as reference_times
from gauss_bench.reference.store import load_stored
from gauss_bench.runs.apart import Alteration, Request, leave_unaltered, run_of
from gauss_bench.runs.offers import Offer, in_python, offer
from gauss_bench.runs.one_run import Run, sampling
from gauss_bench.runs.questions import accelerations
from gauss_bench.runs.scrutiny import LONGEST, at_samples, decides, evidence_of, has_sound_rates, repeat_finer, sample_spacing
from gauss_bench.tables import KEY
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Samples, Status, Trajectory

SERIES = 100  # least number of points to which a curve of the report is thinned out
NO_REFERENCE = (ArithmeticError, ValueError, np.linalg.LinAlgError)  # raised for a linkage without a reference


@lru_cache(maxsize=8)
def mechanism_of(linkage: str, scenario: str) -> Mechanism:
    """Return a linkage, given by name or path, in a scenario; "" is the first scenario that has a start."""
    return load(linkage, scenario or None)


@lru_cache(maxsize=4)
def states_of(linkage: str, scenario: str) -> Samples | None:
    """Return random states with their reference accelerations, or None if the accelerations are not unique."""
    try:
        return random_states(mechanism_of(linkage, scenario))
    except NO_REFERENCE:
        return None


@lru_cache(maxsize=4)
def reference_of(linkage: str, scenario: str, t_end: float, store: str) -> Reference:
    """Return the reference of a scenario until `t_end` [s], which is kept in the folder `store`.

    Raises:
        ArithmeticError, ValueError, LinAlgError: the linkage has no reference (the exceptions in NO_REFERENCE).
    """
    return load_stored(mechanism_of(linkage, scenario), t_end, Path(store))


@lru_cache(maxsize=4)
def reference_or_reason(linkage: str, scenario: str, t_end: float, store: str) -> Reference | str:
    """Return the reference as `reference_of` does, or the reason why there is none; both are cached, as both take long."""
    try:
        return reference_of(linkage, scenario, t_end, store)
    except NO_REFERENCE as error:
        return str(error)


def measure(case: Case, store: str, alter: Alteration = leave_unaltered, limit: float = CASE_LIMIT, posed: bool = False) -> Tables:
    """Run a case and judge the run; return its row of results, and the rows of curves and poses for the report.

    The run is repeated with finer steps to estimate its errors, unless a reference is exact enough to judge the run, and the run's
    velocities and accelerations are derivatives of its positions. The engine is also asked for its accelerations at states whose
    accelerations are known, if there are any.

    Args:
        store: folder of references.
        alter: plants a fault in the mechanism that the engine is given; the unaltered mechanism is used to judge the run.
        limit: time [s] after which an engine in a process of its own is stopped.
        posed: whether poses are computed; they need a reference, and a run that reached its end.
    """
    mechanism, offered = mechanism_of(case.linkage, case.scenario), offer(case.engine)
    key = {k: x for k, x in asdict(case).items() if k in KEY} | place_of(mechanism)
    row: dict[str, Any] = key | {"control": case.engine in CONTROLS, "in_python": in_python(case.engine, mechanism, case.choice)}

    def fail(status: Status, message: str) -> Tables:
        """Return the tables of a case for which no numbers could be measured."""
        return {"results": [row | {"status": str(status), "message": message}], "series": [], "poses": []}

    if not offered.usable:
        return fail(offered.status, offered.reason)
    states = states_of(case.linkage, case.scenario)
    wanted = sampling(case.step, case.t_end, reference_times(case.t_end), sample_spacing(mechanism, case.t_end))
    request = Request(case.linkage, case.scenario, case.engine, case.choice, wanted, alter=alter)
    if states is not None:
        request = replace(request, ask=partial(accelerations, states.t, states.q, states.v), answers=states.a.size)
    run = run_of(request, mechanism, limit)
    if states is not None and run.answer is not None:
        row |= acceleration_errors(run.answer, states)
    if run.trajectory is None:
        return fail(run.status, run.message)
    found = reference_or_reason(case.linkage, case.scenario, case.t_end, store)
    reference, why_no_reference = (None, f"no truth to compare with: {found}") if isinstance(found, str) else (found, "")
    try:
        finer_run, why_no_repetition = None, ""
        if not (reference and decides(reference, mechanism) and has_sound_rates(mechanism, run.trajectory)):
            finer_run, why_no_repetition = repeat_run(request, offered, run, mechanism, limit)
        acceleration_error, adaptive = row.get("acceleration_error_median"), case.integrator in offered.adaptive
        evidence, undecided = evidence_of(
            mechanism, case.choice, run.trajectory, reference, finer_run, acceleration_error, adaptive, why_no_repetition
        )
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        return fail(Status.ERROR, f"the run cannot be judged: {error}")
    verdict = judge(evidence)
    status = Status.OK if verdict.valid else Status.INVALID
    # `flag` has the judge's sentence alone; `message` also has the reasons of cases that were not judged
    row |= {"status": str(status), "message": verdict.sentence, "valid": verdict.valid, "flag": verdict.sentence}
    row["note"] = "; ".join(filter(None, (run.message, why_no_reference, why_no_repetition, undecided, remark(evidence))))
    row |= {"steps": run.trajectory.steps, "evaluations": run.trajectory.evaluations}
    row |= figures(mechanism, run.trajectory, evidence)
    shown = poses(mechanism, run.trajectory, reference) if posed and reference is not None else []
    series = curves(run.trajectory, evidence)
    return {"results": [row], "series": [key | x for x in series], "poses": [key | x for x in shown]}


def repeat_run(request: Request, offered: Offer, run: Run, mechanism: Mechanism, limit: float) -> tuple[Run | None, str]:
    """Return a finer repetition of a run and an empty text, or None and the reason why there is no repetition.

    The run and its repetition may take `limit` [s]; the repetition is planned to take half of the time that is left after the run.
    """
    assert run.trajectory is not None
    times, spent = run.trajectory.t, run.seconds + run.build_time
    longest = min(LONGEST, (limit - spent) / 2)
    if len(times) < 2 or not longest > run.seconds * 2 / len(times):  # even one sample would take longer at half the step
        return None, "it was not repeated: no time is left"
    again = run_of(repeat_finer(request, offered, run.seconds, times, longest), mechanism, limit - spent)
    return at_samples(again, times), ""


def acceleration_errors(given: object, states: Samples) -> dict[str, float]:
    """Return the columns of median and largest relative error of an engine's accelerations at given states.

    Both are NaN if `given` is not an array of accelerations of the expected shape.
    """
    error = np.full(1, np.nan)
    with suppress(TypeError, ValueError):  # an engine may return anything
        a = np.asarray(given, dtype=float)
        if a.shape == states.a.shape:
            error = metrics.relative_acceleration_error(a, states.a)
    return {"acceleration_error_median": float(np.median(error)), "acceleration_error_max": float(error.max())}


def figures(mechanism: Mechanism, trajectory: Trajectory, evidence: Evidence) -> dict[str, Any]:
    """Return the columns of drift, energy and errors of a case's row; each value is the largest over the trajectory."""
    drift, errors = evidence.drift, evidence.errors
    row: dict[str, Any] = {
        "position_drift": float(drift.position.max()),
        "velocity_drift": float(drift.velocity.max()),
        "acceleration_residual": float(drift.acceleration.max()),
        "energy_error": float(np.abs(evidence.energy).max()),
        "energy_error_bar": evidence.energy_bar,
    }
    if errors is None:
        return row
    for name in ("position", "length", "angle", "velocity"):
        row[f"{name}_error"] = float(getattr(errors, name).max())
    for name in ("position", "velocity"):
        row[f"{name}_error_bar"] = float(getattr(errors, f"{name}_bar").max())
    row |= {"compared": len(errors.t), "measured": mechanism.measured.name, "measured_unit": mechanism.measured.unit}
    row |= at_checkpoints("measured_error", errors.t, errors.measured)
    row |= at_checkpoints("measured_error_bar", errors.t, errors.position_bar)  # the error bar of positions is used
    per_link = zip(mechanism.links, errors.position.max(axis=0), errors.velocity.max(axis=0), strict=True)
    row["link_errors"] = json.dumps({link.name: {"position": float(p), "velocity": float(v)} for link, p, v in per_link})
    return row


def at_checkpoints(name: str, t: Array, values: Array) -> dict[str, float]:
    """Return the columns of a quantity at the checkpoints [s] that tables list: NAME_t05 for 0.5 s.

    The quantity has `values` (k,) at the times `t` (k,) [s]; it is NaN at a checkpoint that is not one of these times.
    """
    columns = {}
    for checkpoint in metrics.CHECKPOINTS:
        samples = np.flatnonzero(np.abs(t - checkpoint) < metrics.SAME_TIME)
        columns[f"{name}_t{checkpoint:g}".replace(".", "")] = float(values[samples[0]]) if len(samples) else np.nan
    return columns


def curves(trajectory: Trajectory, evidence: Evidence) -> list[dict[str, float]]:
    """Return table rows of error, drift and energy error as functions of time, or no rows if there is no reference."""
    drift, errors = evidence.drift, evidence.errors
    if errors is None:
        return []
    samples = np.searchsorted(trajectory.t, errors.t - metrics.SAME_TIME)  # indices of the samples at the times of the errors
    shown = slice(None, None, max(1, len(errors.t) // SERIES))
    columns = {
        "t": errors.t,
        "measured_error": errors.measured,
        "length_error": errors.length.max(axis=1),
        "angle_error": errors.angle.max(axis=1),
        "position_drift": drift.position[samples],
        "velocity_drift": drift.velocity[samples],
        "energy_error": evidence.energy[samples],
    }
    points = zip(*(x[shown].tolist() for x in columns.values()), strict=True)
    return [dict(zip(columns, point, strict=True)) for point in points]
