"""The content of a page's message: values of one kind or another, checked before anything is made of them."""

import math
import sys
from collections.abc import Mapping
from typing import Any

from gauss_bench.studio.errors import Refused
from gauss_bench.studio.security import DEEPEST

Message = Mapping[str, Any]
FARTHEST = 1e5  # [m]


def tell_kind(message: Message, key: str, kind: type, otherwise: Any = None) -> Any:
    """A value of a message.

    Raises:
        Refused: it is of another kind, or missing where nothing else is given.
    """
    value = message.get(key, otherwise)
    if value is None and otherwise is None:
        raise Refused(f"{key} is missing", field=key)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise Refused(f"{key} is not what it should be", field=key)
    return value


def number(message: Message, key: str, otherwise: float | None = None) -> float:
    """A number of a message.

    Raises:
        Refused: it is none.
    """
    x = message.get(key, otherwise)
    if not isinstance(x, (int, float)) or isinstance(x, bool) or not math.isfinite(x):
        raise Refused(f"{key} is a number", field=key)
    return float(x)


def place(x: Any, field: str = "at") -> complex:
    """A place x + i y [m] of a message.

    Raises:
        Refused: it is none, or is further off than a linkage may be.
    """
    numbers = isinstance(x, list) and len(x) == 2 and all(isinstance(y, (int, float)) and not isinstance(y, bool) for y in x)
    if not numbers or not all(abs(y) <= FARTHEST for y in x):
        raise Refused(f"a place is two numbers of metres, at most {FARTHEST:g}", field=field)
    return complex(*x)


def sound(message: Message) -> None:
    """Check that every number of a message is one to compute with, every text one to write, and none of it endlessly deep.

    Raises:
        Refused: it is not so.
    """
    level: list[Any] = [message]
    for _ in range(DEEPEST):
        for x in level:
            if isinstance(x, (int, float)) and not abs(x) <= sys.float_info.max:
                raise Refused("a number of the message is larger than any that can be computed with")
            if isinstance(x, str) and not x.isascii() and any("\ud800" <= c <= "\udfff" for c in x):
                raise Refused("a text of the message has half a character, which no file can hold")
        inner = [x for x in level if isinstance(x, (dict, list))]
        level = [y for x in inner for y in ((*x.keys(), *x.values()) if isinstance(x, dict) else x)]
        if not level:
            return
    raise Refused(f"the message is nested deeper than {DEEPEST} levels")
