"""Install and remove the Python environments of engines whose libraries need one of their own (the engines of ELSEWHERE).

venv makes an environment in a hidden folder, and pip installs the packages of the engine's `requirements.txt`, whose hashes it
checks. Then the folder is renamed to the name of the engine, by which `read_environments` finds it. An installation that fails or
is interrupted leaves nothing behind. An installation that is killed leaves its hidden folder, which the next call of `hold`
deletes. Apart from hidden folders, `install` and `remove` delete only folders that contain the file MADE.
"""

import contextlib
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gauss_bench.engines import ELSEWHERE, MADE, UnknownEngine, file_of_engines, home, interpreter_in, is_ours, read_environments
from gauss_bench.untrusted import BadInput, parse_toml

ROOMS = Path(__file__).parent
HIDDEN = re.compile(r"\.[\w.-]+\.part-\w+")  # name of a folder in which an environment is built or deleted
OPTIONS = ("--only-binary", ":all:", "--no-input", "--disable-pip-version-check")  # of pip
LAST_LINES = 3  # number of lines of a program's output that a failure quotes

Told = Callable[[str], None]  # function that shows the user one line of progress


class InstallationFault(BadInput):
    """An environment cannot be installed or removed; the message says why."""


@dataclass(frozen=True)
class Offered:
    """The content of an engine's file `environment.toml`, which users read before an installation.

    Attributes:
        library: name and version of the library.
        licence: licences of all packages that are installed.
        download, installed: sizes [MB].
        pythons: interpreters and machines for which there are wheels.
    """

    library: str
    licence: str
    download: float
    installed: float
    pythons: str


def read_offered(name: str) -> Offered:
    """Return the description of an engine's environment; an UnknownEngine if no engine of ELSEWHERE has that name."""
    if name not in ELSEWHERE:
        raise UnknownEngine(f"{name!r} is no engine that can be installed; there are {', '.join(ELSEWHERE)}")
    return Offered(**parse_toml((ROOMS / name / "environment.toml").read_text(encoding="utf-8")))


def is_installed_here(name: str) -> bool:
    """Tell whether an engine runs in an environment that `install` made."""
    environment = read_environments().get(name)
    return environment is not None and Path(environment.python) == interpreter_in(home() / name) and is_ours(home() / name)


def install(name: str, why_unusable: Callable[[str], str], told: Told) -> None:
    """Install the environment of an engine.

    Args:
        why_unusable: function of the engine's name, called after the packages are installed; it returns the reason why the engine
            cannot be used, or an empty text if it can.
        told: function that shows the user one line of progress.

    Raises:
        InstallationFault: the environment cannot be installed, or the engine cannot be used.
    """
    offered, place = read_offered(name), home() / name
    home().mkdir(parents=True, exist_ok=True)
    with hold(home()):
        require_free(name)
        told(f"{name}: installing {offered.library}, {offered.download:g} MB to download")
        failure = f"{offered.library} cannot be installed (there are wheels for {offered.pythons})"

        packages = ("install", *OPTIONS, "--require-hashes", "-r", str(ROOMS / name / "requirements.txt"))
        make_environment(place, lambda folder: run_program([*pip_of(folder), *packages], failure, told), told)
        try:
            if reason := why_unusable(name):
                raise InstallationFault(f"{name} was installed and cannot be used, so it was removed: {reason}")
        except BaseException:
            _delete(place)
            raise


def make_environment(place: Path, fill: Callable[[Path], object], told: Told, quiet: bool = False) -> None:
    """Make an environment in the folder `place`; if that fails, leave nothing behind. The caller must `hold` the parent folder.

    Args:
        place: the folder; an environment that is already there is replaced.
        fill: function that installs the packages into a folder; the folder is the hidden one in which the environment is built.
        quiet: whether the programs' output is kept from the terminal.

    Raises:
        InstallationFault: the environment cannot be made.
    """
    unfinished = _make_hidden(place)
    try:
        told(f"{place.name}: making an environment of Python {sys.version_info[0]}.{sys.version_info[1]} in {place}")
        run_program([sys.executable, "-I", "-m", "venv", str(unfinished)], "the environment cannot be made", told, quiet)
        fill(unfinished)
        if place.exists():
            _delete(place)
        unfinished.rename(place)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise


