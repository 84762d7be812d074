"""An engine's knobs, settings and variants as data: `variants.toml` in its room, read in one place.

    [knobs]      NAME = { meaning = "...", source = "https://..." }, or own_search = "why" in the place of source; `values` lists
                 further words that the knob may take besides those used in the file
    [settings]   LABEL = { KNOB = value, ... }: shown by suites; the first label gives every knob a value, others only differences
    [[unfinished]] KNOB = value, ... and cause = "...": variants that stop their solver before it has converged, and why
    [variants]   NAME = { settings = "LABEL", integrator = "...", stabilization = "...", KNOB = value, ... }: tried by searches
    first = [NAME, ...], above the tables: variants that a search tries first if its time is short

A variant is one line. A knob that it leaves out has the value of its settings (the first settings if it names none); the
stabilisation is then "none". A list of values stands for each of its entries: the line then means every combination, and each
combination is named by the line's name and its own values ("lean/rk4/2"). Settings may carry a `remark` for readers, which is no
knob, and `soft`: the reason why accelerations under them, and under their variants, satisfy J a = gamma only roughly.

Every knob must give the address of a documentation page, example or tracker, or the reason why it is our own search; otherwise the
file is refused, as is a value of an unknown knob. So a reader can look up everything that is raced.
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
LEAST_WORDS = 20  # characters: a shorter text is not accepted as a reason
REMARK, SOFT = "remark", "soft"
OWN_SEARCH = "own search: "

Line = dict[str, Any]


class VariantError(ValueError):
    """A file of variants that cannot be used; the message names file, table and field."""


@dataclass(frozen=True)
class Knob:
    """An option of an engine that can be chosen.

    Attributes:
        source: the address of its documentation, or OWN_SEARCH and the reason to try it.
        values: further words that it may take besides those used in the file.
    """

    meaning: str
    source: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Variants:
    """The content of an engine's file of variants.

    Attributes:
        settings: label -> knob -> value.
        space: the variants that a search tries, by name, in the file's order.
        first: the variants to try first if time is short.
        soft: setting or variant that satisfies J a = gamma only roughly -> cause.
        unfinished: variant that stops its solver before it has converged -> cause.
    """

    knobs: Mapping[str, Knob]
    settings: Mapping[str, Mapping[str, Any]]
    space: Mapping[str, Variant]
    first: tuple[str, ...] = ()
    soft: Mapping[str, str] = field(default_factory=dict)
    unfinished: Mapping[str, str] = field(default_factory=dict)

    def options(self, name: str) -> Mapping[str, Any]:
        """Return the options of a setting, of a variant, or of a text in the form that `own_options` describes.

        Raises:
            KeyError: no setting and no variant has that name.
            OptionError: an option is unknown, or its value has the wrong type.
        """
        labels = {**self.settings, **{k: x.options for k, x in self.space.items()}}
        return Known(labels, [k for k in self.knobs if k not in CHOSEN], {k: x.values for k, x in self.knobs.items()}).resolve(name)


def read_variants(room: Path) -> Variants:
    """Read the knobs, settings and variants of the engine in a folder.

    Raises:
        VariantError: a table or field is faulty, a knob has no source, or a value is for an unknown knob.
    """
    path = room / FILE
    try:
        return _read(parse_toml(path.read_text(encoding="utf-8")))
    except tomllib.TOMLDecodeError as error:
        raise VariantError(f"{path}: TOML syntax: {error}") from error
    except VariantError as error:
        raise VariantError(f"{path}: {error}") from error


def _read(file: Mapping[str, Any]) -> Variants:
    """Check the parsed file table by table and build its variants: knobs, settings, variants, first, unfinished."""
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
        options = {**settings.get(usual, {}), **line}  # the first label has no defaults and must give every knob
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
    """Check one line of [knobs]: it must have a meaning, and either a source or a reason to try it."""
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
    """Refuse a line that has a key besides `names`."""
    for name in line.keys() - {*names}:
        raise VariantError(f"{place}: {name} is no knob: nothing says what it is and where it comes from")


def _cause(text: Any, place: str) -> str:
    """Return a cause if it is a text that is long enough to be one."""
    _require(isinstance(text, str) and len(text) >= LEAST_WORDS, place, f"gives no cause: {text}")
    return str(text)


def _points(name: str, line: Line, usual: Mapping[str, Any]) -> Iterator[Variant]:
    """Yield a variant for every combination of the values that a line lists."""
    values = {k: x for k, x in line.items() if k != "settings"}
    lists = {k: x for k, x in values.items() if _several(x, usual.get(k))}
    for choice in product(*lists.values()):
        chosen = {**values, **dict(zip(lists, choice, strict=True))}
        options = {**usual, **{k: x for k, x in chosen.items() if k not in CHOSEN}}
        integrator, stabilization = (str(chosen[x]) for x in CHOSEN)
        yield Variant("/".join([name, *map(str, choice)]), integrator, stabilization, options)


def _several(value: Any, usual: Any) -> bool:
    """Tell whether a value lists several values; for a knob whose default is itself a list, only a list of lists does."""
    return isinstance(value, list) and (not isinstance(usual, list) or all(isinstance(x, list) for x in value))
