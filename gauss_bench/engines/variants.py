"""Read an engine's knobs, settings and variants from the file `variants.toml` in the engine's folder.

A knob is an option of the engine. Suites run the settings, and searches try the variants; both are named sets of knob values. The
file has one line and four tables:

    first = [NAME, ...]     variants to which a brief search is limited; this line stands above the tables
    [knobs]                 NAME = { meaning = "...", source = "https://..." }; `own_search` = "reason" may replace the source;
                            `values` lists further words that are allowed, `range` the smallest and the largest number
    [settings]              LABEL = { KNOB = value, ... }, run by suites; the first label gives every knob a value, the others
                            only the values that differ
    [[unfinished]]          KNOB = value, ... and cause = "...": variants with these values stop their solver before it has
                            converged, for this cause
    [variants]              NAME = { settings = "LABEL", integrator = "...", stabilization = "...", KNOB = value, ... }, tried by
                            searches

A variant without `settings` uses the engine's first settings, also for the knobs that it leaves out, and one without
`stabilization` uses "none". A line of [variants] that lists several values of knobs stands for every combination, whose name is the
line's name and the chosen values ("lean/rk4/2"). A line of [settings] may also have `remark`, a note for readers, and `soft`, the
reason why accelerations with these settings, and with the variants that name them, satisfy J a = gamma only approximately.

A knob needs `source`, the address of a documentation page, example or issue, or `own_search`, the reason why the suite's authors
try it, so that readers can look up every option that is compared.
"""

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from gauss_bench.engines.base import CHOSEN, Variant
from gauss_bench.engines.own_options import OptionTable
from gauss_bench.untrusted import parse_toml

FILE = "variants.toml"
MIN_REASON_LENGTH = 20  # [characters] a shorter text is not accepted as a reason
REMARK, SOFT = "remark", "soft"
OWN_SEARCH = "own search: "

Line = dict[str, Any]


class VariantError(ValueError):
    """A file `variants.toml` has a fault; the message names file, table and field."""


@dataclass(frozen=True)
class Knob:
    """An option of an engine.

    Attributes:
        meaning: effect of the option, in a few words.
        source: address of the option's documentation, or the text OWN_SEARCH and the reason to try the option.
        values: allowed words, besides those that settings and variants use.
        range: smallest and largest allowed number, for the option's value or, if this is a list, for every entry.
    """

    meaning: str
    source: str
    values: tuple[str, ...] = ()
    range: tuple[float, float] = (-math.inf, math.inf)

    def allows(self, value: Any) -> bool:
        """Tell whether all numbers in a value of this knob are in `range`; strings and Booleans are always allowed."""
        entries = value if isinstance(value, (list, tuple)) else [value]
        numbers = [x for x in entries if isinstance(x, (int, float)) and not isinstance(x, bool)]  # Python's bool is an int
        least, most = self.range
        return all(least <= x <= most for x in numbers)


@dataclass(frozen=True)
class Variants:
    """The content of an engine's file of variants.

    Attributes:
        settings: label of settings -> (name of an option -> value).
        space: name of a variant -> `Variant`, in the order of the file; a search tries all of them.
        first: names of the variants to which a brief search is limited; `recommend` tries them before all others.
        soft: name of settings or of a variant whose accelerations satisfy J a = gamma only approximately -> cause.
        unfinished: name of a variant that stops its solver before it has converged -> cause.
    """

    knobs: Mapping[str, Knob]
    settings: Mapping[str, Mapping[str, Any]]
    space: Mapping[str, Variant]
    first: tuple[str, ...] = ()
    soft: Mapping[str, str] = field(default_factory=dict)
    unfinished: Mapping[str, str] = field(default_factory=dict)

    def options(self, name: str) -> Mapping[str, Any]:
        """Return option -> value, given the name of settings or of a variant, or a text such as "rigid,iterations=2".

        Raises:
            KeyError: no settings and no variant have that name.
            OptionError: an option is unknown, or its value has the wrong type.
        """
        return self.table.resolve(name)

    @property
    def table(self) -> OptionTable:
        """All settings and variants by name, and the options that users can set one by one."""
        variants = {name: variant.options for name, variant in self.space.items()}
        options = {name: knob.values for name, knob in self.knobs.items() if name not in CHOSEN}
        return OptionTable({**self.settings, **variants}, options)


