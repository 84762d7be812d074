"""The constraint rows in loop coordinates: closures of loops, drivers and knife edges, each with two time derivatives.

    closure of a loop:    P = 0, with P the sum of vectors around the loop; two rows, for x and y
    driver of an angle:   theta + turn - law(t) = 0, with a constant `turn`
    driver of a slide:    s - law(t) = 0
    driver of a length:   (d . d - law(t)^2) / 2 = 0, with d the vector from one point to the other
    knife edge:           n . P' = 0, with P the point of the edge and n its normal, which turns with the link

The time derivatives of the rows are A x' = rate and A x'' = gamma: A is their Jacobian, `rate` the velocities that drivers
prescribe, and gamma the negative sum of all terms of the second derivative without x''.

The start of a motion adds a row for each value in the scenario's table `start`: an angle or a displacement of a slide is prescribed
as by a driver, and a position of a point is a closure P - target = 0 with a given velocity of P.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, assert_never

import numpy as np

from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import AngleDriver, Driver, LengthDriver, Mechanism, SlideDriver
from gauss_bench.mechanism.numbers import Number, angle_of, exact, pair, radians
from gauss_bench.reference.refinement import pseudo_inverse, solve_by_chord
from gauss_bench.reference.taylor.arithmetic import Long, Value, cross, dot, epsilon, multiply, stack_arrays, to_dense, vanishes
from gauss_bench.reference.taylor.vector_sums import NONE, Instant, LoopCoordinates, Sum, VectorTerm, at_states, merge
from gauss_bench.terms import Array

Law = tuple[Value, Value, Value]  # value, rate and second rate of a driver


class Prescribed(NamedTuple):
    """A quantity whose value is prescribed: a length, or a coordinate plus a constant.

    Attributes:
        name: name of the driver that prescribes the value.
        coordinate: index of the coordinate, or NONE if the quantity has none.
        turn: constant that is added to the coordinate [rad]; without a coordinate the quantity is this constant.
        gap: the vector whose length is prescribed, or an empty sum if the quantity is not a length.
    """

    name: str
    coordinate: int
    turn: Any
    gap: Sum


@dataclass(frozen=True, eq=False)
class LoopRows:
    """The constraint rows of one mechanism: two for each closure of a loop, then one for each driver and each knife edge.

    Attributes:
        closures: sums of vectors that must vanish, one for each loop.
        prescribed: the quantities that drivers prescribe.
        edges: (index of the link's angle in the coordinates, point of the edge, normal to the edge) of every knife edge.
        names: for each row the part of the linkage from which it comes, such as "joint A".
    """

    coordinates: LoopCoordinates
    closures: tuple[Sum, ...]
    prescribed: tuple[Prescribed, ...]
    edges: tuple[tuple[int, Sum, Sum], ...]
    names: tuple[str, ...]

    @property
    def m(self) -> int:
        """The number of rows."""
        return len(self.names)

    def laws(self, t: Any) -> list[Law]:
        """Return value, rate and second rate of every driver at a time, or at times (k,)."""
        return [driver.law(t) for driver in self.coordinates.mechanism.drivers]

    def close(self, x: Long, laws: Sequence[Law], eps: float) -> Long:
        """Return the positions (k, n) near x (k, n) that satisfy all rows to the last digit of the type of x.

        Raises:
            Unsolved: no positions near x satisfy all rows.
        """
        zero = x[:, 0] - x[:, 0]  # (k,) in the type of x

        def residual(x: Long) -> Long:
            """Return the residuals (k, m) at positions x (k, n)."""
            residuals = self.residuals(at_states(x), laws)
            return stack_arrays([*residuals, *(0 for _ in self.edges)], zero)  # knife edges restrict only velocities

        return solve_by_chord(residual, pseudo_inverse(to_dense(self.entries(at_states(x)), *x.shape)), x, eps)

    def entries(self, at: Instant) -> list[dict[int, Value]]:
        """Return the rows of A, each as coordinate -> derivative at an instant; vanishing entries are left out."""
        rows: list[dict[int, Value]] = []
        for closure in self.closures:  # two rows, x and y
            gradient = at.gradient(closure)
            rows += [{j: g[axis] for j, g in gradient.items()} for axis in (0, 1)]
        for quantity in self.prescribed:
            if quantity.gap:  # the derivative of d . d / 2, with d the vector whose length is prescribed
                d = at.combine(quantity.gap)
                rows.append({j: dot(d, g) for j, g in at.gradient(quantity.gap).items()})
            else:  # NONE: the angle of a link that cannot turn, whose derivative is zero
                rows.append({} if quantity.coordinate == NONE else {quantity.coordinate: 1})
        # a knife edge: the velocity of its point P has no component along the normal n, n . P' = 0
        for _, point, normal in self.edges:
            n = at.combine(normal)
            rows.append({j: dot(n, g) for j, g in at.gradient(point).items()})
        return [{j: x for j, x in row.items() if not vanishes(x)} for row in rows]

    def residuals(self, at: Instant, laws: Sequence[Law]) -> list[Value]:
        """Return the residuals of rows that restrict positions, closures before drivers [m, rad, or m^2 for a length]."""
        residuals = [x for closure in self.closures for x in at.combine(closure)]
        for quantity, (value, _, _) in zip(self.prescribed, laws, strict=True):
            if quantity.gap:  # half the difference of squares, whose derivative d . d' needs no root
                d = at.combine(quantity.gap)
                residuals.append((dot(d, d) - value * value) / 2)
            else:
                residuals.append(quantity.turn + (0 if quantity.coordinate == NONE else at.x[quantity.coordinate]) - value)
        return residuals

    def rates(self, laws: Sequence[Law]) -> list[Value]:
        """Return the right-hand side `rate` of A x' = rate, in the order of the rows."""
        driven = [value * rate if quantity.gap else rate for quantity, (value, rate, _) in zip(self.prescribed, laws, strict=True)]
        return [0] * (2 * len(self.closures)) + driven + [0] * len(self.edges)

    def biases(self, at: Instant, v: Mapping[int, Value], laws: Sequence[Law]) -> list[Value]:
        """Return the right-hand side gamma of A x'' = gamma at velocities v (coordinate -> velocity), in the order of the rows."""
        rate, bias = at.variation(v), at.bias(v)
        biases = [-x for closure in self.closures for x in at.combine(closure, bias)]
        for quantity, (value, first, second) in zip(self.prescribed, laws, strict=True):
            if quantity.gap:
                # the second derivative of (d . d - L^2) / 2 for x'' = 0; u is d', b is d''
                d, u, b = (at.combine(quantity.gap, vectors) for vectors in (at, rate, bias))
                biases.append(first * first + value * second - (dot(u, u) + dot(d, b)))
            else:
                biases.append(second)
        for angle, point, normal in self.edges:
            n = at.combine(normal)  # n turns with the link, so that n' . P' = theta' n x P'
            u, b = (at.combine(point, vectors) for vectors in (rate, bias))
            biases.append(-(dot(n, b) + v.get(angle, 0) * cross(n, u)))
        return biases


def loop_rows(coordinates: LoopCoordinates) -> LoopRows:
    """Return the constraint rows of a mechanism, in the order of `LoopRows`."""
    mechanism = coordinates.mechanism
    edges = []
    for edge in mechanism.knife_edges:
        normal = coordinates.turn_vector(unit(edge.angle, across=True), edge.point.link)
        edges.append((coordinates.angle[edge.point.link], coordinates.point(edge.point), normal))
    names = [f"joint {name}" for name, _ in coordinates.closures for _ in ("x", "y")]
    names += [f"driver {d.name}" for d in mechanism.drivers] + [f"knife edge {e.name}" for e in mechanism.knife_edges]
    prescribed = tuple(prescribe(coordinates, d) for d in mechanism.drivers)
    return LoopRows(coordinates, tuple(x for _, x in coordinates.closures), prescribed, tuple(edges), tuple(names))


def prescribe(coordinates: LoopCoordinates, driver: Driver) -> Prescribed:
    """Return the quantity that a driver prescribes."""
    match driver:
        case AngleDriver():
            return Prescribed(driver.name, coordinate=coordinates.angle[driver.link], turn=coordinates.turn[driver.link], gap=())
        case SlideDriver():
            return Prescribed(driver.name, coordinate=coordinates.slides[driver.joint.name], turn=0, gap=())
        case LengthDriver():
            gap = merge(coordinates.point(driver.b), less=coordinates.point(driver.a))
            return Prescribed(driver.name, coordinate=NONE, turn=0, gap=gap)
    assert_never(driver)


def hold_start(rows: LoopRows, scenario: dict[str, Any], number: Number) -> tuple[LoopRows, list[Law], list[Any]]:
    """Return the constraint rows of the mechanism and its start, and their right-hand sides at t = 0.

    Returns:
        The rows, in the order: loops, points, drivers, angles and slides of the start, knife edges; the laws (value, rate and
        second rate) of every prescribed quantity, those of the drivers first; and the right-hand side b of A x' = b.
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
    loops = 2 * len(rows.closures)  # the closures of points come after those of the loops, and have the given velocities
    rates[loops : loops + len(speeds)] = speeds
    return held, laws, rates


def _list_held_angles(mechanism: Mechanism, start: dict[str, Any], number: Number) -> dict[int, tuple[Any, Any]]:
    """Return link -> angle [rad] and speed [rad/s] that the table `start` gives; its keys `crank` and `speed` mean the crank."""
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
    """Return the loop coordinates and their velocities (1, n) at t = 0, to the last digit of the type of number.

    Args:
        scenario: the scenario's table in the document.
        guess: (n,) loop coordinates of the assembly in double precision, from which the solution is searched.

    Raises:
        Unsolved: no coordinates near the guess satisfy the constraint rows and the values that the start gives.
    """
    n, eps = rows.coordinates.n, epsilon(number)
    held, laws, rates = hold_start(rows, scenario, number)
    x = np.array([[exact(number, value) for value in guess.tolist()]]).reshape(1, n)
    # first with the values of the start; their decimals may contradict the loops in the last digits, so that the loops and drivers
    # alone are closed once more
    for constraints in (held, rows):
        x = constraints.close(x, laws[: len(constraints.prescribed)], eps)
    A, b = held.entries(at_states(x)), stack_arrays(rates, x[:, 0])
    v = solve_by_chord(lambda v: multiply(A, v) - b, pseudo_inverse(to_dense(A, 1, n)), np.zeros_like(x), eps)
    return x, v
