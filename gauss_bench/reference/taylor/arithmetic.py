"""One arithmetic for arrays of numbers and for symbols: the equations of a linkage are written once and serve both.

A value is an array over states, a symbol, or one of the literals 0, 1 and -1, written as plain integers: a product of a symbol with
what is known to vanish or to be one is no operation of the compiled code. A vector of the plane is a pair of values.
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


def vanishes(a: Value) -> bool:
    """Tell whether a value is known to be zero for every state."""
    return isinstance(a, int) and a == 0


def total(values: Any) -> Value:
    """Sum of any number of values, added in pairs, then pairs of pairs, so that long sums of arrays lose least to rounding."""
    parts = [x for x in values if not vanishes(x)]
    while len(parts) > 1:
        parts = [sum(parts[k + 1 : k + 2], start=parts[k]) for k in range(0, len(parts), 2)]
    return parts[0] if parts else 0


def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1]


def scale_by(k: Value, a: Vector) -> Vector:
    return k * a[0], k * a[1]


def quarter(a: Vector) -> Vector:
    """i a, the vector turned by a quarter to the left."""
    return -a[1], a[0]


def product(a: Vector, b: Vector) -> Vector:
    """a b, as complex numbers."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def dot(a: Vector, b: Vector) -> Value:
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Vector, b: Vector) -> Value:
    return a[0] * b[1] - a[1] * b[0]
