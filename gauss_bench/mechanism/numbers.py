"""Numbers of any precision: a linkage is built from the decimals of its file in the type that computes with it.

A `Number` converts decimal text to its type: float, numpy.longdouble, or the 128-bit type of an extended library. All of them add,
multiply and work with numpy's elementary functions; operations that numpy would round to double are implemented here.
"""

from collections.abc import Callable, Mapping
from decimal import Decimal
from typing import Any

import numpy as np

Number = Callable[[str], Any]

PI = "3.14159265358979323846264338327950288419716939937510582097494"


def exact(number: Number, value: float | int | Decimal) -> Any:
    """Convert a number of the file to the type; a float is taken as its shortest decimal, so that 0.1 means one tenth."""
    return number(str(value))


def pair(number: Number, values: Any) -> Any:
    """(2,) array of the type."""
    return np.array([exact(number, x) for x in values])


def radians(number: Number, degrees: float | Decimal) -> Any:
    """Degrees of the file as radians."""
    return exact(number, degrees) * (number(PI) / number("180"))


def angle_of(table: Mapping[str, Any], key: str, number: Number = float) -> Any:
    """The angle `key` of a table in radians, written as `key` or as `key_deg`; 0 where neither is given."""
    return exact(number, table[key]) if key in table else radians(number, table.get(f"{key}_deg", 0))


def direction(theta: Any) -> Any:
    """Unit vector (2,) at an angle [rad]."""
    return np.array([np.cos(theta), np.sin(theta)])


def turn_vector(vector: Any, theta: Any) -> Any:
    """A vector (2,), turned by an angle [rad]."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def length(vector: Any) -> Any:
    """Euclidean length of a vector (2,)."""
    return np.sqrt(vector[0] * vector[0] + vector[1] * vector[1])
