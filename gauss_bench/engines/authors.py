"""Settings that an engine's authors own: a file in the engine's room, or from outside, its reader and its checks.

    format = "gauss-bench-settings/1"
    engine = "mujoco"
    authors = "who answers for these settings"
    contact = "https://..."           # or an address of e-mail
    date = 2026-11-26

    [knobs.iterations]                # of every knob that a setting names
    source = "https://..."            # the address of its documentation
    why = "why it has this value, in a sentence"

    [settings.fast]                   # a candidate; the search chooses step or tolerance, as for every other candidate
    base = "rigid"                    # settings of the suite, whose values hold for knobs that are not named; else the first ones
    integrator = "rk4"                # not needed for an engine that has one
    iterations = 2

The engine's `variants.toml` says which knobs there are, and the type and range of their values. There may be as many settings as
the search has variants of that engine. A setting is known by the text of its options, from which everybody can run it again:
"rigid,iterations=2" (`own_options`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from gauss_bench.engines import ELSEWHERE, get
from gauss_bench.engines.base import CHOSEN, Variant
from gauss_bench.engines.own_options import OptionError, write_options
from gauss_bench.engines.variants import FILE as VARIANTS_FILE
from gauss_bench.engines.variants import LEAST_WORDS, Variants, read_variants
from gauss_bench.untrusted import BadInput, harmless, parse_toml, read_bytes

ROOMS = Path(__file__).parent
FILE = "authors.toml"  # in an engine's room
FORMAT = "gauss-bench-settings/1"
LARGEST = 1 << 16  # bytes of a file
LONGEST = 200  # characters of a name, a contact or a reason
TABLES = ("knobs", "settings")
FACTS = ("format", "engine", "authors", "contact", "date")
BASE = "base"
ONE_DAY = timedelta(days=1)  # their date may be a day ahead of ours

Line = Mapping[str, Any]


class SettingsFault(BadInput, ValueError):
    """A file of settings that is refused; the message names file, table and field."""


@dataclass(frozen=True)
class Reason:
    """Why a knob is set.

    Attributes:
        source: the address of its documentation; why: a sentence.
    """

    source: str
    why: str


@dataclass(frozen=True)
class AuthorsSettings:
    """A file of settings that has passed all checks.

    Attributes:
        path: of the file; engine: its name.
        authors, contact, date: who owns the settings, how to reach them, and when they were written.
        most: the largest number of settings that the file may have: the number of variants of the suite's own search.
        knobs: name -> reason.
        candidates: name in the file -> candidate of the search.
    """

    path: str
    engine: str
    authors: str
    contact: str
    date: str
    most: int
    knobs: Mapping[str, Reason]
    candidates: Mapping[str, Variant]


def read_settings(path: Path) -> AuthorsSettings:
    """Read a file of settings and check it.

    Raises:
        SettingsFault: it has a fault.
        OSError: it cannot be read.
    """
    try:
        return _read(path, parse_toml(read_bytes(path, LARGEST).decode("utf-8")))
    except SettingsFault as fault:
        raise SettingsFault(f"{path}: {fault}") from fault
    except ValueError as error:
        raise SettingsFault(f"{path}: TOML syntax: {error}") from error


def candidates_of(engine: str, files: Sequence[str | Path] = ()) -> list[Variant]:
    """Return the settings that the authors of an engine own, each once: those of the file in its room, then those of `files`.

    Raises:
        SettingsFault, OSError: as `read_settings`.
    """
    room = ROOMS / engine / FILE
    read = [read_settings(Path(x)) for x in ([room] if room.is_file() else []) + [*files]]
    found = [x for settings in read if settings.engine == engine for x in settings.candidates.values()]
    return [*{(x.name, x.integrator, x.stabilization): x for x in reversed(found)}.values()][::-1]


def _read(path: Path, file: Line) -> AuthorsSettings:
    """Check a parsed file table by table."""
    for key in file:
        _require(key in (*FACTS, *TABLES), key, f"no such field; there are {', '.join((*FACTS, *TABLES))}")
    _require(file.get("format") == FORMAT, "format", f"must be {FORMAT!r}")
    authors, contact = (_read_text(file, key, key) for key in ("authors", "contact"))
    _require(contact.startswith("https://") or "@" in contact, "contact", "must be an address: https://... or of e-mail")
    written = file.get("date")
    if not isinstance(written, date) or isinstance(written, datetime):
        raise SettingsFault("date: must be a date, as in date = 2026-11-26")
    _require(written <= date.today() + ONE_DAY, "date", f"{written} has not come yet")
    name = _read_text(file, "engine", "engine")
    engine, variants = _find_engine(name)
    knobs = {key: _read_reason(f"knobs.{key}", line) for key, line in _lines(file, "knobs").items()}
    for key in knobs:
        _require(key in variants.knobs, f"knobs.{key}", f"{name} has no such knob; it has {', '.join(variants.knobs)}")
    lines = _lines(file, "settings")
    most = len(variants.space)
    allowed = f"there may be {most}, as many as the search has variants of {name}"
    _require(len(lines) <= most, "settings", f"{len(lines)} settings; {allowed}")
    candidates = {key: _read_candidate(f"settings.{key}", line, engine, variants, authors) for key, line in lines.items()}
    named = {key for line in lines.values() for key in line if key != BASE}
    for key, line in lines.items():
        for knob in line:
            _require(knob == BASE or knob in knobs, f"settings.{key}.{knob}", f"has no source: there is no table knobs.{knob}")
    for key in knobs:
        _require(key in named, f"knobs.{key}", "no setting names it")
    return AuthorsSettings(str(path), name, authors, contact, str(written), most, knobs, candidates)


def _find_engine(name: str) -> tuple[Any, Variants]:
    """Return the adapter of an engine and its variants; its library need not be installed."""
    room = ROOMS / name
    there = sorted(x.parent.name for x in ROOMS.glob(f"*/{VARIANTS_FILE}"))
    _require(name in there, "engine", f"{name!r} has no file of knobs; the engines that have one are {', '.join(there)}")
    engine = resolve_name(ELSEWHERE[name])() if name in ELSEWHERE else get(name)
    return engine, read_variants(room)


def _read_candidate(place: str, line: Line, engine: Any, variants: Variants, owner: str) -> Variant:
    """Check one of the settings and return the candidate."""
    base = line.get(BASE, next(iter(variants.settings)))
    _require(base in variants.settings, f"{place}.{BASE}", f"no settings {base!r}; there are {', '.join(variants.settings)}")
    offered = engine.integrators
    named = "integrator" in line or len(offered) == 1
    _require(named, f"{place}.integrator", f"is missing; {engine.name} has {', '.join(offered)}")
    chosen = {"integrator": line.get("integrator", offered[0]), "stabilization": line.get("stabilization", "none")}
    for key, there in (("integrator", offered), ("stabilization", engine.stabilizations)):
        _require(chosen[key] in there, f"{place}.{key}", f"no {key} {chosen[key]!r}; there are {', '.join(there)}")
    changes = {}
    for key in (x for x in line if x not in (BASE, *CHOSEN)):
        _require(key in variants.knobs, f"{place}.{key}", f"{engine.name} has no such knob; it has {', '.join(variants.knobs)}")
        changes[key] = _read_value(f"{place}.{key}", key, line[key], variants)
    _require(bool(changes), place, "changes no knob, so that it is a setting of the suite already")
    text = write_options(base, changes)
    return Variant(text, **chosen, options=variants.options(text), owner=owner)


def _read_value(place: str, key: str, value: Any, variants: Variants) -> Any:
    """Return the value of a knob if it has the knob's type and is in its range."""
    try:
        checked = variants.table.check_value(key, value, repr(value))
    except OptionError as error:
        raise SettingsFault(f"{place}: {error}") from error
    least, most = variants.knobs[key].range
    _require(variants.knobs[key].allows(checked), place, f"must be in the range {least:g} to {most:g}, not {value!r}")
    return checked


