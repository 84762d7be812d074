"""All engines by name: the suite's formulations, adapters to foreign libraries, plug-ins, and engines of other environments.

The module of an adapter is imported when the engine is first used. Libraries that cannot be installed with those of other engines
run in Python environments of their own, which need Python >= 3.11 and numpy >= 2, but not this package. Engines that `gauss-bench
engines install` has installed are found by the folders of their environments. The user's file of engines lists further engines, one
table for each:

    [heun]
    class = "my_engine:Heun"                     # MODULE:CLASS of the adapter; engines of ELSEWHERE do not need it
    python = "/home/me/heun/bin/python"          # the interpreter of the environment; installed engines do not need it
    memory = 8                                   # [GiB] limit of a process, if the usual limit is too low

The file is `gauss-bench/engines.toml` in the user's folder of settings, or the file that GAUSS_BENCH_ENGINES names.
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
DERIVED = {  # further equations of this suite, compiled; like libraries, they can model only some linkages
    "minimal": "gauss_bench.engines.minimal.adapter:Minimal",
}
RIVALS = {  # only for searches and for users who name them: suites leave out engines that need a C compiler or model few linkages
    "by_hand": "gauss_bench.engines.by_hand.adapter:ByHand",
    "pinocchio_casadi": "gauss_bench.engines.pinocchio.symbolic:PinocchioCasadi",
}
ELSEWHERE = {  # adapters of this package whose library needs an environment of its own; listed only if it is installed
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
SAFE = (*OWN, *COMPILED, *DERIVED, *FOREIGN, *RIVALS)  # the import of these adapters imports no foreign library
AUTHORED = (*OWN, *COMPILED, *DERIVED, "by_hand")  # written by the suite's authors: a comparison with others must say so

EXTRAS = {  # library -> the extra of this package that installs it
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

MADE = "made-by-gauss-bench"  # file in every folder that `installation` makes
FILE = "GAUSS_BENCH_ENGINES"  # environment variable with the path of the file of engines
LARGEST = 1 << 16  # [bytes] largest file of engines that is read
KEYS: dict[str, type | tuple[type, ...]] = {"class": str, "python": str, "memory": (int, float)}
LEAST, MOST = 0.5, 1024.0  # [GiB] allowed values of `memory`


class UnknownEngine(BadInput, KeyError):
    """No engine has the given name; the message lists the names of all engines."""


class EnvironmentFault(BadInput, ValueError):
    """The file of engines has a fault; the message names file, table and key."""


@dataclass(frozen=True)
class Environment:
    """A Python environment in which one engine runs.

    Attributes:
        engine: name of the engine.
        class_name: MODULE:CLASS of the engine's adapter.
        python: path of the environment's Python interpreter.
        memory: limit [bytes] of the memory of a process; 0 stands for the usual limit.
    """

    engine: str
    class_name: str
    python: str
    memory: int = 0


def is_class(name: str) -> bool:
    """Tell whether a name has the form MODULE:CLASS, by which a user names an adapter that is not registered."""
    module, _, class_name = name.partition(":")
    return class_name.isidentifier() and all(x.isidentifier() for x in module.split("."))


def names() -> list[str]:
    """List the names of all engines except RIVALS: this package's, then plug-ins, then those in environments of their own."""
    others = [*(point.name for point in _plug_ins()), *read_environments()]
    return [*OWN, *COMPILED, *DERIVED, *FOREIGN, *dict.fromkeys(others)]


def all_names() -> list[str]:
    """List the engines of `names`, and then those of RIVALS."""
    return [*names(), *RIVALS]


def environment_of(name: str) -> Environment | None:
    """Return the environment of the engine called `name`; None if the engine runs in the Python environment of this process."""
    return None if name in SAFE or is_class(name) else read_environments().get(name)


def get(name: str) -> Engine:
    """Return a new `Engine`, given its name or the MODULE:CLASS of its adapter.

    Raises:
        UnknownEngine: no engine has that name.
        ImportError: the adapter cannot be imported; the library is not needed before the adapter builds a model.
    """
    if name in (*OWN, *COMPILED):
        return resolve_name(OWN_CLASS if name in OWN else COMPILED_CLASS)(name)  # type: ignore[no-any-return]
    environment = environment_of(name)  # only a process of this environment can import its class
    class_name = environment.class_name if environment else {**DERIVED, **FOREIGN, **RIVALS}.get(name)
    if class_name or is_class(name):
        return resolve_name(class_name or name)()  # type: ignore[no-any-return]
    for point in _plug_ins():
        if point.name == name:
            return point.load()()  # type: ignore[no-any-return]
    raise unknown(name)


def unknown(name: str) -> UnknownEngine:
    """Return the error for a name that no engine has."""
    if name in ELSEWHERE:
        return UnknownEngine(f"the engine {name} is not installed; `gauss-bench engines install {name}` installs it")
    return UnknownEngine(f"unknown engine {name!r}; there are {', '.join(all_names())}")


