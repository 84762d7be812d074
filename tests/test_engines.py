"""An engine whose library is missing is a row with a status and a reason, and names the command that installs it."""

import os
import sys

import pytest

from gauss_bench.bench.cases import Case
from gauss_bench.bench.measure import measure
from gauss_bench.engines import FOREIGN, MissingExtra, get, not_installed


@pytest.mark.parametrize("engine", FOREIGN)
def test_an_engine_that_is_not_installed_is_a_skip_with_a_reason(engine, tmp_path, monkeypatch):
    missing = f'raise ModuleNotFoundError("No module named {engine}", name="{engine}")\n'
    (tmp_path / f"{engine}.py").write_text(missing, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))  # of the engine's process
    monkeypatch.setattr("gauss_bench.runs.worker._kept", {})
    adapter = get(engine)
    case = Case("four_bar", "torque", engine, next(iter(adapter.settings)), adapter.integrators[0], "none", 1e-2, 0.02)
    found = measure(case, str(tmp_path))["results"][0]
    assert found["status"] == "skip"
    assert "not installed" in found["message"]


def test_a_missing_library_is_named_with_the_command_that_installs_it():
    missing = not_installed(ImportError("no package mujoco", name="mujoco"))
    assert missing == "not installed: no package mujoco; pip install 'gauss-bench[mujoco]'"
    assert not_installed(MissingExtra(missing, name="mujoco")) == missing
