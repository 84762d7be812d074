"""Read and check a file of settings that an engine's authors contribute.

The file is `authors.toml` in the engine's folder, or any file that a user names:

    format = "gauss-bench-settings/1"
    engine = "mujoco"
    authors = "who answers for these settings"
    contact = "https://..."           # or an e-mail address
    date = 2026-11-26

    [knobs.iterations]                # a table for every knob that a setting changes
    source = "https://..."            # the address of the knob's documentation
    why = "why it has this value, in a sentence"

    [settings.fast]                   # a candidate of searches; the search chooses its step or tolerance
    base = "rigid"                    # settings of the suite that give all other knobs their values; by default the first
    integrator = "rk4"                # may be left out if the engine has only one
    iterations = 2

The engine's `variants.toml` defines the knobs. A file may have at most as many settings as the search has variants of the engine.
Tables of results name a setting by its options, as in "rigid,iterations=2".
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
from gauss_bench.engines.variants import MIN_REASON_LENGTH, VariantError, Variants, read_tables, read_variants, require
from gauss_bench.untrusted import BadInput, harmless, parse_toml, read_bytes

ROOMS = Path(__file__).parent  # holds the folders of all engines
FILE = "authors.toml"
FORMAT = "gauss-bench-settings/1"
LARGEST = 1 << 16  # [bytes] largest file that is read
LONGEST = 200  # [characters] longest text of a field
FIELDS = ("format", "engine", "authors", "contact", "date", "knobs", "settings")
BASE = "base"

Line = Mapping[str, Any]


class SettingsFault(BadInput, ValueError):
    """A file of settings has a fault; the message names file, table and field."""


@dataclass(frozen=True)
class CheckedSetting:
    """A setting that an engine's authors contributed.

    Attributes:
        settings: text of the setting, in the form that `simulate --settings` accepts.
        integrator, stabilization: names as the engine offers them.
        options: name of a knob (an option of the engine) -> value, for every knob of the engine.
    """

    settings: str
    integrator: str
    stabilization: str
    options: dict[str, Any]


@dataclass(frozen=True)
class CheckedSettings:
    """A file of settings that has passed all checks.

    Attributes:
        engine: name of the engine; authors, contact: owners of the settings, and their address; date: date of the file.
        most: largest number of settings, equal to the number of variants in the suite's own search.
        knobs: name of a knob (an option of the engine) -> address of the knob's documentation.
        settings: name of a setting in the file -> setting.
    """

    engine: str
    authors: str
    contact: str
    date: str
    most: int
    knobs: dict[str, str]
    settings: dict[str, CheckedSetting]


def read_settings(path: Path) -> CheckedSettings:
    """Read a file of settings and check it.

    Raises:
        SettingsFault: the file has a fault.
        OSError: the file cannot be read.
    """
    try:
        return _read(parse_toml(read_bytes(path, LARGEST).decode("utf-8")))
    except (SettingsFault, VariantError) as fault:
        raise SettingsFault(f"{path}: {fault}") from fault
    except ValueError as error:
        raise SettingsFault(f"{path}: TOML syntax: {error}") from error


def candidates_of(engine: str, files: Sequence[str | Path] = ()) -> list[Variant]:
    """Return the candidate settings that the authors of an engine contribute, without duplicates.

    The candidates in the `authors.toml` of the engine's folder come first, then those in `files`; files for other engines are
    skipped.

    Raises:
        SettingsFault: a file has a fault.
        OSError: a file cannot be read.
    """
    own = ROOMS / engine / FILE
    candidates: dict[tuple[str, str, str], Variant] = {}
    for path in [own, *files] if own.is_file() else files:
        file = read_settings(Path(path))
        if file.engine == engine:
            for x in file.settings.values():
                key = x.settings, x.integrator, x.stabilization
                candidates.setdefault(key, Variant(*key, x.options, file.authors))
    return [*candidates.values()]


def _read(file: Line) -> CheckedSettings:
    """Check a parsed file table by table, and return its content; a VariantError or SettingsFault if it has a fault."""
    for key in file:
        require(key in FIELDS, key, f"no such field; there are {', '.join(FIELDS)}")
    require(file.get("format") == FORMAT, "format", f"must be {FORMAT!r}")
    authors, contact = (_read_text(file, key, key) for key in ("authors", "contact"))
    require(contact.startswith("https://") or "@" in contact, "contact", "must be an address: https://... or an e-mail address")
    day = file.get("date")
    if not isinstance(day, date) or isinstance(day, datetime):  # a datetime is also a date
        raise SettingsFault("date: must be a date, as in date = 2026-11-26")
    # the authors' time zone may be a day ahead
    require(day <= date.today() + timedelta(days=1), "date", f"{day} is in the future")
    name = _read_text(file, "engine", "engine")
    engines = sorted(path.parent.name for path in ROOMS.glob(f"*/{VARIANTS_FILE}"))
    require(name in engines, "engine", f"{name!r} has no {VARIANTS_FILE}; the engines that have one are {', '.join(engines)}")
    engine = resolve_name(ELSEWHERE[name])() if name in ELSEWHERE else get(name)  # the library need not be installed
    variants = read_variants(ROOMS / name)
    knobs = {key: _read_source(f"knobs.{key}", line) for key, line in read_tables(file, "knobs").items()}
    for key in knobs:
        require(key in variants.knobs, f"knobs.{key}", f"{name} has no such knob; it has {', '.join(variants.knobs)}")
    lines, most = read_tables(file, "settings"), len(variants.space)
    allowed = f"at most {most} are allowed, because the search has {most} variants of {name}"
    require(len(lines) <= most, "settings", f"{len(lines)} settings; {allowed}")
    settings = {key: _read_setting(f"settings.{key}", line, engine, variants) for key, line in lines.items()}
    for key, line in lines.items():
        for knob in line:
            require(knob in (BASE, *knobs), f"settings.{key}.{knob}", f"has no source: there is no table knobs.{knob}")
    for key in knobs:
        require(any(key in line for line in lines.values()), f"knobs.{key}", "no setting names it")
    return CheckedSettings(name, authors, contact, str(day), most, knobs, settings)


def _read_setting(place: str, line: Line, engine: Any, variants: Variants) -> CheckedSetting:
    """Check one table [settings.NAME], called `place` in messages; return the setting, with a value of every knob of the engine."""
    base = line.get(BASE, next(iter(variants.settings)))
    require(base in variants.settings, f"{place}.{BASE}", f"no settings {base!r}; there are {', '.join(variants.settings)}")
    offered = engine.integrators
    is_known = "integrator" in line or len(offered) == 1
    require(is_known, f"{place}.integrator", f"is missing; {engine.name} has {', '.join(offered)}")
    chosen = {"integrator": line.get("integrator", offered[0]), "stabilization": line.get("stabilization", "none")}
    for key, available in (("integrator", offered), ("stabilization", engine.stabilizations)):
        require(chosen[key] in available, f"{place}.{key}", f"no {key} {chosen[key]!r}; there are {', '.join(available)}")
    knob_values = {key: value for key, value in line.items() if key not in (BASE, *CHOSEN)}
    changes = {}
    for key, value in knob_values.items():
        require(key in variants.knobs, f"{place}.{key}", f"{engine.name} has no such knob; it has {', '.join(variants.knobs)}")
        try:
            changes[key] = variants.table.check_value(key, value, repr(value))
        except OptionError as error:
            raise SettingsFault(f"{place}.{key}: {error}") from error
        least, most = variants.knobs[key].range
        in_range = variants.knobs[key].allows(changes[key])
        require(in_range, f"{place}.{key}", f"must be in the range {least:g} to {most:g}, not {value!r}")
    require(bool(changes), place, "changes no knob, so it equals a setting of the suite")
    text = write_options(base, changes)
    return CheckedSetting(text, **chosen, options=dict(variants.options(text)))


def _read_source(place: str, line: Line) -> str:
    """Return the address in a table [knobs.NAME], which must also have a sentence that gives the reason for the knob's value."""
    for key in line:
        require(key in ("source", "why"), f"{place}.{key}", "no such field; there are source, why")
    source, why = (_read_text(line, key, f"{place}.{key}") for key in ("source", "why"))
    require(source.startswith("https://"), f"{place}.source", "must be an address: https://...")
    require(len(why) >= MIN_REASON_LENGTH, f"{place}.why", f"must be a sentence of {MIN_REASON_LENGTH} characters at least")
    return source


def _read_text(line: Line, key: str, place: str) -> str:
    """Return the text of the field `key`; a VariantError, which names `place`, unless it is a line of 1 to LONGEST characters."""
    text = line.get(key)
    valid = isinstance(text, str) and harmless(text) == text and "\n" not in text and text.strip() != "" and len(text) <= LONGEST
    require(valid, place, f"must be a text of 1 to {LONGEST} characters in one line")
    return str(text).strip()
