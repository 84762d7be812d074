"""List linkages, engines and schemas, describe a linkage file, and check an adapter or a file of settings."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gauss_bench.api.telling import Answer, Told
from gauss_bench.bench.conformance import conformance
from gauss_bench.bench.subject import Check
from gauss_bench.engines.authors import CheckedSettings, read_settings
from gauss_bench.linkage.load import built_in, document_of, load
from gauss_bench.linkage.schema import CONSTRAINTS
from gauss_bench.runs.offers import offers
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status
from gauss_bench.verbs.formats import find_schema


@dataclass(frozen=True)
class ListedLinkage:
    """A built-in linkage.

    Attributes:
        title: title in the file.
        scenarios: names of the scenarios.
    """

    title: str
    scenarios: tuple[str, ...]


@dataclass(frozen=True)
class ListedEngine:
    """An engine, as `list` prints it.

    Attributes:
        version: version of the engine's library, or "not installed".
        settings: names of the settings; the first is the default.
        integrators: names of the integrators; the first is the default.
        stabilizations: names of the stabilizations.
        environment: path and version of the interpreter of an engine in an environment of its own; else empty.
        status: "ok", or in one word why the engine cannot be used; reason: the same in a sentence, or empty.
    """

    version: str
    settings: tuple[str, ...]
    integrators: tuple[str, ...]
    stabilizations: tuple[str, ...]
    environment: str
    status: Status
    reason: str


@dataclass(frozen=True)
class Catalogue:
    """All built-in linkages and all engines.

    Attributes:
        linkages: name -> linkage.
        engines: name -> engine.
    """

    linkages: dict[str, ListedLinkage]
    engines: dict[str, ListedEngine]


@dataclass(frozen=True)
class Conformance:
    """The checks of an engine's adapter.

    Attributes:
        engine: name of the engine, or MODULE:CLASS of its adapter.
        passed: whether no check failed.
        checks: one check for each rule and linkage.
    """

    engine: str
    passed: bool
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class DescribedLink:
    """A rigid link.

    Attributes:
        mass: mass [kg]; inertia: moment of inertia about the centre of mass [kg m^2].
        com: (2,) centre of mass in the link's own frame [m].
        points: name -> (2,) position in the link's own frame [m].
    """

    mass: float
    inertia: float
    com: Array
    points: Mapping[str, Array]


@dataclass(frozen=True)
class DescribedScenario:
    """A scenario in its assembled position.

    Attributes:
        duration: duration [s].
        forces: names of the forces and frictions that act.
        driven: whether motions are prescribed.
        q0, v0: (n,) coordinates at the start [m, rad], and rates of the coordinates [m/s, rad/s].
    """

    duration: float
    forces: tuple[str, ...]
    driven: bool
    q0: Array
    v0: Array


@dataclass(frozen=True)
class Description:
    """A linkage file, as `show` prints it.

    Attributes:
        name, title: name and title of the linkage; source: path of the file.
        dof: degrees of freedom; redundant: number of redundant constraint rows; loops: number of loops.
        links: name of a rigid link -> the link; links that are welded together count as one.
        joints: name of a joint -> kind of joint.
        knife_edges: names of the knife edges; couplings: name of any other constraint besides joints and drivers -> its kind.
        welds: name of a weld -> names of the links that the weld carries: its welded link, and all links welded onto that link.
        warnings: the loader's warnings on the file.
        scenarios: name of a scenario -> scenario.
    """

    name: str
    title: str
    source: str
    dof: int
    redundant: int
    loops: int
    links: dict[str, DescribedLink]
    joints: dict[str, str]
    knife_edges: tuple[str, ...]
    couplings: dict[str, str]
    welds: dict[str, tuple[str, ...]]
    warnings: tuple[str, ...]
    scenarios: dict[str, DescribedScenario]


def list_all(schema: str | None = None) -> Answer[Catalogue] | Answer[None]:
    """List all linkages with their scenarios and all engines with their settings, or print the schema with the given name."""
    if schema is not None:
        return Answer(None, text=json.dumps(find_schema(schema), indent=1))
    documents = {name: document_of(name)[0] for name in built_in()}
    linkages = {name: ListedLinkage(x.get("title", ""), tuple(x["scenarios"])) for name, x in documents.items()}
    engines = {
        x.name: ListedEngine(x.version, tuple(x.settings), x.integrators, x.stabilizations, x.environment, x.status, x.reason)
        for x in offers()
    }
    return Answer(Catalogue(linkages, engines))


def check_engine(engine: str, told: Told) -> Answer[Conformance]:
    """Check whether an engine's adapter follows the rules of `engines/base.py`; `told` is called with each sentence of progress."""
    checks = conformance(engine, told)
    passed = all(x.passed is not False for x in checks)  # None: the rule could not be checked
    return Answer(Conformance(engine, passed, tuple(checks)), passed)


def show(linkage: str, scenario: str | None) -> Answer[Description]:
    """Describe a linkage file with all its scenarios, or with the given one; each is assembled at its start."""
    first = load(linkage, scenario)
    others = [load(linkage, name) for name in first.scenarios if scenario is None and name != first.scenario]
    scenarios = {}
    for x in (first, *others):
        forces = tuple(force.name for force in (*x.forces, *x.frictions))
        scenarios[x.scenario] = DescribedScenario(x.duration, forces, bool(x.drivers), x.q0, x.v0)
    kinds = {entry.read.__self__: kind for kind, entry in CONSTRAINTS.items()}  # class of a constraint -> its kind in files
    return Answer(
        Description(
            name=first.name,
            title=first.title,
            source=first.source,
            dof=first.dof,
            redundant=first.redundant,
            loops=first.loops,
            links={x.name: DescribedLink(x.mass, x.inertia, x.com, x.points) for x in first.links},
            joints={x.name: type(x).__name__.lower() for x in first.joints},
            knife_edges=tuple(x.name for x in first.knife_edges),
            couplings={x.name: kinds[type(x)] for x in first.couplings if type(x) in kinds},
            welds={x.name: tuple(first.whole.links[i].name for i in x.beyond) for x in first.welds},
            warnings=tuple(sorted({warning for x in (first, *others) for warning in x.warnings})),
            scenarios=scenarios,
        )
    )


def check_settings(file: Path) -> Answer[CheckedSettings]:
    """Check a file of settings that the authors of an engine contributed; return the settings that it lists."""
    return Answer(read_settings(file))
