"""Files and outputs keep to the schemas that are published for them, and a schema allows no key beside those that it names."""

import io
import json
import tomllib
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict

import pytest
from jsonschema import Draft202012Validator

from gauss_bench.api.telling import HIDDEN, Result
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
}
LONGER = SLOW | {
    "export a step that is sought": ["export", "four_bar", "--engine", "exudyn", "--tuned", "--out", "OUT/four_bar.py"],
    "tune": ["tune", "ROOT/tests/data/four_bar_default.xml", "--position", "1e-4", "--until", "0.1", "--out", "OUT/tuned.xml"],
    "check a new baseline": [*CHECK, "--accept", "first"],
    "check": CHECK,
    "report of two runs": ["report", "--out", "ROOT/reports", "--against", "ROOT/reports"],
    "report": ["report", "--out", "OUT/run"],
}
BEFORE = {"check": [*CHECK, "--accept", "first"], "report": SLOW["run"]}  # what must have been done in the same folder
NEEDED = {"export a step that is sought": "exudyn", "tune": "mujoco"}
LINKAGES = [*built_in().values(), *sorted(DATA.glob("*.toml"))]
OPEN = {"options", "where"}  # keys of an engine's own choice, and of a stored file


def print_json(call: list[str], folder: Path) -> Any:
    """Return what a verb prints with --json."""
    certificate = ROOT / "mechanisms" / "certificates" / "four_bar.conservative.npz"
    for name, place in {"OUT": folder, "ROOT": ROOT, "CERTIFICATE": certificate}.items():
        call = [x.replace(name, str(place)) for x in call]
    output = io.StringIO()
    with redirect_stdout(output):
        main([*call, "--json"])
    return json.loads(output.getvalue())


def faults(schema: Any, data: Any) -> list[str]:
    """Return the place and message of everything in the data that does not fit the schema."""
    found = Draft202012Validator(schema).iter_errors(data)
    return [f"{'.'.join(map(str, x.absolute_path))}: {x.message}" for x in found]


