"""Poses of links for a report's animation: the deviation of a run from the reference, split into a closed motion and gaps of loops.

A run's pose at a time is the sum

    q = reference + ahead + gap,    reference + ahead: the pose nearest to q whose loops are closed

The report's player magnifies the two parts separately: it moves the linkage along its motion for `ahead`, and shifts single links
by `gap`. If it magnified the sum, a run that is only late would be drawn with open loops, because links move along arcs. Both parts
are stored, so that a gap of 1e-12 m is not lost beside a delay of a centimetre.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.bench.cases import Case, combinations
from gauss_bench.bench.tasks import Rows
from gauss_bench.formulations import CONTROLS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles, bodies
from gauss_bench.metrics import common_times
from gauss_bench.runs.offers import offer
from gauss_bench.tables import case_of
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Trajectory

STEP = 1e-3  # [s] the case whose step is nearest is played
FRAMES = 50  # least number of poses to which a run is thinned out
AXES = ("x", "y", "angle")


def choose_played(cases: Sequence[Case]) -> frozenset[Case]:
    """Return the cases whose motion the report's player shows: for each linkage, engine and setting the step nearest to STEP.

    Engines with a planted fault (CONTROLS) are left out.
    """
    nearest: dict[Case, Case] = {}  # the case with STEP in place of its own step -> the case that is played
    for case in sorted(cases, key=lambda x: abs(np.log(x.step / STEP))):
        if case.engine not in CONTROLS:
            nearest.setdefault(replace(case, step=STEP), case)
    return frozenset(nearest.values())


def frames(truth: Reference) -> Array:
    """Return the times (k,) [s] at which poses of a run are kept."""
    return truth.t[:: max(1, len(truth.t) // FRAMES)]


def wrap(q: Array) -> Array:
    """Return coordinates, or differences of coordinates, (..., n) with angles in [-pi, pi)."""
    q = q.copy()
    angles(q)[...] = (angles(q) + np.pi) % (2 * np.pi) - np.pi
    return q


def true_poses(mechanism: Mechanism, truth: Reference) -> Rows:
    """Return a row (link, time, pose) for each link at each of the times `frames`; angles are in [-pi, pi)."""
    times = frames(truth)
    reference_rows, _ = common_times(truth.t, times)
    rows: Rows = []
    for t, q in zip(times, truth.q[reference_rows], strict=True):
        rows += _rows(mechanism, float(t), {"": wrap(q)})  # the names of these columns have no suffix
    return rows


def poses(mechanism: Mechanism, trajectory: Trajectory, truth: Reference) -> Rows:
    """Return one row for the deviation of each link's pose from the reference, at each frame that the run reached.

    If p is the closed pose nearest to the run's pose q, the columns "_ahead" have p - reference, and the columns "_gap" q - p.
    """
    times = frames(truth)
    own, reached = common_times(trajectory.t, times)  # indices of the run's samples at frames, and mask of these frames
    true, _ = common_times(truth.t, times[reached])  # indices of the reference's samples
    evaluator = Evaluator(mechanism)
    rows: Rows = []
    for t, q, v, true_q in zip(times[reached], trajectory.q[own], trajectory.v[own], truth.q[true], strict=True):
        closed, _ = evaluator.project(float(t), q, v)
        if not np.isfinite(closed).all():  # the loops are too far open to be closed
            break
        rows += _rows(mechanism, float(t), {"_ahead": wrap(closed - true_q), "_gap": q - closed})
    return rows


def _rows(mechanism: Mechanism, t: float, parts: Mapping[str, Array]) -> Rows:
    """Return one row for each link at a time; `parts` maps a suffix of the columns x, y, angle to coordinates (n,) of all links."""
    rows: Rows = [{"link": link.name, "t": t} for link in mechanism.links]
    for suffix, coordinates in parts.items():
        for row, pose in zip(rows, bodies(coordinates).tolist(), strict=True):
            row |= zip([f"{axis}{suffix}" for axis in AXES], pose, strict=True)
    return rows


def keep(results: Rows, poses: Rows) -> Rows:
    """Return, for each linkage and engine, the poses of its default case and of its most accurate valid case."""
    posed = {case_of(row) for row in poses}
    shown: set[tuple[Any, ...]] = set()  # keys of cases
    best: dict[tuple[Any, ...], tuple[float, tuple[Any, ...]]] = {}  # linkage, scenario, engine -> least error, and key of its case
    for row in results:
        key = case_of(row)
        if key not in posed:
            continue
        linkage, scenario, engine, settings, integrator, stabilization, *_ = key
        if (settings, integrator, stabilization) == combinations(offer(engine))[0]:
            shown.add(key)
        if row["status"] == "ok":
            group = linkage, scenario, engine
            best[group] = min(best.get(group, (np.inf, ())), (row["position_error"], key))
    shown |= {key for _, key in best.values()}
    return [row for row in poses if case_of(row) in shown]
