"""All engines give right accelerations, and a row with a status and a reason where they cannot run a linkage."""

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gauss_bench.bench.cases import Case
from gauss_bench.bench.measure import measure
from gauss_bench.engines import DERIVED, FOREIGN, MissingExtra, get, names, not_installed
from gauss_bench.formulations import CONTROLS
from gauss_bench.linkage.load import load
from gauss_bench.runs.worker import Worker
from gauss_bench.suites.read import read_suite

SCENARIOS = read_suite("gate").accuracy[0].linkages
# median relative error at the same state that each engine's arithmetic explains
GATES = {
    ("mujoco", "rigid"): 1e-8,  # regularisation scaled down by 1e-6
    ("mujoco", "tuned"): 1e-3,  # impedance is clamped at 0.9999
    ("exudyn", "default"): 1e-5,  # one-sided numerical differentiation at 1e-7
    ("exudyn", "tuned"): 1e-9,  # central differences
}
EXACT = 1e-11  # rounding at the condition of the eight-bar

OFF = {("mujoco", "default"), *((name, "default") for name in CONTROLS)}


@pytest.fixture(scope="module")
def row(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[Case], dict[str, Any]]]:
    """A function that returns the row of a case, measured in a worker."""
    store = str(tmp_path_factory.mktemp("references"))
    with Worker() as worker:
        yield lambda case: dict(worker.call(measure, (case, store), 120.0)[0])


SETTINGS = [(engine, settings) for engine in names() for settings in get(engine).settings]


HARDEST = ("crank_slider", "eight_bar")  # a slide, and the worst condition; the gate has them all, in every engine


@pytest.mark.slow("gauss-default-crank_slider", "gauss-native-default-eight_bar", "lagrange-native-default-eight_bar")
@pytest.mark.parametrize("linkage", HARDEST)
@pytest.mark.parametrize(("engine", "settings"), SETTINGS)
def test_accelerations_at_the_same_state(engine: str, settings: str, linkage: str, row: Any) -> None:
    adapter = get(engine)
    case = Case(linkage, SCENARIOS[linkage], engine, settings, adapter.integrators[0], "none", 1e-3, 0.05)
    found = row(case)
    if engine in DERIVED and adapter.skip(load(linkage, SCENARIOS[linkage]), case.choice):
        assert found["status"] == "skip"
        return
    assert found["status"] == ("invalid" if not found["valid"] else "ok"), found["message"]
    if (engine, settings) in OFF:
        assert found["acceleration_error_median"] > 5e-3
    else:
        assert found["acceleration_error_median"] < GATES.get((engine, settings), EXACT)
        assert found["valid"], found["flag"]


@pytest.mark.parametrize("engine", FOREIGN)
def test_an_engine_that_is_not_installed_is_a_skip_with_a_reason(
    engine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = f'raise ModuleNotFoundError("No module named {engine}", name="{engine}")\n'
    (tmp_path / f"{engine}.py").write_text(missing, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))  # of the engine's process
    monkeypatch.setattr("gauss_bench.runs.worker._kept", {})
    adapter = get(engine)
    case = Case("four_bar", "torque", engine, next(iter(adapter.settings)), adapter.integrators[0], "none", 1e-2, 0.02)
    found = measure(case, str(tmp_path)).row
    assert found["status"] == "skip"
    assert "not installed" in found["message"]


def test_a_missing_library_is_named_with_the_command_that_installs_it() -> None:
    missing = not_installed(ImportError("no package mujoco", name="mujoco"))
    assert missing == "not installed: no package mujoco; pip install 'gauss-bench[mujoco]'"
    assert not_installed(MissingExtra(missing, name="mujoco")) == missing
