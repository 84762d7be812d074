"""An engine's knobs, settings and variants as data: `variants.toml` in its room, read in one place.

    [knobs]      NAME = { meaning = "...", source = "https://..." }, or own_search = "why" in the place of source; `values` lists
                 words that it may be besides those that stand below
    [settings]   LABEL = { KNOB = value, ... }: what suites show; the first label gives every knob its value, others what differs
    [[unfinished]] KNOB = value, ... and cause = "...": which variants stop their solver before its end, and why that may be
    [variants]   NAME = { settings = "LABEL", integrator = "...", stabilization = "...", KNOB = value, ... }: what searches try
    first = [NAME, ...], above the tables: which of them are tried first where a user's time is short

A variant is one line. What it leaves out is as in its settings (the first ones where it names none), and "none" for the
stabilisation. A list in the place of a value stands for each of its entries: the line is then every combination, and each is named
by the line's name and its own values ("lean/rk4/2"). Settings may carry a `remark` to their readers, which is no knob, and `soft`,
the cause for which accelerations under them, and under their variants, keep the constraints J a = gamma only roughly.

A knob without an address of documentation, example or tracker, and without a word on why it is our own search, is refused, and so
is a value of an unknown knob: what nobody can look up is not raced.
"""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from gauss_bench.engines.base import CHOSEN, Variant
from gauss_bench.engines.own_options import Known
from gauss_bench.untrusted import parse_toml

FILE = "variants.toml"
LEAST_WORDS = 20  # characters of a reason: shorter ones give none
REMARK, SOFT = "remark", "soft"
OWN_SEARCH = "own search: "

Line = dict[str, Any]


class VariantError(ValueError):
    """A file of variants that cannot be used; the message names file, table and field."""


@dataclass(frozen=True)
class Knob:
    """Something about an engine that can be chosen.

    Attributes:
        source: the address of its documentation, or OWN_SEARCH and why it is tried.
        values: words that it may be besides those that stand in the file.
    """

    meaning: str
    source: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Variants:
    """The content of an engine's file of variants.

    Attributes:
        settings: label -> knob -> value.
        space: the points of the searched space by name, in the file's order.
        first: those that are tried first where time is short.
        soft: settings and variants that keep J a = gamma only roughly -> cause.
        unfinished: variants that stop their solver before its end -> cause.
    """

    knobs: Mapping[str, Knob]
    settings: Mapping[str, Mapping[str, Any]]
    space: Mapping[str, Variant]
    first: tuple[str, ...] = ()
    soft: Mapping[str, str] = field(default_factory=dict)
    unfinished: Mapping[str, str] = field(default_factory=dict)

    def options(self, name: str) -> Mapping[str, Any]:
        """The options of settings, of a variant, or of a text as `own_options` tells it.

        Raises:
            KeyError: there is neither of that name.
            OptionError: an option that there is not, or a value that it cannot take.
        """
        labels = {**self.settings, **{k: x.options for k, x in self.space.items()}}
        return Known(labels, [k for k in self.knobs if k not in CHOSEN], {k: x.values for k, x in self.knobs.items()}).resolve(name)


def read_variants(room: Path) -> Variants:
    """The knobs, settings and variants of the engine in a folder.

    Raises:
        VariantError: a table or field that is faulty, a knob without provenance, a value of an unknown knob.
    """
    path = room / FILE
    try:
        return _read(parse_toml(path.read_text(encoding="utf-8")))
    except tomllib.TOMLDecodeError as error:
        raise VariantError(f"{path}: TOML syntax: {error}") from error
    except VariantError as error:
        raise VariantError(f"{path}: {error}") from error