def read_variants(room: Path) -> Variants:
    """Read the knobs (options), settings and variants of the engine whose folder is `room`.

    Raises:
        VariantError: a table or field has a fault, a knob has no source, or settings or a variant use an undeclared knob.
    """
    path = room / FILE
    try:
        return _read(parse_toml(path.read_text(encoding="utf-8")))
    except tomllib.TOMLDecodeError as error:
        raise VariantError(f"{path}: TOML syntax: {error}") from error
    except VariantError as error:
        raise VariantError(f"{path}: {error}") from error


def _read(file: Mapping[str, Any]) -> Variants:
    """Check a parsed file table by table, and return its content; a `line` is the table of one knob, set of settings or variant.

    A variant is soft if the settings that it names are soft. A variant is unfinished if its options include all knob values of a
    table [[unfinished]].

    Raises:
        VariantError: a table or field has a fault.
    """
    knobs = {name: _read_knob(f"knobs.{name}", line) for name, line in read_tables(file, "knobs").items()}
    settings, soft = _read_settings(read_tables(file, "settings"), [name for name in knobs if name not in CHOSEN])
    space: dict[str, Variant] = {}
    for name, line in read_tables(file, "variants").items():
        label = line.get("settings", next(iter(settings)))
        for variant in _read_line(name, line, label, settings, knobs):
            is_new = variant.name not in space and variant.name not in settings
            require(is_new, f"variants.{name}", f"{variant.name} is there already")
            space[variant.name] = variant
            if label in soft:
                soft[variant.name] = soft[label]
    # every value of a knob, in settings and in variants, must be in the knob's range
    for label, options in [*settings.items(), *((x.name, x.options) for x in space.values())]:
        outside = [name for name, knob in knobs.items() if name in options and not knob.allows(options[name])]
        require(not outside, label, f"{', '.join(outside)} is not in its own range")
    first = tuple(file.get("first", ()))
    for name in first:
        require(name in space, "first", f"there is no variant {name!r}")
    unfinished: dict[str, str] = {}
    lines = file.get("unfinished", [])
    require(isinstance(lines, list), "unfinished", "must be a list of tables")
    for line in lines:
        values = {key: x for key, x in line.items() if key != "cause"}
        _require_known(values, tuple(knobs), "unfinished")
        cause = _read_cause(line.get("cause"), "unfinished.cause")
        unfinished |= {name: cause for name, variant in space.items() if values.items() <= variant.options.items()}
    return Variants(knobs, settings, space, first, soft, unfinished)


def read_tables(file: Mapping[str, Any], name: str) -> dict[str, Line]:
    """Return the table `name` of a file, all of whose entries must be tables; only the table "variants" may be empty."""
    lines: dict[str, Line] = file.get(name)  # type: ignore[assignment]  # checked in the next two lines
    has_tables = isinstance(lines, dict) and all(isinstance(x, dict) for x in lines.values())
    require(has_tables and (bool(lines) or name == "variants"), name, "must be a table of tables")
    return lines


