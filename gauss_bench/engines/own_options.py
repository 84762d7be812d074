"""An engine's own options as a user writes them: NAME, KEY=VALUE,... or NAME,KEY=VALUE,... with NAME of settings or a variant.

Without a name the engine's first settings are meant. What is known, and of which type, is what those settings say: a number stays a
number, a list keeps its length, and a word is one of those that some settings or variant of the engine uses or its knob lists.
"""

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gauss_bench.untrusted import parse_toml

COMMA = re.compile(r',(?![^\[]*\])(?=(?:[^"]*"[^"]*")*[^"]*$)')  # in no bracket and no quotes
BARE = re.compile(r"[^\s\"'\[\]=]+( [^\s\"'\[\]=]+)*")  # a word, or several, without quotes


class OptionError(ValueError):
    """An option that an engine does not know, or a value that it cannot take; the message lists what is known."""


@dataclass(frozen=True)
class Known:
    """The names that an engine knows.

    Attributes:
        labels: name of settings or of a variant -> option -> value; the first are the engine's defaults.
        options: those that may be given one by one.
        words: option -> further values, of options whose values are words.
    """

    labels: Mapping[str, Mapping[str, Any]]
    options: Sequence[str]
    words: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def resolve(self, text: str) -> dict[str, Any]:
        """All options of settings, a variant, or of what a user writes.

        Raises:
            KeyError: no settings and no variant have that name.
            OptionError: an unknown option, one that is given twice, or a value that it cannot take.
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
        """The options with their usual values."""
        usual = next(iter(self.labels.values()), {})
        return ", ".join(f"{key}={_write(usual[key])}" for key in self.options)

    def _value(self, key: str, text: str) -> Any:
        usual = next(iter(self.labels.values()))[key]
        value = _read(text)
        match usual:
            case bool():
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
        used = (options[key] for options in self.labels.values() if key in options)
        return list(dict.fromkeys([*used, *self.words.get(key, ())]))


def is_own(text: str) -> bool:
    """Tell whether a text names options one by one."""
    return "=" in text


def _read(text: str) -> Any:
    """A value as TOML writes it, or the text itself where it is words."""
    try:
        return parse_toml(f"x = {text}")["x"] if "\n" not in text else None
    except tomllib.TOMLDecodeError:
        return text if BARE.fullmatch(text) else None


def _is_number(x: Any, kind: Any = (int, float)) -> bool:
    return isinstance(x, kind) and not isinstance(x, bool) and math.isfinite(x)


def _write(value: Any) -> str:
    """A value as `resolve` reads it."""
    if isinstance(value, (list, tuple)):
        return f"[{','.join(map(_write, value))}]"
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
