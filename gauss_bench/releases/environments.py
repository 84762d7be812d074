"""Make Python environments, one for each release of an engine's library.

Each environment is a subfolder `ENGINE-VERSION` of the user's data folder, and stays there for later calls. pip first downloads the
library's wheel. If `releases.toml` lists a hash for the file, the hash must agree; files without a listed hash are installed by
their version alone. pip chooses the versions of numpy >= 2 and of further requirements, as it does for a user who installs the
release today.
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
from gauss_bench.engines import home, interpreter_in, is_ours
from gauss_bench.engines.installation import OPTIONS, InstallationFault, Told, hold, make_environment, pip_of, run_program
from gauss_bench.releases.library import Library
from gauss_bench.trajectory import in_a_sentence

NUMPY = "numpy>=2"  # requirement of the code that runs in the environment beside the library
PATIENCE = ("--retries", "1", "--quiet")  # options of pip: with a single retry it fails soon if the index does not answer
CHECKED, BY_VERSION = "its hash is listed", "installed by its version"
HOW = "how-installed"  # text file in an environment with CHECKED or BY_VERSION, written at the end of the installation
WITHOUT_A_WHEEL = "No matching distribution"  # words in pip's message if the index has no wheel for this machine
IMPOSSIBLE = "ResolutionImpossible"  # word in pip's message if requirements contradict each other
AGAIN = "again"  # ending of the second name of the newest release
LONGEST = 120.0  # [s] time limit for listing the releases of an index


@dataclass(frozen=True)
class Release:
    """A release that is installed, or the reason why it is not installed.

    Attributes:
        engine, version: name of the engine, and number of the release.
        python: path of the release's interpreter.
        how: text that says whether the hash of the release's file was checked.
        reason: why the release is not installed; empty if it is.
    """

    engine: str
    version: str
    python: str = ""
    how: str = ""
    reason: str = ""

    @property
    def name(self) -> str:
        """The name of the engine that a comparison makes of this release, such as "mujoco-3.6.0"."""
        return f"{self.engine}-{self.version}"


def install_release(library: Library, version: str, told: Told) -> Release:
    """Install a release unless it is installed already, and return it.

    If the installation fails, the returned release has the reason. `told` is called with a sentence before an installation begins.
    """
    folder = home().with_name("releases")  # has the environments of all releases
    folder.mkdir(parents=True, exist_ok=True)
    environment = folder / Release(library.engine, version).name
    if not (is_ours(environment) and (environment / HOW).is_file()):
        with hold(folder):
            told(f"{library.engine} {version}: installing it")
            try:
                _install(library, version, environment)
            except InstallationFault as fault:
                return Release(library.engine, version, reason=explain_failure(library, version, str(fault)))
    how = (environment / HOW).read_text(encoding="utf-8")
    return Release(library.engine, version, str(interpreter_in(environment)), how)


def _install(library: Library, version: str, environment: Path) -> None:
    """Make the environment of a release in the folder `environment`.

    Raises:
        InstallationFault: pip fails, or the hash of the file differs from the listed hash.
    """
    failure = f"{library.package} {version} cannot be installed"

    def ignore(sentence: str) -> None:
        """Drop a line of pip's output; if pip fails, the message of the failure quotes the output."""

    def fill(folder: Path) -> None:
        """Download the release's wheel, check its hash, and install it with numpy and further requirements.

        The file HOW records whether the hash was checked.
        """
        with tempfile.TemporaryDirectory() as downloads:
            requirement = f"{library.package}=={version}"
            fetch = [*pip_of(folder), "download", *OPTIONS, *PATIENCE, "--no-deps", "--dest", downloads, requirement]
            run_program(fetch, failure, ignore, quiet=True)
            (wheel,) = Path(downloads).iterdir()
            note, further = check_hash(library, wheel), library.besides.get(version, [])
            install = [*pip_of(folder), "install", *OPTIONS, *PATIENCE, NUMPY, str(wheel), *further]
            run_program(install, failure, ignore, quiet=True)
        (folder / HOW).write_text(note, encoding="utf-8")

    make_environment(environment, fill, ignore, quiet=True)


def check_hash(library: Library, wheel: Path) -> str:
    """Return CHECKED if the hash of a file is listed, and BY_VERSION if the file is not listed.

    Raises:
        InstallationFault: the hash of the file differs from the hash that is listed for it.
    """
    listed = library.sha256.get(wheel.name)
    if listed is None:
        return BY_VERSION
    if hashlib.sha256(wheel.read_bytes()).hexdigest() != listed:
        raise InstallationFault(f"{wheel.name} is not the file that was listed: its hash differs")
    return CHECKED


def explain_failure(library: Library, version: str, failure: str) -> str:
    """Return a sentence on the reason of a failed installation; `failure` is pip's message."""
    if WITHOUT_A_WHEEL in failure:
        return f"pip finds no wheel of {library.package} {version} for this Python and machine"
    if IMPOSSIBLE in failure:
        return f"{library.package} {version} cannot be installed together with {NUMPY}"
    return in_a_sentence(failure)


def list_available(release: Release, library: Library) -> list[str]:
    """Return the releases that the index of packages offers for this Python and machine, newest first; `release` is installed.

    Raises:
        InstallationFault: the index does not answer.
    """
    environment = Path(release.python).parents[1]
    command = [*pip_of(environment), "index", "versions", library.package, "--disable-pip-version-check", "--retries", "1"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False).stdout
    except subprocess.TimeoutExpired:
        answer = ""  # names no releases, which `read_available` reports
    return read_available(answer, library.package)


def read_available(answer: str, package: str) -> list[str]:
    """Return the releases in the output of `pip index versions`, in its order.

    Raises:
        InstallationFault: the output lists no releases.
    """
    for line in answer.splitlines():
        title, _, versions = line.partition(":")
        if title == "Available versions":
            return [x.strip() for x in versions.split(",")]
    raise InstallationFault(f"the package index lists no releases of {package}")


@contextlib.contextmanager
def as_engines(library: Library, releases: Sequence[Release]) -> Iterator[None]:
    """Register releases of a library as engines in this process while the context is open.

    The newest release, the last of `releases`, is also registered under a second name, to be timed against itself. A file of
    engines temporarily replaces the user's own.
    """
    named = {x.name: x.python for x in releases}
    # the same interpreter under another path: worker processes are kept by path, so that the second name gets a process of its own
    named[second_name(releases[-1])] = str(Path(releases[-1].python).with_name("python3"))
    own_file = os.environ.get(ENGINES_FILE)  # the user's file, if there is one
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
            if own_file is not None:
                os.environ[ENGINES_FILE] = own_file


def second_name(release: Release) -> str:
    """Return the name under which a release is registered as an engine a second time, to be timed against itself."""
    return f"{release.name}-{AGAIN}"
