"""All engines by name: the suite's formulations and the adapters to foreign libraries, each imported when it is first used.

If a library is missing, the message names the extra of this package that installs it.
"""

from collections.abc import Iterable
from importlib.util import find_spec
from pkgutil import resolve_name
from typing import Any

from gauss_bench.engines.base import Engine
from gauss_bench.untrusted import BadInput

FOREIGN = {
    "pinocchio": "gauss_bench.engines.pinocchio.adapter:Pinocchio",
    "exudyn": "gauss_bench.engines.exudyn.adapter:Exudyn",
    "mujoco": "gauss_bench.engines.mujoco.adapter:Mujoco",
    "casadi": "gauss_bench.engines.casadi.adapter:Casadi",
}
DERIVED = {  # further equations of the suite's own, compiled; like a library, they can model only some linkages
    "minimal": "gauss_bench.engines.minimal.adapter:Minimal",
}
RIVALS = {  # used by searches and by users who name them, but not by suites: they need a C compiler, or fit few linkages
    "by_hand": "gauss_bench.engines.by_hand.adapter:ByHand",
    "pinocchio_casadi": "gauss_bench.engines.pinocchio.symbolic:PinocchioCasadi",
}
COMPILED = ("gauss-native", "lagrange-native")
OWN = ("gauss", "gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16")
OWN_CLASS, COMPILED_CLASS = "gauss_bench.engines.interpreted:Interpreted", "gauss_bench.engines.compiled:Compiled"
AUTHORED = (*OWN, *COMPILED, *DERIVED, "by_hand")  # written by the suite's authors: a comparison with others must say so

EXTRAS = {  # library -> the extra of the package that brings it
    "pinocchio": "pinocchio",
    "exudyn": "exudyn",
    "mujoco": "mujoco",
    "casadi": "casadi",
    "llvmlite": "kernel",
    "heyoka": "certify",
    "starlette": "studio",
    "uvicorn": "studio",
    "websockets": "studio",
    "tomlkit": "studio",
}


class UnknownEngine(BadInput, KeyError):
    """No engine has that name; the message lists the names that exist."""


def is_class(name: str) -> bool:
    """Tell whether a name has the form MODULE:CLASS, by which a user names an adapter that is not registered."""
    module, colon, class_name = name.partition(":")
    return bool(colon) and class_name.isidentifier() and all(x.isidentifier() for x in module.split("."))


def names() -> list[str]:
    """List all engines: formulations, compiled and derived ones, foreign ones, then those of installed plug-ins."""
    return [*OWN, *COMPILED, *DERIVED, *FOREIGN, *(point.name for point in _plug_ins())]


def all_names() -> list[str]:
    """List the engines of `names` and the rivals that suites leave out."""
    return [*names(), *RIVALS]


def get(name: str) -> Engine:
    """Return a new instance of the engine of that name, or of the class MODULE:CLASS.

    Raises:
        KeyError: there is no such engine.
        ImportError: its adapter cannot be imported. Adapters import their library only when they build.
    """
    if name in (*OWN, *COMPILED):
        return resolve_name(OWN_CLASS if name in OWN else COMPILED_CLASS)(name)  # type: ignore[no-any-return]
    registered = {**DERIVED, **FOREIGN, **RIVALS}
    if name in registered or is_class(name):
        return resolve_name(registered.get(name, name))()  # type: ignore[no-any-return]
    for point in _plug_ins():
        if point.name == name:
            return point.load()()  # type: ignore[no-any-return]
    raise UnknownEngine(f"unknown engine {name!r}; there are {', '.join(all_names())}")


def _plug_ins() -> Iterable[Any]:
    """Return the entry points by which installed packages offer engines."""
    from importlib.metadata import entry_points  # slow to import, and most processes of an engine do not need it

    return entry_points(group="gauss_bench.engines")


class MissingExtra(BadInput, ImportError):
    """The library that an engine or a verb needs is not installed; one of the package's extras brings it."""


def not_installed(error: ImportError) -> str:
    """Return a sentence that names the missing module, and the command that installs it if one of the extras does."""
    if isinstance(error, MissingExtra):
        return str(error)
    library = (error.name or "").partition(".")[0]
    how = f"; pip install 'gauss-bench[{EXTRAS[library]}]'" if library in EXTRAS else ""
    return f"not installed: {error}{how}"


def require(library: str) -> None:
    """Check that a library of EXTRAS is installed.

    Raises:
        MissingExtra: it is not installed.
    """
    if find_spec(library) is None:
        raise MissingExtra(not_installed(ImportError(f"no package {library}", name=library)), name=library)
