"""The verb `engines`: engines in environments of their own, which it lists, installs and removes."""

import sys
from dataclasses import asdict, dataclass

from gauss_bench.api.telling import Answer, Told, tell
from gauss_bench.engines import ELSEWHERE, read_environments
from gauss_bench.engines.installation import home, install, is_installed_here, read_offered, remove, remove_leftovers, require_free
from gauss_bench.runs.offers import offer
from gauss_bench.untrusted import BadInput


@dataclass(frozen=True)
class ListedEnvironment:
    """An engine in an environment of its own.

    Attributes:
        library: name and version; empty for an engine that only the user's file of engines names.
        licence: of all that is installed.
        download, installed: size [MB].
        pythons: interpreters and machines for which it can be installed.
        python: path of the interpreter; empty if the engine is not installed.
        removable: whether `engines remove` can remove it, as `engines install` made it.
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
    """The engines in environments of their own.

    Attributes:
        done: what was installed or removed, in a sentence; else empty.
        folder: in which environments are installed.
        engines: name -> engine, also those that are not installed.
    """

    done: str
    folder: str
    engines: dict[str, ListedEnvironment]


def engines(action: str, name: str | None, yes: bool, told: Told) -> Answer[Environments]:
    """List engines in environments of their own, or install or remove one."""
    if (name is None) != (action == "list"):
        raise BadInput("`engines install` and `engines remove` take the name of an engine, and `engines list` takes none")
    if name is None:
        remove_leftovers()
        return Answer(_list_environments(""))
    if action == "remove":
        remove(name)
        return Answer(_list_environments(f"{name} is removed"))
    require_free(name)
    _describe(name)
    if not (yes or _confirm(name)):
        return Answer(_list_environments("nothing is installed"), succeeded=False)
    install(name, lambda installed: offer(installed).reason, told)
    return Answer(_list_environments(f"{name} is installed: {offer(name).version}"))


def _list_environments(done: str) -> Environments:
    """Return all engines in environments of their own: those that can be installed first."""
    named = read_environments()
    listed = {
        name: ListedEnvironment(
            **(asdict(read_offered(name)) if name in ELSEWHERE else {}),
            python=named[name].python if name in named else "",
            removable=is_installed_here(name),
        )
        for name in (*ELSEWHERE, *(x for x in named if x not in ELSEWHERE))
    }
    return Environments(done, str(home()), listed)


def _describe(name: str) -> None:
    """Tell what would be installed."""
    offered = read_offered(name)
    tell(f"{offered.library}, for {offered.pythons}")
    tell(f"licence   {offered.licence}")
    tell(f"size      {offered.download:g} MB to download, {offered.installed:g} MB in {home() / name}")


def _confirm(name: str) -> bool:
    """Ask whether to install.

    Raises:
        BadInput: there is no terminal to ask.
    """
    if not (sys.stdin and sys.stdin.isatty()):
        raise BadInput("there is no terminal to ask for confirmation; --yes installs without")
    print(f"Install {name}? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")
