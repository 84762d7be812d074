"""Verbs that list linkages and engines, describe a linkage file, and check an engine against the engine contract."""

from typing import Any

from gauss_bench.api.telling import Answer, Told
from gauss_bench.bench.conformance import conformance
from gauss_bench.linkage.load import built_in, document_of, load
from gauss_bench.runs.offers import offers

OFFERED = ("version", "settings", "integrators", "stabilizations", "environment", "status", "reason")


def list_all() -> Answer:
    """List linkages with their scenarios, without assembling them, and engines with their settings and integrators."""
    linkages = {name: document_of(name)[0] for name in built_in()}
    described = {k: {"title": x.get("title", ""), "scenarios": list(x["scenarios"])} for k, x in linkages.items()}
    engines = {x.name: {key: getattr(x, key) for key in OFFERED} | {"settings": list(x.settings)} for x in offers()}
    return Answer({"linkages": described, "engines": engines})


def check_engine(engine: str, told: Told) -> Answer:
    """Check whether an engine keeps the contract of `engines/base.py`."""
    checks = conformance(engine, told)
    passed = all(x.passed is not False for x in checks)
    return Answer({"engine": engine, "passed": passed, "checks": [vars(x) for x in checks]}, passed)


def show(linkage: str, scenario: str | None) -> Answer:
    """Describe a linkage file: all its scenarios, or one, each assembled."""
    first = load(linkage, scenario)
    others = [load(linkage, name) for name in first.scenarios if scenario is None and name != first.scenario]
    description: dict[str, Any] = {key: getattr(first, key) for key in ("name", "title", "source", "dof", "redundant")}
    description |= {
        "loops": len(first.joints) - len(first.links),
        "links": {x.name: {"mass": x.mass, "inertia": x.inertia, "com": x.com, "points": x.points} for x in first.links},
        "joints": {x.name: type(x).__name__.lower() for x in first.joints},
        "knife_edges": [x.name for x in first.knife_edges],
        "welds": {x.name: [first.whole.links[i].name for i in x.beyond] for x in first.welds},
        "warnings": sorted({x for m in (first, *others) for x in m.warnings}),
        "scenarios": {},
    }
    for m in (first, *others):
        forces = [f.name for f in (*m.forces, *m.frictions)]
        assembled = {"duration": m.duration, "forces": forces, "driven": bool(m.drivers), "q0": m.q0, "v0": m.v0}
        description["scenarios"][m.scenario] = assembled
    return Answer(description)
