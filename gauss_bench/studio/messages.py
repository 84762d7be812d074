"""Checks of the values in a page's message."""

import math
import sys
from collections.abc import Mapping
from typing import Any

from gauss_bench.studio.errors import Refused
from gauss_bench.studio.security import DEEPEST

Message = Mapping[str, Any]
FARTHEST = 1e5  # [m] largest coordinate of a place


def value_of(message: Message, key: str, kind: type, otherwise: Any = None) -> Any:
    """Return a value of a message, or `otherwise` if it is missing.

    Raises:
        Refused: the value is of another type, or is missing without a default.
    """
    value = message.get(key, otherwise)
    if value is None and otherwise is None:
        raise Refused(f"{key} is missing", field=key)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise Refused(f"{key} has a wrong type", field=key)
    return value


def number(message: Message, key: str, otherwise: float | None = None) -> float:
    """Return a number of a message, or `otherwise` if it is missing.

    Raises:
        Refused: the value is no finite number.
    """
    x = message.get(key, otherwise)
    if not isinstance(x, (int, float)) or isinstance(x, bool) or not math.isfinite(x):
        raise Refused(f"{key} must be a finite number", field=key)
    return float(x)


def place(x: Any, field: str = "at") -> complex:
    """Return the point that a message gives as [x, y], as x + i y [m].

    Raises:
        Refused: the value is not a point, or is too far away.
    """
    numbers = isinstance(x, list) and len(x) == 2 and all(isinstance(y, (int, float)) and not isinstance(y, bool) for y in x)
    if not numbers or not all(abs(y) <= FARTHEST for y in x):
        raise Refused(f"a place is two numbers, each of at most {FARTHEST:g} m", field=field)
    return complex(*x)


def check_message(message: Message) -> None:
    """Check that all numbers of a message fit into a double, all texts can be written, and that it is not nested too deep.

    Raises:
        Refused: one of these is not true.
    """
    level: list[Any] = [message]  # all values at one level of nesting
    for _ in range(DEEPEST):
        for x in level:
            if isinstance(x, (int, float)) and not abs(x) <= sys.float_info.max:
                raise Refused("a number of the message is too large")
            if isinstance(x, str) and not x.isascii() and any("\ud800" <= c <= "\udfff" for c in x):
                raise Refused("a text of the message has half a character, which cannot be stored in a file")
        inner = [x for x in level if isinstance(x, (dict, list))]
        level = [y for x in inner for y in ((*x.keys(), *x.values()) if isinstance(x, dict) else x)]
        if not level:
            return
    raise Refused(f"the message is nested deeper than {DEEPEST} levels")
