"""Load a linkage: read its file, apply a scenario, and return the assembled mechanism; a `LinkageError` lists all faults."""

import copy
import hashlib
import json
import re
import tomllib
from collections.abc import Callable, Collection
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import assemble, close_joints, joint_constraints
from gauss_bench.linkage.errors import AssemblyError, BuildError, Fault, LinkageError
from gauss_bench.linkage.limits import limit_faults
from gauss_bench.linkage.references import items, reference_faults, table
from gauss_bench.linkage.schema import check_grammar
from gauss_bench.linkage.sketch import sketch
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.trajectory import in_a_sentence
from gauss_bench.untrusted import TooDeep, parse_toml, read_bytes

Place = Callable[[Mechanism, dict[str, Any]], Mechanism]  # fills in q0, v0 of an unassembled mechanism from its document

MAX_BYTES = 1_048_576  # 700 times the file of the four-bar; nobody writes a larger file by hand
CACHED = 64  # largest number of mechanisms in the cache
FIXED = ("format", "name", "crank", "expect", "scenarios")  # keys that a scenario may not override
BUILT_IN = (Path(__file__).parents[1] / "_mechanisms", Path(__file__).parents[2] / "mechanisms")  # installed, in the repository
SINGLE = ("pendulum", "projectile")  # linkages in `written/`, whose motion is known in closed form
FAMILY_MEMBER = re.compile(r"(n_four_bar|pendulums)_([1-9][0-9]{0,2})")  # name of a function of generate.py, and its argument
LARGEST = 400  # windows or bars of a generated linkage

_cache: dict[tuple[str, str, str | None], Mechanism] = {}  # key: path, digest of the content, scenario; most recently used last


def built_in_folder() -> Path | None:
    """Return the folder of the built-in linkages, in the installed package or in the repository; None if there is none."""
    return next((x for x in BUILT_IN if x.is_dir()), None)


def built_in() -> dict[str, Path]:
    """Return name -> path of the file, for all built-in linkages; empty if their folder is missing."""
    folder = built_in_folder()
    return {path.stem: path for path in sorted(folder.glob("*.toml"))} if folder else {}


def find(name_or_path: str | Path) -> Path:
    """Return the file of the built-in linkage of this name, else the path as given."""
    return built_in().get(str(name_or_path), Path(name_or_path))


def load(name_or_path: str | Path, scenario: str | None = None) -> Mechanism:
    """Load a linkage and assemble it in one scenario, by default the first scenario with a table `start`.

    While a file is unchanged, the same object is returned, so that results can be cached for it.

    Raises:
        LinkageError: the linkage has faults; the message names file, table and field of each.
    """
    document, digest, path = document_of(name_or_path)
    key = str(path), digest, scenario
    # the cache drops the linkage that was not used for the longest time: pop and insert move the present one to the end
    mechanism = _cache.pop(key, None) or load_document(document, scenario, str(path), digest, path.stem)
    if len(_cache) >= CACHED:
        del _cache[next(iter(_cache))]
    _cache[key] = mechanism
    return mechanism


def document_of(name_or_path: str | Path) -> tuple[dict[str, Any], str, Path]:
    """Return the document (the parsed TOML), its SHA-256 and its path; a linkage without a file is generated from its name.

    Raises:
        LinkageError: the file cannot be read.
    """
    path = find(name_or_path)
    document = None if path.exists() else generate(str(name_or_path))
    if document is None:
        return *read(path), path
    return document, hashlib.sha256(json.dumps(document).encode()).hexdigest(), path


def generate(name: str) -> dict[str, Any] | None:
    """Return the document of a member of a family, such as `n_four_bar_8`, or of a linkage in `written/`; None for other names."""
    if name in SINGLE:
        return parse_toml((Path(__file__).parent / "written" / f"{name}.toml").read_text(encoding="utf-8"))
    member = FAMILY_MEMBER.fullmatch(name)
    if member is None or int(member[2]) > LARGEST:
        return None
    make_document = resolve_name(f"gauss_bench.linkage.generate:{member[1]}")  # imported only here: few runs need it
    document: dict[str, Any] = make_document(int(member[2]))
    return document


