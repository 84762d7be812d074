"""Test the self-test: it detects every planted fault, and names missed faults and false alarms."""

import json

import pytest

import gauss_bench
from gauss_bench.bench import gate
from gauss_bench.cli import main
from gauss_bench.diagnosis import checks, selftest
from gauss_bench.diagnosis.selftest import PLANTED, SIZES, Planted, plant, smallest
from gauss_bench.runs.blocks import Block
from gauss_bench.runs.one_run import measure_seconds


def test_faults_of_four_kinds_are_detected(capsys):
    kinds = ("clocks", "gate", "formulations", "metrics")
    assert main(["selftest", "--json", *(x for kind in kinds for x in ("--only", kind))]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["detected"] == found["planted"] == sum(x.kind in kinds for x in PLANTED)
    assert found["passed"]
    assert found["false_alarms"] == []


@pytest.mark.long
def test_the_whole_suite_is_guarded_and_tells_how_small_a_fault_it_sees():
    found = gauss_bench.selftest()
    assert [x for x in found.findings if not x.seen] == []
    assert all(sum(x.kind == kind for x in found.findings) >= 5 for kind in selftest.KINDS)
    assert found.false_alarms == ()
    assert {x.fault for x in found.smallest} == set(SIZES)
    assert all(0 < x.size < 1e-6 for x in found.smallest)


def test_a_missed_fault_and_a_false_alarm_fail_and_are_named(monkeypatch, capsys):
    blind = Planted("gate", "a fault that no check looks at", checks.check_gate, checks.check_gate)
    with monkeypatch.context() as patched:
        patched.setattr(selftest, "PLANTED", (blind,))
        assert main(["selftest", "--only", "gate"]) == 1
    said = capsys.readouterr().out
    assert "MISSED gate" in said
    assert "0 of 1 planted" in said
    monkeypatch.setattr(gate, "ORDER_MARGIN", 2.0)
    assert main(["selftest", "--only", "gate"]) == 1
    assert "FALSE ALARM" in capsys.readouterr().out


def test_what_is_planted_is_put_back():
    before = measure_seconds.__code__, Block.seconds.__code__, gate.RULES["position_error"]
    for one in PLANTED:
        if one.kind in ("clocks", "gate"):
            one.check()
    assert before == (measure_seconds.__code__, Block.seconds.__code__, gate.RULES["position_error"])
    with plant("gauss_bench/bench/gate.py", "FLATTERING = 10.0", "FLATTERING = 20.0"):
        assert gate.FLATTERING == 20.0
    assert gate.FLATTERING == 10.0
    with pytest.raises(ValueError, match="does not contain"), plant("gauss_bench/bench/gate.py", "no such text", ""):
        pass


def test_the_smallest_fault_that_is_seen_is_where_seeing_begins():
    def check(size):
        return "seen" if size >= 3e-8 else None

    assert smallest(check) == pytest.approx(3e-8, rel=0.06)
    with pytest.raises(ValueError, match="not detected"):
        smallest(lambda size: None)
