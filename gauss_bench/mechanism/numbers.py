"""Numbers of any precision: a linkage is built from the decimals of its file in the number type of the later computation.

A `Number` is a function that converts decimal text to the type of the computation: float, numpy.longdouble, or a 128-bit type.
This file has the operations that numpy would round to double.
"""

from collections.abc import Callable, Mapping
from decimal import Decimal
from typing import Any

import numpy as np

Number = Callable[[str], Any]

PI = "3.14159265358979323846264338327950288419716939937510582097494"


def exact(number: Number, value: float | int | Decimal) -> Any:
    """Convert a number of the file by `number`; a float counts as its shortest decimal, so that 0.1 is one tenth."""
    return number(str(value))


def pair(number: Number, values: Any) -> Any:
    """Return a pair of numbers of the file, such as [x, y], as an array (2,)."""
    return np.array([exact(number, x) for x in values])


def radians(number: Number, degrees: float | Decimal) -> Any:
    """Convert an angle in degrees to radians, in the type of numbers that `number` returns."""
    return exact(number, degrees) * (number(PI) / number("180"))


def angle_of(table: Mapping[str, Any], key: str, number: Number = float) -> Any:
    """Return an angle [rad] that a table of the file gives as `key` or, in degrees, as `key_deg`; 0 if both are missing."""
    return exact(number, table[key]) if key in table else radians(number, table.get(f"{key}_deg", 0))


def turn_vector(vector: Any, theta: Any) -> Any:
    """Return a vector (2,), rotated by an angle theta [rad]."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def length(vector: Any) -> Any:
    """Return the Euclidean length of a vector (2,)."""
    return np.sqrt(vector[0] * vector[0] + vector[1] * vector[1])
