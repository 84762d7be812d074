"""A run held against another: what lies apart beyond the gate's limits is told, and nothing else."""

import json

import pytest

from gauss_bench.api.telling import render
from gauss_bench.atomic import write_text
from gauss_bench.bench.differences import compare_times, differences
from gauss_bench.cli import main
from gauss_bench.tables import KEY, write_schema, write_table

CASE = dict(zip(KEY, ("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-3, 2.0), strict=True))
ROW = CASE | {"status": "ok", "valid": True, "acceleration_error_median": 1e-15, "position_error": 1e-6, "position_drift": 1e-7}
TRUTH = {"mechanism": "four_bar", "scenario": "torque", "t_end": 2.0, "measured_t1": 1.25}


def written(folder, rows, truth=1.25):
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
        ({"measured_t1": 1.2500001}, {"measured_t1"}),  # of the reference
    ],
)
def test_what_lies_apart_is_told(change, apart, tmp_path):
    truth = change.get("measured_t1", 1.25)
    rows = [ROW | {k: x for k, x in change.items() if k in ROW or k == "message"}]
    here, there = written(tmp_path / "here", rows, truth), written(tmp_path / "there", [ROW])
    found = differences(here, there)
    assert {v.metric for v in found.beyond} == apart
    assert (found.only_here, found.only_there) == (0, 0)


def test_cases_of_one_run_alone_are_counted_and_not_judged(tmp_path):
    here = written(tmp_path / "here", [ROW, ROW | {"step": 1e-2}])
    there = written(tmp_path / "there", [ROW, ROW | {"engine": "lagrange"}, ROW | {"engine": "schur"}])
    found = differences(here, there)
    assert (found.only_here, found.only_there, found.beyond) == (1, 2, ())
    said = render("differences", found, there=there)
    assert f"0 of {found.compared}" in said
    assert "1 cases are only in this run" in said
    assert "2 cases are only in the other" in said


MADE = {"commit": "0123456789ab", "date": "2026-01-02", "cpu": "a processor", "dirty": False}
RIVAL = {"mechanism": "four_bar", "scenario": "torque", "formulation": "gauss", "stabilization": "none", "rival": "mujoco"}
RIVAL |= {"settings": "tuned", "step": 1e-4, "status": "ok"}


def made(folder, rows, ratio, **more):
    """A run with one ratio of times, its spread and whether it meets its target."""
    told = dict(zip(("ratio", "ratio_low", "ratio_high"), ratio, strict=True)) | {"target": 1.0, "met": ratio[0] >= 1}
    write_table("kernel_steps", [RIVAL | told], folder)
    write_text(folder / "environment.json", json.dumps(MADE | more))
    return written(folder, rows)


@pytest.mark.parametrize(
    ("ratio", "moved", "matters"),
    [
        ((1.5, 1.4, 1.6), 0, 0),
        ((1.9, 1.55, 2.0), 0, 0),  # spreads overlap
        ((1.9, 1.7, 2.0), 1, 0),
        ((0.9, 0.8, 0.99), 2, 2),  # of 1, and of the target
    ],
)
def test_a_ratio_matters_where_it_changes_sides(ratio, moved, matters, tmp_path):
    folders = made(tmp_path / "here", [ROW], ratio), made(tmp_path / "there", [ROW], (1.5, 1.4, 1.6))
    compared, apart = compare_times(*folders)
    assert compared == 2
    assert (len(apart), sum(x.matters for x in apart)) == (moved, matters)


def test_what_changed_is_said_as_markdown(tmp_path, capsys):
    here = made(tmp_path / "here", [ROW | {"position_error": 3e-6}], (0.9, 0.8, 0.99), cpu="another")
    there = made(tmp_path / "there", [ROW], (1.5, 1.4, 1.6))
    before = sorted(tmp_path.rglob("*"))
    assert main(["report", "--out", str(here), "--against", str(there)]) == 0
    said = capsys.readouterr().out
    assert "**1 of 6 accuracy figures differ by more than the gate allows; 2 of 2 statements on times" in said
    assert "| position_error | 3e-06 | 1e-06 | 2e-06 |" in said
    assert "ratio | 0.9 (0.8..0.99) | 1.5 (1.4..1.6) |" in said
    assert "met | no | yes |" in said
    assert "The machines differ" in said
    assert sorted(tmp_path.rglob("*")) == before
    assert main(["report", "--out", str(here), "--against", str(there), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["times"][0]["matters"]


def test_an_earlier_format_is_compared_and_a_later_one_refused(tmp_path, capsys):
    there = tmp_path / "there"
    there.mkdir()
    head = ",".join([*KEY, "status", "valid", "acceleration_error_median", "position_drift", "position_error"])
    (there / "results.csv").write_text(f"{head}\nfour_bar,torque,gauss,default,rk4,none,0.001,2,ok,True,1e-15,1e-7,4e-7\n")
    for form, code, said in ((3, 0, "1 of 5"), (2, 0, "1 of 5"), (99, 2, "format 99 is later")):
        (there / "tables.json").write_text(json.dumps({"format": form}))
        asked = ["report", "--out", str(written(tmp_path / "here", [ROW])), "--against", str(there)]
        assert main(asked) == code
        told = capsys.readouterr()
        assert said in told.out + told.err


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"dirty": True}, "uncommitted changes"),
        ({"commit": ""}, "commit"),
        ({"cpu": ""}, "processor"),
        ({"shortened": "GAUSS_BENCH_ATTEMPTS=8"}, "shortcuts: GAUSS_BENCH_ATTEMPTS=8"),
    ],
)
def test_a_run_that_cannot_be_traced_is_not_published(more, said, tmp_path, capsys):
    folder = made(tmp_path / "run", [ROW], (1.5, 1.4, 1.6), **more)
    before = sorted(folder.rglob("*"))
    assert main(["report", "--out", str(folder), "--publish"]) == 2
    assert said in capsys.readouterr().err
    assert sorted(folder.rglob("*")) == before
