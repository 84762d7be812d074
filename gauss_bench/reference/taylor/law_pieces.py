"""Motion laws as formulas of time, for a linkage that drivers move in part: between two breaks every law is smooth.

Values at the ends of a piece come from the law itself; what stands between is written anew:

    constant    value + rate (t - t0)
    table       the cubic with value, rate and curvature at one knot and the curvature at the next
    rise        start + travel f(t / time), f one of: s - sin(2 pi s) / 2 pi,  (1 - cos(pi s)) / 2,  s^3 (10 - 15 s + 6 s^2)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gauss_bench.mechanism.model import Driver
from gauss_bench.mechanism.numbers import PI, Number, exact
from gauss_bench.reference.taylor.arithmetic import Arithmetic, Value, add, mul, sub
from gauss_bench.reference.taylor.rows import Law


@dataclass(frozen=True, eq=False)
class Piece:
    """The time between two breaks; `end` is None for the last one."""

    drivers: tuple[tuple[Driver, dict[str, Any]], ...]
    begin: Any
    end: Any
    number: Number

    def laws(self, t: Value, arithmetic: Arithmetic) -> list[Law]:
        """Value, rate and second rate of every driver at a time within the piece."""
        return [self._law(driver, table, t, arithmetic) for driver, table in self.drivers]

    def _law(self, driver: Driver, table: dict[str, Any], t: Value, arithmetic: Arithmetic) -> Law:
        value, rate, second = driver.law(self.begin)
        none = rate - rate
        third, ends = none, breaks(table, self.number)
        if ends and (self.begin >= max(ends) or ("rows" in table and self.begin < min(ends))):
            rate, second = none, none
        elif "time" in table:
            return self._rise(driver, exact(self.number, table["time"]), t, arithmetic)
        elif "rows" in table:
            third = (driver.law(self.end)[2] - second) / (self.end - self.begin)
        return polynomial([value, rate, second / 2, third / 6], sub(t, arithmetic.of(self.begin)), arithmetic)

    def _rise(self, driver: Driver, time: Any, t: Value, arithmetic: Arithmetic) -> Law:
        start, one = driver.law(self.number("0"))[0], self.number("1")
        travel = driver.law(time)[0] - start
        s = mul(arithmetic.of(one / time), t)
        if driver.law.name == "poly345":
            zero = one - one
            rise = polynomial([zero, zero, zero, 10 * one, -15 * one, 6 * one], s, arithmetic)
        else:
            rise = self._wave(driver.law.name, s, arithmetic)
        return (
            add(arithmetic.of(start), mul(arithmetic.of(travel), rise[0])),
            mul(arithmetic.of(travel / time), rise[1]),
            mul(arithmetic.of(travel / (time * time)), rise[2]),
        )

    def _wave(self, name: str, s: Value, arithmetic: Arithmetic) -> Law:
        pi = self.number(PI)
        w = 2 * pi if name == "sine" else pi
        angle = mul(arithmetic.of(w), s)
        c, sine = arithmetic.cos(angle), arithmetic.sin(angle)
        if name == "sine":
            return sub(s, mul(arithmetic.of(1 / w), sine)), sub(1, c), mul(arithmetic.of(w), sine)
        half = arithmetic.of(self.number("1") / 2)
        return mul(half, sub(1, c)), mul(arithmetic.of(w / 2), sine), mul(arithmetic.of(w * w / 2), c)


def polynomial(c: list[Any], x: Value, arithmetic: Arithmetic) -> Law:
    """sum_k c_k x^k with its first and second derivative."""

    def horner(coefficients: list[Any]) -> Value:
        value: Value = 0
        for a in reversed(coefficients):
            value = add(arithmetic.of(a), mul(x, value))
        return value

    first = [k * a for k, a in enumerate(c)][1:]
    return horner(c), horner(first), horner([k * a for k, a in enumerate(first)][1:])


def breaks(table: dict[str, Any], number: Number) -> list[Any]:
    """Times [s] at which a driver's law is not smooth: the end of a rise, the knots of a table."""
    return [exact(number, x) for x in (*([table["time"]] if "time" in table else []), *(row[0] for row in table.get("rows", [])))]


def pieces(drivers: Sequence[Driver], scenario: dict[str, Any], number: Number) -> list[Piece]:
    """The pieces of all laws of a scenario together, from t = 0."""
    tables = [scenario["driver"]] if "driver" in scenario else scenario.get("drivers", [])
    pairs = tuple(zip(drivers, tables, strict=True))
    zero = number("0")
    ends = sorted(x for table in tables for x in breaks(table, number) if x > zero)
    knots = [x for k, x in enumerate(ends) if k == 0 or x != ends[k - 1]]
    return [Piece(pairs, begin, end, number) for begin, end in zip([zero, *knots], [*knots, None], strict=True)]