def _read_knob(place: str, line: Line) -> Knob:
    """Check one line of [knobs]: it must have a meaning, and either a source or a reason to try the knob."""
    for key in line:
        require(key in ("meaning", "source", "own_search", "values", "range"), place, f"unknown field {key}")
    meaning, address, reason = (line.get(x, "") for x in ("meaning", "source", "own_search"))
    require(isinstance(meaning, str) and bool(meaning.strip()), place, "has no `meaning`")
    require(bool(address) != bool(reason), place, "needs either `source` (an address) or `own_search` (the reason to try it)")
    require(not address or str(address).startswith("https://"), place, "`source` is no address: https://...")
    require(not reason or len(str(reason)) >= MIN_REASON_LENGTH, place, "`own_search` gives no reason")
    match line.get("range", list(Knob.range)):
        case [int() | float() as least, int() | float() as most] if least < most:
            values = tuple(line.get("values", ()))
            return Knob(meaning.strip(), address or OWN_SEARCH + reason, values, (float(least), float(most)))
    raise VariantError(f"{place}: `range` must be the smallest and the largest number")


def _read_settings(lines: Mapping[str, Line], own: Sequence[str]) -> tuple[dict[str, Line], dict[str, str]]:
    """Return label of settings -> (knob -> value), and label of soft settings -> cause that the file states.

    Args:
        lines: label of settings -> table of the file.
        own: names of the knobs to which settings give values.
    """
    settings: dict[str, Line] = {}
    soft: dict[str, str] = {}
    defaults: Line = {}
    for label, line in lines.items():
        place = f"settings.{label}"
        _require_known(line, (*own, REMARK, SOFT), place)
        options = {**defaults, **line}
        defaults = defaults or line  # the first label has no defaults, so it must give every knob a value
        lacking = ", ".join(x for x in own if x not in options)
        require(not lacking, place, f"{lacking} has no value")
        settings[label] = {x: options[x] for x in own}
        if REMARK in line:
            settings[label][REMARK] = line[REMARK]
        if SOFT in line:
            soft[label] = _read_cause(line[SOFT], f"{place}.{SOFT}")
    return settings, soft


def _read_line(name: str, line: Line, label: str, settings: Mapping[str, Line], knobs: Mapping[str, Knob]) -> Iterator[Variant]:
    """Check one line of [variants] and yield its variants, one for every combination of the values that it lists.

    Args:
        name: name of the line; with the chosen values it is the name of a variant.
        label: label of the settings that the line names; they give a value to every knob that the line leaves out.
        settings: label of settings -> (knob -> value).
    """
    place = f"variants.{name}"
    require(label in settings, place, f"there are no settings {label!r}")
    _require_known(line, (*knobs, "settings"), place)
    require("integrator" in line, place, "integrator is missing")
    usual = settings[label]
    # names of combinations list the values in the order of the line's keys; `|` keeps the position of a key that the line has
    values = line | {"stabilization": line.get("stabilization", "none")}
    values.pop("settings", None)
    lists = {key: x for key, x in values.items() if _is_choice(x, usual.get(key))}  # key -> alternatives
    for picked in product(*lists.values()):  # a value of each list
        chosen = values | dict(zip(lists, picked, strict=True))
        options = {**usual, **{key: x for key, x in chosen.items() if key not in CHOSEN}}
        yield Variant("/".join([name, *map(str, picked)]), str(chosen["integrator"]), str(chosen["stabilization"]), options)


def _is_choice(value: Any, usual: Any) -> bool:
    """Tell whether a value is a list of alternatives; for a knob whose usual value is a list, it must be a list of lists."""
    return isinstance(value, list) and (not isinstance(usual, list) or all(isinstance(x, list) for x in value))


def require(condition: bool, place: str, fault: str) -> None:
    """Raise a VariantError with the place in the file and the fault, unless the condition is true."""
    if not condition:
        raise VariantError(f"{place}: {fault}")


def _require_known(line: Line, names: tuple[str, ...], place: str) -> None:
    """Refuse a table of the file that has a key other than `names`."""
    for name in line:
        require(name in names, place, f"{name} is no knob allowed here; there are {', '.join(names)}")


def _read_cause(text: Any, place: str) -> str:
    """Return the cause that `soft` or [[unfinished]] states; a VariantError if it is no text, or too short."""
    require(isinstance(text, str) and len(text) >= MIN_REASON_LENGTH, place, f"gives no cause: {text}")
    return str(text)
