"""List, install and remove engines in environments of their own, for the subcommand `engines`."""

import sys
from dataclasses import asdict, dataclass

from gauss_bench.api.telling import Answer, Told, tell
from gauss_bench.engines import ELSEWHERE, home, read_environments
from gauss_bench.engines.installation import install, is_installed_here, read_offered, remove, remove_leftovers, require_free
from gauss_bench.runs.offers import offer
from gauss_bench.untrusted import BadInput


@dataclass(frozen=True)
class ListedEnvironment:
    """An engine in an environment of its own.

    Attributes:
        library: name and version of the library; empty for an engine that only the user's file of engines names.
        licence: licences of all packages that are installed.
        download, installed: size of the downloaded and of the installed files [MB].
        pythons: interpreters and machines for which the engine can be installed.
        python: path of the interpreter; empty if the engine is not installed.
        removable: whether `engines install` made the environment, so that `engines remove` can remove it.
    """

    library: str = ""
    licence: str = ""
    download: float = 0.0
    installed: float = 0.0
    pythons: str = ""
    python: str = ""
    removable: bool = False


@dataclass(frozen=True)
class Environments:
    """All engines in environments of their own.

    Attributes:
        done: sentence on what was installed or removed; else empty.
        folder: folder of the installed environments.
        engines: name -> engine, also those that are not installed.
    """

    done: str
    folder: str
    engines: dict[str, ListedEnvironment]


def engines(action: str, name: str | None, yes: bool, told: Told) -> Answer[Environments]:
    """List engines in environments of their own, or install or remove the engine `name`; with `yes`, install it without asking.

    Raises:
        BadInput: the arguments do not fit together, or the engine cannot be installed or removed.
    """
    if (name is None) != (action == "list"):
        raise BadInput("`engines install` and `engines remove` take the name of an engine, and `engines list` takes none")
    if name is None:
        remove_leftovers()  # of interrupted installations
        return Answer(_list_environments(""))
    if action == "remove":
        remove(name)
        return Answer(_list_environments(f"{name} is removed"))
    require_free(name)  # raises InstallationFault if the engine is installed already
    _print_contents(name)
    if not (yes or _confirm(name)):
        return Answer(_list_environments("nothing is installed"), succeeded=False)
    install(name, lambda installed: offer(installed).reason, told)
    return Answer(_list_environments(f"{name} is installed: {offer(name).version}"))


def _list_environments(done: str) -> Environments:
    """Return all engines in environments of their own: first those of this package, then further ones of the user's file."""
    environments = read_environments()  # from the user's file
    listed = {}
    for name in dict.fromkeys((*ELSEWHERE, *environments)):
        offered = asdict(read_offered(name)) if name in ELSEWHERE else {}
        python = environments[name].python if name in environments else ""
        listed[name] = ListedEnvironment(**offered, python=python, removable=is_installed_here(name))
    return Environments(done, str(home()), listed)


def _print_contents(name: str) -> None:
    """Print what would be installed: library, licences and sizes."""
    offered = read_offered(name)
    tell(f"{offered.library}, for {offered.pythons}")
    tell(f"licence   {offered.licence}")
    tell(f"size      {offered.download:g} MB to download, {offered.installed:g} MB in {home() / name}")


def _confirm(name: str) -> bool:
    """Ask the user whether to install an engine; raise BadInput without a terminal."""
    if not (sys.stdin and sys.stdin.isatty()):
        raise BadInput("there is no terminal to ask for confirmation; --yes installs without")
    print(f"Install {name}? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")
