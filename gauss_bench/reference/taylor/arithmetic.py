"""One arithmetic for arrays of numbers and for symbols: the equations of a linkage are written once and serve both.

A value is an array over states, a symbol, or one of the literals 0, 1 and -1, written as plain integers: what is known to vanish
or to be one while the equations are written never becomes an operation. A vector of the plane is a pair of values.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Value = Any
Vector = tuple[Value, Value]


@dataclass(frozen=True)
class Arithmetic:
    """Elementary functions of the values, and what makes a value of a constant."""

    cos: Callable[[Value], Value]
    sin: Callable[[Value], Value]
    sqrt: Callable[[Value], Value]
    constant: Callable[[Any], Value]

    def of(self, number: Any) -> Value:
        """A constant, as a literal where it is one."""
        for literal in (0, 1, -1):
            if number == literal:
                return literal
        return self.constant(number)


NUMBERS = Arithmetic(np.cos, np.sin, np.sqrt, lambda x: x)


def literal(a: Value, value: int) -> bool:
    return isinstance(a, int) and a == value


def neg(a: Value) -> Value:
    return -a


def add(a: Value, b: Value) -> Value:
    return b if literal(a, 0) else a if literal(b, 0) else a + b


def sub(a: Value, b: Value) -> Value:
    return a if literal(b, 0) else -b if literal(a, 0) else a - b


def mul(a: Value, b: Value) -> Value:
    """Product; a literal factor costs nothing."""
    for x, y in ((a, b), (b, a)):
        if isinstance(x, int):
            return 0 if x == 0 else y if x == 1 else -y if x == -1 else x * y
    return a * b


def div(a: Value, b: Value) -> Value:
    return 0 if literal(a, 0) else a if literal(b, 1) else -a if literal(b, -1) else a / b


def total(values: Any) -> Value:
    """Sum of any number of values, added in pairs, then pairs of pairs, so that long sums of arrays lose least to rounding."""
    parts = [x for x in values if not literal(x, 0)]
    while len(parts) > 1:
        parts = [add(*parts[k : k + 2]) if k + 1 < len(parts) else parts[k] for k in range(0, len(parts), 2)]
    return parts[0] if parts else 0


def plus(a: Vector, b: Vector) -> Vector:
    return add(a[0], b[0]), add(a[1], b[1])


def minus(a: Vector, b: Vector) -> Vector:
    return sub(a[0], b[0]), sub(a[1], b[1])


def scale_by(k: Value, a: Vector) -> Vector:
    return mul(k, a[0]), mul(k, a[1])


def quarter(a: Vector) -> Vector:
    """i a, the vector turned by a quarter to the left."""
    return neg(a[1]), a[0]


def product(a: Vector, b: Vector) -> Vector:
    """a b, as complex numbers."""
    return sub(mul(a[0], b[0]), mul(a[1], b[1])), add(mul(a[0], b[1]), mul(a[1], b[0]))


def dot(a: Vector, b: Vector) -> Value:
    return add(mul(a[0], b[0]), mul(a[1], b[1]))


def cross(a: Vector, b: Vector) -> Value:
    return sub(mul(a[0], b[1]), mul(a[1], b[0]))
