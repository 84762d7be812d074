"""Read and check the values of a message that a page sends; the error `Refused` refuses a request."""

import math
import sys
from collections.abc import Mapping
from typing import Any

from gauss_bench.studio.security import DEEPEST

Message = Mapping[str, Any]
FARTHEST = 1e5  # [m] largest coordinate of a place


class Refused(ValueError):
    """The error with which a function that reads a message or a drawing refuses the request; its text is shown to the user.

    Attributes:
        where: ids of the parts of the drawing that the refusal concerns: `links.NAME`, `pins.ID`, `slides.NAME`, `forces.NAME`.
        field: key of the message that is at fault, or "".
    """

    def __init__(self, text: str, where: tuple[str, ...] = (), field: str = ""):
        self.where, self.field = where, field
        super().__init__(text)


def value_of(message: Message, key: str, kind: type, otherwise: Any = None) -> Any:
    """Return the value of type `kind` at a key of a message. A missing key gives `otherwise`, or is refused without `otherwise`."""
    value = message.get(key, otherwise)
    if value is None and otherwise is None:
        raise Refused(f"{key} is missing", field=key)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise Refused(f"{key} has a wrong type", field=key)
    return value


def number(message: Message, key: str, otherwise: float | None = None) -> float:
    """Return the finite number at a key of a message. A missing key gives `otherwise`, or is refused without `otherwise`."""
    x = message.get(key, otherwise)
    if not isinstance(x, (int, float)) or isinstance(x, bool) or not math.isfinite(x):
        raise Refused(f"{key} must be a finite number", field=key)
    return float(x)


def place(x: Any, field: str = "at") -> complex:
    """Return x + i y [m] for a point that a message gives as [x, y]; `field` is the key that a refusal names."""
    is_pair = isinstance(x, list) and len(x) == 2 and all(isinstance(y, (int, float)) and not isinstance(y, bool) for y in x)
    if not is_pair or not all(abs(y) <= FARTHEST for y in x):
        raise Refused(f"a place is two numbers, each of at most {FARTHEST:g} m", field=field)
    return complex(*x)


def check_message(message: Message) -> None:
    """Refuse a message with a number beyond a double, a text that no file can store, or more than DEEPEST levels of nesting."""
    level: list[Any] = [message]  # all values at one level of nesting
    for _ in range(DEEPEST):
        inner: list[Any] = []
        for x in level:
            if isinstance(x, (int, float)) and not abs(x) <= sys.float_info.max:
                raise Refused("a number of the message is too large")
            if isinstance(x, str) and not x.isascii() and any("\ud800" <= c <= "\udfff" for c in x):  # half of a surrogate pair
                raise Refused("a text of the message has half a character, which cannot be stored in a file")
            if isinstance(x, dict):
                inner += [*x.keys(), *x.values()]
            elif isinstance(x, list):
                inner += x
        if not inner:
            return
        level = inner
    raise Refused(f"the message is nested deeper than {DEEPEST} levels")
