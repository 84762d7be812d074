"""What every engine must do, by one loop over all of them: right accelerations, a typed answer, and no word taken on trust."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gauss_bench.bench.cases import Case
from gauss_bench.bench.measure import measure
from gauss_bench.engines import DERIVED, FOREIGN, MissingExtra, get, names, not_installed
from gauss_bench.engines.base import Choice
from gauss_bench.formulations import CONTROLS
from gauss_bench.linkage.load import load
from gauss_bench.runs.worker import Worker
from gauss_bench.suites.read import read_suite
from tests.conftest import everything

DATA = Path(__file__).parent / "data"
SCENARIOS = read_suite("gate").accuracy[0].linkages
# median relative error at the same state that each engine's arithmetic explains
GATES = {
    ("mujoco", "rigid"): 1e-8,  # regularisation scaled down by 1e-6
    ("mujoco", "tuned"): 1e-3,  # impedance is clamped at 0.9999
    ("exudyn", "default"): 1e-5,  # one-sided numerical differentiation at 1e-7
    ("exudyn", "tuned"): 1e-9,  # central differences
}
EXACT = 1e-11  # rounding at the condition of the eight-bar
SOME = (*DERIVED, *FOREIGN)  # take some linkages only; own formulations take every one
OFF = {("mujoco", "default"), *((name, "default") for name in CONTROLS)}


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with Worker() as one:
        yield one


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(tmp_path_factory.mktemp("references"))


def row(worker: Worker, store: str, case: Case) -> dict[str, Any]:
    found: dict[str, Any] = worker.call(measure, (case, store), 120.0)["row"]
    return found


SETTINGS = [(engine, settings) for engine in names() for settings in get(engine).settings]


HARDEST = ("crank_slider", "eight_bar")  # a slide, and the worst condition; the gate has them all, in every engine


@pytest.mark.slow("gauss-default-crank_slider", "gauss-native-default-eight_bar", "lagrange-native-default-eight_bar")
@pytest.mark.parametrize("linkage", HARDEST)
@pytest.mark.parametrize(("engine", "settings"), SETTINGS)
def test_accelerations_at_the_same_state(engine: str, settings: str, linkage: str, worker: Worker, store: str) -> None:
    adapter = get(engine)
    case = Case(linkage, SCENARIOS[linkage], engine, settings, adapter.integrators[0], "none", 1e-3, 0.05)
    found = row(worker, store, case)
    if engine in DERIVED and adapter.skip(load(linkage, SCENARIOS[linkage]), case.choice):
        assert found["status"] == "skip"
        return
    assert found["status"] == ("invalid" if not found["valid"] else "ok"), found["message"]
    if (engine, settings) in OFF:
        assert found["acceleration_error_median"] > 5e-3
    else:
        assert found["acceleration_error_median"] < GATES.get((engine, settings), EXACT)
        assert found["valid"], found["flag"]


@pytest.mark.slow("gauss-native", "lagrange-native")
@pytest.mark.parametrize("engine", sorted(set(names()) - CONTROLS))
def test_a_linkage_of_others_runs_in_every_engine(engine: str, worker: Worker, store: str) -> None:
    settings, integrator = list(get(engine).settings)[-1], get(engine).integrators[0]  # the last setting is each engine's best
    found = row(worker, store, Case("jansen", "walk", engine, settings, integrator, "none", 1e-3, 0.1))
    assert found["status"] == "ok", found["message"]
    assert found["position_error"] < 1e-4  # the native integrator of second order at a millisecond is the coarsest
    assert found["valid"], found["flag"]


@pytest.mark.long("lagrange-native")
@pytest.mark.slow("gauss-native")
@pytest.mark.parametrize("engine", names())
def test_what_an_engine_cannot_model_it_skips_with_a_reason_or_runs(engine: str, worker: Worker, store: str) -> None:
    adapter = get(engine)
    for linkage, scenario in (("six_bar", "cycloid"), (str(DATA / "everything.toml"), "free")):
        case = Case(linkage, scenario, engine, next(iter(adapter.settings)), adapter.integrators[0], "none", 1e-3, 0.02)
        found = row(worker, store, case)
        assert found["status"] in ("ok", "skip", *(["invalid"] if (engine, case.settings) in OFF else [])), found["message"]
        if found["status"] == "skip":
            assert engine in SOME
            assert len(found["message"]) > 20


@pytest.mark.parametrize("engine", FOREIGN)
def test_an_engine_that_is_not_installed_is_a_skip_with_a_reason(
    engine: str, store: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = f'raise ModuleNotFoundError("No module named {engine}", name="{engine}")\n'
    (tmp_path / f"{engine}.py").write_text(missing, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))  # of the engine's process
    monkeypatch.setattr("gauss_bench.runs.worker._kept", {})
    adapter = get(engine)
    case = Case("four_bar", "torque", engine, next(iter(adapter.settings)), adapter.integrators[0], "none", 1e-2, 0.02)
    found = measure(case, store)["row"]
    assert found["status"] == "skip"
    assert "not installed" in found["message"]


def test_what_is_missing_is_said_once_however_often_it_is_told_on() -> None:
    missing = not_installed(ImportError("no package mujoco", name="mujoco"))
    assert missing == "not installed: no package mujoco; pip install 'gauss-bench[mujoco]'"
    assert not_installed(MissingExtra(missing, name="mujoco")) == missing


@pytest.mark.parametrize("engine", SOME)
def test_a_fault_planted_in_an_engines_model_shows(engine: str, worker: Worker, store: str) -> None:
    from functools import partial

    from gauss_bench.bench.gate import scale_inertia

    adapter = get(engine)
    settings = list(adapter.settings)[-1]
    case = Case("crank_slider", "paper", engine, settings, adapter.integrators[0], "none", 1e-3, 0.02)
    sound, faulty = (
        row(worker, store, case),
        worker.call(measure, (case, store, partial(scale_inertia, 1.01)), 60.0)["row"],
    )
    assert faulty["acceleration_error_median"] > 1e-4
    assert faulty["acceleration_error_median"] > 1e3 * sound["acceleration_error_median"]


def test_defaults_come_first() -> None:
    every, four_bar = everything(), load("four_bar")
    for name in names():
        adapter = get(name)
        assert next(iter(adapter.settings)) == "default"
        assert adapter.stabilizations[0] == "none"
        assert adapter.native_loop or adapter.python_loop
        assert adapter.skip(every, Choice(integrator=adapter.integrators[0])) is None or name in SOME
        assert adapter.skip(four_bar, Choice(integrator=adapter.integrators[0])) is None
