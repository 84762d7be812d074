"""All engines give right accelerations, and a row with a status and a reason where they cannot run a linkage."""

import os
import sys
from pathlib import Path

import pytest

from gauss_bench.bench.cases import Case
from gauss_bench.bench.measure import measure
from gauss_bench.engines import COMPILED, FOREIGN, OWN, MissingExtra, get, not_installed
from gauss_bench.formulations import CONTROLS


@pytest.mark.slow("gauss-native", "lagrange-native")
@pytest.mark.parametrize("engine", [*OWN, *COMPILED])
def test_accelerations_at_the_same_state(engine: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Of the worst conditioned linkage; `test_engines_libraries.py` compares those of libraries."""
    case = Case("eight_bar", "torque", engine, "default", get(engine).integrators[0], "none", 1e-3, 0.05)
    found = measure(case, str(tmp_path_factory.getbasetemp() / "references"))["results"][0]
    assert found["status"] == ("ok" if found["valid"] else "invalid"), found["message"]
    if engine in CONTROLS:
        assert found["acceleration_error_median"] > 5e-3
    else:
        assert found["acceleration_error_median"] < 1e-11  # rounding at the condition of the eight-bar
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
    found = measure(case, str(tmp_path))["results"][0]
    assert found["status"] == "skip"
    assert "not installed" in found["message"]


def test_a_missing_library_is_named_with_the_command_that_installs_it() -> None:
    missing = not_installed(ImportError("no package mujoco", name="mujoco"))
    assert missing == "not installed: no package mujoco; pip install 'gauss-bench[mujoco]'"
    assert not_installed(MissingExtra(missing, name="mujoco")) == missing
