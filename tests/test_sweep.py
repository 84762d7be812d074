"""Test sweeps: the plan, starts of samples, figures and rows, and a folder in which a sweep continues."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gauss_bench import cli, metrics
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import document_of, load, load_document, reduce_to_scenario
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.sweep import halving
from gauss_bench.sweep.batch import SweepCase
from gauss_bench.sweep.errors import SweepError
from gauss_bench.sweep.family import Family
from gauss_bench.sweep.figures import figures, units
from gauss_bench.sweep.folder import PARTS
from gauss_bench.sweep.paths import change, number_at
from gauss_bench.sweep.plan import dimension, plan
from gauss_bench.sweep.run import Backend, Options, _batches, _choice, sweep
from gauss_bench.sweep.summary import _dependence, sensitivities, summary
from tests.conftest import DATA, needs
from tests.engine_runs import ran
from tests.faults import alive
from tests.fuzz.files import toml
from tests.test_scrutiny import oscillator

VARIED = ["links.rod.length=0.5:0.6:3", "forces.motor.value=normal(-0.5,0.05)"]
CASES = tomllib.loads((DATA / "sweep" / "arguments.toml").read_text(encoding="utf-8"))
DOCUMENT = reduce_to_scenario(document_of("crank_slider")[0], "paper")
SHORT = Options(scenario="paper", until=0.2, stabilization="projection")


def table(folder):
    return {x.name: x.read_bytes() for x in sorted((folder / PARTS).iterdir())}


def rows(folder):
    import pyarrow.parquet as pq

    return [row for x in sorted((folder / PARTS).iterdir()) for row in pq.read_table(x).to_pylist()]


def test_another_length_moves_the_points_of_a_link_along_its_bar_and_no_others():
    document, _, _ = document_of("crank_slider")
    assert number_at(document, "links.rod.length") == pytest.approx(0.56)
    made = change(document, {"links.rod.length": 0.70})
    assert made["links"]["rod"]["points"] == {"A": [0.0, 0.0], "B": [pytest.approx(0.70), 0.0], "P": [pytest.approx(0.35), 0.05]}
    assert document["links"]["rod"]["points"]["B"] == [0.56, 0.0]
    assert made["links"]["crank"] is document["links"]["crank"]
    link = load_document(reduce_to_scenario(made, "paper")).links[1]
    assert link.com == pytest.approx([0.35, 0.0])
    assert (link.mass, link.inertia) == (0.77, pytest.approx(0.77 * 0.70**2 / 12))  # a given mass stays, its spread follows the bar


def test_a_path_that_names_no_number_is_refused_by_name():
    for path in CASES["paths_without_numbers"]:
        with pytest.raises(SweepError, match=path):
            number_at(document_of("crank_slider")[0], path)


def test_grids_are_crossed_and_random_values_come_from_the_seed():
    assert plan(["a=0:1:3", "b=5:6:2"]).values.tolist() == [[0, 5], [0, 6], [0.5, 5], [0.5, 6], [1, 5], [1, 6]]
    mixed, same, other = (plan(["a=0:1:3", "b=normal(1.5,0.1)"], 4000, seed=seed).values for seed in (1, 1, 2))
    assert mixed[:4, 0].tolist() == [0, 0.5, 1, 0]
    assert mixed[:, 1].mean() == pytest.approx(1.5, abs=0.01)
    assert mixed[:, 1].std() == pytest.approx(0.1, rel=0.05)
    assert (mixed == same).all()
    assert (mixed != other).any()


def test_what_cannot_be_planned_is_refused():
    for case in CASES["no_plan"]:
        with pytest.raises(SweepError, match=case["said"]):
            plan(case["vary"], case.get("samples"))
    assert dimension("a=1:2:10000000").count == 10_000_000


def test_indices_of_a_sobol_plan_are_the_shares_of_a_known_variance():
    some = plan(["a=uniform(0,1)", "b=uniform(0,1)", "c=normal(0,1)"], 5 * 1024, "sobol", 3)
    assert (some.base, some.values.shape) == (1024, (5120, 3))
    y = 2 * some.values[:, 0] + some.values[:, 1]
    found = sensitivities(some, y)["sobol"]
    assert [found[x]["first"] for x in "abc"] == pytest.approx([0.8, 0.2, 0.0], abs=0.02)
    assert [found[x]["total"] for x in "abc"] == pytest.approx([0.8, 0.2, 0.0], abs=0.02)
    y[3] = np.nan
    assert "rank_correlation" in sensitivities(some, y)  # a lost sample spoils the design


@pytest.mark.parametrize(
    ("name", "scenario", "paths", "low", "high"),
    [
        ("crank_slider", "paper", ["links.rod.length", "scenarios.paper.start.crank_deg"], [0.4, -40.0], [0.7, 40.0]),
        ("four_bar", "driven", ["links.coupler.length", "ground.points.D.x"], [0.33, 0.36], [0.4, 0.42]),
        ("parallelogram", None, ["gravity.y"], [-20.0], [0.0]),
    ],
)
def test_starts_close_at_their_own_dimensions(name, scenario, paths, low, high):
    mechanism = load(name, scenario)
    document = reduce_to_scenario(document_of(name)[0], mechanism.scenario)
    family = Family(document, mechanism.scenario, paths, name)
    values = np.linspace(low, high, 5)
    found = family.starts(values)
    assert not found.reasons
    for k, row in enumerate(values):
        alone = family.mechanism_of(row)
        assert found.q[k] == pytest.approx(alone.q0, abs=1e-10)
        assert found.v[k] == pytest.approx(alone.v0, abs=1e-9)


@pytest.mark.slow
def test_a_batch_in_one_call_is_what_every_sample_is_alone_and_half_the_step_halves_an_error_of_first_order(tmp_path):
    """The kernel with open numbers is compared with the reference formulation, which builds every linkage anew."""
    how = replace(SHORT, integrator="semi_implicit_euler", step=1e-4, until=0.05)
    summary = sweep("crank_slider", VARIED, tmp_path / "s", ["gauss-native", "gauss"], 3, how=how, where=Backend(jobs=1))
    assert all(x["status"] == {"ok": 3} for x in summary["engines"].values())
    found = rows(tmp_path / "s")
    for native, alone in zip(found[:3], found[3:], strict=True):
        assert native["sample"] == alone["sample"]
        assert (native["engine"], alone["engine"]) == ("gauss-native", "gauss")
        for key in native.keys() - {"engine", "status", "message", "energy_bar"}:
            assert native[key] == pytest.approx(alone[key], rel=1e-7, abs=1e-8), key
    assert len({x["measured"] for x in found[:3]}) == 3
    finer = sweep("crank_slider", VARIED, tmp_path / "f", ["gauss-native"], 3, how=replace(how, step=5e-5), where=Backend(jobs=1))
    changes = [x["engines"]["gauss-native"]["half_the_step"]["rad"] for x in (summary, finer)]
    assert changes[0] / changes[1] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize(
    ("linkage", "scenario"),
    [
        ("crank_slider", "paper"),
        ("four_bar", "torque"),
        ("four_bar", "driven"),
        (str(DATA / "pushed.toml"), None),
        (str(DATA / "loaded.toml"), None),
    ],
)
def test_a_row_has_the_forces_and_the_energy_that_one_motion_alone_has(linkage, scenario):
    """Forces on pins and slides, the work of dampers and drivers, and its error bar are compared with the metrics."""
    mechanism = load(linkage, scenario)
    evaluator = Evaluator(mechanism)
    x = ran(get("lagrange"), mechanism, 5e-3 * np.arange(41), integrator="rk4", step=5e-3)
    found, (evidence,) = figures(mechanism, {}, x.t, x.q[:, None], x.v[:, None], metrics.reactions(evaluator, x)[:, None])
    for name, force in metrics.joint_forces(evaluator, x).items():
        assert found[f"force.{name}"][0] == pytest.approx(np.hypot(force["fx"], force["fy"]).max(), rel=1e-9)
    gain, bar = metrics.energy_error(evaluator, x)
    assert bar > 0
    assert evidence.energy_bar == pytest.approx(bar, rel=1e-3)
    np.testing.assert_allclose(evidence.energy, gain, rtol=0, atol=1e-3 * bar + 1e-12)
    assert evidence.energy_scale == pytest.approx(metrics.energy_scale(evaluator, x), rel=1e-9)
    assert found["loops"][0] == pytest.approx(metrics.drift(evaluator, x).position.max(), rel=1e-6)


def test_ranks_that_rise_together_correlate_wholly_whatever_their_form():
    some = plan(["a=uniform(0,1)", "b=uniform(0,1)", "c=uniform(2,2.0000001)"], 200, seed=1)
    found = sensitivities(some, np.exp(9 * some.values[:, 0]))["rank_correlation"]
    assert found["a"] == pytest.approx(1.0, abs=1e-12)
    assert abs(found["b"]) < 0.2
    assert sensitivities(some, -(some.values[:, 1] ** 3))["rank_correlation"]["b"] == pytest.approx(-1.0, abs=1e-12)
    for count in (7, 8):  # a correlation needs eight samples, which are not all the same
        some = plan([f"gravity.y=1:5:{count}"], None, "random", 0)
        found = {"rank_correlation": {"gravity.y": pytest.approx(1.0)}} if count == 8 else {}
        assert sensitivities(some, np.arange(float(count))) == found
        assert sensitivities(some, np.ones(count)) == {}


@pytest.mark.slow
def test_damping_that_no_sample_sees_is_judged_as_by_every_verb(tmp_path):
    """A block on a stiff spring is at rest after 0.3 ms, between two samples that are a millisecond apart."""
    path = tmp_path / "oscillator.toml"
    path.write_bytes(toml(oscillator(k=8e8, c=4e4)))
    how = Options(until=0.4, step=2e-5, integrator="rk4")
    told = sweep(str(path), ["forces.f.c=4e4:5e4:2"], tmp_path / "s", how=how, where=Backend(jobs=1))
    assert told["engines"]["gauss-native"]["status"] == {"ok": 2}
    for row in rows(tmp_path / "s"):
        assert row["energy_error"] == pytest.approx(0.5 * 8e8 * 0.1**2, rel=1e-6)
        assert "energy is not decidable" in str(row["message"])


@pytest.mark.slow
def test_a_sweep_goes_on_where_it_was_and_no_other_one_does(tmp_path, monkeypatch):
    monkeypatch.setattr("gauss_bench.sweep.run.BATCH", 8)
    folder = tmp_path / "s"
    sweep("crank_slider", VARIED, folder, samples=24, how=SHORT, where=Backend(jobs=1))
    whole = table(folder)
    assert len(whole) == 3
    (folder / PARTS / "part-00000.parquet").unlink()
    damaged = folder / PARTS / "part-00002.parquet"
    damaged.write_bytes(damaged.read_bytes()[:-100])
    (folder / PARTS / ".part-00001.parquet.1.part").write_bytes(b"left by a sweep that was killed")
    told = []
    sweep("crank_slider", VARIED, folder, samples=24, how=SHORT, where=Backend(jobs=2), tell=told.append)
    assert "1 of 3 batches are stored already" in told
    assert table(folder) == whole
    with pytest.raises(SweepError, match="seed was 0, is now 1"):
        sweep("crank_slider", VARIED, folder, samples=24, seed=1, how=SHORT)
    with pytest.raises(SweepError, match="no folder"):
        sweep("crank_slider", VARIED, tmp_path / "no" / "s", samples=24, how=SHORT)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    with pytest.raises(SweepError, match="something other"):
        sweep("crank_slider", VARIED, tmp_path / "mine", samples=24, how=SHORT)
    assert table(folder) == whole


@pytest.mark.slow
def test_what_does_not_assemble_is_a_row_with_its_reason_and_the_verb_prints_the_summary(tmp_path, capsys):
    varied = [x for text in ("links.coupler.length=0.3:2.3:2", "links.crank.kg_per_m=-0.8:0.8:2") for x in ("--vary", text)]
    asked = ["sweep", "four_bar", *varied, "--scenario", "torque", "--until", "0.1", "--out", str(tmp_path / "s"), "--json"]
    assert cli.main(asked) == 0
    found = rows(tmp_path / "s")
    assert [x["status"] for x in found] == ["not_assembled", "ok", "not_assembled", "not_assembled"]
    assert "kg_per_m: must be positive" in str(found[0]["message"])
    assert "cannot be assembled" in str(found[3]["message"])
    assert found[3]["measured"] is None
    summary = json.loads(capsys.readouterr().out)["engines"]["gauss-native"]
    assert summary["status"] == {"not_assembled": 3, "ok": 1}
    assert set(summary["figures"]["measured"]) == {"count", "mean", "deviation", "quantiles"}
    assert (tmp_path / "s" / "summary.svg").read_text().startswith("<?xml")


GAUSS = (("gauss", Choice("default", "rk4", step=1e-3)),)
CASE = SweepCase(json.dumps(DOCUMENT), "paper", "crank_slider", ("gravity.y",), 0.2, GAUSS, 60.0, 1)


def repeated(monkeypatch, count, changes, unit="m", lost=-1):
    """Return the check of `count` samples, some of which change one figure when repeated, and one of which may be lost."""
    pandas = pytest.importorskip("pandas")
    columns = units(load("crank_slider", "paper"))
    moved = next(name for name, x in columns.items() if x == unit)
    table = pandas.DataFrame({"sample": range(count), "status": "ok"} | dict.fromkeys(columns, 1.0))

    def again(case, engine, numbers, values, parts):
        assert parts == 2
        found = {name: np.ones(len(numbers)) for name in columns}
        found[moved] = np.array([1.0 + changes.get(k, 0.0) for k in numbers])
        return found | {"status": ["invalid" if k == lost else "ok" for k in numbers]}

    monkeypatch.setattr(halving, "rows_of", again)
    found = halving.halve(CASE, "gauss", table, np.zeros((count, 1)))
    assert found is not None
    return found


def test_one_sample_in_ten_is_repeated_and_sixteen_at_most(monkeypatch):
    for count, checked in ((1, 1), (10, 1), (11, 2), (150, 15), (160, 16), (1000, 16)):
        found = repeated(monkeypatch, count, {})
        assert (found["samples"], found["worst"]) == (checked, None)


@pytest.mark.parametrize("unit", ["m", "rad"])
def test_a_repetition_may_change_a_fortieth_of_the_size_or_of_a_radian(unit, monkeypatch):
    limit = 0.025 * (load("crank_slider", "paper").size if unit == "m" else 1.0)
    for share, ok in ((0.99, True), (1.01, False)):
        found = repeated(monkeypatch, 20, {0: -share * limit, 19: share * limit / 2}, unit)
        assert (found["ok"], found["worst"], found["lost"]) == (ok, 0, 0)
        assert (found[unit], found["rad" if unit == "m" else "m"]) == (pytest.approx(share * limit), 0.0)
    found = repeated(monkeypatch, 20, {0: 1e-6, 19: 1.0}, unit, lost=19)
    assert (found["ok"], found["worst"], found["lost"], found[unit]) == (False, 0, 1, pytest.approx(1e-6))


def test_the_default_integrator_and_step_of_an_engine():
    needs("llvmlite")
    for case in CASES["steps"]:
        how = Options(stabilization="none", **case.get("options", {}))
        choice = _choice(case["engine"], how, until=1.0)
        assert (choice.integrator, choice.step) == (case["integrator"], case["step"])
        if how.step is None:
            assert _choice(case["engine"], how, until=1e-4).step == 1e-4


def test_batches_are_large_where_one_call_takes_them():
    native, other = (_batches(513, [engine]) for engine in ("gauss-native", "gauss"))
    assert [(x.number, x.first, x.end) for x in native] == [(0, 0, 512), (1, 512, 513)]
    assert [x.size for x in other] == [8] * 64 + [1]
    assert [x.number for x in _batches(9, ["gauss", "lagrange"])] == [0, 1, 2, 3]
    assert replace(CASE, jobs=9) == CASE != replace(CASE, until=0.3)  # threads change no row


def test_a_summary_of_known_rows():
    """Four samples are ok and have the values 1, 2, 3 and 4; a fifth is not."""
    pandas = pytest.importorskip("pandas")
    some = plan(["gravity.y=1:5:5"], None, "random", 0)
    table = pandas.DataFrame({"sample": range(5), "engine": "gauss", "y": [1.0, 2.0, 3.0, 4.0, 99.0]})
    table["status"], table["message"] = ["ok"] * 4 + ["invalid"], ["", "", "", "", "why"]
    found = summary(table, some, ["y"])["gauss"]
    assert (found["samples"], found["status"], found["reasons"]) == (5, {"invalid": 1, "ok": 4}, {"why": 1})
    y = found["figures"]["y"]
    assert (y["count"], y["mean"], y["quantiles"]["0.5"], y["quantiles"]["1"]) == (4, 2.5, 2.5, 4.0)
    assert [*y["quantiles"]] == ["0", "0.05", "0.25", "0.5", "0.75", "0.95", "1"]
    assert y["deviation"] == pytest.approx(np.sqrt(5 / 3))
    assert "rank_correlation" not in y  # of fewer than eight samples
    alone = summary(table[table["sample"] == 0], some, ["y"])["gauss"]["figures"]["y"]
    assert (alone["count"], alone["deviation"]) == (1, 0.0)
    # dependences in words begin with the strongest
    sobol = {"a": {"first": 0.1, "total": 0.2}, "b": {"first": 0.3, "total": 0.4}}
    assert _dependence({"sobol": sobol}) == "b 0.30/0.40, a 0.10/0.20"
    assert _dependence({"rank_correlation": {"a": 0.5, "b": -0.75}}) == "b -0.75, a +0.50"


def test_a_kernel_leaves_open_what_no_welded_body_holds():
    for case in CASES["open"]:
        family = Family(DOCUMENT, "paper", [case["path"]], "crank_slider")
        family.document = DOCUMENT | ({"welds": {}} if case.get("welds") else {})
        assert family.not_open == (f"{case['path']} {case['said']}" if "said" in case else "")


@pytest.mark.long
def test_an_engine_that_chooses_its_steps_is_repeated_at_a_tighter_tolerance(tmp_path):
    how = Options(until=1.0, integrator="dop853", settings="dop853_rtol=1e-9,dop853_atol=1e-9")
    found = sweep("pendulum", ["gravity.1=-9:-10:12"], tmp_path / "s", ["gauss"], how=how, where=Backend(jobs=1))
    check = found["engines"]["gauss"]["half_the_step"]
    assert (check["how"], check["ok"], check["samples"]) == ("a tighter tolerance", True, 2)
    assert check["rad"] < 1e-6


@pytest.mark.slow
def test_an_engine_in_a_worker_moves_as_the_native_code_does(tmp_path):
    pytest.importorskip("mujoco")
    how = replace(SHORT, until=0.05, step=1e-4, stabilization=None)
    sweep("crank_slider", VARIED, tmp_path / "s", ["gauss-native", "mujoco"], 2, how=how)
    found = rows(tmp_path / "s")
    assert [x["engine"] for x in found] == ["gauss-native"] * 2 + ["mujoco"] * 2
    for one, other in zip(found[:2], found[2:], strict=True):
        assert other["slider.B.x_max"] == pytest.approx(one["slider.B.x_max"], abs=1e-3)


@pytest.mark.long
def test_a_cluster_that_loses_a_worker_writes_the_same_table(tmp_path):
    """A scheduler with two worker processes, one of which is killed in the middle of the run."""
    distributed = pytest.importorskip("distributed")
    asked = {"engines": ["gauss"], "samples": 32, "how": replace(SHORT, until=0.05)}
    sweep("crank_slider", VARIED, tmp_path / "local", where=Backend(jobs=1), **asked)
    options = {"n_workers": 2, "threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
    killed = []

    with distributed.LocalCluster(**options) as cluster:
        address = cluster.scheduler_address

        def kill_one():
            parts = tmp_path / "dask" / PARTS
            while not (parts.is_dir() and any(parts.glob("part-*"))):  # one batch is done, others are under way
                time.sleep(0.01)
            pid = cluster.workers[0].pid
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)

        thread = threading.Thread(target=kill_one, daemon=True)
        thread.start()
        sweep("crank_slider", VARIED, tmp_path / "dask", where=Backend("dask", address), **asked)
        thread.join(10.0)
    assert killed
    assert table(tmp_path / "dask") == table(tmp_path / "local")


INTERRUPTIBLE = """
import signal, sys
from gauss_bench import cli
signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever the tests were started by
sys.exit(cli.command())
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("how", "before"), [(signal.SIGINT, "others"), (signal.SIGKILL, "others"), (signal.SIGKILL, "its first task")]
)
def test_a_sweep_that_is_broken_off_says_nothing_else_and_leaves_no_process(how, before, tmp_path):
    asked = ["sweep", "crank_slider", "--vary", "links.rod.mass=0.7:0.8:4000", "--engine", "gauss", "--until", "0.2", "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, *asked, "--out", str(tmp_path / "s")],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"SIGN_OF_A_SWEEP": str(tmp_path)},
    )
    sign = f"SIGN_OF_A_SWEEP={tmp_path}".encode()

    def under_way():
        if before == "others":
            return any((tmp_path / "s" / PARTS).glob("part-*"))
        return any(b"LokyProcess" in Path(f"/proc/{pid}/cmdline").read_bytes() for pid in alive(sign))

    while process.poll() is None and not under_way():
        time.sleep(0.02)
    process.send_signal(how)
    _, said = process.communicate(timeout=60)
    if how is signal.SIGINT:
        assert process.returncode == 130
        told = [x for x in said.splitlines() if " of 4000 samples, " not in x]
        assert told == ["4000 samples to run", "interrupted; finished cases are kept"]
    until = time.monotonic() + 30.0
    while left := alive(sign):
        assert time.monotonic() < until, left
        time.sleep(0.1)
