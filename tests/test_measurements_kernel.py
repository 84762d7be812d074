"""What the kernel suite makes of known costs: every divisor, ratio and bound, with kernels and rivals whose time is given."""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gauss_bench.bench.clock import Key, Measured, compare, prediction_interval
from gauss_bench.bench.measurements import claim, limits
from gauss_bench.bench.measurements.batch import race_batch
from gauss_bench.bench.measurements.cost import BARE, race_cost
from gauss_bench.bench.measurements.growth import CONTENDERS, exact_state, race_growth
from gauss_bench.bench.measurements.limits import compare_with_bound
from gauss_bench.bench.measurements.long_runs import judge_row
from gauss_bench.bench.measurements.processor import LATENCY_KEY, RATE_KEY, processor_rows
from gauss_bench.bench.measurements.rivals import rhs_rows
from gauss_bench.bench.measurements.turns import race_turns
from gauss_bench.bench.runner import complete_rows
from gauss_bench.compiler.closure import Closure
from gauss_bench.compiler.kernel import Kernel
from gauss_bench.compiler.machine import native_code
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.compiled import CompiledModel
from gauss_bench.linkage.load import load
from gauss_bench.suites.read import read_suite
from gauss_bench.suites.schema import Cost
from tests.engine_runs import moved
from tests.synthetic import Costs, charge, replace_engine, rolled

Rows = list[dict[str, Any]]
SUITE = read_suite("kernel")
BATCH = SUITE.batch[0].model_copy(update={"states": 64, "rounds": 3, "processes": 1})
TURNS = SUITE.turns[0].model_copy(update={"rounds": 3, "samples": 360, "processes": 1})
LONG = SUITE.long_runs[0]


@pytest.mark.parametrize("off", [0.0, 2e-3])
def test_a_batch_is_compared_by_the_step_of_one_trajectory_and_its_lanes_with_single_runs(off, clock, monkeypatch):
    """The kernel takes 10 ns for a step of a trajectory, MuJoCo 3 us: 300 times as long, however many steps each is given.

    Lanes of the kernel end `off` away from where single runs end.
    """
    true = Kernel.rollout

    def disturbed(self, q, v, *rest, **options):
        ends, speeds = true(self, q, v, *rest, **options)
        return (ends + off if q.ndim == 2 else ends), speeds

    monkeypatch.setattr(Kernel, "rollout", disturbed)
    charge(monkeypatch, clock, Kernel, "rollout", rolled(10e-9))
    replace_engine(monkeypatch, "mujoco", clock, Costs(native_step=3e-6))
    (row,) = race_batch("crank_slider", "paper", BATCH)["kernel_batch"]
    assert (row["seconds"], row["rival_seconds"], row["ratio"]) == pytest.approx((10e-9, 3e-6, 300.0))
    assert (row["met"], row["lost"]) == (False, 0)
    assert row["lanes_error"] == pytest.approx(off)


STEP, CALL = 4e-6, 5e-6  # [s] of the kernel: a step of Runge and Kutta, an acceleration from Python
MUJOCO, PINOCCHIO, EMPTY = 200e-6, 12e-6, 2e-6  # [s] of rivals: a step, constraintDynamics, a call of nothing


def test_steps_right_hand_sides_and_batches_are_counted_as_what_they_are(clock, monkeypatch):
    """A step of the kernel takes 4 us, so that one of its four stages takes 1 us; of 12 us of constraintDynamics 2 are the call."""
    charge(monkeypatch, clock, Kernel, "rollout", rolled(STEP))
    charge(monkeypatch, clock, Kernel, "acceleration", lambda *arguments, **options: CALL)
    charge(monkeypatch, clock, CompiledModel, "__init__", lambda *arguments: 5e-3)
    replace_engine(monkeypatch, "mujoco", clock, Costs(native_step=MUJOCO))
    replace_engine(monkeypatch, "pinocchio", clock, Costs(acceleration=PINOCCHIO, call=EMPTY))
    both = ("gauss-native", "lagrange-native")
    more = {"batch": both, "bare": ("pinocchio",), "processor": True}
    part = Cost(linkages={}, engines=(*both, "mujoco", "pinocchio"), integrators=1, step=1e-4, rounds=2, **more)
    tables = race_cost("four_bar", "torque", part) | limits.count_operations("four_bar", "torque")
    complete_rows(SUITE, tables)
    assert not tables["untimed"]
    assert {*Counter(tuple(row[x] for x in Key._fields) for row in tables["samples"]).values()} == {part.rounds}
    for row in tables["kernel_steps"]:
        assert (row["seconds"], row["rival_seconds"], row["ratio"]) == pytest.approx((STEP, MUJOCO, 50.0))
    known = {
        ("in its own loop", "as called"): (1e-6, 12e-6, 12.0),
        ("in its own loop", "less the call"): (1e-6, 10e-6, 10.0),
        ("called from Python", "as called"): (5e-6, 12e-6, 2.4),
        ("called from Python", "less the call"): (5e-6, 10e-6, 2.0),
    }
    assert len(tables["kernel_rhs"]) == 8
    for row in tables["kernel_rhs"]:
        assert (row["seconds"], row["rival_seconds"], row["ratio"]) == pytest.approx(known[row["own"], row["rival"]])
    (batch,) = (row for row in tables["kernel_bounds"] if row["quantity"] == "a batch")
    assert batch["seconds"] == pytest.approx(STEP)  # of one trajectory