def _read(file: Mapping[str, Any]) -> Variants:
    for name in ("knobs", "settings", "variants"):
        lines = file.get(name)
        tables = isinstance(lines, dict) and all(isinstance(x, dict) for x in lines.values())
        _require(tables and (bool(lines) or name == "variants"), name, "a table of inline tables is wanted")
    unfinished_lines = file.get("unfinished", [])
    _require(isinstance(unfinished_lines, list), "unfinished", "a list of tables is wanted")
    knobs = {name: _knob(f"knobs.{name}", line) for name, line in file["knobs"].items()}
    own = [name for name in knobs if name not in CHOSEN]
    usual, settings, soft = next(iter(file["settings"])), dict[str, Line](), dict[str, str]()
    for label, line in file["settings"].items():
        _known(line, (*own, REMARK, SOFT), f"settings.{label}")
        options = {**settings.get(usual, {}), **line}
        lacking = ", ".join(x for x in own if x not in options)
        _require(not lacking, f"settings.{label}", f"{lacking} has no value")
        settings[label] = {x: options[x] for x in own} | ({REMARK: line[REMARK]} if REMARK in line else {})
        if SOFT in line:
            soft[label] = _cause(line[SOFT], f"settings.{label}.{SOFT}")
    space: dict[str, Variant] = {}
    for name, line in file["variants"].items():
        label = line.get("settings", usual)
        _require(label in settings, f"variants.{name}", f"there are no settings {label!r}")
        _known(line, (*knobs, "settings"), f"variants.{name}")
        _require("integrator" in line, f"variants.{name}", "integrator is missing")
        for variant in _points(name, line | {"stabilization": line.get("stabilization", "none")}, settings[label]):
            _require(variant.name not in {**space, **settings}, f"variants.{name}", f"{variant.name} is there already")
            space[variant.name] = variant
            soft |= {variant.name: soft[label]} if label in soft else {}
    first = tuple(file.get("first", ()))
    for name in first:
        _require(name in space, "first", f"there is no variant {name!r}")
    unfinished: dict[str, str] = {}
    for line in unfinished_lines:
        wanted = {key: x for key, x in line.items() if key != "cause"}
        _known(wanted, tuple(knobs), "unfinished")
        cause = _cause(line.get("cause"), "unfinished.cause")
        unfinished |= {name: cause for name, x in space.items() if wanted.items() <= x.options.items()}
    return Variants(knobs, settings, space, first, soft, unfinished)


def _knob(place: str, line: Line) -> Knob:
    for field_name in line.keys() - {"meaning", "source", "own_search", "values"}:
        raise VariantError(f"{place}: unknown field {field_name}")
    meaning, address, reason = (line.get(x, "") for x in ("meaning", "source", "own_search"))
    _require(isinstance(meaning, str) and bool(meaning.strip()), place, "does not say what it means")
    _require(bool(address) != bool(reason), place, "needs `source`, or `own_search`, why we try it")
    _require(not address or str(address).startswith("https://"), place, "`source` is no address")
    _require(not reason or len(str(reason)) >= LEAST_WORDS, place, "`own_search` gives no reason")
    return Knob(meaning.strip(), address or OWN_SEARCH + reason, tuple(line.get("values", ())))


def _require(good: bool, place: str, otherwise: str) -> None:
    if not good:
        raise VariantError(f"{place}: {otherwise}")


def _known(line: Line, names: tuple[str, ...], place: str) -> None:
    for name in line.keys() - {*names}:
        raise VariantError(f"{place}: {name} is no knob: nothing says what it is and where it comes from")


def _cause(said: Any, place: str) -> str:
    _require(isinstance(said, str) and len(said) >= LEAST_WORDS, place, f"gives no cause: {said}")
    return str(said)


def _points(name: str, line: Line, usual: Mapping[str, Any]) -> Iterator[Variant]:
    """Every combination of a line."""
    values = {k: x for k, x in line.items() if k != "settings"}
    lists = {k: x for k, x in values.items() if _several(x, usual.get(k))}
    for choice in product(*lists.values()):
        chosen = {**values, **dict(zip(lists, choice, strict=True))}
        options = {**usual, **{k: x for k, x in chosen.items() if k not in CHOSEN}}
        integrator, stabilization = (str(chosen[x]) for x in CHOSEN)
        yield Variant("/".join([name, *map(str, choice)]), integrator, stabilization, options)


def _several(value: Any, usual: Any) -> bool:
    """Tell whether a value is a list of values: of a knob whose usual value is a list itself, only a list of lists is."""
    return isinstance(value, list) and (not isinstance(usual, list) or all(isinstance(x, list) for x in value))
