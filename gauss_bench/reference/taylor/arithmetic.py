"""One arithmetic for arrays of numbers and for symbols, so that the equations of a linkage are written once for both.

A value is an array over states, a symbol, or one of the literals 0, 1 and -1, which are plain integers: the compiled code has no
operation for a product with them. A vector of the plane is a pair of values. Matrices are sparse rows, each as column -> value.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.mechanism.numbers import Number
from gauss_bench.terms import Array

Value = Any
Vector = tuple[Value, Value]
Long = NDArray[Any]  # array of numbers of extended precision


@dataclass(frozen=True)
class Arithmetic:
    """The elementary functions for one type of value (arrays or symbols), and the conversion of a number to this type."""

    cos: Callable[[Value], Value]
    sin: Callable[[Value], Value]
    sqrt: Callable[[Value], Value]
    convert: Callable[[Any], Value]

    def constant(self, number: Any) -> Value:
        """Return the value of a constant: the literal 0, 1 or -1 if the number is equal to it, else `convert(number)`."""
        for literal in (0, 1, -1):
            if number == literal:
                return literal
        return self.convert(number)


NUMBERS = Arithmetic(np.cos, np.sin, np.sqrt, lambda x: x)


def vanishes(a: Value) -> bool:
    """Tell whether a value is known to be zero for every state."""
    return isinstance(a, int) and a == 0


def total(values: Any) -> Value:
    """Return the sum of values, added in pairs, then in pairs of pairs, so that long sums have the least rounding errors."""
    parts = [x for x in values if not vanishes(x)]
    while len(parts) > 1:
        unpaired = parts[-1:] if len(parts) % 2 else []
        parts = [a + b for a, b in zip(parts[::2], parts[1::2], strict=False)] + unpaired
    return parts[0] if parts else 0


def plus(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1]


def scale_by(k: Value, a: Vector) -> Vector:
    """Return k a."""
    return k * a[0], k * a[1]


def perp(a: Vector) -> Vector:
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


@lru_cache
def epsilon(number: Number) -> float:
    """Return the distance from 1 to the next larger number of a number type."""
    one = number("1")
    power = one / 2  # of 1/2
    while one + power != one:
        power = power / 2
    return float(power * 2)


def stack_arrays(values: Sequence[Value], like: Long) -> Long:
    """Return m values, each an array (k,), a number or a plain integer, as one array (k, m) in the number type of `like` (k,)."""
    zero = like - like
    return np.stack([zero + x for x in values], axis=-1) if len(values) else np.zeros((len(like), 0), dtype=like.dtype)


def to_dense(entries: Sequence[Mapping[int, Value]], k: int, n: int) -> Array:
    """Return sparse rows as matrices (k, m, n) in double precision."""
    A = np.zeros((k, len(entries), n))
    for r, row in enumerate(entries):
        for j, value in row.items():
            A[:, r, j] = np.asarray(value).astype(float)
    return A


def multiply(entries: Sequence[Mapping[int, Value]], x: Long) -> Long:
    """Return A x (k, m) in the type of x (k, n), for the sparse rows of A."""
    zero = x[:, 0] - x[:, 0]  # (k,) in the type of x
    return stack_arrays([sum((value * x[:, j] for j, value in row.items()), start=zero) for row in entries], zero)
