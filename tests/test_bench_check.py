"""The gate passes what has not changed, fails a planted fault by name, and tells an improvement."""

import re

import pytest

from gauss_bench.bench import gate
from gauss_bench.bench.cases import Case
from gauss_bench.bench.gate import accept, compare, failures, figures_of, read_baseline
from gauss_bench.bench.runner import measure_all
from gauss_bench.cli import main
from gauss_bench.report.rows import group_by
from gauss_bench.tables import KEY
from gauss_bench.verbs import suites

CASES = [Case("four_bar", "torque", "gauss", "default", "rk4", "none", h, 1.0) for h in (1e-2, 5e-3)]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return figures_of(*measure_all(CASES, tmp_path_factory.mktemp("gate")))


@pytest.fixture
def baseline(found, tmp_path):
    path = tmp_path / "a baseline.csv"
    accept(found, path, "first")
    return path


def changed(found, metric, factor):
    return [{**row, "value": str(float(row["value"]) * factor)} if row["metric"] == metric else row for row in found]


def test_an_accepted_change_carries_its_date_and_reason_and_leaves_the_others(found, baseline):
    assert accept(changed(found, "measured_error_t1", 3.0), baseline, "a longer lever") == (2, [])
    accepted = group_by(read_baseline(baseline), "metric")
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d a longer lever", row["accepted"]) for row in accepted["measured_error_t1"])
    assert all(row["accepted"].endswith(" first") for row in accepted["velocity_error"])


@pytest.mark.slow
def test_one_per_cent_in_one_inertia_fails_the_gate_by_name(tmp_path, capsys):
    command = ["check", "crank_slider", "--engine", "schur", "--baseline", str(tmp_path / "baseline.csv")]
    assert main([*command, "--accept", "first"]) == 0
    capsys.readouterr()
    assert main([*command, "--plant-inertia", "1.01"]) == 1
    said = capsys.readouterr().out
    assert "fail: crank_slider paper schur default rk4 none 0.01 1: acceleration_error_median" in said
    assert "limit" in said


def test_of_a_part_what_the_baseline_knows_is_run_and_what_it_does_not_know_is_told(baseline, capsys, monkeypatch):
    run = []
    figures = read_baseline(baseline)

    def measured(cases, *rest):
        run.extend(cases)
        return [CASE], []

    monkeypatch.setattr(suites, "measure_all", measured)
    monkeypatch.setattr(gate, "figures_of", lambda *arguments: figures)
    assert main(["check", "four_bar", "--baseline", str(baseline)]) == 0
    assert {x.engine for x in run} == {"gauss"}
    assert "are not in the baseline and are not run" in capsys.readouterr().err
    monkeypatch.setattr(gate, "figures_of", lambda *arguments: [{**row, "value": "nan"} for row in figures])
    assert main(["check", "four_bar", "--engine", "gauss", "--baseline", str(baseline)]) == 1
    assert f"gauss-bench check four_bar --engine gauss --baseline '{baseline}' --accept 'REASON'" in capsys.readouterr().out
    run.clear()
    assert main(["check", "four_bar", "--engine", "lagrange", "--baseline", str(baseline)]) == 2
    assert "has no figure of four_bar by lagrange" in capsys.readouterr().err
    assert not run


def test_a_known_case_that_an_engine_no_longer_has_fails(found, baseline):
    kept = read_baseline(baseline)
    other = [{**row, "engine": "lost"} for row in kept]
    part = gate.restrict(kept + other, {"four_bar"}, {"gauss", "lost"})
    assert {v.case.split()[2] for v in failures(compare(found, part))} == {"lost"}


CASE = dict(zip(KEY, ("four_bar", "torque", "gauss", "default", "rk4", "none", 1e-3, 1.0), strict=True))


def ended(status, message=""):
    """The facts of one case that ended so."""
    figures = [{"metric": "position_error", "value": "1e-5", "message": ""}] if status == "ok" else []
    return [CASE | x for x in [{"metric": "status", "value": status, "message": message}, *figures]]


@pytest.mark.parametrize("status", ["nan", "crashed"])
def test_a_case_that_did_not_end_well_is_not_accepted(status, tmp_path):
    path = tmp_path / "baseline.csv"
    accept(ended("ok"), path, "first")
    before = path.read_bytes()
    verdict, *_ = failures(compare(ended(status, "the engine's own words"), read_baseline(path)))
    said = f"fail: four_bar torque gauss default rk4 none 0.001 1: the engine's own words: status = {status}, limit ok"
    assert str(verdict).startswith(said)
    changed, refused = accept(ended(status, "the engine's own words"), path, "later")
    assert changed == 0
    assert "the engine's own words" in refused[0]
    assert path.read_bytes() == before
    new = [{**row, "engine": "lagrange"} for row in ended(status)]  # a case that the baseline does not know
    _, refused = accept(ended("ok") + new, path, "later")
    assert len(refused) == 1
    assert {row["engine"] for row in read_baseline(path)} == {"gauss"}
    first = tmp_path / "first.csv"  # which takes failures of mathematics, not of processes, for what they are
    accept(ended(status), first, "first")
    found = [v.outcome for v in compare(ended(status), read_baseline(first))]
    assert found == (["fail"] if status in gate.BROKEN else ["ok"])
