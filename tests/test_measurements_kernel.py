"""What the kernel suite makes of known costs: every divisor, ratio and bound, with kernels and rivals whose time is given."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gauss_bench.bench.clock import Key, Measured, compare, foreseen
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
from gauss_bench.bench.survived import ROOM, at_work, race_here
from gauss_bench.compiler.closure import Closure
from gauss_bench.compiler.kernel import Kernel
from gauss_bench.compiler.machine import native_code
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.compiled import CompiledModel
from gauss_bench.linkage.load import load
from gauss_bench.suites.read import read_suite
from gauss_bench.suites.schema import Cost
from tests.synthetic import Clock, Costs, charge, clocked, replace_engine, rolled

Rows = list[dict[str, Any]]
SUITE = read_suite("kernel")
BATCH = SUITE.batch[0].model_copy(update={"states": 64, "rounds": 3, "processes": 1})
TURNS = SUITE.turns[0].model_copy(update={"rounds": 3, "samples": 360, "processes": 1})
LONG = SUITE.long_runs[0]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return clocked(monkeypatch)


def only(rows: Rows, **values: Any) -> dict[str, Any]:
    (found,) = (row for row in rows if all(row[k] == x for k, x in values.items()))
    return found


def test_a_batch_is_compared_by_the_step_of_one_trajectory(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel takes 10 ns for a step of a trajectory, MuJoCo 3 us: 300 times as long, however many steps each is given."""
    charge(monkeypatch, clock, Kernel, "rollout", rolled(10e-9))
    replace_engine(monkeypatch, "mujoco", clock, Costs(native_step=3e-6))
    (row,) = race_batch("crank_slider", "paper", BATCH, race_here)["kernel_batch"]
    assert (row["seconds"], row["rival_seconds"]) == pytest.approx((10e-9, 3e-6))
    assert row["ratio"] == pytest.approx(300.0)
    assert row["met"] is False
    assert (row["lanes_error"], row["lost"]) == (0.0, 0)


