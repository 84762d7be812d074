"""Measurements of time with a clock whose ticks are known: what is divided by what, and what a spread means."""

import gc
import math
import os
import subprocess
import sys

import numpy as np
import pytest

from gauss_bench.bench.clock import Key, Measured, interleave, ratio
from gauss_bench.bench.measurements import cost
from gauss_bench.bench.measurements.cost import race_cost
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.blocks import BLOCK, Block, calls_block, get_model, steps_block
from gauss_bench.runs.one_run import measure_seconds
from gauss_bench.runs.starting import cold_there
from gauss_bench.suites.schema import Cost
from tests.synthetic import Costs, SyntheticModel, replace_engine

MUJOCO = Cost(linkages={}, engines=("mujoco",), step=1e-3, rounds=4)


def test_a_time_is_that_of_the_processor_for_one_repetition_without_getting_ready(clock):
    """A clock that ticks one second for a thousand steps reports a millisecond a step."""
    assert measure_seconds(lambda: clock.spend(1.0)) == pytest.approx(1.0)
    block = Block("steps", lambda: clock.spend(5.0), lambda: clock.spend(1.0), 1000)
    assert [seconds for _, _, seconds in interleave([block], 3)] == pytest.approx([1e-3] * 3)


def test_a_model_serves_its_own_scenario_alone():
    models = {}
    first, other, again = (
        get_model(models, "gauss", load("four_bar", scenario), choice)
        for scenario, choice in (("torque", Choice()), ("conservative", Choice()), ("torque", Choice(step=1e-2)))
    )
    assert again is first
    assert other.mechanism.scenario == "conservative"


@pytest.mark.parametrize("seconds", [1e-7, 3e-5, 0.3e-3, 0.02])
@pytest.mark.parametrize("work", [1, 40])
def test_a_call_costs_the_same_however_often_a_block_repeats_it(seconds, work, clock):
    """A repetition is a piece of the call's work, and a block lasts a millisecond at least, or as long as one call."""
    block = calls_block("call", lambda: clock.spend(seconds), work)
    block.ready()
    whole = measure_seconds(block.go)
    assert whole / block.count == pytest.approx(seconds / work)
    assert 1e-3 <= whole <= max(5e-3, seconds * 1.001)


def test_every_quantity_of_an_engine_is_what_it_costs(clock, monkeypatch):
    costs = Costs(build=5e-3, step=7e-6, native_step=3e-6, acceleration=2e-6)
    replace_engine(monkeypatch, "mujoco", clock, costs)
    found = race_cost("four_bar", "torque", MUJOCO)
    assert not found["untimed"]
    for quantity, seconds in (vars(costs) | {"build": costs.build + costs.native_step}).items():  # a model and its first step
        measured = [x["seconds"] for x in found["samples"] if x["quantity"] == quantity]
        assert quantity == "call" or measured
        assert measured == pytest.approx([seconds] * len(measured), rel=1e-6), quantity


class Handed(SyntheticModel):
    """A run costs 5 us beside its steps: the hand-over from Python, which is no part of a step."""

    def run(self):
        super().run()
        self.clock.spend(5e-6)


@pytest.mark.parametrize("step", [5e-8, 1e-7, 5e-7, 2e-6, 3e-5, 1e-3, 5e-3])
def test_blocks_are_long_enough_for_every_engine(step, clock):
    """From compiled steps of 50 ns to interpreted ones of 5 ms, a step costs what it costs to 1 %, in blocks of 2 ms and more."""
    choice = Choice("default", "rk4", "none", 1e-4)
    model = Handed(load("four_bar", "torque"), choice, clock, Costs(native_step=step))
    block = steps_block("steps", model, choice.step, native=True)
    assert block.seconds() == pytest.approx(step, rel=0.0101)
    before = clock.now
    block.seconds()
    assert clock.now - before >= 0.99 * BLOCK * 1e9


class Compiles:
    """Whatever builds a model runs a compiler."""

    def __init__(self, clock):
        self.clock = clock
        self.stores = []

    def build(self, mechanism, choice):
        self.stores.append(os.environ["XDG_CACHE_HOME"])
        self.clock.spend(0.3)
        subprocess.run([sys.executable, "-c", "import time\nwhile time.process_time() < 0.2: pass"], check=True)
        return SyntheticModel(mechanism, choice, self.clock, Costs(native_step=0.1))


