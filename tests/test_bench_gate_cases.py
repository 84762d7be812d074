"""Every kind of joint, guide, force, driver and law of a linkage file is run by the gate, and the baseline knows the run."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

from gauss_bench.bench.gate import read_baseline
from gauss_bench.linkage import schema
from gauss_bench.linkage.load import document_of, load
from gauss_bench.suites.read import read_suite

BASELINE = Path(__file__).parents[1] / "reports" / "baseline.csv"


def laws() -> set[str]:
    return {
        law
        for table in (schema.ConstantLaw, schema.RiseLaw, schema.TableLaw)
        for law in get_args(table.model_fields["law"].annotation)
    }


def constraints() -> set[str]:
    return set(get_args(schema.KnifeEdgeTable.model_fields["type"].annotation))


def driven() -> set[str]:
    """What a driver may name: everything that its table has beside its start."""
    return set(schema.DrivenTable.model_fields) - {"start", "start_deg"}


MEMBERS = {f"joint {x}" for x in schema.JOINTS} | {f"constraint {x}" for x in constraints()} | {f"force {x}" for x in schema.FORCES}
MEMBERS |= {f"law {x}" for x in laws()} | {f"driven {x}" for x in driven()}
MEMBERS |= {
    "guide on the ground",
    "guide on a link",
    "force in the world",
    "force in a link",
    "axis in the world",
    "axis in a link",
}
MEMBERS |= {"torque against the ground", "torque against a link"}
MEMBERS |= {"welds", "cylinders", "point_masses", "against"}
MEMBERS |= {
    f"over time {law}"
    for kind in (schema.TableOverTime, schema.RampOverTime, schema.StepOverTime, schema.SineOverTime)
    for law in get_args(kind.model_fields["law"].annotation)
}


def used(document: dict[str, Any], scenario: str) -> Iterator[str]:
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
        yield from (f"driven {key}" for key in driven() if key in driver)


@pytest.fixture(scope="module")
def gated() -> dict[str, set[str]]:
    """Member -> mechanisms in scenarios that use it, that the gate runs, and of which the baseline holds a run that ended well."""
    baseline = read_baseline(BASELINE)
    ended = baseline[(baseline["metric"] == "status") & (baseline["value"] == "ok")]
    known = set(zip(ended["mechanism"], ended["scenario"], strict=True))
    found: dict[str, set[str]] = {}
    for part in read_suite("gate").accuracy:
        for linkage, scenario in part.linkages.items():
            if (load(linkage, scenario).name, scenario) in known:
                for member in used(document_of(linkage)[0], scenario):
                    found.setdefault(member, set()).add(f"{linkage} {scenario}")
    return found


@pytest.mark.parametrize("member", sorted(MEMBERS))
def test_every_member_of_the_grammar_has_a_gated_case(member: str, gated: dict[str, set[str]]) -> None:
    assert gated.get(member), f"no case of the gate has a {member}"


def test_what_is_used_is_in_the_grammar(gated: dict[str, set[str]]) -> None:
    assert gated.keys() <= MEMBERS
