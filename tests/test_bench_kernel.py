"""The kernel suite: targets are held the right way round, a miss is told, and its report needs its tables alone."""

import math
from pathlib import Path

import numpy as np
import pytest

from gauss_bench.bench.clock import Key, Measured, at_least, at_most, prediction_interval
from gauss_bench.bench.measurements import growth
from gauss_bench.bench.measurements.growth import exponents, summarise_races
from gauss_bench.bench.measurements.processor import CHAINS, chain_text
from gauss_bench.bench.measurements.rivals import step_rows
from gauss_bench.bench.runner import run
from gauss_bench.bench.tasks import Context
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.report.build import all_findings, build_report, read_run
from gauss_bench.report.rows import Run
from gauss_bench.suites.read import read_suite, restrict
from gauss_bench.tables import TABLES, read_table, write_table
from gauss_bench.verbs.suites import format_run
from tests.engine_runs import moved

SUITE = read_suite("kernel")


def small():
    """The kernel suite on the four-bar alone, with less of everything."""
    suite = restrict(SUITE, {"four_bar": "torque"})
    engines = ("gauss", "gauss-native", "lagrange-native", "mujoco", "pinocchio")
    less = {
        "cost": {"rounds": 2, "integrators": 1, "engines": engines},
        "claim": {"processes": 2, "rounds": 2},
        "agreement": {"states": 20},
        "long_runs": {"duration": 0.5},
        "turns": {"rounds": 2, "samples": 360},
        "growth": {"sizes": (1, 4), "processes": 1, "rounds": 2, "large": 1},
    }
    # chains of four-bars are no named linkage: `restrict` leaves them out
    suite = suite.model_copy(update={"growth": SUITE.growth})
    parts = {name: tuple(x.model_copy(update=y) for x in getattr(suite, name)) for name, y in less.items()}
    batch = SUITE.batch[0].model_copy(update={"linkages": {"four_bar": "torque"}, "states": 64, "rounds": 2, "processes": 1})
    return suite.model_copy(update=parts | {"batch": (batch,)})


@pytest.mark.long
def test_a_small_run_fails_nowhere(tmp_path):
    run(small(), tmp_path, 2, name="kernel")
    tables = {name: read_table(name, tmp_path) for name in TABLES if name.startswith("kernel_")}
    for name, rows in tables.items():
        assert rows, name
        assert all(row.get("status", "ok") in ("ok", "skip") for row in rows), name
    for row in tables["kernel_steps"] + tables["kernel_rhs"]:
        assert 0 < row["seconds_low"] <= row["seconds"] <= row["seconds_high"] < 1e-2
        assert row["ratio_low"] <= row["ratio"] * (1 + 1e-9)
        assert row["ratio"] <= row["ratio_high"] * (1 + 1e-9)
    assert all(0 < row["share"] < 1 for row in tables["kernel_bounds"])


def test_targets_are_held_the_right_way_round():
    """What was not measured, or is no number, has met nothing."""
    rows = [{"x": 0.5}, {"x": 1.0}, {"x": 2.0}, {"status": "error"}, {"x": math.nan}]
    assert [at_least(row, "x", 1.0)["met"] for row in rows] == [False, True, True, False, False]
    assert [at_most(row, "x", 1.0)["met"] for row in rows] == [True, True, False, False, False]
    assert "met" not in at_least({"x": 0.5}, "x", None)


@pytest.mark.parametrize(("slower", "met"), [(1.0, True), (3.0, False)])
def test_a_slower_kernel_misses_its_target(slower, met):
    """MuJoCo at 100 times a step of the kernel: enough for 80 times; planted three times slower it is not."""
    own = {
        Key("native_step", f, stabilization=s): np.full(9, slower * 1e-7)
        for f in ("gauss-native", "lagrange-native")
        for s in ("none", "projection")
    }
    rivals = {Key("native_step", "mujoco", s): np.full(9, 1e-5) for s in ("tuned", "default")}
    rows = step_rows(("crank_slider", "paper"), SUITE.steps[0], 1e-4, Measured({**own, **rivals}, {}))
    aimed = [row for row in rows if row["formulation"] == "gauss" and row["stabilization"] == "none"]
    assert len(aimed) == 2
    assert all(row["met"] is met and row["target"] == 80.0 for row in aimed)
    assert all(row["ratio"] == pytest.approx(100 / slower) for row in aimed)
    assert all("met" not in row for row in rows if row["formulation"] == "lagrange")
    told = format_run({"kernel_steps": rows}, Path("out"))
    assert ("missed: crank_slider paper gauss" in told) is not met


def of_process(number, size, seconds, engine="a"):
    told = {"engine": engine, "quantity": "q", "size": size, "process": number, "n": 9 * size, "status": "ok", "message": ""}
    times = {"seconds": seconds, "seconds_low": 0.9 * seconds, "seconds_high": 1.1 * seconds}
    return told | times | {"generate_seconds": 1.0 + number, "compile_seconds": 2.0, "error": 1e-15 * number}


