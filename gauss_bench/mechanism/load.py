"""Reads a linkage file, applies a scenario and returns the assembled mechanism, or every fault at once."""

import copy
import hashlib
import re
import tomllib
from pathlib import Path
from typing import Any

from gauss_bench.mechanism.build import BuildError, build_mechanism
from gauss_bench.mechanism.closure import AssemblyError, assemble
from gauss_bench.mechanism.errors import Fault, LinkageError
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.references import items, reference_faults, table
from gauss_bench.mechanism.schema import schema_faults

MAX_BYTES = 1_048_576  # 3,000 times a four-bar; anything larger is not a hand-written linkage
FIXED = ("format", "name", "crank", "expect", "scenarios")
BUILT_IN = (Path(__file__).parents[1] / "_mechanisms", Path(__file__).parents[2] / "mechanisms")


def built_in() -> dict[str, Path]:
    """Name -> file of the linkages that come with the suite: in the installed package, or in the repository."""
    folder = next((x for x in BUILT_IN if x.is_dir()), None)
    return {path.stem: path for path in sorted(folder.glob("*.toml"))} if folder else {}


def find(name_or_path: str | Path) -> Path:
    """The file of a built-in linkage, or the path as given."""
    return built_in().get(str(name_or_path), Path(name_or_path))


def load(name_or_path: str | Path, scenario: str | None = None) -> Mechanism:
    """A linkage, assembled in one scenario; without a name, the first scenario that has a start.

    Raises:
        LinkageError: naming file, table and field of every independent fault.
    """
    path = find(name_or_path)
    document, digest = read(path)
    return load_document(document, scenario, str(path), digest, path.stem)


def load_document(
    document: dict[str, Any], scenario: str | None = None, source: str = "<document>", sha256: str = "", stem: str | None = None
) -> Mechanism:
    """As `load`, for a document that is already parsed."""
    faults = document_faults(document, stem)
    if faults:
        raise LinkageError(source, faults)
    scenarios = document["scenarios"]
    if scenario is None:
        scenario = next((name for name, x in scenarios.items() if "start" in x), next(iter(scenarios)))
    if scenario not in scenarios:
        raise LinkageError(source, [Fault(f"scenarios.{scenario}", f"unknown scenario; the file has {', '.join(scenarios)}")])
    merged = merge(document, scenarios[scenario].get("override", {}))
    try:
        mechanism = build_mechanism(merged, scenario, source, sha256)
        return assemble(mechanism, merged)
    except (BuildError, AssemblyError) as error:
        raise LinkageError(source, [error.fault]) from error


def read(path: Path) -> tuple[dict[str, Any], str]:
    """The document and the sha256 of the file's bytes.

    Raises:
        LinkageError: the file is missing, empty, too large, not text or not TOML.
    """
    source = str(path)

    def refuse(text: str, where: str = "") -> LinkageError:
        return LinkageError(source, [Fault(where, text)])

    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except FileNotFoundError as error:
        names = ", ".join(built_in())
        raise refuse(f"no such file, and no built-in linkage of that name (there are {names})") from error
    except OSError as error:
        raise refuse(f"cannot be read: {error.strerror}") from error
    if len(content) > MAX_BYTES:
        raise refuse(f"larger than {MAX_BYTES} bytes; not a linkage file")
    try:
        document = tomllib.loads(content.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise refuse(f"not UTF-8 text (byte {error.start})") from error
    except tomllib.TOMLDecodeError as error:
        raise refuse(*_toml_fault(str(error))) from error
    except RecursionError as error:
        raise refuse("TOML: nested too deeply") from error
    except ValueError as error:  # Python refuses to read whole numbers of thousands of digits
        raise refuse(f"TOML: a number cannot be read ({error})") from error
    if not document:
        raise refuse("the file is empty")
    return document, hashlib.sha256(content).hexdigest()


def _toml_fault(message: str) -> tuple[str, str]:
    """Text and path of a TOML error; a table declared twice is a duplicate name."""
    twice = re.match(r"Cannot (?:declare|mutate immutable namespace|overwrite) \((.*?),?\) ?.*(\(at .*\))", message)
    if twice:
        return f"duplicate name: declared twice {twice[2]}", ".".join(re.findall(r"['\"](.*?)['\"]", twice[1]))
    if message.startswith("Cannot overwrite a value"):
        return f"duplicate name: a key is given twice {message.removeprefix('Cannot overwrite a value ')}", ""
    return f"TOML syntax: {message}", ""


def document_faults(document: dict[str, Any], stem: str | None = None) -> list[Fault]:
    """Every fault of a document: keys, values, names, and those of each scenario's override."""
    faults = schema_faults(document)
    if any(f.path == "format" for f in faults):
        return [f for f in faults if f.path == "format"]
    faults += reference_faults(document, stem)
    known = {(f.path, f.text) for f in faults}
    for name, scenario in items(document, "scenarios"):
        path, override = f"scenarios.{name}.override", table(scenario, "override")
        own = override_faults(document, override, path)
        faults += own
        if override and not own:
            merged = merge(document, override)
            later = [*schema_faults(merged), *reference_faults(merged, stem)]
            faults += [Fault(f"{path}.{f.path}", f.text) for f in later if (f.path, f.text) not in known]
    return sorted(set(faults))


def override_faults(document: dict[str, Any], override: dict[str, Any], path: str) -> list[Fault]:
    """Faults of an override's own paths: tables that do not exist, and keys that may not change."""
    faults = [Fault(f"{path}.{key}", "cannot be overridden") for key in override if key in FIXED]

    def walk(existing: Any, change: dict[str, Any], where: str) -> None:
        for key, value in change.items():
            if isinstance(value, dict) and key not in existing:
                faults.append(Fault(f"{where}.{key}", "no such table"))
            elif isinstance(value, dict) and isinstance(existing[key], dict):
                walk(existing[key], value, f"{where}.{key}")

    walk(document, {k: v for k, v in override.items() if k not in FIXED}, path)
    return faults


def merge(document: dict[str, Any], override: dict[str, Any]) -> dict[str, Any]:
    """A copy of the document with an override's leaves put in their places."""
    merged = copy.deepcopy(document)

    def put(existing: dict[str, Any], change: dict[str, Any]) -> None:
        for key, value in change.items():
            if isinstance(value, dict) and isinstance(existing.get(key), dict):
                put(existing[key], value)
            else:
                existing[key] = copy.deepcopy(value)

    put(merged, override)
    return merged