def remove(name: str) -> None:
    """Remove an environment that `install` made; an InstallationFault if there is none."""
    read_offered(name)  # raises an UnknownEngine if the engine cannot be installed
    place = home() / name
    if not is_ours(place):
        listed = read_environments().get(name)
        where = f"; its environment is listed in {file_of_engines()}, where you can remove its table" if listed else ""
        raise InstallationFault(f"{name} was not installed by `gauss-bench engines install`{where}")
    with hold(home()):
        _delete(place)


def remove_leftovers() -> None:
    """Remove the hidden folders of killed installations, unless an installation is running."""
    if home().is_dir():
        # `hold` removes them when it has the lock; while an installation has the lock, `hold` raises the suppressed fault
        with contextlib.suppress(InstallationFault), hold(home()):
            pass


@contextlib.contextmanager
def hold(environments: Path) -> Iterator[None]:
    """Lock a folder of environments for this process, and remove the hidden folders of killed installations from it.

    Raises:
        InstallationFault: another process has locked it.
    """
    folder = os.open(environments, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InstallationFault("another process is installing or removing an engine; try again later") from error
        for path in environments.iterdir():
            if HIDDEN.fullmatch(path.name):
                shutil.rmtree(path, ignore_errors=True)
        yield
    finally:
        os.close(folder)


def _make_hidden(place: Path) -> Path:
    """Make a hidden folder beside a path, and return it."""
    # the name is unique, because the pip of an installation that was killed may still write into its own hidden folder
    folder = Path(tempfile.mkdtemp(prefix=f".{place.name}.part-", dir=place.parent))
    (folder / MADE).touch()  # marks a folder that gauss-bench made and may remove
    return folder


def _delete(place: Path) -> None:
    """Move an environment into a hidden folder, and delete that folder; if interrupted, the next `hold` deletes the rest."""
    hidden = _make_hidden(place)
    place.rename(hidden / place.name)
    shutil.rmtree(hidden)


def require_free(name: str) -> None:
    """Raise an InstallationFault if an engine is installed, or if its name is taken by a table or folder of the user."""
    place = home() / name
    if is_installed_here(name):
        raise InstallationFault(f"{name} is installed, in {place}; `gauss-bench engines remove {name}` removes it")
    if listed := read_environments().get(name):
        raise InstallationFault(f"{file_of_engines()} lists an environment of {name}, {listed.python}; remove its table first")
    if place.is_symlink() or (place.exists() and not is_ours(place)):
        raise InstallationFault(f"{place} was not made by gauss-bench; move it away first")


def pip_of(folder: Path) -> list[str]:
    """Return the command that starts the pip of an environment; with -I, pip imports no modules from elsewhere."""
    return [str(interpreter_in(folder)), "-I", "-m", "pip"]


def run_program(command: Sequence[str], failure: str, told: Told, quiet: bool = False) -> None:
    """Run a program to its end, with its output on the terminal, or line by line to `told` if there is no terminal.

    Args:
        failure: beginning of the message if the program fails.
        quiet: whether `told` gets the output even if there is a terminal. The message of a failure then quotes the output.

    Raises:
        InstallationFault: the program fails.
    """
    at_terminal = sys.stderr.isatty() and not quiet
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=sys.stderr.fileno() if at_terminal else subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,  # so that an interrupt of the terminal reaches this process alone, which then ends the program
    )
    lines: list[str] = []
    try:
        for line in process.stdout or ():  # there is no pipe if the output goes to the terminal
            if text := line.strip():
                lines.append(text)
                told(text)
        code = process.wait()
    except BaseException:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        raise
    if code:
        errors = [line for line in lines if line.startswith("ERROR")] or lines
        reason = "see its message above" if at_terminal else " ".join(errors[-LAST_LINES:])
        raise InstallationFault(f"{failure}: {reason}")
