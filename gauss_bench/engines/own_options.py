"""An engine's own options as a user writes them: NAME, KEY=VALUE,... or NAME,KEY=VALUE,... where NAME is a setting or a variant.

Without a name the engine's first settings apply. These settings also define which options exist and their types: a number stays a
number, a list keeps its length, and a word must be one that a setting or variant of the engine uses or its knob lists.
"""

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gauss_bench.untrusted import parse_toml

COMMA = re.compile(r',(?![^\[]*\])(?=(?:[^"]*"[^"]*")*[^"]*$)')  # a comma outside of brackets and quotes
BARE = re.compile(r"[^\s\"'\[\]=]+( [^\s\"'\[\]=]+)*")  # a word, or several, without quotes


class OptionError(ValueError):
    """An option that an engine does not know, or a value that it cannot take; the message lists what is known."""


@dataclass(frozen=True)
class Known:
    """The names that an engine knows.

    Attributes:
        labels: name of a setting or variant -> option -> value; the first entry holds the engine's defaults.
        options: the options that a user may give one by one.
        words: option -> further permitted words, for options whose values are words.
    """

    labels: Mapping[str, Mapping[str, Any]]
    options: Sequence[str]
    words: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def resolve(self, text: str) -> dict[str, Any]:
        """Return all options that a text stands for: the name of a setting or variant, options one by one, or both.

        Raises:
            KeyError: no setting and no variant has that name.
            OptionError: an option is unknown or given twice, or its value has the wrong type.
        """
        if text in self.labels:
            return dict(self.labels[text])
        first, *others = parts = [x.strip() for x in COMMA.split(text)]
        name, given = (next(iter(self.labels)), parts) if is_own(first) else (first, others)
        if strange := [x for x in (name, *given) if not is_own(x) and x not in self.labels]:
            raise KeyError(f"neither settings nor a variant: {strange[0]!r}; there are {', '.join(self.labels)}")
        if bare := [x for x in given if not is_own(x)]:
            raise OptionError(f"{bare[0]!r}: only the first may be a name, what follows is KEY=VALUE")
        options = dict(self.labels[name])
        pairs = [[x.strip() for x in part.split("=", 1)] for part in given]
        for key, _ in pairs:
            if key not in self.options:
                raise OptionError(f"no option {key!r}; there are {self.told() or 'none'}")
            if [x for x, _ in pairs].count(key) > 1:
                raise OptionError(f"the option {key!r} is given twice")
        return options | {key: self._value(key, value) for key, value in pairs}

    def told(self) -> str:
        """List the options with their default values, as KEY=VALUE."""
        usual = next(iter(self.labels.values()), {})
        return ", ".join(f"{key}={_write(usual[key])}" for key in self.options)

    def _value(self, key: str, text: str) -> Any:
        """Read an option's value; its default decides which type it must have."""
        usual = next(iter(self.labels.values()))[key]
        value = _read(text)
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
            raise OptionError(f"the option {key!r} takes {wanted}; not {text!r}")
        return value

    def _words(self, key: str) -> list[str]:
        """List the words that an option may take, without repetition."""
        used = (options[key] for options in self.labels.values() if key in options)
        return list(dict.fromkeys([*used, *self.words.get(key, ())]))


def is_own(text: str) -> bool:
    """Tell whether a text gives an option by KEY=VALUE, not a name."""
    return "=" in text


def _read(text: str) -> Any:
    """Parse a value as TOML, or return the text itself if it is plain words; None if it is neither."""
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