def test_a_call_that_costs_more_than_what_it_calls_leaves_no_negative_time():
    keys = {Key("native_step", "gauss-native"): STEP, Key("acceleration", "gauss-native"): CALL}
    for settings in ("default", "one_iteration"):
        keys |= {Key(BARE, "pinocchio", settings): 1e-6, Key("empty call", "pinocchio", settings): 2e-6}
    rows = rhs_rows(("four_bar", "torque"), SUITE.right_hand_side[0], Measured({key: np.full(5, x) for key, x in keys.items()}, {}))
    net = [row for row in rows if row["rival"] == "less the call"]
    assert len(net) == 4
    assert all(0 < row["rival_seconds"] < 1e-8 for row in net)


CLAIM = SUITE.claim[0].model_copy(update={"rounds": 3, "linkages": {}})


def test_a_race_of_the_claim_times_each_pair_as_it_should_be(clock, monkeypatch):
    """Few unknowns: 2 us a step, 4 with projection, 10 ns in a batch; many: 3, 5 and 40."""
    seconds = {("gauss", "none"): 2e-6, ("gauss", "projection"): 4e-6, ("lagrange", "none"): 3e-6, ("lagrange", "projection"): 5e-6}
    true = Kernel.rollout

    def charged(self, q, v, h, n, *rest, **options):
        formulation = self.options.formulation
        each = seconds[formulation, self.options.stabilization] if q.ndim == 1 else {"gauss": 1e-8, "lagrange": 4e-8}[formulation]
        clock.spend(each * n * len(np.atleast_2d(q)))
        return true(self, q, v, h, n, *rest, **options)

    monkeypatch.setattr(Kernel, "rollout", charged)
    rows = claim.race_claim("four_bar", "torque", CLAIM, 3)["claim_races"]
    told = {r["what"]: [r["seconds"], r["rival_seconds"], r["ratio"], r["process"]] for r in rows}
    expected = {"step": [2e-6, 3e-6, 1.5, 3], "projected": [4e-6, 5e-6, 1.25, 3], "batch": [1e-8, 4e-8, 4.0, 3]}
    assert told == {what: pytest.approx(numbers) for what, numbers in expected.items()}


def raced(**ratios):
    """The races of a linkage: for each thing that is raced the ratio of every process."""
    return [{"what": what, "status": "ok", "message": "", "ratio": x} for what, values in ratios.items() for x in values]


def test_the_claim_is_the_median_of_processes_and_its_spread_where_a_second_race_falls():
    start = {"mechanism": "four_bar", "scenario": "torque"}
    row = claim.claim_row(start, raced(step=[1.5, 1.4, 1.6, 1.45, 1.55], projected=[0.97, 1.02, 1.01], batch=[0.7, 0.71, 0.69]))
    spreads = [prediction_interval(np.array(x)) for x in ([1.5, 1.4, 1.6, 1.45, 1.55], [0.97, 1.02, 1.01])]
    assert [row[x] for x in ("ratio", "ratio_low", "ratio_high")] == [1.5, *spreads[0]]
    assert [row[f"projected_{x}"] for x in ("ratio", "ratio_low", "ratio_high")] == [1.01, *spreads[1]]
    assert [row[f"{x}verdict"] for x in ("", "projected_", "batch_")] == ["holds", "open", "reversed"]
    assert (row["status"], row["processes"]) == ("ok", 5)
    lost = claim.claim_row(start, [{"what": "step", "status": "crashed", "message": "SIGSEGV"}])
    assert (lost["status"], lost["message"], lost["processes"]) == ("crashed", "SIGSEGV", 0)
    assert claim.claim_row(start, [])["status"] == "skip"


def samples(**seconds):
    own = {"step": Key("native_step", "gauss-native"), "batch": Key("batch step", "gauss-native")}
    keys = own | {"latency": LATENCY_KEY, "rate": RATE_KEY}
    return Measured({keys[name]: np.full(5, x) for name, x in seconds.items()}, {})


def test_the_latency_of_a_multiply_add_gives_the_length_of_a_cycle():
    """Four cycles take 2 ns, so one takes 0.5 ns; a vector of multiply-adds in 1 ns is two operations a lane."""
    rows = {row["key"]: row["value"] for row in processor_rows(samples(latency=2e-9, rate=1e-9))}
    assert rows["latency"] == pytest.approx(2e-9)
    assert rows["cycle"] == pytest.approx(0.5e-9)
    assert rows["rate"] == pytest.approx(2 * native_code.best_lanes() / 1e-9)


