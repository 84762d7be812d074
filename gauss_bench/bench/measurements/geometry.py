"""Compare three independent methods of kinematics: link units, point coordinates, and the differentiated constraints of dynamics.

The methods have no equation in common: their agreement confirms the velocities and accelerations at the start of runs.
"""

from itertools import combinations
from typing import Any

import numpy as np

from gauss_bench.bench.tasks import Context, Tables, Task
from gauss_bench.kinematics.basic_coordinates import basic_motion
from gauss_bench.kinematics.basins import basins, loop_form, point_form
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.singular import ChangePoint, singular_positions
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.minimal import MinimalCoordinate
from gauss_bench.suites.schema import Geometry, Suite
from gauss_bench.terms import Array

POSITIONS = 361  # number of positions in a turn
STARTS = 60  # random starts of a search: the share of successes is known to 6 %: "always", "half" and "seldom" differ by more
FORMS = (  # name of a form of the equations, distances of starts from the solution, function that makes the equations
    ("loop variables", (0.5, 1.0, np.pi), loop_form),
    ("point coordinates", (0.1, 0.2, 0.5), point_form),
)
Levels = tuple[Array, Array, Array]  # positions, velocities and accelerations (k, n)


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    return context.each(suite.geometry, "agreement", geometry)


def geometry(linkage: str, scenario: str, part: Geometry) -> Tables:
    """Return the rows of three tables for a linkage: agreement of the methods, singular positions, and searches for the assembly.

    The methods are compared in pairs, over one turn of the crank. Searches are tried for the linkages in `part.searched`.
    """
    mechanism = load(linkage, scenario)
    times = np.linspace(0.0, 1.0, POSITIONS)
    loop, basic = (solve(mechanism, times) for solve in (loop_motion, basic_motion))
    assert mechanism.driver is not None
    laws = np.array([mechanism.driver.law(t) for t in times]).T  # (3, k): angle of the crank and its two rates
    methods: dict[str, Levels] = {
        "link units": (loop.q, loop.v, loop.a),
        "point coordinates": (basic.q, basic.v, basic.a),
        "constraints": exact_motion(MinimalCoordinate(mechanism), *laws),
    }
    start = {"mechanism": mechanism.name}
    agreement = [start | {"first": a, "second": b} | differences(methods[a], methods[b]) for a, b in combinations(methods, 2)]
    searched = basin_rows(mechanism) if linkage in part.searched else []
    return {"agreement": agreement, "singular": singular(linkage), "basins": searched}


def exact_motion(motion: MinimalCoordinate, angles: Array, speeds: Any = 1.0, accelerations: Any = 0.0) -> Levels:
    """Return q, v, a (k, n) at k crank angles [rad], speeds [rad/s] and accelerations [rad/s^2].

    A single number, instead of an array (k,), holds at all angles. Newton's method starts from the previous position.
    """
    states = [motion.state(*(np.array([float(x)]) for x in law)) for law in np.broadcast(angles, speeds, accelerations)]
    q, v, a = (np.concatenate(level) for level in zip(*states, strict=True))
    return q, v, a


def basin_rows(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Return rows with the share of random starts from which a search finds the assembly.

    There is one row for each form of the equations, each search method (of `basins`), and each distance of the starts from the
    solution.
    """
    rows = []
    for name, distances, make_equations in FORMS:
        for basin in basins(mechanism, distances, STARTS, form=make_equations):
            rows.append({"mechanism": mechanism.name, "form": name, **vars(basin)})  # all attributes of a basin are columns
    return rows


def differences(one: Levels, other: Levels) -> dict[str, float]:
    """Return the largest differences of positions, velocities and accelerations, each relative to the largest value in `other`."""
    named = zip(("position", "velocity", "acceleration"), one, other, strict=True)
    return {name: float(np.abs(x - y).max() / np.abs(y).max()) for name, x, y in named}


def singular(linkage: str) -> list[dict[str, Any]]:
    """Return rows of a linkage's limit positions and dead centres, with crank angles [deg]; none if it has a change point."""
    mechanism = load(linkage)
    try:
        positions = singular_positions(mechanism)
    except ChangePoint:
        return []
    return [
        {"mechanism": mechanism.name, "coordinate": s.coordinate, "kind": s.kind, "crank_deg": float(np.degrees(s.crank)) % 360.0}
        for s in positions
    ]
