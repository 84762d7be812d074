"""Read suites by name or path, join them with the suites that they build on, and restrict them to given linkages and engines.

A suite is a TOML file that lists measurements. Each of its sections, such as `[[accuracy]]`, describes one measurement.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gauss_bench.suites.schema import OnLinkages, Suite
from gauss_bench.untrusted import BadInput, parse_toml, read_bytes

FOLDER = Path(__file__).parent
MAX_BYTES = 1_048_576  # largest size of a suite's file; the longest built-in suite has 4,000 bytes
SECTIONS = tuple(name for name in Suite.model_fields if name not in ("format", "title", "hours", "parts"))  # kinds of sections


class SuiteError(BadInput, ValueError):
    """Raised for a suite that cannot be read; the message names file, table and field."""


def names() -> list[str]:
    """Return the names of the built-in suites."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def read_suite(name: str) -> Suite:
    """Return the suite with a built-in name, or at the path of a .toml file, joined with the suites that it builds on.

    Raises:
        SuiteError: the suite does not exist, is not valid TOML, does not fit the schema, or builds on itself.
    """
    return _read(name, ())


def _read(name: str, above: tuple[str, ...]) -> Suite:
    """Read a suite and, recursively, the suites that it builds on; return all of them as one suite."""
    path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
    if name in above:
        raise SuiteError(f"{path}: builds on itself: {' with '.join([*above, name])}")
    try:
        document = parse_toml(read_bytes(path, MAX_BYTES).decode("utf-8"))
    except FileNotFoundError as error:
        raise SuiteError(f"unknown suite {name!r}; there are {', '.join(names())}, or the path of a .toml file") from error
    except OSError as error:
        raise SuiteError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise SuiteError(f"{path}: TOML syntax: {error}") from error
    try:
        suite = Suite.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(x) for x in first["loc"]) or "the file"
        raise SuiteError(f"{path}: {place}: {first['msg']}") from error
    return join_entries([*(_read(part, (*above, name)) for part in suite.parts), _with_own_linkages(suite, path.parent)])


def _change(suite: Suite, change: Callable[[str, Any], Any]) -> Suite:
    """Replace each section x of the kind `name` by change(name, x), or remove it if the result is None; return the new suite."""
    changed = {name: [change(name, section) for section in getattr(suite, name)] for name in SECTIONS}
    return suite.model_copy(update={name: tuple(x for x in sections if x is not None) for name, sections in changed.items()})


def _with_own_linkages(suite: Suite, folder: Path) -> Suite:
    """Return the suite with absolute paths of the linkage files that lie in its folder."""

    def locate(_: str, section: Any) -> Any:
        """Return a section in which files of linkages in the suite's folder have absolute paths."""
        if not isinstance(section, OnLinkages):
            return section
        paths = {x: folder / x for x in section.linkages if x.endswith(".toml") and (folder / x).is_file()}
        return section.model_copy(update={"linkages": {str(paths.get(x, x)): scenario for x, scenario in section.linkages.items()}})

    return _change(suite, locate)


def join_entries(suites: Sequence[Suite]) -> Suite:
    """Return one suite with the distinct sections of all suites, and the title of the last."""
    content: dict[str, Any] = {}
    for name in SECTIONS:
        distinct: list[Any] = []
        for suite in suites:
            distinct += [x for x in getattr(suite, name) if x not in distinct]
        content[name] = tuple(distinct)
    return suites[-1].model_copy(update=content | {"parts": ()})  # `content` has the sections of all parts


def sections_on_linkages(suite: Suite) -> list[OnLinkages]:
    """Return all sections of a suite that list linkages."""
    return [x for name in SECTIONS for x in getattr(suite, name) if isinstance(x, OnLinkages)]


def scenario_of(suite: Suite, linkage: str) -> str | None:
    """Return the scenario of a linkage in the first section with `any_linkage` that lists it, or None if no such section does."""
    for section in sections_on_linkages(suite):
        if section.any_linkage and linkage in section.linkages:
            return section.linkages[linkage]
    return None


def linkages_of(suite: Suite) -> tuple[str, ...]:
    """Return names and paths of all linkages of a suite, each once."""
    return tuple(dict.fromkeys(linkage for section in sections_on_linkages(suite) for linkage in section.linkages))


def of_engines(suite: Suite, engines: Sequence[str]) -> Suite:
    """Return the suite with only these engines in its sections `accuracy`, `cost`, `search` and `field`.

    Sections of these four kinds that have none of the engines are left out. Sections of other kinds are unchanged.
    """

    def select(name: str, section: Any) -> Any:
        """Return a section restricted to the given engines; None if it has none of them."""
        if name not in ("accuracy", "cost", "search", "field"):
            return section
        chosen = tuple(e for e in engines if not section.engines or e in section.engines)  # all, if the section names none
        return section.model_copy(update={"engines": chosen}) if chosen else None

    return _change(suite, select)


def restrict(suite: Suite, linkages: Mapping[str, str]) -> Suite:
    """Return the suite restricted to the given linkages (name or path -> scenario).

    A section with `any_linkage` is run for all given linkages, in the given scenarios. A section without it keeps its linkages that
    are given, each in the scenario that the section names. Sections without linkages are left out, except `left_out` and the
    sections whose results are computed from times of other sections.
    """

    def keep(name: str, section: Any) -> Any:
        """Return a section with the given linkages for which it is run; None if there are none."""
        if not isinstance(section, OnLinkages):
            return section if name in ("left_out", "steps", "right_hand_side", "bounds") else None
        chosen = linkages if section.any_linkage else {x: s for x, s in section.linkages.items() if x in linkages}
        return section.model_copy(update={"linkages": dict(chosen)}) if chosen else None

    return _change(suite, keep)