def decimal_document(name_or_path: str | Path) -> dict[str, Any]:
    """Return the document with every fractional number of a file as its exact Decimal, not the nearest double.

    A linkage without a file keeps the doubles with which it is generated.

    Raises:
        LinkageError: the file cannot be read.
    """
    path = find(name_or_path)
    document, _, _ = document_of(name_or_path)  # also checks a file, which raises LinkageError
    return parse_toml(path.read_text(encoding="utf-8"), Decimal) if path.exists() else document


def place_by_sketch(mechanism: Mechanism, document: dict[str, Any]) -> Mechanism:
    """Return the mechanism at rest with its joints closed near the sketch; the scenario's start is ignored."""
    q = close_joints(mechanism, joint_constraints(mechanism), sketch(mechanism, document))
    return replace(mechanism, q0=q, v0=0.0 * q)


def load_document(
    document: dict[str, Any],
    scenario: str | None = None,
    source: str = "<document>",
    sha256: str = "",
    stem: str | None = None,
    place: Place = assemble,
) -> Mechanism:
    """Return the mechanism of a document in one scenario, by default the first with a start.

    Args:
        source, sha256: name of the file for messages, and digest of its bytes.
        stem: name of the file without its suffix, which must be the name of the linkage; None if there is no file.
        place: function that finds the positions and velocities at the start of the mechanism.

    Raises:
        LinkageError: the document has faults, among them numbers that overflow or lead to a singular matrix.
    """
    scenario = choose_scenario(document, scenario, source, stem)
    merged = merge(document, document["scenarios"][scenario].get("override", {}))
    try:
        with np.errstate(all="ignore"):
            mechanism = place(build_mechanism(merged, scenario, source, sha256), merged)
    except (BuildError, AssemblyError) as error:
        raise LinkageError(source, [error.fault]) from error
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise LinkageError(source, [Fault("", f"calculating with its numbers fails ({in_a_sentence(error)})")]) from error
    if not all(np.isfinite(x).all() for x in (mechanism.q0, mechanism.v0, mechanism.mass)):
        raise LinkageError(source, [Fault("", "its numbers lead to a start that is not finite")])
    return mechanism


def choose_scenario(document: dict[str, Any], scenario: str | None, source: str, stem: str | None = None) -> str:
    """Check a document and return the name of its scenario: the given one, else the first with a start, else the first.

    Raises:
        LinkageError: the document has faults, or has no scenario of the given name.
    """
    faults = limit_faults(document) or document_faults(document, stem)
    if faults:
        raise LinkageError(source, faults)
    scenarios = document["scenarios"]
    if scenario is None:
        with_start = [name for name, entry in scenarios.items() if "start" in entry]
        scenario = [*with_start, *scenarios][0]
    if scenario not in scenarios:
        raise LinkageError(source, [Fault(f"scenarios.{scenario}", f"unknown scenario; the file has {', '.join(scenarios)}")])
    return scenario


def reduce_to_scenario(document: dict[str, Any], scenario: str) -> dict[str, Any]:
    """Return the document with one scenario's override applied and all other scenarios removed."""
    reduced = dict(document["scenarios"][scenario])
    merged = merge(document, reduced.pop("override", {}))
    return merged | {"scenarios": {scenario: reduced}}


