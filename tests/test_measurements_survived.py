"""Batches, growth and turns: who brings the process down is a row with a reason, and the others are measured all the same."""

import os
from collections.abc import Sequence
from types import SimpleNamespace

import pytest

from gauss_bench.bench.measurements import batch, growth, turns
from gauss_bench.bench.survived import watching
from gauss_bench.bench.tasks import Tables
from gauss_bench.suites.read import read_suite
from gauss_bench.suites.schema import Batch, Turns

SUITE = read_suite("kernel")


def abort(*_: object, **__: object) -> None:
    os.abort()


def growth_in_which_straight_lines_abort(size: int, rounds: int, number: int, engines: Sequence[str], path: str) -> Tables:
    growth.CONTENDERS |= {"lagrange-native": abort}  # type: ignore[dict-item]
    return growth.scaling(size, rounds, number, engines, watching(path))


def batch_in_which_the_rival_aborts(linkage: str, scenario: str, part: Batch, engines: Sequence[str], path: str) -> Tables:
    true = batch.get
    batch.get = lambda name: SimpleNamespace(build=abort) if name == part.rival else true(name)  # type: ignore[assignment, attr-defined]
    return batch.batch(linkage, scenario, part, engines, watching(path))


def turns_in_which_pylinkage_aborts(linkage: str, scenario: str, part: Turns, methods: Sequence[str], path: str) -> Tables:
    turns.pylinkage.turning = abort  # type: ignore[assignment]
    return turns.turn(linkage, scenario, part, methods, watching(path))


@pytest.mark.long
def test_a_size_that_one_engine_does_not_survive_is_measured_of_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growth, "_race_of", growth_in_which_straight_lines_abort)
    for name in set(growth.CONTENDERS) - {"gauss-native", "lagrange-native"}:
        monkeypatch.delitem(growth.CONTENDERS, name)
    *timed, lost = growth.race_growth(1, 2)["scaling_races"]
    assert [(r["engine"], r["status"]) for r in timed] == [("gauss-native", "ok")] * 2
    assert all(r["seconds"] > 0 for r in timed)
    assert (lost["engine"], lost["size"], lost["status"]) == ("lagrange-native", 1, "crashed")
    assert "SIGABRT" in lost["message"]


@pytest.mark.long
@pytest.mark.slow
def test_a_batch_whose_rival_aborts_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "_race_of", batch_in_which_the_rival_aborts)
    part = SUITE.batch[0].model_copy(update={"states": 16, "rounds": 2, "step_count": 2})
    (row,) = batch.race_batch("crank_slider", "paper", part)["kernel_batch"]
    assert (row["mechanism"], row["rival"], row["status"]) == ("crank_slider", "mujoco", "crashed")
    assert "SIGABRT" in row["message"]
    assert row["met"] is False


@pytest.mark.long
@pytest.mark.slow
def test_turns_are_told_of_those_who_survive_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "_race_of", turns_in_which_pylinkage_aborts)
    part = SUITE.turns[0].model_copy(update={"rounds": 2, "samples": 36})
    rows = {r["method"]: r for r in turns.race_turns("four_bar", "driven", part)["kernel_kinematics"]}
    assert {x: r["status"] for x, r in rows.items()} == {turns.NATIVE: "ok", turns.LINK_UNITS: "ok", turns.RIVAL: "crashed"}
    assert rows[turns.NATIVE]["position_error"] < 1e-12
    assert "SIGABRT" in rows[turns.RIVAL]["message"]
