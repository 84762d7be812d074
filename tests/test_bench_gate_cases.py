"""Every kind of joint, guide, force, driver and law of a linkage file is run by the gate, and the baseline knows the run."""

from pathlib import Path
from typing import get_args

import pytest

from gauss_bench.bench.gate import read_baseline
from gauss_bench.linkage import schema
from gauss_bench.linkage.load import document_of, load
from gauss_bench.suites.read import read_suite

BASELINE = Path(__file__).parents[1] / "reports" / "baseline.csv"


KINDS = (schema.ConstantLaw, schema.RiseLaw, schema.TableLaw)
OVER_TIME = (schema.TableOverTime, schema.RampOverTime, schema.StepOverTime, schema.SineOverTime)
DRIVEN = {*schema.DrivenTable.model_fields} - {"start", "start_deg"}  # what a driver may name


def words(table, field):
    """The words that a field of a table may have."""
    yield from get_args(table.model_fields[field].annotation)


MEMBERS = {f"joint {x}" for x in schema.JOINTS} | {f"force {x}" for x in schema.FORCES} | {f"driven {x}" for x in DRIVEN}
MEMBERS |= {f"constraint {x}" for x in words(schema.KnifeEdgeTable, "type")}
MEMBERS |= {f"law {x}" for table in KINDS for x in words(table, "law")}
MEMBERS |= {f"over time {x}" for table in OVER_TIME for x in words(table, "law")}
MEMBERS |= {f"{x} {place}" for x in ("force", "axis") for place in ("in the world", "in a link")}
MEMBERS |= {"guide on the ground", "guide on a link", "torque against the ground", "torque against a link"}
MEMBERS |= {"welds", "cylinders", "point_masses", "against"}


def used(document, scenario):
    """The members of the grammar that a scenario of a file uses."""
    for joint in document["joints"].values() if "joints" in document else ():
        yield f"joint {joint['type']}"
        if joint["type"] == "prismatic":
            yield "guide on the ground" if joint["guide"].startswith("ground.") else "guide on a link"
    for constraint in document.get("constraints", {}).values():
        yield f"constraint {constraint['type']}"
    yield from (key for key in ("welds", "cylinders") if key in document)
    yield from (key for link in document["links"].values() for key in ("point_masses",) if key in link)
    chosen = document["scenarios"][scenario]
    for force in (document["forces"][name] for name in chosen.get("forces", [])):
        yield f"force {force['type']}"
        yield from (f"over time {law}" for key, law in force.get("over_time", {}).items() if key == "law")
        yield from (key for key in ("against",) if key in force)
        match force["type"]:
            case "force":
                yield "force in the world" if force.get("frame", "ground") == "ground" else "force in a link"
            case "axis_spring_damper":
                yield "axis in the world" if force.get("origin", "ground.").startswith("ground.") else "axis in a link"
            case "torque":
                yield "torque against the ground" if force.get("reaction", "ground") == "ground" else "torque against a link"
    for driver in [*chosen.get("drivers", []), *([chosen["driver"]] if "driver" in chosen else [])]:
        yield f"law {driver['law']}"
        yield from (f"driven {key}" for key in DRIVEN if key in driver)


@pytest.fixture(scope="module")
def gated():
    """Member -> mechanisms in scenarios that use it, that the gate runs, and of which the baseline holds a run that ended well."""
    baseline = read_baseline(BASELINE)
    known = {(x["mechanism"], x["scenario"]) for x in baseline if (x["metric"], x["value"]) == ("status", "ok")}
    found = {}
    for part in read_suite("gate").accuracy:
        for linkage, scenario in part.linkages.items():
            if (load(linkage, scenario).name, scenario) in known:
                for member in used(document_of(linkage)[0], scenario):
                    found.setdefault(member, set()).add(f"{linkage} {scenario}")
    return found


def test_every_member_of_the_grammar_has_a_gated_case(gated):
    assert gated.keys() == MEMBERS