def _read_reason(place: str, line: Line) -> Reason:
    """Check the table of a knob: it must have the address of its documentation and a sentence why it is set."""
    for key in line.keys() - {"source", "why"}:
        raise SettingsFault(f"{place}.{key}: no such field; there are source, why")
    source, why = (_read_text(line, key, f"{place}.{key}") for key in ("source", "why"))
    _require(source.startswith("https://"), f"{place}.source", "must be an address: https://...")
    _require(len(why) >= LEAST_WORDS, f"{place}.why", f"must be a sentence of {LEAST_WORDS} characters at least")
    return Reason(source, why)


def _lines(file: Line, name: str) -> Mapping[str, Line]:
    """Return a table of tables that is not empty."""
    lines = file.get(name)
    if not (isinstance(lines, dict) and lines and all(isinstance(x, dict) for x in lines.values())):
        raise SettingsFault(f"{name}: a table of tables is wanted")
    return lines


def _read_text(line: Line, key: str, place: str) -> str:
    """Return a printable text that is neither empty nor long."""
    text = line.get(key)
    good = isinstance(text, str) and len(text.strip()) > 0 and len(text) <= LONGEST and harmless(text) == text and "\n" not in text
    _require(good, place, f"must be a text of 1 to {LONGEST} characters in one line")
    return str(text).strip()


def _require(good: bool, place: str, otherwise: str) -> None:
    """Raise a SettingsFault unless a condition holds."""
    if not good:
        raise SettingsFault(f"{place}: {otherwise}")
