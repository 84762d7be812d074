"""An engine's own options as a user writes them: NAME, KEY=VALUE,... or NAME,KEY=VALUE,... where NAME is a setting or a variant.

Without a name the engine's first settings apply. These settings also define which options exist and their types: a number must stay
a number, a list must keep its length, and a word must be one that a setting or variant of the engine uses or that its knob lists.
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
BARE = re.compile(r"[^\s\"'\[\]=]+( [^\s\"'\[\]=]+)*")  # a word, or several, without quotes


class OptionError(ValueError):
    """An option that an engine does not have, or a value that an option cannot take; the message lists what is possible."""


@dataclass(frozen=True)
class OptionTable:
    """The settings, variants and options of an engine, by name.

    Attributes:
        labels: name of a setting or variant -> option -> value; the first entry holds the engine's defaults.
        options: option that a user may give as KEY=VALUE -> further permitted words, if its values are words.
    """

    labels: Mapping[str, Mapping[str, Any]]
    options: Mapping[str, Sequence[str]]

    def resolve(self, text: str) -> dict[str, Any]:
        """Return the value of every option under a text: the name of a setting or variant, KEY=VALUE pairs, or both.

        Raises:
            KeyError: no setting and no variant has that name.
            OptionError: an option is unknown or given twice, or its value has the wrong type.
        """
        if text in self.labels:
            return dict(self.labels[text])
        parts = [x.strip() for x in COMMA.split(text)]
        name = next(iter(self.labels)) if is_assignment(parts[0]) else parts.pop(0)
        for part in (name, *parts):
            if not is_assignment(part) and part not in self.labels:
                raise KeyError(f"neither settings nor a variant: {part!r}; there are {', '.join(self.labels)}")
        changes: dict[str, Any] = {}
        for part in parts:
            if not is_assignment(part):
                raise OptionError(f"{part!r}: only the first may be a name, what follows is KEY=VALUE")
            key, value = (x.strip() for x in part.split("=", 1))
            if key not in self.options:
                raise OptionError(f"no option {key!r}; there are {self.describe() or 'none'}")
            if key in changes:
                raise OptionError(f"the option {key!r} is given twice")
            changes[key] = self._read_value(key, value)
        return {**self.labels[name], **changes}

    def describe(self) -> str:
        """List the options with their default values, as KEY=VALUE."""
        usual = next(iter(self.labels.values()), {})
        return ", ".join(f"{key}={_write(usual[key])}" for key in self.options)

    def _read_value(self, key: str, text: str) -> Any:
        """Read the value of an option; it must have the type of the option's default.

        Raises:
            OptionError: it has another type, or is not in the range of the option.
        """
        return self.check_value(key, _read(text), text)

    def check_value(self, key: str, value: Any, shown: str) -> Any:
        """Return the value of an option, with its numbers as floats where the default has floats; `shown` is the value as text.

        Raises:
            OptionError: it has another type than the default, or is not in the range of the option.
        """
        usual = next(iter(self.labels.values()))[key]
        match usual:
            case bool():  # before int: Python's bool is an int
                wanted, good = "true or false", isinstance(value, bool)
            case int():
                wanted, good = "a whole number from 1 on", _is_number(value, int) and value >= 1
            case float():
                wanted, good = "a number that is not negative", _is_number(value) and value >= 0
                value = float(value) if good else value
            case list() | tuple():
                wanted = f"{len(usual)} numbers in brackets, as in {_write(usual)}"
                good = isinstance(value, list) and len(value) == len(usual) and all(map(_is_number, value))
                value = [float(x) for x in value] if good else value
            case _:
                words = self._words(key)
                wanted, good = f"one of: {'; '.join(words)}", value in words
        if not good:
            raise OptionError(f"the option {key!r} takes {wanted}; not {shown!r}")
        return value

    def _words(self, key: str) -> list[str]:
        """List the words that an option may take, without repetition."""
        used = (options[key] for options in self.labels.values() if key in options)
        return list(dict.fromkeys([*used, *self.options[key]]))


def write_options(name: str, changes: Mapping[str, Any]) -> str:
    """Return the text NAME,KEY=VALUE,... from which `OptionTable.resolve` reads the same values, bit for bit."""
    return ",".join([name, *(f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in changes.items())])


def is_assignment(text: str) -> bool:
    """Tell whether a text has the form KEY=VALUE; otherwise it is a name."""
    return "=" in text


def _read(text: str) -> Any:
    """Return the value that a text is in TOML, or the text itself if it is plain words, or None if it is neither."""
    try:
        return parse_toml(f"x = {text}")["x"] if "\n" not in text else None
    except tomllib.TOMLDecodeError:
        return text if BARE.fullmatch(text) else None


def _is_number(x: Any, kind: Any = (int, float)) -> bool:
    return isinstance(x, kind) and not isinstance(x, bool) and math.isfinite(x)


def _write(value: Any) -> str:
    """Write a value in the form that `resolve` reads."""
    if isinstance(value, (list, tuple)):
        return f"[{','.join(map(_write, value))}]"
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
