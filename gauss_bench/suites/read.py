"""Read suites by name or path, join them with the suites that they build on, and restrict them to what a user asks for."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gauss_bench.suites.schema import OnLinkages, Suite
from gauss_bench.untrusted import BadInput, parse_toml, read_bytes

FOLDER = Path(__file__).parent
MAX_BYTES = 1_048_576  # of a suite: the longest has 4,000
SECTIONS = tuple(name for name in Suite.model_fields if name not in ("format", "title", "hours", "parts"))


class SuiteError(BadInput, ValueError):
    """Raised for a suite that cannot be read; the message names file, table and field."""


def names() -> list[str]:
    """Return the names of the built-in suites."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def read_suite(name: str) -> Suite:
    """Return the suite of that name, or in the file of that path, joined with the suites that it builds on.

    Raises:
        SuiteError: there is no such suite, it is no TOML, it does not fit the schema, or it builds on itself.
    """
    return _read(name, ())


def _read(name: str, above: tuple[str, ...]) -> Suite:
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


def _with_own_linkages(suite: Suite, folder: Path) -> Suite:
    """Return the suite with paths instead of the names of linkage files that lie in its folder."""

    def locate(part: Any) -> Any:
        if not isinstance(part, OnLinkages):
            return part
        paths = {x: folder / x for x in part.linkages if x.endswith(".toml") and (folder / x).is_file()}
        return part.model_copy(update={"linkages": {str(paths.get(x, x)): s for x, s in part.linkages.items()}})

    return suite.model_copy(update={name: tuple(locate(x) for x in getattr(suite, name)) for name in SECTIONS})


def join_entries(suites: Sequence[Suite]) -> Suite:
    """Join suites: the parts of all, each once, with the title of the last."""
    content: dict[str, Any] = {}
    for name in SECTIONS:
        once: list[Any] = []
        for suite in suites:
            once += [x for x in getattr(suite, name) if x not in once]
        content[name] = tuple(once)
    return suites[-1].model_copy(update=content | {"parts": ()})


def scenario_of(suite: Suite, linkage: str) -> str | None:
    """Return the scenario in which a suite runs a linkage, or None if it does not list the linkage."""
    parts = [x for name in SECTIONS for x in getattr(suite, name) if isinstance(x, OnLinkages) and x.any_linkage]
    return next((x.linkages[linkage] for x in parts if linkage in x.linkages), None)


def linkages_of(suite: Suite) -> tuple[str, ...]:
    """Return names and paths of all linkages of a suite, each once."""
    parts = (x for name in SECTIONS for x in getattr(suite, name) if isinstance(x, OnLinkages))
    return tuple(dict.fromkeys(linkage for part in parts for linkage in part.linkages))


def of_engines(suite: Suite, engines: Sequence[str]) -> Suite:
    """Return the suite with only these engines in its accuracy, cost, search and field parts."""

    def select(parts: tuple[Any, ...]) -> tuple[Any, ...]:
        chosen = [(x, tuple(e for e in engines if not x.engines or e in x.engines)) for x in parts]
        return tuple(x.model_copy(update={"engines": names}) for x, names in chosen if names)

    return suite.model_copy(update={name: select(getattr(suite, name)) for name in ("accuracy", "cost", "search", "field")})


def restrict(suite: Suite, linkages: Mapping[str, str]) -> Suite:
    """Restrict a suite to the given linkages (name or path -> scenario).

    A part for any linkage has all of them, another part those that it lists.
    """
    content: dict[str, tuple[Any, ...]] = {}
    for name in SECTIONS:
        kept = []
        for part in getattr(suite, name):
            if isinstance(part, OnLinkages):
                # a part that lists linkages names its own scenarios
                chosen = linkages if part.any_linkage else {x: s for x, s in part.linkages.items() if x in linkages}
                if chosen:
                    kept.append(part.model_copy(update={"linkages": dict(chosen)}))
            elif name in ("left_out", "steps", "right_hand_side", "bounds"):
                kept.append(part)
        content[name] = tuple(kept)
    return suite.model_copy(update=content)
