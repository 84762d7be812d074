"""Read the releases of an engine's library from the file `releases.toml` of the engine's folder."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gauss_bench import engines
from gauss_bench.engines import FOREIGN
from gauss_bench.untrusted import BadInput, parse_toml

FILE = "releases.toml"
NUMBER = re.compile(r"\d+(\.\d+)*(\.post\d+)?")  # the number of a release, not that of a release candidate


class ReleaseFault(BadInput, ValueError):
    """Raised if the requested releases of an engine's library cannot be compared."""


@dataclass(frozen=True)
class Library:
    """The library of an engine.

    Attributes:
        class_name: PACKAGE.MODULE:CLASS of the engine's adapter.
        adapter_package: the Python package, a folder, that holds the adapter: PACKAGE in `class_name`.
        package: name under which pip installs the library.
        releases: releases that are compared by default, the oldest first.
        raced: linkage, settings and integrator of every timed comparison.
        besides: release -> requirements that the release's metadata do not name.
        sha256: name of a file -> hash of the file.
    """

    engine: str
    class_name: str
    adapter_package: str
    package: str
    releases: tuple[str, ...]
    raced: tuple[tuple[str, str, str], ...] = ()
    besides: dict[str, list[str]] = field(default_factory=dict)
    sha256: dict[str, str] = field(default_factory=dict)


def names() -> list[str]:
    """Return the names of the engines whose releases can be compared."""
    return [name for name in FOREIGN if _file_of(name).is_file()]


def _file_of(engine: str) -> Path:
    """Return the path of the file that lists an engine's releases."""
    return Path(engines.__file__).parent / engine / FILE


def read_library(engine: str) -> Library:
    """Return the library of an engine.

    Raises:
        ReleaseFault: the engine has no list of releases.
    """
    if engine not in names():
        raise ReleaseFault(f"releases of {engine!r} cannot be compared, only those of {', '.join(names())}")
    table = parse_toml(_file_of(engine).read_text(encoding="utf-8"))
    class_name = FOREIGN[engine]  # PACKAGE.MODULE:CLASS
    module, _, _ = class_name.partition(":")
    return Library(
        engine,
        class_name,
        adapter_package=module.rpartition(".")[0],
        package=table["package"],
        releases=tuple(table["releases"]),
        raced=tuple((x["linkage"], x["settings"], x["integrator"]) for x in table["raced"]),
        besides=table.get("besides", {}),
        sha256=table["sha256"],
    )


def version_numbers(version: str) -> tuple[int, ...]:
    """Return the numbers of a version, such as (3, 6, 0), by which releases are sorted.

    Raises:
        ReleaseFault: the text is no version of a release.
    """
    if not NUMBER.fullmatch(version):
        raise ReleaseFault(f"{version!r} is no release: it must be a number such as 3.6.0")
    return tuple(int(x) for x in re.findall(r"\d+", version))


def choose_releases(library: Library, first: str | None, last: str | None, only: Sequence[str] | None) -> list[str]:
    """Return the releases to compare, the oldest first: those in `only`, or `first`, `last` and the listed ones between them.

    A missing `first` or `last` is the oldest or the newest listed release.

    Raises:
        ReleaseFault: there are fewer than two releases, or the arguments contradict each other.
    """
    if only and (first or last):
        raise ReleaseFault("--only names every release, and cannot be combined with --from or --to")
    if only:
        chosen = sorted(set(only), key=version_numbers)
    else:
        earliest, latest = first or library.releases[0], last or library.releases[-1]
        low, high = version_numbers(earliest), version_numbers(latest)
        if low > high:
            raise ReleaseFault(f"--from {earliest} is later than --to {latest}")
        listed = [x for x in library.releases if low <= version_numbers(x) <= high]
        chosen = sorted({earliest, latest, *listed}, key=version_numbers)
    if len(chosen) < 2:
        raise ReleaseFault(f"a comparison needs two releases; listed are {', '.join(library.releases)}")
    return chosen
