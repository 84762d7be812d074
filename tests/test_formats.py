"""Test that files and outputs fit their published schemas, and that a schema allows no other keys."""

import io
import json
import tomllib
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from gauss_bench.cli import main
from gauss_bench.linkage.load import built_in
from gauss_bench.suites.read import FOLDER as SUITES
from gauss_bench.suites.read import SECTIONS
from gauss_bench.verbs import formats
from tests.conftest import DATA, needs
from tests.fake_releases import use_fake_releases
from tests.kept.interface import QUICK, SLOW
from tests.test_suites import FAULTY

ROOT = Path(__file__).parents[1]
CHECK = ["check", "crank_slider", "--engine", "schur", "--baseline", "OUT/baseline.csv"]
CALLS = QUICK | {
    "engines": ["engines"],
    "releases": ["releases", "mujoco", "--only", "3.6.0,3.7.0", "--no-costs", "--out", "OUT"],
    "check-settings": ["check-settings", "ROOT/tests/data/settings/minimal.toml"],
    "simulate what an engine cannot model": ["simulate", "ROOT/tests/data/friction.toml", "--engine", "gauss-native"],
    "show welds": ["show", "ROOT/tests/data/everything.toml"],
    "kinematics of two drivers": ["kinematics", "excavator", "--intervals", "4"],
    "export": ["export", "four_bar", "--engine", "mujoco", "--out", "OUT/four_bar.xml"],
}
LONGER = SLOW | {
    "export a program": QUICK["export"],
    "export a step that is sought": ["export", "four_bar", "--engine", "exudyn", "--tuned", "--out", "OUT/four_bar.py"],
    "tune": ["tune", "ROOT/tests/data/four_bar_default.xml", "--position", "1e-4", "--until", "0.1", "--out", "OUT/tuned.xml"],
    "check a new baseline": [*CHECK, "--accept", "first"],
    "check": CHECK,
    "report of two runs": ["report", "--out", "ROOT/reports", "--against", "ROOT/reports"],
    "report": ["report", "--out", "OUT/run"],
}
BEFORE = {"check": [*CHECK, "--accept", "first"], "report": SLOW["run"]}  # what must have been done in the same folder
NEEDED = {"export": "mujoco", "export a step that is sought": "exudyn", "tune": "mujoco"}
SOMETIMES = {
    "show": set(),
    "simulate": {"drivers", "welds", "warnings", "loads"},
    "kinematics": {"loads"},
}  # keys left out if empty
OPEN = {"options", "where"}  # keys of an engine's own choice, and of a stored file


def print_json(call, folder):
    """Return what a verb prints with --json."""
    certificate = ROOT / "mechanisms" / "certificates" / "four_bar.conservative.npz"
    for name, place in {"OUT": folder, "ROOT": ROOT, "CERTIFICATE": certificate}.items():
        call = [x.replace(name, str(place)) for x in call]
    output = io.StringIO()
    with redirect_stdout(output):
        main([*call, "--json"])
    return json.loads(output.getvalue())


def faults(schema, data):
    """Return the place and message of everything in the data that does not fit the schema."""
    return [f"{'.'.join(map(str, x.absolute_path))}: {x.message}" for x in Draft202012Validator(schema).iter_errors(data)]


def parts_of(schema, name=""):
    """Yield every schema inside a schema, with the key that it describes."""
    yield name, schema
    for group in ("properties", "$defs", "patternProperties"):
        for key, part in schema.get(group, {}).items():
            yield from parts_of(part, key)
    for group in ("items", "additionalProperties", "propertyNames"):
        if isinstance(schema.get(group), dict):
            yield from parts_of(schema[group], name)
    for part in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("prefixItems", ())):
        yield from parts_of(part, name)


def test_every_verb_with_json_is_called_here():
    assert {call[0] for call in (CALLS | LONGER).values()} == set(formats.PRINTED)


@pytest.mark.slow("export", "import")
@pytest.mark.long(
    *("conformance", "doctor", "atlas", "run", "recommend", "check", "report", "tune"),
    *("export a program", "export a step that is sought"),
)
@pytest.mark.parametrize("name", [*CALLS, *(pytest.param(x, marks=pytest.mark.slow) for x in LONGER)])
def test_a_verb_prints_what_its_schema_names_and_nothing_else(name, tmp_path, monkeypatch):
    if name in NEEDED:
        needs(NEEDED[name])
    use_fake_releases(monkeypatch)
    call = (CALLS | LONGER)[name]
    if name in BEFORE:
        print_json(BEFORE[name], tmp_path)
    printed, schema = print_json(call, tmp_path), formats.find_schema(call[0])
    assert faults(schema, printed) == []
    row, whole = (printed[0], [printed[0]]) if isinstance(printed, list) and printed else (printed, printed)
    if isinstance(row, dict):
        row["invented"] = 1  # a key that the schema lacks is refused, as each key would be that the schema forgot
        assert faults(schema, whole)
        del row["invented"]
    if name in SOMETIMES:
        definition = schema["$defs"][schema["$ref"].rpartition("/")[2]]
        assert set(definition["properties"]) - set(definition["required"]) == SOMETIMES[name]
        for key in printed.keys() - SOMETIMES[name]:
            assert faults(schema, {k: x for k, x in printed.items() if k != key}) == [f": '{key}' is a required property"]


def test_a_schema_is_valid_closed_and_says_what_every_key_means():
    for name in formats.list_formats():
        schema = formats.find_schema(name)
        Draft202012Validator.check_schema(schema)
        assert "$id" not in schema
        for key, part in parts_of(schema):
            if "properties" in part:
                assert part["additionalProperties"] is False, key
                undescribed = {k for k, x in part["properties"].items() if "description" not in x}
                # a section's own schema has its meaning, and the guide has those of linkages
                assert name == "linkage" or undescribed <= {*SECTIONS}, key
            is_open = part.keys() <= {"description"} or part.get("additionalProperties") is True
            assert not is_open or key in OPEN or name == "linkage", key


def test_every_suite_and_linkage_fits_its_schema_and_none_with_an_unknown_key_does():
    for name, paths in {"suite": SUITES.glob("*.toml"), "linkage": [*built_in().values(), *DATA.glob("*.toml")]}.items():
        schema = formats.find_schema(name)
        for path in paths:
            document = tomllib.loads(path.read_text(encoding="utf-8"))
            assert faults(schema, document) == [], path
            assert any("invented" in x for x in faults(schema, document | {"invented": 1})), path


def test_a_faulty_suite_is_refused_by_the_schema_at_the_same_place():
    for content, said in FAULTY:
        if said != "TOML syntax":
            (fault,) = faults(formats.find_schema("suite"), tomllib.loads(content))
            place, _, key = said.rpartition(".")
            assert fault.startswith(f"{said}: ") or (fault.startswith(f"{place}: ") and f"'{key}'" in fault)


def test_a_schema_is_printed_by_name_and_an_unknown_name_is_refused(capsys):
    assert main(["list", "--schema", "simulate"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == formats.find_schema("simulate")
    assert printed["$defs"]["LinkState"]["properties"]["omega"]["description"] == "(k,) angular velocity [rad/s]"
