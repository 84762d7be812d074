"""All engines by name: the suite's formulations, adapters to foreign libraries, plug-ins, and engines of other environments.

Adapters are imported when they are first used. If a library is missing, the message names the extra of this package that brings it.

An engine whose library does not go together with those of this environment lives in one of its own. A file of the user's names such
engines, each by a table:

    [heun]
    class = "my_engine:Heun"                     # MODULE:CLASS, as it is imported there; an engine of ELSEWHERE needs none
    python = "/home/me/heun/bin/python"          # the interpreter of the environment
    memory = 8                                   # GiB that a process may have, where the usual limit does not do

It is `gauss-bench/engines.toml` in the user's folder of settings, or the file that GAUSS_BENCH_ENGINES names. The environment needs
Python >= 3.11 and numpy >= 2 besides the engine's library; it need not have this package.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from gauss_bench.engines.base import Engine
from gauss_bench.untrusted import BadInput, parse_toml, read_bytes

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
ELSEWHERE = {  # adapters of this package whose library needs an environment of its own; not listed without one
    "opensim": "gauss_bench.engines.opensim.adapter:OpenSim",
    "dart": "gauss_bench.engines.dart.adapter:Dart",
    "drake": "gauss_bench.engines.drake.adapter:Drake",
    "bullet": "gauss_bench.engines.bullet.adapter:Bullet",
    "mjx": "gauss_bench.engines.mjx.adapter:Mjx",
    "newton": "gauss_bench.engines.newton.adapter:Newton",
}
COMPILED = ("gauss-native", "lagrange-native")
OWN = ("gauss", "gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16")
OWN_CLASS, COMPILED_CLASS = "gauss_bench.engines.interpreted:Interpreted", "gauss_bench.engines.compiled:Compiled"
SAFE = (*OWN, *COMPILED, *DERIVED, *FOREIGN, *RIVALS)  # adapters of this package, which import their library only where they build
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

FILE = "GAUSS_BENCH_ENGINES"  # environment variable
LARGEST = 1 << 16  # bytes of the file
KEYS: dict[str, type | tuple[type, ...]] = {"class": str, "python": str, "memory": (int, float)}
LEAST, MOST = 0.5, 1024.0  # [GiB] of memory that can be asked for


class UnknownEngine(BadInput, KeyError):
    """No engine has that name; the message lists the names that exist."""


class EnvironmentFault(BadInput, ValueError):
    """The file of engines has a fault; the message names file, table and key."""


@dataclass(frozen=True)
class Environment:
    """The environment of an engine.

    Attributes:
        engine: name of the engine; class_name: MODULE:CLASS of its adapter.
        python: path of the interpreter.
        memory: bytes that a process may have; 0 for the usual limit.
    """

    engine: str
    class_name: str
    python: str
    memory: int = 0


def is_class(name: str) -> bool:
    """Tell whether a name has the form MODULE:CLASS, by which a user names an adapter that is not registered."""
    module, colon, class_name = name.partition(":")
    return bool(colon) and class_name.isidentifier() and all(x.isidentifier() for x in module.split("."))


def names() -> list[str]:
    """List all engines: formulations, compiled and derived ones, foreign ones, then plug-ins, then those of other environments."""
    others = [*(point.name for point in _plug_ins()), *read_environments()]
    return [*OWN, *COMPILED, *DERIVED, *FOREIGN, *dict.fromkeys(others)]


def all_names() -> list[str]:
    """List the engines of `names` and the rivals that suites leave out."""
    return [*names(), *RIVALS]


def environment_of(name: str) -> Environment | None:
    """Return the environment of its own in which an engine lives; None for an engine of this environment."""
    return None if name in SAFE or is_class(name) else read_environments().get(name)


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
    if environment := environment_of(name):  # in a process of that environment
        return resolve_name(environment.class_name)()  # type: ignore[no-any-return]
    for point in _plug_ins():
        if point.name == name:
            return point.load()()  # type: ignore[no-any-return]
    raise unknown(name)


def unknown(name: str) -> UnknownEngine:
    """Return the error of a name that no engine has."""
    if name in ELSEWHERE:
        return UnknownEngine(f"the engine {name} is not installed; `gauss-bench engines install {name}` installs it")
    return UnknownEngine(f"unknown engine {name!r}; there are {', '.join(all_names())}")


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


def file_of_engines() -> Path:
    """Return the path of the user's file of engines, which need not exist."""
    if named := os.environ.get(FILE):
        return Path(named)
    base = os.environ.get("XDG_CONFIG_HOME", "")
    home = Path(base) if os.path.isabs(base) else Path.home() / ".config"
    return home / "gauss-bench" / "engines.toml"


def read_environments() -> dict[str, Environment]:
    """Return engine -> environment, in the order of the user's file; empty where there is no file.

    Raises:
        EnvironmentFault: the file has a fault.
        OSError: it cannot be read.
    """
    path = file_of_engines()
    try:
        content = read_bytes(path, LARGEST)
    except FileNotFoundError:
        return {}
    try:
        tables = parse_toml(content.decode())
    except ValueError as error:
        raise EnvironmentFault(f"{path}: {error}") from error
    if taken := next((x for x in tables if x in SAFE), None):
        raise EnvironmentFault(f"{path}: {taken}: is an engine of this package; take another name")
    return {name: _read_table(path, name, table) for name, table in tables.items()}


def _read_table(path: Path, name: str, table: Any) -> Environment:
    """Return the environment that a table describes."""

    def fault(key: str, reason: str) -> EnvironmentFault:
        return EnvironmentFault(f"{path}: {'.'.join(filter(None, (name, key)))}: {reason}")

    if not isinstance(table, dict):
        raise fault("", "must be a table with class and python")
    if not name.replace("_", "").replace("-", "").replace(".", "").isalnum():
        raise fault("", "an engine's name has letters, digits and - _ . alone")
    if unknown := next((key for key in table if key not in KEYS), None):
        raise fault(unknown, f"no such key; there are {', '.join(KEYS)}")
    for key, kind in KEYS.items():
        if key in table and (not isinstance(table[key], kind) or isinstance(table[key], bool)):
            raise fault(key, "must be a number" if key == "memory" else "must be a text")
    class_name = table.get("class", ELSEWHERE.get(name, ""))
    if not is_class(class_name):
        raise fault("class", "must be MODULE:CLASS")
    python = os.path.expanduser(table.get("python", ""))
    if not os.path.isabs(python) or "\0" in python:
        raise fault("python", "must be the absolute path of an interpreter")
    memory = float(table.get("memory", 0.0))
    if memory and not LEAST <= memory <= MOST:
        raise fault("memory", f"must be {LEAST:g} to {MOST:g} GiB, not {memory:g}")
    return Environment(name, class_name, python, int(memory * 2**30))
