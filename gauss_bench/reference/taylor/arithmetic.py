"""One arithmetic for arrays of numbers and for symbols, so that the equations of a linkage are written once for both.

A value is an array over states, a symbol, or one of the literals 0, 1 and -1, which are plain integers. A product of a symbol and a
literal is simplified before compilation, so that the compiled code has no operation for it. A vector of the plane is a pair of
values.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Value = Any
Vector = tuple[Value, Value]


@dataclass(frozen=True)
class Arithmetic:
    """The elementary functions for one type of value (arrays or symbols), and the conversion of a constant to this type."""

    cos: Callable[[Value], Value]
    sin: Callable[[Value], Value]
    sqrt: Callable[[Value], Value]
    constant: Callable[[Any], Value]

    def of(self, number: Any) -> Value:
        """Return the value for a constant number: the literal 0, 1 or -1 if the number is equal to it, else `constant(number)`."""
        for literal in (0, 1, -1):
            if number == literal:
                return literal
        return self.constant(number)


NUMBERS = Arithmetic(np.cos, np.sin, np.sqrt, lambda x: x)


def vanishes(a: Value) -> bool:
    """Tell whether a value is known to be zero for every state."""
    return isinstance(a, int) and a == 0


def total(values: Any) -> Value:
    """Return the sum of values, added in pairs, then in pairs of pairs, so that long sums have the least rounding errors."""
    parts = [x for x in values if not vanishes(x)]
    while len(parts) > 1:
        alone = parts[-1:] if len(parts) % 2 else []
        parts = [a + b for a, b in zip(parts[::2], parts[1::2], strict=False)] + alone
    return parts[0] if parts else 0


def plus(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1]


def scale_by(k: Value, a: Vector) -> Vector:
    """Return k a."""
    return k * a[0], k * a[1]


def quarter(a: Vector) -> Vector:
    """Return i a, the vector turned by 90 degrees counterclockwise."""
    return -a[1], a[0]


def product(a: Vector, b: Vector) -> Vector:
    """Return the product of two vectors as complex numbers."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def dot(a: Vector, b: Vector) -> Value:
    """Return the scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Vector, b: Vector) -> Value:
    """Return the component of a x b normal to the plane."""
    return a[0] * b[1] - a[1] * b[0]
