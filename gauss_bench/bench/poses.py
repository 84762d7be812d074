"""Poses of links in a run that a report plays: beside the true motion, told apart by what the loops allow and what they do not.

A run's pose at a time is written as the sum

    q = truth + ahead + gap,    truth + ahead: the nearest pose to q whose loops are closed,

so that `ahead` is a motion of the linkage, early, late or elsewhere, and `gap` is how far links stand off where loops would be
closed. Whoever magnifies a difference follows the linkage with the one and pulls links apart by the other alone: magnified without
being told apart, a run that is merely late would be drawn with open loops, since links turn along arcs.

Each part keeps digits of its own: a gap of 1e-12 m is not lost beside a run that is late by a centimetre.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gauss_bench.bench.cases import Case, variants
from gauss_bench.bench.tasks import Rows
from gauss_bench.formulations import CONTROLS
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import common_times
from gauss_bench.runs.offers import offer
from gauss_bench.tables import KEY
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Trajectory

STEP = 1e-3  # [s] of the runs that are played, or what is nearest to it
FRAMES = 50  # of a run
AXES = ("x", "y", "angle")


def play(cases: Sequence[Case]) -> frozenset[Case]:
    """Of each linkage, engine and setting the case at the step nearest to STEP; no negative controls."""
    nearest: dict[tuple[Any, ...], Case] = {}
    for case in cases:
        if case.engine in CONTROLS:
            continue
        key = (case.linkage, case.scenario, case.engine, case.settings, case.integrator, case.stabilization)
        if key not in nearest or _far(case) < _far(nearest[key]):
            nearest[key] = case
    return frozenset(nearest.values())


def _far(case: Case) -> float:
    return abs(float(np.log(case.step / STEP)))


def frames(truth: Reference) -> Array:
    """The times (k,) [s] that are kept of a motion."""
    return truth.t[:: max(1, len(truth.t) // FRAMES)]


def wrap(q: Array) -> Array:
    """States or differences (..., n) with angles between -pi and pi."""
    q = q.copy()
    q[..., 2::3] = (q[..., 2::3] + np.pi) % (2 * np.pi) - np.pi
    return q


def true_poses(mechanism: Mechanism, truth: Reference) -> Rows:
    """The true pose of every link at every frame."""
    times = frames(truth)
    at = common_times(truth.t, times)[0]
    return [row for t, q in zip(times, truth.q[at], strict=True) for row in _rows(mechanism, float(t), {"": wrap(q)})]


def poses(mechanism: Mechanism, trajectory: Trajectory, truth: Reference) -> Rows:
    """The difference of every link's pose in a run from the true one, at every frame that the run reached."""
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
    """One row a link: name of a part -> its coordinates (n,)."""
    columns = {f"{axis}{part}": x[k::3] for part, x in parts.items() for k, axis in enumerate(AXES)}
    return [
        {"link": link.name, "t": t} | {name: float(x[i]) for name, x in columns.items()} for i, link in enumerate(mechanism.links)
    ]


def keep(results: Rows, poses: Rows) -> Rows:
    """Of each linkage and engine the poses of its default and of its most exact valid case, among the cases that have poses.

    Args:
        results: rows of the cases; poses: those of their poses.
    """
    have = {_key(row) for row in poses}
    shown: set[tuple[Any, ...]] = set()
    by_engine: dict[tuple[Any, ...], Rows] = {}
    for row in results:
        if _key(row) in have:
            by_engine.setdefault(_key(row)[:3], []).append(row)
    for (*_, engine), rows in by_engine.items():
        default = variants(offer(engine))[0]
        exact = [r for r in rows if r["status"] == "ok"]
        chosen = [r for r in rows if (r["settings"], r["integrator"], r["stabilization"]) == default]
        chosen += [min(exact, key=lambda r: (r["position_error"], _key(r)))] if exact else []
        shown |= {_key(r) for r in chosen}
    return [row for row in poses if _key(row) in shown]


def _key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(row[c] for c in KEY)
