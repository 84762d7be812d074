"""The constraint rows in loop coordinates: closures of loops, drivers and knife edges, each with two time derivatives.

    closure of a loop:    P = 0, with P the sum of vectors around the loop; two rows, for x and y
    driver of an angle:   theta + turn - law(t) = 0, with a constant `turn`
    driver of a slide:    s - law(t) = 0
    driver of a length:   (d . d - law(t)^2) / 2 = 0, with d the vector from one point to the other
    knife edge:           n . P' = 0, with P the point of the edge and n its normal, which turns with the link

The rows of knife edges restrict velocities, but not positions. The time derivatives of the rows are A x' = rate and A x'' = gamma:
A is their Jacobian, `rate` the velocities that drivers prescribe, and gamma the negative sum of all terms of the second derivative
without x''.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, assert_never

from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import AngleDriver, Driver, LengthDriver, SlideDriver
from gauss_bench.reference.refinement import pseudo_inverse, solve_by_chord
from gauss_bench.reference.taylor.arithmetic import Value, cross, dot, vanishes
from gauss_bench.reference.taylor.moving_vectors import Instant, at_states
from gauss_bench.reference.taylor.solve import Long, stack_arrays, to_dense
from gauss_bench.reference.taylor.vector_sums import NONE, LoopCoordinates, Sum, merge

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
        coordinates: the loop coordinates of the mechanism.
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
        """Number of rows."""
        return len(self.names)

    def laws(self, t: Any) -> list[Law]:
        """Return value, rate and second rate of every driver at a time, or at times (k,)."""
        return [driver.law(t) for driver in self.coordinates.mechanism.drivers]

    def close(self, x: Long, laws: Sequence[Law], eps: float) -> Long:
        """Return the positions (k, n) near x (k, n) that satisfy all rows to the last digit of the type of x.

        The pseudo-inverse of A at x serves for all iterations (chord iteration).

        Raises:
            Unsolved: no positions near x satisfy all rows.
        """
        zero = x[:, 0] - x[:, 0]  # (k,) in the type of x

        def residual(x: Long) -> Long:
            """Return the residuals (k, m) of all rows; knife edges restrict only velocities and have none."""
            return stack_arrays([*self.residuals(at_states(x), laws), *(0 for _ in self.edges)], zero)

        return solve_by_chord(residual, pseudo_inverse(to_dense(self.entries(at_states(x)), *x.shape)), x, eps)

    def entries(self, at: Instant) -> list[dict[int, Value]]:
        """Return the rows of A, the Jacobian of the constraints, each as coordinate -> derivative; vanishing entries are left out.

        Args:
            at: the coordinates x, and the vectors l e of `moving_vectors` at x.
        """
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
        for _, point, normal in self.edges:  # n . P' = 0
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
        """Return the right-hand side `rate` of A x' = rate, with A the Jacobian, in the order of the rows."""
        driven = [value * rate if quantity.gap else rate for quantity, (value, rate, _) in zip(self.prescribed, laws, strict=True)]
        return [0] * (2 * len(self.closures)) + driven + [0] * len(self.edges)

    def biases(self, at: Instant, v: Mapping[int, Value], laws: Sequence[Law]) -> list[Value]:
        """Return the right-hand side gamma of A x'' = gamma, with A the Jacobian, in the order of the rows.

        Args:
            at: the coordinates x, and the vectors l e of `moving_vectors` at x; v: coordinate -> its velocity.
            laws: value, rate and second rate that every driver prescribes.
        """
        # functions that give the time derivative of a vector, and the part of its second derivative that does not depend on x''
        rate, bias = at.variation(v), at.bias(v)
        biases = [-x for closure in self.closures for x in at.combine(closure, bias)]
        for quantity, (value, first, second) in zip(self.prescribed, laws, strict=True):
            if quantity.gap:
                # the second derivative of (d . d - L^2) / 2 without its part that is linear in x''; u is d', b is d'' for x'' = 0
                d, u, b = (at.combine(quantity.gap, of) for of in (at, rate, bias))
                biases.append(first * first + value * second - (dot(u, u) + dot(d, b)))
            else:
                biases.append(second)
        for angle, point, normal in self.edges:
            n = at.combine(normal)  # turns with the link, so that n' . P' = theta' n x P'
            u, b = (at.combine(point, of) for of in (rate, bias))
            biases.append(-(dot(n, b) + v.get(angle, 0) * cross(n, u)))
        return biases


def loop_rows(coordinates: LoopCoordinates) -> LoopRows:
    """Collect the constraint rows of a mechanism: two for each closed loop, one for each driver, one for each knife edge."""
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
    """Return the quantity that a driver prescribes: an angle or a displacement as a coordinate plus a constant, or a length.

    A length is not a coordinate, and is given by the vector between its two points.
    """
    match driver:
        case AngleDriver():
            return Prescribed(driver.name, coordinate=coordinates.angle[driver.link], turn=coordinates.turn[driver.link], gap=())
        case SlideDriver():
            return Prescribed(driver.name, coordinate=coordinates.slides[driver.joint.name], turn=0, gap=())
        case LengthDriver():
            gap = merge(coordinates.point(driver.b), less=coordinates.point(driver.a))
            return Prescribed(driver.name, coordinate=NONE, turn=0, gap=gap)
    assert_never(driver)
