"""A run held against another: what lies apart beyond the gate's limits is told, and nothing else."""

from pathlib import Path
from typing import Any

import pytest

from gauss_bench.api.text import format_differences
from gauss_bench.bench.differences import differences
from gauss_bench.cli import main
from gauss_bench.tables import KEY, TableError, write_schema, write_table

CASE = dict(zip(KEY, ("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-3, 2.0), strict=True))
ROW = CASE | {"status": "ok", "valid": True, "acceleration_error_median": 1e-15, "position_error": 1e-6, "position_drift": 1e-7}
TRUTH = {"mechanism": "four_bar", "scenario": "torque", "t_end": 2.0, "measured_t1": 1.25}


def written(folder: Path, rows: list[dict[str, Any]], truth: float = 1.25) -> Path:
    write_table("results", rows, folder)
    write_table("references", [TRUTH | {"measured_t1": truth}], folder)
    write_schema(folder)
    return folder


@pytest.mark.parametrize(
    ("change", "apart"),
    [
        ({}, set()),
        ({"position_error": 1.9e-6}, set()),
        ({"position_error": 2.1e-6}, {"position_error"}),
        ({"position_error": 0.4e-6}, {"position_error"}),
        ({"acceleration_error_median": 9e-13}, set()),  # below the floor
        ({"status": "diverged", "message": "lost"}, {"status"}),
        ({"valid": False}, {"valid"}),
    ],
)
def test_what_lies_apart_is_told(change: dict[str, Any], apart: set[str], tmp_path: Path) -> None:
    here, there = written(tmp_path / "here", [ROW | change]), written(tmp_path / "there", [ROW])
    found = differences(here, there)
    assert {v.metric for v in found.beyond} == apart
    assert (found.only_here, found.only_there) == (0, 0)


def test_a_truth_that_moved_is_told(tmp_path: Path) -> None:
    found = differences(written(tmp_path / "here", [ROW], truth=1.2500001), written(tmp_path / "there", [ROW]))
    assert [v.metric for v in found.beyond] == ["measured_t1"]


def test_cases_of_one_run_alone_are_counted_and_not_judged(tmp_path: Path) -> None:
    here = written(tmp_path / "here", [ROW, ROW | {"step": 1e-2}])
    there = written(tmp_path / "there", [ROW, ROW | {"engine": "lagrange"}, ROW | {"engine": "schur"}])
    found = differences(here, there)
    assert (found.only_here, found.only_there, found.beyond) == (1, 2, ())
    said = format_differences(found, there)
    assert f"0 of {found.compared}" in said
    assert "1 cases are here only" in said
    assert "2 cases are there only" in said


def test_a_folder_without_a_run_is_refused_before_anything_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(TableError, match="no accuracy cases"):
        differences(tmp_path, tmp_path)
    assert main(["run", "four_bar", "--out", str(tmp_path / "out"), "--against", str(tmp_path / "nowhere")]) == 2
    assert "nowhere" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
