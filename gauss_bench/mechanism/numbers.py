"""Numbers of any precision: a linkage is built in the type it will be computed in, from the decimals its file says.

A `Number` makes one value of its type from decimal text: float, numpy.longdouble, or the 128-bit type of an extended library. All
of them add, multiply and go through numpy's elementary functions; what numpy would round to double on the way is done here.
"""

from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np

Number = Callable[[str], Any]

PI = "3.14159265358979323846264338327950288419716939937510582097494"


def exact(number: Number, value: float | int | Decimal) -> Any:
    """A number of the file in the type asked for; a float stands for the shortest decimal that reads as it."""
    return number(str(value))


def pair(number: Number, values: Any) -> Any:
    """(2,) array of the type."""
    return np.array([exact(number, x) for x in values])


def radians(number: Number, degrees: float | Decimal) -> Any:
    """Degrees of the file as radians."""
    return exact(number, degrees) * (number(PI) / number("180"))


def direction(theta: Any) -> Any:
    """Unit vector (2,) at an angle [rad]."""
    return np.array([np.cos(theta), np.sin(theta)])


def length(vector: Any) -> Any:
    """Euclidean length of a vector (2,)."""
    return np.sqrt(vector[0] * vector[0] + vector[1] * vector[1])