def test_lanes_that_disturb_each_other_are_told(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel whose lanes end 2e-3 away from where single runs end."""
    true = Kernel.rollout

    def disturbed(self: Kernel, q: np.ndarray, v: np.ndarray, *rest: Any, **options: Any) -> tuple[np.ndarray, np.ndarray]:
        ends, speeds = true(self, q, v, *rest, **options)
        return (ends + 2e-3 if q.ndim == 2 else ends), speeds

    monkeypatch.setattr(Kernel, "rollout", disturbed)
    charge(monkeypatch, clock, Kernel, "rollout", rolled(10e-9))
    replace_engine(monkeypatch, "mujoco", clock)
    (row,) = race_batch("crank_slider", "paper", BATCH, race_here)["kernel_batch"]
    assert row["lanes_error"] == pytest.approx(2e-3)


STEP, CALL = 4e-6, 5e-6  # [s] of the kernel: a step of Runge and Kutta, an acceleration from Python
MUJOCO, PINOCCHIO, EMPTY = 200e-6, 12e-6, 2e-6  # [s] of rivals: a step, constraintDynamics, a call of nothing


@pytest.fixture(scope="module")
def costs() -> dict[str, Rows]:
    with pytest.MonkeyPatch.context() as patched:
        clock = clocked(patched)
        charge(patched, clock, Kernel, "rollout", rolled(STEP))
        charge(patched, clock, Kernel, "acceleration", lambda *arguments, **options: CALL)
        charge(patched, clock, CompiledModel, "__init__", lambda *arguments: 5e-3)
        replace_engine(patched, "mujoco", clock, Costs(native_step=MUJOCO))
        replace_engine(patched, "pinocchio", clock, Costs(acceleration=PINOCCHIO, call=EMPTY))
        engines = ("gauss-native", "lagrange-native", "mujoco", "pinocchio")
        both = ("gauss-native", "lagrange-native")
        part = Cost(
            linkages={}, engines=engines, integrators=1, step=1e-4, rounds=2, batch=both, bare=("pinocchio",), processor=True
        )
        found: dict[str, Rows] = race_cost("four_bar", "torque", part, race=race_here)
        found |= limits.count_operations("four_bar", "torque")
    complete_rows(SUITE, found)
    return found


@pytest.mark.long
def test_a_step_is_compared_with_a_step(costs: dict[str, Rows]) -> None:
    for row in costs["kernel_steps"]:
        assert (row["seconds"], row["rival_seconds"]) == pytest.approx((STEP, MUJOCO))
        assert row["ratio"] == pytest.approx(50.0)


@pytest.mark.slow
def test_a_right_hand_side_is_a_quarter_of_a_step_of_runge_and_kutta(costs: dict[str, Rows]) -> None:
    """The step takes 4 us, so that one of its four stages takes 1 us; constraintDynamics 12 us, of which 2 us are the call."""
    known = {
        ("in its own loop", "as called"): (1e-6, 12e-6, 12.0),
        ("in its own loop", "less the call"): (1e-6, 10e-6, 10.0),
        ("called from Python", "as called"): (5e-6, 12e-6, 2.4),
        ("called from Python", "less the call"): (5e-6, 10e-6, 2.0),
    }
    assert len(costs["kernel_rhs"]) == 8
    for row in costs["kernel_rhs"]:
        assert (row["seconds"], row["rival_seconds"], row["ratio"]) == pytest.approx(known[row["own"], row["rival"]])


def test_a_call_that_costs_more_than_what_it_calls_leaves_no_negative_time() -> None:
    keys = {Key("native_step", "gauss-native"): STEP, Key("acceleration", "gauss-native"): CALL}
    for settings in ("default", "one_iteration"):
        keys |= {Key(BARE, "pinocchio", settings): 1e-6, Key("empty call", "pinocchio", settings): 2e-6}
    rows = rhs_rows(("four_bar", "torque"), SUITE.right_hand_side[0], Measured({key: np.full(5, x) for key, x in keys.items()}, {}))
    net = [row for row in rows if row["rival"] == "less the call"]
    assert len(net) == 4
    assert all(0 < row["rival_seconds"] < 1e-8 for row in net)


CLAIM = SUITE.claim[0].model_copy(update={"rounds": 3, "linkages": {}})


def test_a_race_of_the_claim_times_each_pair_as_it_should_be(clock: Clock, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Few unknowns: 2 us a step, 4 with projection, 10 ns in a batch; many: 3, 5 and 40."""
    seconds = {("gauss", "none"): 2e-6, ("gauss", "projection"): 4e-6, ("lagrange", "none"): 3e-6, ("lagrange", "projection"): 5e-6}
    true = Kernel.rollout

    def charged(self: Kernel, q: np.ndarray, v: np.ndarray, h: float, n: int, *rest: Any, **options: Any) -> Any:
        formulation = self.options.formulation
        each = seconds[formulation, self.options.stabilization] if q.ndim == 1 else {"gauss": 1e-8, "lagrange": 4e-8}[formulation]
        clock.spend(each * n * len(np.atleast_2d(q)))
        return true(self, q, v, h, n, *rest, **options)

    monkeypatch.setattr(Kernel, "rollout", charged)
    memory = tmp_path / "memory"
    memory.write_bytes(bytes(ROOM))
    rows = claim.race_claim("four_bar", "torque", CLAIM, 3, partial(race_here, path=str(memory)))["claim_races"]
    told = {r["what"]: [r["seconds"], r["rival_seconds"], r["ratio"], r["process"]] for r in rows}
    expected = {"step": [2e-6, 3e-6, 1.5, 3], "projected": [4e-6, 5e-6, 1.25, 3], "batch": [1e-8, 4e-8, 4.0, 3]}
    assert told == {what: pytest.approx(numbers) for what, numbers in expected.items()}
    assert at_work(str(memory)) in CLAIM.compiled


def raced(**ratios: list[float]) -> Rows:
    """The races of a linkage: for each thing that is raced the ratio of every process."""
    return [{"what": what, "status": "ok", "message": "", "ratio": x} for what, values in ratios.items() for x in values]


def test_the_claim_is_the_median_of_processes_and_its_spread_where_a_second_race_falls() -> None:
    start = {"mechanism": "four_bar", "scenario": "torque"}
    row = claim.claim_row(start, raced(step=[1.5, 1.4, 1.6, 1.45, 1.55], projected=[0.97, 1.02, 1.01], batch=[0.7, 0.71, 0.69]))
    spreads = [foreseen(np.array(x)) for x in ([1.5, 1.4, 1.6, 1.45, 1.55], [0.97, 1.02, 1.01])]
    assert [row[x] for x in ("ratio", "ratio_low", "ratio_high")] == [1.5, *spreads[0]]
    assert [row[f"projected_{x}"] for x in ("ratio", "ratio_low", "ratio_high")] == [1.01, *spreads[1]]
    assert [row[f"{x}verdict"] for x in ("", "projected_", "batch_")] == ["holds", "open", "reversed"]
    assert (row["status"], row["processes"]) == ("ok", 5)
    lost = claim.claim_row(start, [{"what": "step", "status": "crashed", "message": "SIGSEGV"}])
    assert (lost["status"], lost["message"], lost["processes"]) == ("crashed", "SIGSEGV", 0)
    assert claim.claim_row(start, [])["status"] == "skip"


def test_both_formulations_in_a_batch_count_each_trajectory(costs: dict[str, Rows]) -> None:
    (bound,) = (row for row in costs["kernel_bounds"] if row["quantity"] == "a batch")
    assert bound["seconds"] == pytest.approx(STEP)


def samples(**seconds: float) -> Measured:
    own = {"step": Key("native_step", "gauss-native"), "batch": Key("batch step", "gauss-native")}
    keys = own | {"latency": LATENCY_KEY, "rate": RATE_KEY}
    return Measured({keys[name]: np.full(5, x) for name, x in seconds.items()}, {})


def test_the_latency_of_a_multiply_add_gives_the_length_of_a_cycle() -> None:
    """Four cycles take 2 ns, so one takes 0.5 ns; a vector of multiply-adds in 1 ns is two operations a lane."""
    rows = {row["key"]: row["value"] for row in processor_rows(samples(latency=2e-9, rate=1e-9))}
    assert rows["latency"] == pytest.approx(2e-9)
    assert rows["cycle"] == pytest.approx(0.5e-9)
    assert rows["rate"] == pytest.approx(2 * native_code.best_lanes() / 1e-9)


def test_a_step_cannot_be_shorter_than_its_chain_nor_a_batch_than_its_operations() -> None:
    measured = samples(step=1e-6, batch=1e-7, latency=4e-9, rate=1e-9)  # a cycle of 1 ns
    starts = limits.count_operations("four_bar", "torque")["kernel_bounds"]
    one, many = (start | compare_with_bound(start, "gauss-native", measured) for start in starts)
    assert one["bound"] == pytest.approx(one["cycles"] * 1e-9)
    assert one["share"] == pytest.approx(one["bound"] / 1e-6)
    assert many["bound"] == pytest.approx(many["flops"] * 1e-9 / (2 * native_code.best_lanes()))
    assert many["share"] == pytest.approx(many["bound"] / 1e-7)


def test_kinematics_tell_positions_per_second(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """A position takes 50 ns: twenty million a second."""
    charge(monkeypatch, clock, Closure, "turn", lambda samples: samples * 50e-9)
    own, plain = race_turns("four_bar", "driven", TURNS, race_here)["kernel_kinematics"]
    assert own["seconds"] == pytest.approx(50e-9)
    assert own["rate"] == pytest.approx(20e6)
    assert own["met"] is True
    assert max(own[f"{x}_error"] for x in ("position", "velocity", "acceleration")) < 1e-12
    assert plain["status"] == "ok"


def test_kinematics_that_are_wrong_meet_no_target_however_fast(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """One acceleration is off by 1e-10 of the largest."""
    true = Closure.turn

    def wrong(self: Closure, *arguments: Any, **options: Any) -> Any:
        found = true(self, *arguments, **options)
        a = found.a.copy()
        a[7, 5] += 1e-10 * np.abs(a).max()
        return type(found)(**{**vars(found), "a": a})

    monkeypatch.setattr(Closure, "turn", wrong)
    charge(monkeypatch, clock, Closure, "turn", lambda samples: samples * 50e-9)
    own = race_turns("four_bar", "driven", TURNS, race_here)["kernel_kinematics"][0]
    assert own["acceleration_error"] == pytest.approx(1e-10, rel=0.01)
    assert own["met"] is False


def test_growth_counts_four_right_hand_sides_to_a_step(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    charge(monkeypatch, clock, Kernel, "rollout", rolled(STEP))
    charge(monkeypatch, clock, Kernel, "acceleration", lambda *arguments, **options: CALL)
    for name in list(CONTENDERS):
        if not name.endswith("-native"):
            monkeypatch.delitem(CONTENDERS, name)
    rows = race_growth(1, 3, race=race_here)["scaling_races"]
    assert len(rows) == 4
    for row in rows:
        assert row["seconds"] == pytest.approx(STEP / 4 if row["quantity"] == "in its own loop" else CALL)
        assert row["error"] < 1e-12


def test_the_error_of_an_acceleration_is_relative_to_the_largest_true_one() -> None:
    wanted = exact_state(1)
    assert wanted.error(1.001 * wanted.a) == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize(("order", "met"), [(4.0, True), (3.85, True), (3.7, False), (3.0, False), (6.0, True)])
def test_the_energy_error_of_a_long_run_falls_with_order_four_within_a_fifth(order: float, met: bool) -> None:
    coarse = {"status": "ok", "position_drift": 1e-16, "velocity_drift": 1e-16, "energy_max": 1e-6}
    found = judge_row(coarse | {"energy_max": 1e-6 / 2**order}, coarse, LONG)
    assert found["order"] == pytest.approx(order)
    assert found["met"] is met


@pytest.mark.parametrize("column", ["position_drift", "velocity_drift"])
@pytest.mark.parametrize(("drift", "met"), [(0.9e-13, True), (1.1e-13, False)])
def test_a_long_run_drifts_by_rounding_alone(column: str, drift: float, met: bool) -> None:
    row = {"status": "ok", "position_drift": 1e-16, "velocity_drift": 1e-16, "energy_max": 1e-6} | {column: drift}
    assert judge_row(row, {}, LONG)["met"] is met


def test_only_rounds_that_both_have_are_compared_and_a_time_has_one_value() -> None:
    """A slow one sat the later rounds out, in which the machine was slower."""
    long, short = np.array([1.0, 1.0, 9.0, 9.0, 9.0, 9.0]), np.array([5.0, 5.0])
    row, turned = compare(long, short), compare(short, long)
    assert row["ratio"] == 5.0
    assert row["seconds"] == turned["rival_seconds"] == 3.0  # the lower quartile of all rounds, whoever it is compared with
    assert row["rival_seconds"] == turned["seconds"] == 5.0


def test_mujocos_rigid_setting_spends_no_more_iterations_than_three() -> None:
    """One already gives the motion to the digits that the closures' softness leaves: more would only cost the rival time."""
    mechanism = load("four_bar", "torque")
    model: Any = get("mujoco").build(mechanism, Choice("rigid", "rk4", "none", 1e-3))
    model.prepare(np.array([0.0, 0.1]))
    model.run()
    assert 1 <= model.data.solver_niter.max() <= 3
    assert model.model.opt.iterations == get("mujoco").settings["rigid"]["iterations"]