def test_a_cold_build_is_that_of_the_first_step_with_nothing_stored_and_counts_compilers(clock, monkeypatch):
    """0.3 s of our own, a step of 0.1 s, and a compiler that takes 0.2 s and a little to start."""
    monkeypatch.setenv("XDG_CACHE_HOME", "what the user has")
    made = Compiles(clock)
    monkeypatch.setattr(type(get("mujoco")), "build", made.build)
    found = cold_there("mujoco", load("four_bar", "torque"), Choice("default", "rk4", "none", 1e-4))
    assert 0.6 - 0.02 <= found["seconds"] < 1.0
    assert made.stores != ["what the user has"]


def test_warm_and_cold_builds_stand_in_columns_of_their_own():
    times = {"build": 0.02, "cold build": 2.0}
    measured = Measured({Key(quantity, "gauss-native"): np.full(3, x) for quantity, x in times.items()}, {})
    row = {"mechanism": "four_bar", "scenario": "torque", "engine": "gauss-native", "settings": "default"}
    row |= {"integrator": "dop853", "stabilization": "none"}
    cost.add_costs([row], {("four_bar", "torque"): measured})
    assert (row["build_time"], row["cold_build_time"]) == (0.02, 2.0)


def test_steps_are_timed_over_a_second_of_motion_at_most(clock, monkeypatch):
    """An engine in which motion takes no time is not run on and on: drift would change what is timed."""
    durations = []
    replace_engine(monkeypatch, "mujoco", clock, Costs(step=1e-9, native_step=1e-9))
    true = SyntheticModel.prepare

    def prepare(self, times, native=True):
        durations.append(float(times[-1]))
        true(self, times, native)

    monkeypatch.setattr(SyntheticModel, "prepare", prepare)
    race_cost("four_bar", "torque", MUJOCO)
    assert 0.9 <= max(durations) <= 1.0 + 1e-9


def test_a_block_that_takes_long_sits_out_later_rounds_and_others_do_not(clock):
    long = Block("long", lambda: None, lambda: clock.spend(0.2), 1)
    short = Block("short", lambda: None, lambda: clock.spend(0.01), 1)
    rounds = [(block.entry, number) for block, number, _ in interleave([long, short], 12)]
    assert sorted(n for entry, n in rounds if entry == "short") == list(range(12))
    assert sorted(n for entry, n in rounds if entry == "long") == list(range(4))


def test_the_garbage_collector_rests_while_it_is_timed_and_no_longer(clock):
    resting = []
    block = Block("x", lambda: None, lambda: resting.append(gc.isenabled()), 1)
    assert gc.isenabled()
    list(interleave([block], 2))
    assert resting == [False, False]
    assert gc.isenabled()
    half_way = interleave([block], 2)
    next(half_way)
    half_way.close()
    assert gc.isenabled()


def test_blocks_take_turns_in_another_order_every_round(clock):
    blocks = [Block(name, lambda: None, lambda: clock.spend(1e-3), 1) for name in "abcd"]
    order = [block.entry for block, _, _ in interleave(blocks, 20)]
    rounds = [tuple(order[k : k + 4]) for k in range(0, 80, 4)]
    assert all(sorted(x) == list("abcd") for x in rounds)
    assert len(set(rounds)) > 5


def test_a_ratio_is_that_of_lower_quartiles():
    """Rounds that an interruption has spoilt, even half of them, say nothing."""
    samples = np.array([4.0, 1.0, 3.0, 2.0, 5.0])  # the lower quartile of five is the second smallest
    assert ratio(samples, np.full(5, 0.5))[0] == pytest.approx(4.0)
    assert ratio(np.full(5, 3.0), samples)[0] == pytest.approx(1.5)
    spoilt = np.where(np.arange(100) % 2 == 0, 1.0, 50.0)
    assert ratio(spoilt, np.full(100, 1.0))[0] == pytest.approx(1.0)


def test_what_both_meet_in_a_round_is_in_no_spread():
    wandering = np.random.default_rng(3).uniform(1.0, 2.0, 40)
    assert ratio(3 * wandering, wandering) == pytest.approx((3.0, 3.0, 3.0))


def test_a_spread_holds_nine_tenths():
    """The lower quartile of n uniform samples scatters by sqrt(3/16 / n); 5 and 95 percent lie 1.645 of it away."""
    n = 4000
    value, low, high = ratio(np.random.default_rng(5).uniform(0.0, 1.0, n) + 1.0, np.ones(n))
    scatter = 1.645 * math.sqrt(3 / 16 / n)
    assert value == pytest.approx(1.25, abs=2 * scatter)
    assert high - low == pytest.approx(2 * scatter, rel=0.3)