def _plug_ins() -> Iterable[Any]:
    """Return the entry points of all installed packages that contribute engines; each has a name and loads an adapter's class."""
    from importlib.metadata import entry_points  # imported late: the import takes time, and most processes do not need it

    return entry_points(group="gauss_bench.engines")


class MissingExtra(BadInput, ImportError):
    """A library that an engine or a subcommand needs is not installed; the message names this package's extra that installs it."""


def not_installed(error: ImportError) -> str:
    """Return a sentence that names the missing module and, if an extra of this package has it, the command that installs it."""
    if isinstance(error, MissingExtra):
        return str(error)
    library = (error.name or "").partition(".")[0]
    command = f"; pip install 'gauss-bench[{EXTRAS[library]}]'" if library in EXTRAS else ""
    return f"not installed: {error}{command}"


def require(library: str) -> None:
    """Raise MissingExtra if an optional library, one of the keys of EXTRAS, is not installed."""
    if find_spec(library) is None:
        raise MissingExtra(not_installed(ImportError(f"no package {library}", name=library)), name=library)


def file_of_engines() -> Path:
    """Return the path of the user's file of engines; the file need not exist."""
    if path := os.environ.get(FILE):
        return Path(path)
    return _user_folder("XDG_CONFIG_HOME", ".config") / "engines.toml"


def home() -> Path:
    """Return the folder of all environments that `gauss-bench engines install` makes; it need not exist."""
    return _user_folder("XDG_DATA_HOME", ".local/share") / "engines"


def _user_folder(variable: str, default: str) -> Path:
    """Return this package's folder in the folder that an environment variable of the XDG specification names.

    If the variable holds no absolute path, the folder `default` of the user's home is taken instead.
    """
    chosen = os.environ.get(variable, "")
    return (Path(chosen) if os.path.isabs(chosen) else Path.home() / default) / "gauss-bench"


def interpreter_in(folder: Path) -> Path:
    """Return the path of the Python interpreter of an environment, given the environment's folder."""
    return folder / "bin" / "python"


def is_ours(folder: Path) -> bool:
    """Tell whether gauss-bench made a folder, which it may then replace or remove; a link to such a folder does not count."""
    return not folder.is_symlink() and (folder / MADE).is_file()


def read_environments() -> dict[str, Environment]:
    """Return name of an engine -> environment: first the engines of the user's file, then the other installed engines.

    Raises:
        EnvironmentFault: the file has a fault.
        OSError: the file cannot be read.
    """
    path = file_of_engines()
    try:
        tables = parse_toml(read_bytes(path, LARGEST).decode())
    except FileNotFoundError:
        tables = {}
    except ValueError as error:
        raise EnvironmentFault(f"{path}: {error}") from error
    if taken := [name for name in tables if name in SAFE]:
        raise EnvironmentFault(f"{path}: {taken[0]}: is an engine of this package; take another name")
    tables |= {name: {} for name in ELSEWHERE if name not in tables and is_ours(home() / name)}
    environments = {name: _read_table(path, name, table) for name, table in tables.items()}
    return {name: x for name, x in environments.items() if not _is_removed(x)}


def _is_removed(environment: Environment) -> bool:
    """Tell whether a table of the user's file names an environment of gauss-bench whose folder is missing."""
    folder = home() / environment.engine
    return environment.engine in ELSEWHERE and environment.python == str(interpreter_in(folder)) and not folder.exists()


def _read_table(path: Path, name: str, table: Any) -> Environment:
    """Return the environment that the table `name` of the file at `path` describes; an EnvironmentFault if it has a fault."""

    def check(condition: bool, place: str, fault: str) -> None:
        if not condition:
            raise EnvironmentFault(f"{path}: {place}: {fault}")

    check(isinstance(table, dict), name, "must be a table with class and python")
    is_name = name.replace("_", "").replace("-", "").replace(".", "").isalnum()
    check(is_name, name, "an engine's name has letters, digits and - _ . alone")
    for key, value in table.items():
        check(key in KEYS, f"{name}.{key}", f"no such key; there are {', '.join(KEYS)}")
        has_type = isinstance(value, KEYS[key]) and not isinstance(value, bool)  # Python's bool is an int
        check(has_type, f"{name}.{key}", "must be a number" if key == "memory" else "must be a text")
    class_name = table.get("class", ELSEWHERE.get(name, ""))
    check(is_class(class_name), f"{name}.class", "must be MODULE:CLASS")
    installed = str(interpreter_in(home() / name)) if name in ELSEWHERE else ""  # default of `python`
    python = os.path.expanduser(table.get("python", installed))
    check(os.path.isabs(python) and "\0" not in python, f"{name}.python", "must be the absolute path of an interpreter")
    memory = float(table.get("memory", 0.0))
    in_range = memory == 0.0 or LEAST <= memory <= MOST
    check(in_range, f"{name}.memory", f"must be {LEAST:g} to {MOST:g} GiB, not {memory:g}")
    return Environment(name, class_name, python, int(memory * 2**30))