def parts_of(schema: Any, name: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
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


def test_every_verb_with_json_is_called_here() -> None:
    assert {call[0] for call in (CALLS | LONGER).values()} == set(formats.PRINTED)


@pytest.mark.slow("export", "import")
@pytest.mark.long("conformance", "doctor", "atlas", "run", "recommend", "check", "report", "export a step that is sought")
@pytest.mark.parametrize("name", [*CALLS, *(pytest.param(x, marks=pytest.mark.slow) for x in LONGER)])
def test_a_verb_prints_what_its_schema_names_and_nothing_else(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


@pytest.mark.parametrize("name", ["show", "simulate", "simulate a driven linkage", "kinematics"])
def test_a_schema_refuses_an_output_without_one_of_its_keys_and_a_schema_without_a_key_refuses_the_output(
    name: str, tmp_path: Path
) -> None:
    printed, schema = print_json(CALLS[name], tmp_path), formats.find_schema(CALLS[name][0])
    definition = schema["$defs"][schema["$ref"].rpartition("/")[2]]
    sometimes = set(definition["properties"]) - set(definition["required"])
    if_there_are_any = {"simulate": {"drivers", "welds", "warnings", "loads"}, "kinematics": {"loads"}}
    assert sometimes == if_there_are_any.get(CALLS[name][0], set())
    for key in printed:
        if key not in sometimes:
            assert faults(schema, {k: x for k, x in printed.items() if k != key}) == [f": '{key}' is a required property"]
        kept = definition["properties"].pop(key)
        assert any(f"('{key}' was unexpected)" in x for x in faults(schema, printed))
        definition["properties"][key] = kept


@pytest.mark.parametrize("name", formats.list_formats())
def test_a_schema_is_valid_closed_and_says_what_every_key_means(name: str) -> None:
    schema = formats.find_schema(name)
    Draft202012Validator.check_schema(schema)
    assert "$id" not in schema
    for key, part in parts_of(schema):
        if "properties" in part:
            assert part["additionalProperties"] is False, key
            undescribed = {k for k, x in part["properties"].items() if "description" not in x}
            assert name == "linkage" or undescribed <= {*SECTIONS}, (
                key
            )  # a section's own schema has its meaning, the guide those of linkages
        is_open = part.keys() <= {"description"} or part.get("additionalProperties") is True
        assert not is_open or key in OPEN or name == "linkage", key


def test_descriptions_have_the_units_of_docstrings_and_of_columns() -> None:
    simulation = formats.find_schema("simulate")["$defs"]
    assert simulation["Simulation"]["properties"]["step"]["description"] == "of the integration [s]"
    assert simulation["LinkState"]["properties"]["omega"]["description"] == "(k,) [rad/s]"
    row = formats.find_schema("run")["properties"]["results"]["items"]["properties"]
    assert row["length_error"]["description"] == "largest error of any link's centre of mass over all times; unit: m"
    suite = formats.find_schema("suite")["$defs"]["LongRuns"]["properties"]
    assert suite["duration"]["description"] == "of the runs [s]"


@pytest.mark.parametrize("path", sorted(SUITES.glob("*.toml")), ids=lambda p: p.stem)
def test_every_suite_fits_the_schema(path: Path) -> None:
    assert faults(formats.find_schema("suite"), tomllib.loads(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(("content", "said"), FAULTY)
def test_a_faulty_suite_is_refused_by_the_schema_at_the_same_place_unless_it_is_no_toml(content: str, said: str) -> None:
    try:
        document = tomllib.loads(content)
    except tomllib.TOMLDecodeError:
        assert said == "TOML syntax"
        return
    (fault,) = faults(formats.find_schema("suite"), document)
    place, _, key = said.rpartition(".")
    assert fault.startswith(f"{said}: ") or (fault.startswith(f"{place}: ") and f"'{key}'" in fault)


@pytest.mark.parametrize("path", LINKAGES, ids=lambda p: p.stem)
def test_every_linkage_fits_the_schema_and_none_with_an_unknown_key_does(path: Path) -> None:
    document, schema = tomllib.loads(path.read_text(encoding="utf-8")), formats.find_schema("linkage")
    assert faults(schema, document) == []
    assert any("invented" in x for x in faults(schema, document | {"invented": 1}))
    link = next(iter(document["links"].values()))
    link["mass"] = -1.0
    assert any(x.startswith("links.") for x in faults(schema, document))


def test_a_schema_is_printed_by_name_and_an_unknown_name_is_refused_with_those_there_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["list", "--schema", "simulate"]) == 0
    assert json.loads(capsys.readouterr().out) == formats.find_schema("simulate")
    assert main(["list", "--schema", "studio"]) == 2
    said = capsys.readouterr()
    assert "no schema 'studio'; there are linkage, suite, list" in said.err
    assert said.out == ""


class Inner(TypedDict, total=False):
    """A part.

    Attributes:
        a, b: both of them: in SI; c: the third.
    """

    a: float
    b: int
    c: str


@dataclass(frozen=True)
class Outer(Result):
    """A whole. It has more.

    Attributes:
        parts: name -> part.
        flag: of the whole,
            on two lines.
    """

    computed = ("count",)
    parts: dict[str, Inner]
    flag: bool | None
    model: object = field(metadata=HIDDEN)

    @property
    def count(self) -> int:
        """Number of parts."""
        return len(self.parts)


def test_a_type_without_a_schema_or_a_field_without_a_meaning_is_an_error_and_not_an_open_schema() -> None:
    assert formats.list_meanings(Inner) == {"a": "both of them: in SI", "b": "both of them: in SI", "c": "the third"}
    assert formats.list_meanings(Outer) | {"parts": "name -> part", "flag": "of the whole, on two lines"} == (
        formats.list_meanings(Outer)
    )
    writer = formats.Writer()
    writer.describe(Outer)
    assert writer.named["Outer"]["required"] == ["parts", "flag", "count"]
    assert writer.named["Outer"]["properties"]["flag"]["type"] == ["boolean", "null"]
    assert writer.named["Inner"]["required"] == []
    with pytest.raises(TypeError, match="no schema of <class 'object'>"):
        writer.describe(dict[str, object])
    with pytest.raises(KeyError, match="'other'"):
        formats.Writer().describe(TypedDict("Undescribed", {"other": int}))
