"""Poses of links that a report plays: the deviation from the reference, split into a motion of the linkage and open loops.

A run's pose at a time is written as the sum

    q = truth + ahead + gap,    truth + ahead: the nearest pose to q whose loops are closed,

so that `ahead` is a motion of the linkage and `gap` the distance of links from their places in closed loops. A player that
magnifies the deviation moves the linkage by `ahead` and separates links by `gap`. If it magnified the sum, a run that is only late
would be drawn with open loops, because links move along arcs.

The two are stored as separate numbers, so that a gap of 1e-12 m is not lost beside a delay of a centimetre.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.bench.cases import Case, variants
from gauss_bench.bench.tasks import Rows
from gauss_bench.formulations import CONTROLS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles, bodies
from gauss_bench.metrics import common_times
from gauss_bench.runs.offers import offer
from gauss_bench.tables import KEY
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Trajectory

STEP = 1e-3  # [s] the case whose step is nearest is played
FRAMES = 50  # poses that are kept of a run
AXES = ("x", "y", "angle")


def play(cases: Sequence[Case]) -> frozenset[Case]:
    """Return, for each linkage, engine and setting, the case with the step nearest to STEP; negative controls are left out."""
    nearest: dict[Case, Case] = {}  # by the case at any step
    for case in sorted(cases, key=lambda x: abs(np.log(x.step / STEP))):
        if case.engine not in CONTROLS:
            nearest.setdefault(replace(case, step=STEP), case)
    return frozenset(nearest.values())


def frames(truth: Reference) -> Array:
    """Return the times (k,) [s] at which poses are kept."""
    return truth.t[:: max(1, len(truth.t) // FRAMES)]


def wrap(q: Array) -> Array:
    """Return states or differences (..., n) with their angles reduced to [-pi, pi)."""
    q = q.copy()
    angles(q)[...] = (angles(q) + np.pi) % (2 * np.pi) - np.pi
    return q


def true_poses(mechanism: Mechanism, truth: Reference) -> Rows:
    """Return the reference pose of every link at every frame."""
    times = frames(truth)
    at = common_times(truth.t, times)[0]
    return [row for t, q in zip(times, truth.q[at], strict=True) for row in _rows(mechanism, float(t), {"": wrap(q)})]


def poses(mechanism: Mechanism, trajectory: Trajectory, truth: Reference) -> Rows:
    """Return the deviation of every link's pose from the reference, at every frame that the run reached."""
    times = frames(truth)
    mine, both = common_times(trajectory.t, times)
    true = truth.q[common_times(truth.t, times[both])[0]]
    evaluator = Evaluator(mechanism)
    rows: Rows = []
    for t, q, v, exact in zip(times[both], trajectory.q[mine], trajectory.v[mine], true, strict=True):
        closed, _ = evaluator.project(float(t), q, v)
        if not np.isfinite(closed).all():
            break
        rows += _rows(mechanism, float(t), {"_ahead": wrap(closed - exact), "_gap": q - closed})
    return rows


def _rows(mechanism: Mechanism, t: float, parts: Mapping[str, Array]) -> Rows:
    """Return one row for each link; `parts` maps the suffix of the columns to coordinates (n,)."""
    rows: Rows = [{"link": link.name, "t": t} for link in mechanism.links]
    for part, x in parts.items():
        for row, pose in zip(rows, bodies(x).tolist(), strict=True):
            row |= zip([f"{axis}{part}" for axis in AXES], pose, strict=True)
    return rows


def keep(results: Rows, poses: Rows) -> Rows:
    """Return, for each linkage and engine, the poses of its default case and of its most accurate valid case.

    Args:
        results: rows of the cases.
        poses: rows of their poses.
    """
    have = {_key(row) for row in poses}
    shown: set[tuple[Any, ...]] = set()
    exact: dict[tuple[Any, ...], tuple[float, tuple[Any, ...]]] = {}  # linkage, scenario, engine -> least error and its case
    for row in results:
        key = _key(row)
        if key not in have:
            continue
        if key[3:6] == variants(offer(row["engine"]))[0]:
            shown.add(key)
        if row["status"] == "ok":
            exact[key[:3]] = min(exact.get(key[:3], (np.inf, ())), (row["position_error"], key))
    shown |= {key for _, key in exact.values()}
    return [row for row in poses if _key(row) in shown]


def _key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(row[c] for c in KEY)