def read(path: Path) -> tuple[dict[str, Any], str]:
    """Return the document of a file, and the SHA-256 of its bytes.

    Raises:
        LinkageError: the file is missing, empty, too large, not text or not TOML.
    """

    def refuse(text: str, where: str = "") -> LinkageError:
        """Return the exception with one fault, at the path `where` of keys."""
        return LinkageError(str(path), [Fault(where, text)])

    try:
        content = read_bytes(path, MAX_BYTES)
    except FileNotFoundError as error:
        names = ", ".join(built_in())
        raise refuse(f"no such file, and no built-in linkage of that name (there are {names})") from error
    except OSError as error:
        raise refuse(f"cannot be read: {error.strerror}") from error
    if content.lstrip().startswith((b"<", b"\xef\xbb\xbf<")):
        raise refuse("is XML, not a linkage file; `gauss-bench import FILE --out NAME.toml` makes one of planar MJCF and URDF")
    try:
        document = parse_toml(content.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise refuse(f"not UTF-8 text (byte {error.start})") from error
    except TooDeep as error:
        raise refuse(f"TOML: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise refuse(*_toml_fault(str(error))) from error
    except ValueError as error:  # Python limits the digits of whole numbers
        raise refuse(f"TOML: a number cannot be read ({error})") from error
    if not document:
        raise refuse("the file is empty")
    return document, hashlib.sha256(content).hexdigest()


def _toml_fault(message: str) -> tuple[str, str]:
    """Return the text of the fault for a message of the TOML parser, and the path of keys that the message names, or ""."""
    # such as "Cannot declare ('links', 'rod') twice (at line 3, column 9)"
    duplicate = re.match(r"Cannot (?:declare|mutate immutable namespace|overwrite) \((.*?),?\) ?.*(\(at .*\))", message)
    if duplicate:
        return f"duplicate name: declared twice {duplicate[2]}", ".".join(re.findall(r"['\"](.*?)['\"]", duplicate[1]))
    if message.startswith("Cannot overwrite a value"):
        return f"duplicate name: a key is given twice {message.removeprefix('Cannot overwrite a value ')}", ""
    return f"TOML syntax: {message}", ""


def document_faults(document: dict[str, Any], stem: str | None = None) -> list[Fault]:
    """Return every fault of a document, including those that the override of a scenario causes."""
    faults = _faults_without_overrides(document, stem)
    if any(f.path == "format" for f in faults):  # another format may have other keys: no other fault is certain
        return [f for f in faults if f.path == "format"]
    reported = set(faults)
    for name, scenario in items(document, "scenarios"):
        path, override = f"scenarios.{name}.override", table(scenario, "override")
        wrong_paths = override_faults(document, override, path)
        faults += wrong_paths
        if override and not wrong_paths:
            overridden = _faults_without_overrides(merge(document, override), stem)
            faults += [Fault(f"{path}.{f.path}", f.text) for f in overridden if f not in reported]
    return sorted(set(faults))


def _faults_without_overrides(document: dict[str, Any], stem: str | None) -> list[Fault]:
    """Return the faults of the keys, values and names of a document; overrides of scenarios are not applied."""
    faults, accepted = check_grammar(document)
    if any(f.path.startswith("cylinders") for f in faults):
        return faults  # a faulty cylinder is not expanded into links, so that references to its links would be reported wrongly
    return [*faults, *reference_faults(accepted, stem)]


def override_faults(document: dict[str, Any], override: dict[str, Any], path: str, fixed: Collection[str] = FIXED) -> list[Fault]:
    """Return the faults of the paths in an override at `path`: tables that do not exist, and keys in `fixed`."""
    faults = []
    for key, value in override.items():
        inner = f"{path}.{key}"
        if key in fixed:
            faults.append(Fault(inner, "cannot be overridden"))
        elif isinstance(value, dict) and key not in document:
            faults.append(Fault(inner, "no such table"))
        elif isinstance(value, dict) and isinstance(document[key], dict):
            faults += override_faults(document[key], value, inner, fixed=())
    return faults


def merge(document: dict[str, Any], override: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of the document in which the values of `override` replace those at the same paths of keys."""
    merged = copy.deepcopy(document)
    for key, value in override.items():
        inner = merged.get(key)
        merged[key] = merge(inner, value) if isinstance(value, dict) and isinstance(inner, dict) else copy.deepcopy(value)
    return merged
