"""Environments of releases, each in a folder `ENGINE-VERSION` of the user's data, where it stays for the next call.

pip fetches the library's wheel first. If `releases.toml` lists a hash for that file it must agree, and the release counts as
checked; a file that is not listed is installed by its version. numpy >= 2 and what else the library needs come from pip as it is:
the numpy that a user of that release would get today.
"""

import contextlib
import hashlib
import json
import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gauss_bench.engines import FILE as ENGINES_FILE
from gauss_bench.engines.installation import (
    OPTIONS,
    InstallationFault,
    Told,
    hold,
    home,
    interpreter_in,
    is_ours,
    make_environment,
    pip_of,
    run_program,
)
from gauss_bench.releases.library import Library
from gauss_bench.trajectory import in_a_sentence

NUMPY = "numpy>=2"  # a worker needs it
PATIENCE = ("--retries", "1", "--quiet")  # options of pip: an index that does not answer is a reason, not a wait
CHECKED, BY_VERSION = "its hash is listed", "installed by its version"
HOW = "how-installed"  # file in an environment: one of the two
WITHOUT_A_WHEEL = "No matching distribution"
IMPOSSIBLE = "ResolutionImpossible"
AGAIN = "again"  # a second name of the newest release, by another path of the same interpreter
LONGEST = 120.0  # [s] to list the releases of an index


@dataclass(frozen=True)
class Release:
    """A release that is installed, or the reason why it is not.

    Attributes:
        engine, version: what it is; python: path of its interpreter.
        how: whether the file's hash was checked.
        reason: why it is not installed; else empty.
    """

    engine: str
    version: str
    python: str = ""
    how: str = ""
    reason: str = ""

    @property
    def name(self) -> str:
        """The name of the release among engines."""
        return name_of(self.engine, self.version)


def name_of(engine: str, version: str) -> str:
    """Return the name of a release among engines."""
    return f"{engine}-{version}"


def folder_of_releases() -> Path:
    """Return the folder of all environments of releases, which need not exist."""
    return home().with_name("releases")


def install_release(library: Library, version: str, told: Told) -> Release:
    """Install a release unless it is there, and return it; what fails is its reason."""
    folder = folder_of_releases()
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / name_of(library.engine, version)
    if not _is_whole(place):
        with hold(folder):
            told(f"{library.engine} {version}: installing it")
            try:
                _install(library, version, place)
            except InstallationFault as fault:
                return Release(library.engine, version, reason=explain(library, version, str(fault)))
    how = (place / HOW).read_text(encoding="utf-8")
    return Release(library.engine, version, str(interpreter_in(place)), how)


def _is_whole(place: Path) -> bool:
    """Tell whether a release is installed in a folder."""
    return is_ours(place) and (place / HOW).is_file()


def _install(library: Library, version: str, place: Path) -> None:
    """Make the environment of a release.

    Raises:
        InstallationFault: it cannot be made, or the file is not the one that is listed.
    """
    failure = f"{library.package} {version} cannot be installed"

    def fill(folder: Path) -> None:
        with tempfile.TemporaryDirectory() as downloads:
            wanted = f"{library.package}=={version}"
            fetch = [*pip_of(folder), "download", *OPTIONS, *PATIENCE, "--no-deps", "--dest", downloads, wanted]
            run_program(fetch, failure, _nobody, quiet=True)
            (wheel,) = Path(downloads).iterdir()
            how, more = check_hash(library, wheel), library.besides.get(version, [])
            run_program([*pip_of(folder), "install", *OPTIONS, *PATIENCE, NUMPY, str(wheel), *more], failure, _nobody, quiet=True)
        (folder / HOW).write_text(how, encoding="utf-8")

    make_environment(place, fill, _nobody, quiet=True)


def _nobody(sentence: str) -> None:
    """Drop a line of pip, which its failure quotes."""


def check_hash(library: Library, wheel: Path) -> str:
    """Return how far a file can be trusted.

    Raises:
        InstallationFault: its hash is not the one that is listed.
    """
    listed = library.sha256.get(wheel.name)
    if listed is None:
        return BY_VERSION
    if hashlib.sha256(wheel.read_bytes()).hexdigest() != listed:
        raise InstallationFault(f"{wheel.name} is not the file that was listed: its hash differs")
    return CHECKED


def explain(library: Library, version: str, failure: str) -> str:
    """Return the reason of a failed installation in a sentence."""
    if WITHOUT_A_WHEEL in failure:
        return f"pip finds no wheel of {library.package} {version} for this Python and machine"
    if IMPOSSIBLE in failure:
        return f"{library.package} {version} does not go together with {NUMPY}"
    return in_a_sentence(failure)


def list_available(release: Release, library: Library) -> list[str]:
    """Return the releases that the index offers for this Python and machine, newest first, asked by the pip of a release.

    Raises:
        InstallationFault: the index does not answer.
    """
    place = Path(release.python).parents[1]
    command = [*pip_of(place), "index", "versions", library.package, "--disable-pip-version-check", "--retries", "1"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False).stdout
    except subprocess.TimeoutExpired:
        answer = ""
    return read_available(answer, library.package)


def read_available(answer: str, package: str) -> list[str]:
    """Return the releases that `pip index versions` printed.

    Raises:
        InstallationFault: it printed none.
    """
    for line in answer.splitlines():
        title, _, versions = line.partition(":")
        if title == "Available versions":
            return [x.strip() for x in versions.split(",")]
    raise InstallationFault(f"the index of packages does not tell the releases of {package}")


@contextlib.contextmanager
def as_engines(library: Library, releases: Sequence[Release]) -> Iterator[None]:
    """Make releases engines of this process by their names, and the newest a second time, as an engine of processes of its own.

    They are listed in a file of engines, which stands in the place of the user's own meanwhile.
    """
    named = {x.name: x.python for x in releases}
    named[again(releases[-1])] = str(Path(releases[-1].python).with_name("python3"))
    before = os.environ.get(ENGINES_FILE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "engines.toml"
        tables = (
            f"[{json.dumps(name)}]\nclass = {json.dumps(library.class_name)}\npython = {json.dumps(python)}\n"
            for name, python in named.items()
        )
        path.write_text("\n".join(tables), encoding="utf-8")
        os.environ[ENGINES_FILE] = str(path)
        try:
            yield
        finally:
            os.environ.pop(ENGINES_FILE)
            if before is not None:
                os.environ[ENGINES_FILE] = before


def again(release: Release) -> str:
    """Return the second name of a release."""
    return f"{release.name}-{AGAIN}"