def test_growth_is_the_exponent_of_large_sizes_and_its_spread_is_that_of_the_processes():
    """Exponents 0.9, 1.0 and 1.1: Student's t of 2 freedoms at 0.995 is 9.925, the scatter 0.1 (pi / 3)^(1/2)."""
    large, lost = (16, 64, 256), {"engine": "b", "quantity": "", "size": 256, "process": 0, "status": "skip"}
    rows = [of_process(0, n, 1.0 if n < 16 else 1e-9 * n**1.5) for n in (1, 4, *large)]
    (alone,) = exponents([*rows, lost], 16)
    assert (alone["exponent"], alone["sizes"], alone["processes"]) == (pytest.approx(1.5), 3, 1)
    assert np.isnan(alone["exponent_low"])  # rounds of one process say nothing of a second race
    (several,) = exponents([of_process(k, n, 1e-9 * n**p) for k, p in enumerate((0.9, 1.0, 1.1)) for n in large], 16)
    half = 9.924843 * 0.1 * np.sqrt(np.pi / 3)
    spread = [several[f"exponent{end}"] for end in ("", "_low", "_high")]
    assert spread == pytest.approx([1.0, 1 - half, 1 + half], abs=1e-6)
    assert several["processes"] == 3
    # a process that lacks a size tells no exponent of its own
    (fewer,) = exponents([of_process(k, n, 1e-9 * n) for k in range(3) for n in large if (k, n) != (2, 256)], 16)
    assert (fewer["exponent"], fewer["processes"]) == (pytest.approx(1.0), 2)


def test_the_time_of_a_size_is_the_median_of_processes_and_its_spread_where_a_second_race_falls():
    lost = {"engine": "b", "quantity": "", "size": 16, "n": 144, "status": "crashed", "message": "SIGSEGV"}
    rows = [of_process(k, 16, x) for k, x in enumerate((1.0, 1.2, 1.1))] + [lost | {"process": k} for k in range(3)]
    found, gone = summarise_races(rows)
    assert [found["seconds"], found["low"], found["high"]] == [pytest.approx(1.1), *prediction_interval(np.array([1.0, 1.2, 1.1]))]
    assert (found["processes"], found["generate_seconds"], found["error"]) == (3, 2.0, 2e-15)
    assert gone == lost | {"processes": 0}
    (single,) = summarise_races(rows[:1])
    assert [single["low"], single["high"]] == [0.9, 1.1]


def test_every_size_is_raced_in_every_process_and_those_of_one_lie_apart():
    part = SUITE.growth[0].model_copy(update={"sizes": (1, 4), "processes": 3})
    tasks = growth.timing_tasks(SUITE.model_copy(update={"growth": (part,)}), Context("", "stamp"), {})
    assert [(t.start["size"], t.start["process"]) for t in tasks] == [(n, k) for k in range(3) for n in (1, 4)]
    assert len({t.key for t in tasks}) == 6


def test_the_chain_that_measures_the_processor_has_as_many_operations_as_it_says():
    text = chain_text(CHAINS, 4, 2)
    assert text.count("= call <2 x double> @llvm.fma.v2f64") == 4 * CHAINS


def test_a_batch_in_mujoco_steps_every_state_as_a_single_run_does():
    mechanism = load("crank_slider", "paper")
    model = get("mujoco").build(mechanism, Choice("tuned", "rk4", "none", 1e-4))
    moved(model, [0.0, 5e-3])
    q, v = (np.tile(x, (3, 1)) for x in (mechanism.q0, mechanism.v0))
    ends = model.batch(q, v, 50)()
    for end in ends:
        np.testing.assert_array_equal(end, [model.y[-1], model.dy[-1]])


def test_the_bare_call_of_pinocchio_gives_the_adapters_accelerations():
    mechanism = load("four_bar", "torque")
    model = get("pinocchio").build(mechanism, Choice("default", "rk4", "none", 1e-4))
    y, dy = model.tree.relative(mechanism.q0, mechanism.v0)
    bare, empty = model.bare_calls()
    found = model.tree.absolute(y, dy, np.array(bare()))[2]
    # one proximal iteration more or less: its last change is 1e-14 of the acceleration
    np.testing.assert_allclose(found, model.acceleration(0.0, mechanism.q0, mechanism.v0), rtol=1e-10, atol=1e-10)
    assert empty().shape == y.shape


@pytest.mark.long
def test_the_report_of_a_run_in_which_everything_failed_tells_why(tmp_path):
    row = {"mechanism": "four_bar", "scenario": "torque", "status": "crashed", "message": "the process died with signal SIGSEGV"}
    for name in TABLES:
        if name.startswith("kernel_") or name == "scaling":
            known = {k: x for k, x in row.items() if k in TABLES[name].names}
            write_table(name, [known] if "status" in known else [], tmp_path)
    build_report(tmp_path)
    pages = [(tmp_path / "site" / f"{name}.html").read_text() for name in ("papers", "kernel")]
    assert "".join(pages).count("SIGSEGV") >= 8
    assert any(finding.tone == "bad" for finding in all_findings(read_run(tmp_path)))


def test_a_miss_is_the_first_thing_the_findings_say():
    row = {"mechanism": "six_bar", "formulation": "gauss", "stabilization": "none", "settings": "tuned", "status": "ok"}
    met = row | {"ratio": 60.0, "target": 48.0, "met": True}
    for planted, tone in ((met, "good"), (met | {"ratio": 30.0, "met": False}, "bad")):
        found = next(all_findings(Run({}, {"kernel_steps": (planted,)})))
        assert found.tone == tone
        assert ("six_bar" in found.text and "30.0, target 48.0" in found.text) is (tone == "bad")
