"""The start of a motion to the last digit: loop coordinates and rates that satisfy the rows and the decimals of the file.

The assembly in double precision is the first guess. The values in the start of a scenario are additional rows: an angle or a slide
is prescribed as by a driver, and a point is a closure P - target = 0 with a rate.
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
    """Return the constraint rows of the mechanism together with those of the start, and what they prescribe at t = 0.

    The values that a start gives are additional rows. Their order is: loops, points of the start, drivers, angles and slides of the
    start, knife edges.

    Returns:
        The rows, whose Jacobian by the coordinates x is A; value, rate and second rate of every prescribed quantity at t = 0; and
        the right-hand side of A x' = rate.
    """
    coordinates, start, zero = rows.coordinates, scenario.get("start", {}), number("0")
    mechanism = coordinates.mechanism
    laws = rows.laws(zero)
    given, points, speeds = [], [], []
    for link, (target, rate) in _list_held_angles(mechanism, start, number).items():
        given.append(Prescribed("", coordinates.angle[link], coordinates.turn[link], ()))
        laws.append((target, rate, zero))
    for name, target in start.get("slides", {}).items():
        given.append(Prescribed("", coordinates.slides[name], zero, ()))
        laws.append((exact(number, target), exact(number, start.get("slide_speeds", {}).get(name, 0)), zero))
    for reference, target in start.get("points", {}).items():
        x, y = pair(number, target)
        points.append(merge(coordinates.point(mechanism.find_point(reference)), less=[VectorTerm(x, y, NONE, NONE)]))
        speeds += [*pair(number, start.get("point_velocities", {}).get(reference, (0, 0)))]
    held = replace(rows, closures=(*rows.closures, *points), prescribed=(*rows.prescribed, *given))
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
        link, turn = mechanism.find_body(name)
        held[link] = x - turn, speeds.get(name, number("0"))
    return held


def start_state(rows: LoopRows, scenario: dict[str, Any], guess: Array, number: Number) -> tuple[Long, Long]:
    """Return coordinates and rates (1, n) at t = 0, from a guess (n,) in double precision.

    Raises:
        Unsolved: the rows cannot be satisfied near the guess.
    """
    n, eps = rows.coordinates.n, epsilon(number)
    held, laws, rates = hold_start(rows, scenario, number)
    x = np.array([[exact(number, value) for value in guess.tolist()]]).reshape(1, n)
    # decimals of the start may contradict the loops in their last digits, so that the loops alone are closed once more
    for group in (held, rows):
        x = group.close(x, laws[: len(group.prescribed)], eps)
    A = held.entries(at_states(x))

    def residual(v: Long) -> Long:
        """Return A v - rate."""
        return multiply(A, v) - stack_arrays(rates, x[:, 0])

    return x, solve_by_chord(residual, pseudo_inverse(to_dense(A, 1, n)), np.zeros_like(x), eps)
