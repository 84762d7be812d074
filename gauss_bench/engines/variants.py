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

from gauss_bench.engines.own_options import Known
from gauss_bench.untrusted import parse_toml

FILE = "variants.toml"
LEAST_WORDS = 20  # characters of a reason: shorter ones give none
CHOSEN = ("integrator", "stabilization")  # knobs that a run is given beside its settings
REMARK, SOFT = "remark", "soft"
OWN_SEARCH = "own search: "


class VariantError(ValueError):
    """A file of variants that cannot be used; the message names file, table and field."""


@dataclass(frozen=True)
class Knob:
    """Something about an engine that can be chosen.

    Attributes:
        source: address of where it is documented, or OWN_SEARCH and why it is tried.
        values: words that it may be besides those that settings and variants use.
    """

    name: str
    meaning: str
    source: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Variant:
    """One point of the searched space: everything that is chosen but the step or tolerance.

    Attributes:
        options: knob -> value, all of them but `integrator` and `stabilization`.
    """

    name: str
    integrator: str
    stabilization: str
    options: Mapping[str, Any]


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
        if name in self.settings:
            return self.settings[name]
        if name in self.space:
            return self.space[name].options
        labels = {**self.settings, **{k: x.options for k, x in self.space.items()}}
        return Known(labels, [k for k in self.knobs if k not in CHOSEN], {k: x.values for k, x in self.knobs.items()}).resolve(name)


def read_variants(room: Path) -> Variants:
    """The knobs, settings and variants of the engine in a folder.

    Raises:
        VariantError: a table or field that is faulty, a knob without provenance, a value of an unknown knob.
    """
    path = room / FILE
    try:
        document = parse_toml(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise VariantError(f"{path}: TOML syntax: {error}") from error
    for name in ("knobs", "settings", "variants"):
        if not all(isinstance(x, dict) for x in document.get(name, {"": None}).values()):
            raise VariantError(f"{path}: {name}: a table of inline tables is wanted")
    if strange := document.keys() - {"knobs", "settings", "variants", "first", "unfinished"}:
        raise VariantError(f"{path}: unknown table {min(strange)}")
    knobs = {name: _knob(f"{path}: knobs.{name}", name, table) for name, table in document["knobs"].items()}
    settings = _settings(str(path), knobs, document["settings"])
    causes = {label: _cause(f"{path}: settings.{label}.soft", x[SOFT]) for label, x in document["settings"].items() if SOFT in x}
    space: dict[str, Variant] = {}
    soft = dict(causes)
    for line, table in document["variants"].items():
        for variant in _points(f"{path}: variants.{line}", line, table, knobs, settings):
            if variant.name in space or variant.name in settings:
                raise VariantError(f"{path}: variants.{line}: {variant.name} is there already")
            space[variant.name] = variant
            if (label := table.get("settings", next(iter(settings)))) in causes:
                soft[variant.name] = causes[label]
    first = tuple(map(str, document.get("first", ())))
    if absent := [name for name in first if name not in space]:
        raise VariantError(f"{path}: first: there is no variant {absent[0]!r}")
    return Variants(
        knobs, settings, space, first, soft, _read_unfinished(f"{path}: unfinished", document.get("unfinished", []), knobs, space)
    )


def _cause(place: str, said: Any) -> str:
    if not isinstance(said, str) or len(said) < LEAST_WORDS:
        raise VariantError(f"{place}: gives no cause: {said}")
    return said


def _read_unfinished(place: str, tables: Any, knobs: Mapping[str, Knob], space: Mapping[str, Variant]) -> dict[str, str]:
    """The variants whose options are those of one of the tables, with its cause."""
    if not isinstance(tables, list):
        raise VariantError(f"{place}: a list of tables is wanted, [[unfinished]]")
    found: dict[str, str] = {}
    for table in tables:
        wanted = {key: x for key, x in table.items() if key != "cause"}
        if strange := wanted.keys() - knobs.keys():
            raise VariantError(f"{place}: {min(strange)} is no knob")
        cause = _cause(f"{place}.cause", table.get("cause"))
        found |= {name: cause for name, x in space.items() if all(x.options.get(key) == value for key, value in wanted.items())}
    return found


def _knob(place: str, name: str, table: Mapping[str, Any]) -> Knob:
    if strange := table.keys() - {"meaning", "source", "own_search", "values"}:
        raise VariantError(f"{place}: unknown field {min(strange)}")
    if not str(table.get("meaning", "")).strip():
        raise VariantError(f"{place}: does not say what it means")
    source, reason = str(table.get("source", "")), str(table.get("own_search", ""))
    if bool(source) == bool(reason):
        raise VariantError(f"{place}: needs `source`, the address where it is documented, or `own_search`, why we try it")
    if source and not source.startswith("https://"):
        raise VariantError(f"{place}: `source` is no address: {source}")
    if reason and len(reason) < LEAST_WORDS:
        raise VariantError(f"{place}: `own_search` gives no reason: {reason}")
    return Knob(name, str(table["meaning"]), source or OWN_SEARCH + reason, tuple(map(str, table.get("values", ()))))


def _settings(path: str, knobs: Mapping[str, Knob], tables: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Every label with all its options."""
    wanted = [name for name in knobs if name not in CHOSEN]
    settings: dict[str, dict[str, Any]] = {}
    for label, table in tables.items():
        place = f"{path}: settings.{label}"
        options = {**next(iter(settings.values()), {}), **table}
        for name in table:
            if name not in (*wanted, REMARK, SOFT):
                raise VariantError(f"{place}: {name} is no knob of settings")
        if lacking := [name for name in wanted if name not in options]:
            raise VariantError(f"{place}: {lacking[0]} has no value")
        settings[label] = {name: options[name] for name in wanted} | ({REMARK: table[REMARK]} if REMARK in table else {})
    if not settings:
        raise VariantError(f"{path}: settings: there are none")
    return settings


def _points(
    place: str, line: str, table: Mapping[str, Any], knobs: Mapping[str, Knob], settings: Mapping[str, Mapping[str, Any]]
) -> Iterator[Variant]:
    """Every combination of a line."""
    label = table.get("settings", next(iter(settings)))
    if label not in settings:
        raise VariantError(f"{place}: there are no settings {label!r}")
    values = {k: x for k, x in table.items() if k != "settings"}
    values.setdefault("stabilization", "none")
    for name in values:
        if name not in knobs:
            raise VariantError(f"{place}: {name} is no knob: nothing says what it is and where it comes from")
    if "integrator" not in values:
        raise VariantError(f"{place}: integrator is missing")
    lists = {name: x for name, x in values.items() if _several(x, settings[label].get(name))}
    for choice in product(*lists.values()):
        chosen = {**values, **dict(zip(lists, choice, strict=True))}
        name = "/".join([line, *map(str, choice)])
        options = {**settings[label], **{k: x for k, x in chosen.items() if k not in CHOSEN}}
        yield Variant(name, str(chosen["integrator"]), str(chosen["stabilization"]), options)


def _several(value: Any, usual: Any) -> bool:
    """Tell whether a value is a list of values: of a knob whose usual value is a list itself, only a list of lists is."""
    return isinstance(value, list) and (not isinstance(usual, list) or all(isinstance(x, list) for x in value))
