"""Functions that tests of single engines share: linkages, runs, and errors against Gauss's principle."""

import tomllib
from collections.abc import Iterable
from typing import Any

import numpy as np

from gauss_bench.engines.base import Choice, Engine
from gauss_bench.engines.interpreted import Interpreted
from gauss_bench.linkage.load import document_of, load, load_document
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.certificate import find_certified
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Samples, Trajectory
from tests.conftest import DATA

LINKAGES = {"crank_slider": "paper", "four_bar": "torque", "six_bar": "torque", "eight_bar": "torque"}
DRIVEN = [(name, law) for name in ("four_bar", "six_bar", "eight_bar", "shaper") for law in ("driven", "cycloid")]
DRIVEN += [("crank_slider", "driven")]
QUICK = (("crank_slider", "driven"), ("four_bar", "cycloid"), ("shaper", "cycloid"))  # a slide, a law that ends, a guide that moves


def document(name: str) -> dict[str, Any]:
    return tomllib.loads((DATA / f"{name}.toml").read_text(encoding="utf-8"))


def table_of_faults(kind: str) -> list[list[Any]]:
    """Return the values of each row of the table `kind` in `data/faults/engines.toml`."""
    return [[*row.values()] for row in document("faults/engines")[kind]]


def linkage(name: str, scenario: str | None = None) -> Mechanism:
    """Return a linkage of the tests' data, or a built-in one."""
    own = (DATA / f"{name}.toml").exists()
    return load_document(document(name), scenario) if own else load(name, scenario or LINKAGES.get(name))


def ran(engine: Engine, mechanism: Mechanism, times: Iterable[float], native: bool = True, **choice: Any) -> Trajectory:
    return moved(engine.build(mechanism, Choice(**{"integrator": engine.integrators[0], **choice})), times, native)


def moved(model: Any, times: Iterable[float], native: bool = True) -> Trajectory:
    """Return the run of a built model."""
    model.prepare(np.array([*times], dtype=float), native)
    model.run()
    return model.read()


def certified(mechanism: Mechanism, until: float) -> Reference:
    found = find_certified(mechanism, until)
    assert found is not None
    return found


def by_gauss(mechanism: Mechanism, times: Iterable[float], **choice: Any) -> Trajectory:
    return ran(Interpreted("gauss"), mechanism, times, **{"integrator": "dop853", **choice})


def relative_error(found: Array, expected: Array) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def acceleration_errors(engine: Engine, mechanism: Mechanism, settings: str, states: Samples) -> Array:
    """Return for each state the largest error of accelerations, relative to the largest true acceleration."""
    model = engine.build(mechanism, Choice(settings, engine.integrators[0]))
    pairs = zip(states.t, states.q, states.v, states.a, strict=True)
    return np.array([relative_error(model.acceleration(t, q, v), a) for t, q, v, a in pairs])


def open_by(mechanism: Mechanism, trajectory: Trajectory) -> float:
    return float(np.abs(Evaluator(mechanism).constraints(trajectory.t, trajectory.q, trajectory.v).phi).max())


def changed(name: str, scenario: str, changes: dict[str, Any]) -> Mechanism:
    """Return a built-in linkage with other values at places of its file, such as "links.crank.mass"."""
    document, _, _ = document_of(name)
    for place, value in changes.items():
        *path, last = place.split(".")
        table = document
        for key in path:
            table = table.setdefault(key, {})
        table[last] = value
    return load_document(document, scenario)
