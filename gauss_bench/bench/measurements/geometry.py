"""Compare three independent methods of kinematics: link units, point coordinates, and the differentiated constraints of dynamics.

They share the linkage file and no equation, so that their agreement confirms the velocities and accelerations at the start of runs.
"""

from itertools import combinations
from typing import Any

import numpy as np

from gauss_bench.bench.tasks import Context, Tables, Task
from gauss_bench.kinematics.basic_coordinates import basic_motion
from gauss_bench.kinematics.basins import basins, loop_form, point_form, whole_turns_apart
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.singular import ChangePoint, singular_positions
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.suites.schema import Geometry, Suite
from gauss_bench.terms import Array

POSITIONS = 361
STARTS = 60  # shares to 6 %: enough to tell "always" from "half" and "seldom"
FORMS = (
    ("loop variables", (0.5, 1.0, np.pi), loop_form, whole_turns_apart),
    ("point coordinates", (0.1, 0.2, 0.5), point_form, np.subtract),
)
Levels = tuple[Array, Array, Array]


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return one task for each linkage."""
    return context.each(suite.geometry, "agreement", geometry)


def geometry(linkage: str, scenario: str, part: Geometry) -> Tables:
    """Return the agreement of the methods over one turn, the singular positions and, if asked for, searches for the assembly."""
    mechanism = load(linkage, scenario)
    times = np.linspace(0.0, 1.0, POSITIONS)
    loop, basic = (solve(mechanism, times) for solve in (loop_motion, basic_motion))
    assert mechanism.driver is not None
    laws = np.array([mechanism.driver.law(t) for t in times]).T
    ways: dict[str, Levels] = {
        "link units": (loop.q, loop.v, loop.a),
        "point coordinates": (basic.q, basic.v, basic.a),
        "constraints": exact_motion(MinimalCoordinate(mechanism), *laws),
    }
    start = {"mechanism": mechanism.name}
    agreement = [start | {"first": a, "second": b} | differences(ways[a], ways[b]) for a, b in combinations(ways, 2)]
    basin = basin_rows(mechanism) if linkage in part.searched else []
    return {"agreement": agreement, "singular": singular(linkage), "basins": basin}


def exact_motion(motion: MinimalCoordinate, angles: Array, speeds: Any = 1.0, accelerations: Any = 0.0) -> Levels:
    """Return q, v, a (k, n) at crank angles (k,) [rad]; each position is solved from the one before."""
    asked = np.broadcast(angles, speeds, accelerations)
    parts = [motion.state(*(np.array([float(x)]) for x in state)) for state in asked]
    q, v, a = (np.concatenate(level) for level in zip(*parts, strict=True))
    return q, v, a


def basin_rows(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Return the share of random starts from which each search finds the assembly, in loop variables and in point coordinates."""
    rows = []
    for form, spreads, make, difference in FORMS:
        for basin in basins(mechanism, spreads, STARTS, form=make, difference=difference):
            rows.append({"mechanism": mechanism.name, "form": form, **vars(basin)})
    return rows


def differences(one: Levels, other: Levels) -> dict[str, float]:
    """Return the largest difference of positions, velocities and accelerations over the turn, relative to the largest of each."""
    named = zip(("position", "velocity", "acceleration"), one, other, strict=True)
    return {name: float(np.abs(x - y).max() / np.abs(y).max()) for name, x, y in named}


def singular(linkage: str) -> list[dict[str, Any]]:
    """Return limits and dead centres with their crank angles [deg]; none where the curve of positions has a branch point."""
    mechanism = load(linkage)
    try:
        positions = singular_positions(mechanism)
    except ChangePoint:
        return []
    return [
        {"mechanism": mechanism.name, "coordinate": s.coordinate, "kind": s.kind, "crank_deg": float(np.degrees(s.crank)) % 360.0}
        for s in positions
    ]
