"""The start of a motion in extended precision: loop coordinates and velocities at t = 0.

This state satisfies, to the last digit, the constraint rows of the linkage and the decimal numbers of the scenario's table `start`.
The assembly in double precision is the first guess. Each value in the table `start` becomes an additional row: an angle or a
displacement of a slide is prescribed as by a driver, and a position of a point is a constraint P - target = 0 with a given velocity
of P.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.numbers import Number, angle_of, exact, pair, radians
from gauss_bench.reference.refinement import pseudo_inverse, solve_by_chord
from gauss_bench.reference.taylor.moving_vectors import at_states
from gauss_bench.reference.taylor.rows import Law, LoopRows, Prescribed
from gauss_bench.reference.taylor.solve import Long, epsilon, multiply, stack_arrays, to_dense
from gauss_bench.reference.taylor.vector_sums import NONE, VectorTerm, merge
from gauss_bench.terms import Array


def hold_start(rows: LoopRows, scenario: dict[str, Any], number: Number) -> tuple[LoopRows, list[Law], list[Any]]:
    """Return the constraint rows of the mechanism together with the rows of its start, and the right-hand sides at t = 0.

    Each value in the scenario's table `start` adds a row to the equations. The rows are in this order: loops, points with
    prescribed start positions, drivers, angles and slides with prescribed start values, knife edges.

    Returns:
        held: all these rows, whose Jacobian by the coordinates x is A.
        laws: value, rate and second rate of every prescribed quantity at t = 0, those of the drivers first.
        rates: the right-hand side b of A x' = b.
    """
    coordinates, start, zero = rows.coordinates, scenario.get("start", {}), number("0")
    mechanism = coordinates.mechanism
    laws = rows.laws(zero)
    prescribed, points, speeds = [], [], []  # angles and slides; points minus their targets; components of the points' velocities
    for link, (target, rate) in _list_held_angles(mechanism, start, number).items():
        prescribed.append(Prescribed("", coordinate=coordinates.angle[link], turn=coordinates.turn[link], gap=()))
        laws.append((target, rate, zero))
    for name, target in start.get("slides", {}).items():
        prescribed.append(Prescribed("", coordinate=coordinates.slides[name], turn=zero, gap=()))
        laws.append((exact(number, target), exact(number, start.get("slide_speeds", {}).get(name, 0)), zero))
    for reference, target in start.get("points", {}).items():
        x, y = pair(number, target)
        points.append(merge(coordinates.point(mechanism.find_point(reference)), less=[VectorTerm(x, y, NONE, NONE)]))
        speeds += [*pair(number, start.get("point_velocities", {}).get(reference, (0, 0)))]
    held = replace(rows, closures=(*rows.closures, *points), prescribed=(*rows.prescribed, *prescribed))
    rates = held.rates(laws)
    loops = 2 * len(rows.closures)  # points are closures behind those of the loops, and move at given speeds
    rates[loops : loops + len(speeds)] = speeds
    return held, laws, rates


def _list_held_angles(mechanism: Mechanism, start: dict[str, Any], number: Number) -> dict[int, tuple[Any, Any]]:
    """Return link -> angle [rad] and speed [rad/s], as the start gives them; its keys `crank` and `speed` mean the crank."""
    angles = {name: radians(number, x) for name, x in start.get("angles_deg", {}).items()}
    angles |= {name: exact(number, x) for name, x in start.get("angles", {}).items()}
    speeds = {name: exact(number, x) for name, x in start.get("speeds", {}).items()}
    if mechanism.crank is not None:
        crank = mechanism.links[mechanism.crank].name
        if "crank" in start or "crank_deg" in start:
            angles[crank] = angle_of(start, "crank", number)
        if "speed" in start:
            speeds.setdefault(crank, exact(number, start["speed"]))
    held = {}
    for name, x in angles.items():
        link, turn = mechanism.find_body(name)  # turn: constant angle of the link `name` in the body that carries it
        held[link] = x - turn, speeds.get(name, number("0"))
    return held


def start_state(rows: LoopRows, scenario: dict[str, Any], guess: Array, number: Number) -> tuple[Long, Long]:
    """Return the loop coordinates and their velocities (1, n) at t = 0, in extended precision.

    Args:
        rows: the constraint rows of the mechanism.
        scenario: the scenario's table in the document.
        guess: (n,) loop coordinates of the assembly in double precision, from which the solution is searched.
        number: type of number.

    Raises:
        Unsolved: no coordinates near the guess satisfy the constraint rows and the values that the start gives.
    """
    n, eps = rows.coordinates.n, epsilon(number)
    # `held`: the rows of the mechanism, and those of the start; `laws`: what both prescribe, the drivers of the mechanism first
    held, laws, rates = hold_start(rows, scenario, number)
    x = np.array([[exact(number, value) for value in guess.tolist()]]).reshape(1, n)
    # decimals of the start may contradict the loops in their last digits, so that the loops alone are closed once more
    for group in (held, rows):
        x = group.close(x, laws[: len(group.prescribed)], eps)
    A = held.entries(at_states(x))

    def residual(v: Long) -> Long:
        """Return the residual A v - b of the velocities v (1, n), where b is `rates`."""
        return multiply(A, v) - stack_arrays(rates, x[:, 0])

    return x, solve_by_chord(residual, pseudo_inverse(to_dense(A, 1, n)), np.zeros_like(x), eps)