def test_a_step_cannot_be_shorter_than_its_chain_nor_a_batch_than_its_operations():
    measured = samples(step=1e-6, batch=1e-7, latency=4e-9, rate=1e-9)  # a cycle of 1 ns
    starts = limits.count_operations("four_bar", "torque")["kernel_bounds"]
    one, many = (start | compare_with_bound(start, "gauss-native", measured) for start in starts)
    assert one["bound"] == pytest.approx(one["cycles"] * 1e-9)
    assert one["share"] == pytest.approx(one["bound"] / 1e-6)
    assert many["bound"] == pytest.approx(many["flops"] * 1e-9 / (2 * native_code.best_lanes()))
    assert many["share"] == pytest.approx(many["bound"] / 1e-7)


@pytest.mark.parametrize("off", [0.0, 1e-10])
def test_kinematics_tell_positions_per_second_and_meet_no_target_if_they_are_wrong(off, clock, monkeypatch):
    """A position takes 50 ns: twenty million a second. One acceleration is off by a share of the largest."""
    true = Closure.turn

    def turn(self, *arguments, **options):
        found = true(self, *arguments, **options)
        a = found.a.copy()
        a[7, 5] += off * np.abs(a).max()
        return replace(found, a=a)

    monkeypatch.setattr(Closure, "turn", turn)
    charge(monkeypatch, clock, Closure, "turn", lambda samples: samples * 50e-9)
    own, plain = race_turns("four_bar", "driven", TURNS)["kernel_kinematics"]
    assert (own["seconds"], own["rate"]) == pytest.approx((50e-9, 20e6))
    assert own["met"] is (off == 0.0)
    assert own["acceleration_error"] == pytest.approx(off, rel=0.01, abs=1e-12)
    assert max(own["position_error"], own["velocity_error"]) < 1e-12
    assert plain["status"] == "ok"


def test_growth_counts_four_right_hand_sides_to_a_step(clock, monkeypatch):
    charge(monkeypatch, clock, Kernel, "rollout", rolled(STEP))
    charge(monkeypatch, clock, Kernel, "acceleration", lambda *arguments, **options: CALL)
    for name in list(CONTENDERS):
        if not name.endswith("-native"):
            monkeypatch.delitem(CONTENDERS, name)
    rows = race_growth(1, 3, 0, ())["scaling_races"]
    assert len(rows) == 4
    for row in rows:
        assert row["seconds"] == pytest.approx(STEP / 4 if row["quantity"] == "in its own loop" else CALL)
        assert row["error"] < 1e-12


def test_the_error_of_an_acceleration_is_relative_to_the_largest_true_one():
    wanted = exact_state(1)
    assert wanted.error(1.001 * wanted.a) == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize("column", ["position_drift", "velocity_drift"])
@pytest.mark.parametrize(
    ("order", "drift", "met"),
    [
        (4.0, 0.9e-13, True),
        (3.85, 1e-16, True),
        (3.7, 1e-16, False),
        (3.0, 1e-16, False),
        (6.0, 1e-16, True),
        (4.0, 1.1e-13, False),
    ],
)
def test_a_long_run_drifts_by_rounding_and_its_energy_error_falls_with_order_four_within_a_fifth(order, drift, met, column):
    coarse = {"status": "ok", "position_drift": 1e-16, "velocity_drift": 1e-16, "energy_max": 1e-6}
    found = judge_row(coarse | {"energy_max": 1e-6 / 2**order, column: drift}, coarse, LONG)
    assert found["order"] == pytest.approx(order)
    assert found["met"] is met


def test_only_rounds_that_both_have_are_compared_and_a_time_has_one_value():
    """A slow one sat the later rounds out, in which the machine was slower."""
    long, short = np.array([1.0, 1.0, 9.0, 9.0, 9.0, 9.0]), np.array([5.0, 5.0])
    row, turned = compare(long, short), compare(short, long)
    assert row["ratio"] == 5.0
    assert row["seconds"] == turned["rival_seconds"] == 3.0  # the lower quartile of all rounds, whoever it is compared with
    assert row["rival_seconds"] == turned["seconds"] == 5.0


def test_mujocos_rigid_setting_spends_no_more_iterations_than_three():
    """One already gives the motion to the digits that the closures' softness leaves: more would only cost the rival time."""
    mechanism = load("four_bar", "torque")
    model = get("mujoco").build(mechanism, Choice("rigid", "rk4", "none", 1e-3))
    moved(model, [0.0, 0.1])
    assert 1 <= model.data.solver_niter.max() <= 3
    assert model.model.opt.iterations == get("mujoco").settings["rigid"]["iterations"]
