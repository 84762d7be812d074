"""Read an engine's options from a text that a user writes in one of three forms.

    NAME:                 the options of the settings, or of the variant, with this name
    KEY=VALUE,...:        the options of the engine's first settings, with the given options changed
    NAME,KEY=VALUE,...:   the options of the settings or variant NAME, with the given options changed

The first settings of an engine define its options, and the type of each value: Boolean, number, list of fixed length, or word. A
word must occur in settings or variants of the engine, or among the values that the engine lists for the option.
"""

import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gauss_bench.untrusted import parse_toml

COMMA = re.compile(r',(?![^\[]*\])(?=(?:[^"]*"[^"]*")*[^"]*$)')  # a comma outside of brackets and quotes
BARE = re.compile(r"[^\s\"'\[\]=]+( [^\s\"'\[\]=]+)*")  # one or several words without quotes


class OptionError(ValueError):
    """An engine lacks the given option, or the option cannot have the given value; the message lists what is possible."""


@dataclass(frozen=True)
class OptionTable:
    """The settings, variants and options of an engine, by name.

    Attributes:
        labels: name of settings or of a variant -> option -> value; the first entry holds the engine's defaults.
        options: option that a user may give as KEY=VALUE -> values that it may have besides those that occur in `labels`.
    """

    labels: Mapping[str, Mapping[str, Any]]
    options: Mapping[str, Sequence[str]]

    def resolve(self, text: str) -> dict[str, Any]:
        """Return option -> value for a text in one of the three forms.

        Raises:
            KeyError: no settings and no variant have that name.
            OptionError: an option is unknown or given twice, or its value has the wrong type.
        """
        if text in self.labels:
            return dict(self.labels[text])
        # a text without a name changes the engine's first settings
        parts = [x.strip() for x in COMMA.split(text)]
        name = next(iter(self.labels)) if is_assignment(parts[0]) else parts.pop(0)
        for part in (name, *parts):
            if not is_assignment(part) and part not in self.labels:
                raise KeyError(f"neither settings nor a variant: {part!r}; there are {', '.join(self.labels)}")
        changes: dict[str, Any] = {}
        for part in parts:
            if not is_assignment(part):
                raise OptionError(f"{part!r}: only the first part may be a name; all others have the form KEY=VALUE")
            key, value = (x.strip() for x in part.split("=", 1))
            if key not in self.options:
                raise OptionError(f"no option {key!r}; there are {self.describe() or 'none'}")
            if key in changes:
                raise OptionError(f"the option {key!r} is given twice")
            changes[key] = self.check_value(key, _read(value), value)
        return {**self.labels[name], **changes}

    def describe(self) -> str:
        """List the options with their default values, as KEY=VALUE."""
        usual = next(iter(self.labels.values()), {})
        return ", ".join(f"{key}={_write(usual[key])}" for key in self.options)

    def check_value(self, key: str, value: Any, shown: str) -> Any:
        """Return the value of the option `key`; numbers become floats if the default is a float or a list.

        Raises:
            OptionError: the option cannot have this value, which the message shows as `shown`.
        """
        usual = next(iter(self.labels.values()))[key]
        match usual:
            case bool():  # before int: Python's bool is an int
                wanted, is_valid = "true or false", isinstance(value, bool)
            case int():
                wanted, is_valid = "a whole number of at least 1", _is_number(value, int) and value >= 1
            case float():
                wanted, is_valid = "a number that is not negative", _is_number(value) and value >= 0
                value = float(value) if is_valid else value
            case list() | tuple():
                wanted = f"{len(usual)} numbers in brackets, as in {_write(usual)}"
                is_valid = isinstance(value, list) and len(value) == len(usual) and all(map(_is_number, value))
                value = [float(x) for x in value] if is_valid else value
            case _:
                used = (options[key] for options in self.labels.values() if key in options)
                words = list(dict.fromkeys([*used, *self.options[key]]))
                wanted, is_valid = f"one of: {'; '.join(words)}", value in words
        if not is_valid:
            raise OptionError(f"the option {key!r} takes {wanted}; not {shown!r}")
        return value


def write_options(name: str, changes: Mapping[str, Any]) -> str:
    """Return the text NAME,KEY=VALUE,... from which `OptionTable.resolve` reads exactly the same values."""
    return ",".join([name, *(f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in changes.items())])


def is_assignment(text: str) -> bool:
    """Tell whether a text has the form KEY=VALUE; otherwise it is a name."""
    return "=" in text


def _read(text: str) -> Any:
    """Return the value of a text in TOML; words without quotes are returned as they are, and None for any other text."""
    if "\n" in text:  # a second line could hold a second value
        return None
    try:
        return parse_toml(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        return text if BARE.fullmatch(text) else None


def _is_number(x: Any, kind: Any = (int, float)) -> bool:
    """Tell whether x is a finite number of a kind, and no bool, which is an int in Python."""
    return isinstance(x, kind) and not isinstance(x, bool) and math.isfinite(x)


def _write(value: Any) -> str:
    """Return a value as a text that `resolve` reads; floats are rounded to six digits."""
    match value:
        case list() | tuple():
            return f"[{','.join(map(_write, value))}]"
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}"
    return str(value)
