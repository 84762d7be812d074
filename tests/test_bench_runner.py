"""A run repeats nothing that is finished and tells what failed; what outlives a kill is told by the tests of durability."""

import time

import pytest

from gauss_bench.bench.cases import Case
from gauss_bench.bench.journal import Journal
from gauss_bench.bench.measure import measure
from gauss_bench.bench.tasks import Task, finish


def slow(seconds):
    time.sleep(seconds)
    return {"results": [{"status": "ok"}]}


@pytest.mark.slow
def test_what_was_stopped_is_asked_again_when_it_may_take_longer(tmp_path):
    told = []
    for limit in (0.3, 0.3, 60.0, 0.3):
        with Journal(tmp_path / "a.jsonl") as journal:
            answer = finish([Task("slow", slow, (1.0,), "stamp", "results", limit=limit)], 1, "", journal)
        told.append((answer["results"][0]["status"], len((tmp_path / "a.jsonl").read_bytes().splitlines())))
    assert told == [("timeout", 1), ("timeout", 1), ("ok", 2), ("ok", 2)]


def test_the_negative_control_is_flagged_and_its_residuals_do_not_show_it(tmp_path):
    case = Case("four_bar", "torque", "yuan_ge_eq16", "default", "rk4", "projection", 1e-3, 0.1)
    row = measure(case, str(tmp_path))["results"][0]
    assert (row["status"], row["control"], row["valid"]) == ("invalid", True, False)
    assert row["acceleration_error_median"] > 0.1
    assert row["position_drift"] < 1e-13
    assert row["velocity_drift"] < 1e-12
    assert "accelerations off" in row["flag"]
