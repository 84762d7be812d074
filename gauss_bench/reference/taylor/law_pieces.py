"""Motion laws of drivers as formulas of time, for a linkage whose motion is driven only in part.

Time is divided into pieces at the breaks of all laws, so that every law is smooth within a piece. The values at both ends of a
piece are taken from the motion law of the mechanism. The formulas for the times in between are derived here a second time:

    constant:   value + rate (t - t0)
    table:      the cubic with value, rate and curvature at one knot and the curvature at the next
    rise:       start + travel f(t / time), f one of: s - sin(2 pi s) / 2 pi,  (1 - cos(pi s)) / 2,  s^3 (10 - 15 s + 6 s^2)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gauss_bench.linkage.references import drivers_of
from gauss_bench.mechanism.model import Driver
from gauss_bench.mechanism.numbers import PI, Number
from gauss_bench.reference.motion import find_breaks
from gauss_bench.reference.taylor.arithmetic import Arithmetic, Value
from gauss_bench.reference.taylor.rows import Law


@dataclass(frozen=True, eq=False)
class Piece:
    """An interval of time between two breaks of the motion laws, within which every law is smooth.

    Attributes:
        drivers: every driver, and its table in the document.
        begin, end: limits of the interval [s]; the last piece has no end.
    """

    drivers: tuple[tuple[Driver, dict[str, Any]], ...]
    begin: Any
    end: Any
    number: Number

    def laws(self, t: Value, arithmetic: Arithmetic) -> list[Law]:
        """Return the value, rate and second rate that each driver prescribes at a time t within this interval."""
        return [self._law(driver, table, t, arithmetic) for driver, table in self.drivers]

    def _law(self, driver: Driver, table: dict[str, Any], t: Value, arithmetic: Arithmetic) -> Law:
        """Return the value, rate and second rate that one driver prescribes at a time t within this interval."""
        value, rate, second = driver.law(self.begin)
        zero, origin, breaks = rate - rate, self.begin, find_breaks(table, self.number)  # zero in the type of number
        coefficients = [value, rate, second / 2]  # a constant rate, unless one of the cases below holds
        if breaks and (self.begin >= max(breaks) or ("rows" in table and self.begin < min(breaks))):
            coefficients = [value]  # before and after its motion a law is constant
        elif "time" in table:  # a rise from t = 0 within `time`
            start, time = driver.law(self.number("0"))[0], breaks[0]
            travel = driver.law(time)[0] - start
            if driver.law.name != "poly345":
                return wave(driver.law.name, start, travel, time, self.number(PI), t, arithmetic)
            cube = travel / (time * time * time)
            coefficients, origin = [start, zero, zero, 10 * cube, -15 * cube / time, 6 * cube / (time * time)], zero
        elif "rows" in table:  # the cubic whose second derivative is linear between the knots
            coefficients.append((driver.law(self.end)[2] - second) / (self.end - self.begin) / 6)
        return polynomial(coefficients, t - arithmetic.constant(origin), arithmetic)


def wave(name: str, start: Any, travel: Any, time: Any, pi: Any, t: Value, arithmetic: Arithmetic) -> Law:
    """Return value, rate and second rate at a time t of a rise "sine" or "cosine" from `start` by `travel` within `time` [s].

    The rise is start + speed t + A (cos w t - 1) + B sin w t.
    """
    sine, constant = name == "sine", arithmetic.constant
    zero = travel - travel  # in the type of number of the travel
    w = 2 * pi / time if sine else pi / time
    speed = travel / time if sine else zero
    A, B = (zero, -speed / w) if sine else (-travel / 2, zero)
    c, s = arithmetic.cos(constant(w) * t), arithmetic.sin(constant(w) * t)
    value = constant(start - A) + (constant(speed) * t + (constant(A) * c + constant(B) * s))
    rate = constant(speed) + (constant(B * w) * c - constant(A * w) * s)
    return value, rate, 0 - (constant(A * w * w) * c + constant(B * w * w) * s)


def polynomial(c: list[Any], x: Value, arithmetic: Arithmetic) -> Law:
    """Return sum_k c_k x^k, and its first and second derivative."""
    levels = []
    for _ in range(3):
        value: Value = 0
        for a in reversed(c):  # Horner's scheme
            value = arithmetic.constant(a) + x * value
        levels.append(value)
        c = [k * a for k, a in enumerate(c)][1:]  # coefficients of the derivative
    return levels[0], levels[1], levels[2]


def cut_pieces(drivers: Sequence[Driver], scenario: dict[str, Any], number: Number) -> list[Piece]:
    """Divide the time from t = 0 on at the breaks of all motion laws of a scenario's table; the last piece has no end."""
    pairs, zero = tuple(zip(drivers, drivers_of(scenario), strict=True)), number("0")
    times = [zero]
    for t in sorted(x for _, table in pairs for x in find_breaks(table, number)):
        if t > times[-1]:
            times.append(t)
    return [Piece(pairs, begin, end, number) for begin, end in zip(times, [*times[1:], None], strict=True)]
