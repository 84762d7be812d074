"""What users and plug-ins name: exports, arguments, verbs, flags, JSON keys, columns, and keys of files, stored once.

    python -m tests.kept.interface     stores them: only where something was added, in a commit of its own

More may come; nothing may go or change its meaning without a release in which the old name works and warns.
"""

import argparse
import inspect
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gauss_bench
from gauss_bench import cli, tables
from gauss_bench.api.options import parser
from gauss_bench.engines.base import Choice, Engine, Model
from gauss_bench.linkage import schema as linkage_schema
from gauss_bench.suites import schema as suite_schema
from tests.conftest import DATA

STORED = DATA / "kept_interface.json"
NAMES = {  # what adapters outside this package have imported so far
    "gauss_bench.engines.mujoco.forces": ["OnJoints", "Steady", "slide_coordinate", "turning"],
    "gauss_bench.engines.shared": [
        "beyond_a_tree",
        "closing_pins",
        "driven_coordinates",
        "finite",
        "finite_acceleration",
        "joint_tree",
        "jointed",
        "require_agreement",
        "size",
        "spatial",
        "tree_states",
        "unsteady",
        "with_accelerations",
    ],
    "gauss_bench.engines.variants": ["read_variants"],
    "gauss_bench.integrate.fixed_step": ["STEPS", "held_back", "stretches"],
    "gauss_bench.mechanism.coordinates": ["position"],
    "gauss_bench.mechanism.evaluate": ["Evaluator"],
    "gauss_bench.mechanism.forces": ["AppliedForces"],
    "gauss_bench.mechanism.model": ["GROUND", "Along", "Angle", "Distance", "LengthDriver", "PointForce", "loads"],
    "gauss_bench.trajectory": ["RunFailure", "Status", "Trajectory"],
}
QUICK: dict[str, list[str]] = {  # a call of each verb whose keys are looked at; OUT is a new folder
    "list": ["list"],
    "show": ["show", "four_bar"],
    "simulate": ["simulate", "four_bar", "--at", "0,0.01"],
    "simulate a driven linkage": ["simulate", "four_bar", "--scenario", "driven", "--at", "0,0.01"],
    "simulate what is not ok": ["simulate", "four_bar", "--scenario", "conservative", "--step", "0.1"],
    "kinematics": ["kinematics", "four_bar", "--intervals", "4"],
    "export": ["export", "four_bar", "--engine", "c", "--out", "OUT/four_bar.c"],
    "import": [
        "import",
        str(DATA / "four_bar.urdf"),
        "--close",
        "coupler.coupler_end=rocker.rocker_end",
        "--out",
        "OUT/four_bar.toml",
    ],
    "selftest": ["selftest", "--only", "metrics"],
}
SLOW: dict[str, list[str]] = {
    "doctor": ["doctor"],
    "conformance": ["conformance", "lagrange"],
    "diagnose": ["diagnose", "four_bar", "--engine", "lagrange", "--until", "0.1"],
    "recommend": ["recommend", "four_bar", "--position", "1e-3", "--until", "0.1", "--engine", "gauss,lagrange"],
    "sweep": [
        "sweep",
        "four_bar",
        "--vary",
        "links.crank.kg_per_m=1:2:2",
        "--engine",
        "gauss",
        "--until",
        "0.1",
        "--out",
        "OUT/sweep",
    ],
    "certify": ["certify", str(DATA / "double_pendulum.toml"), "--until", "0.1"],
    "verify": ["verify", "CERTIFICATE"],
    "atlas": ["atlas", "--engine", "gauss", "--axis", "step"],
    "run": ["run", "four_bar", "--engine", "gauss", "--steps", "1e-2", "--until", "0.1", "--no-costs", "--out", "OUT/run"],
}


def exports() -> dict[str, list[str]]:
    """Return the public names of the package; those of functions and classes with their arguments."""
    return {name: _arguments(getattr(gauss_bench, name)) for name in gauss_bench.__all__}


def interfaces() -> dict[str, list[str]]:
    """Return what an engine's adapter offers and is given, with the arguments of its methods."""
    found = {}
    for kind in (Choice, Engine, Model):
        for name in {*kind.__annotations__, *(x for x in vars(kind) if not x.startswith("_"))}:
            member = inspect.getattr_static(kind, name, None)
            found[f"{kind.__name__}.{name}"] = _arguments(member) if inspect.isfunction(member) else []
    return found


def _arguments(item: object) -> list[str]:
    try:
        return [x for x in inspect.signature(item).parameters if x != "self"] if callable(item) else []
    except ValueError:
        return []


def verbs() -> dict[str, dict[str, list[str]]]:
    """Return the arguments of each verb: their spellings, or the name of one without, and the choices of each."""
    top = parser({name: lambda options: 0 for name in cli.ACTIONS})
    (choices,) = [x.choices for x in top._actions if isinstance(x, argparse._SubParsersAction)]
    return {
        verb: {
            x: [str(c) for c in action.choices or ()] for action in options._actions for x in action.option_strings or [action.dest]
        }
        for verb, options in choices.items()
    }


def columns() -> dict[str, list[str]]:
    """Return the columns of each table."""
    return {name: list(table.names) for name, table in tables.TABLES.items()}


def file_keys() -> dict[str, list[str]]:
    """Return the places of keys in linkage files and suites; a name that the user chooses is a star."""
    kinds = {"linkage": linkage_schema.LinkageTable, "suite": suite_schema.Suite}
    return {name: sorted(set(_places(x := kind.model_json_schema(), x.get("$defs", {})))) for name, kind in kinds.items()}


def _places(schema: Mapping[str, Any], named: Mapping[str, Any], place: str = "") -> Iterator[str]:
    """Yield the place of every key that a JSON schema allows."""
    for part in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())):
        yield from _places(part, named, place)
    if "$ref" in schema:
        yield from _places(named[schema["$ref"].rpartition("/")[2]], named, place)
    for key, part in schema.get("properties", {}).items():
        yield f"{place}/{key}"
        yield from _places(part, named, f"{place}/{key}")
    for part in (schema.get("items"), schema.get("additionalProperties"), *schema.get("patternProperties", {}).values()):
        if isinstance(part, dict):
            yield from _places(part, named, f"{place}/*")


def json_keys(arguments: list[str], folder: Path) -> list[str]:
    """Return the paths of keys in what a verb prints with --json; items of a list are one."""
    certificate = str(Path(__file__).parents[2] / "mechanisms" / "certificates" / "four_bar.conservative.npz")
    given = [x.replace("OUT", str(folder)).replace("CERTIFICATE", certificate) for x in arguments]
    printed = io.StringIO()
    with redirect_stdout(printed):
        cli.main([*given, "--json"])
    return sorted(set(paths_of(json.loads(printed.getvalue()))))


def paths_of(item: Any, place: str = "") -> Iterator[str]:
    """Yield the path of every key of nested dictionaries and lists."""
    if isinstance(item, dict):
        for key, x in item.items():
            yield f"{place}/{key}"
            yield from paths_of(x, f"{place}/{key}")
    elif isinstance(item, list):
        for x in item:
            yield from paths_of(x, f"{place}/*")


def store() -> None:
    """Write everything."""
    with TemporaryDirectory() as folder:
        keys = {name: json_keys(call, Path(folder)) for name, call in (QUICK | SLOW).items()}
    found: Mapping[str, Any] = {
        "exports": exports(),
        "interfaces": interfaces(),
        "verbs": verbs(),
        "columns": columns(),
        "files": file_keys(),
        "json": keys,
    }
    STORED.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    store()
