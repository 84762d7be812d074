"""An engine that brings the process of a race down is a row with a reason, and the others are timed all the same."""

import os
import time
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import pytest

from gauss_bench.bench.survived import list_survivors, race_here, race_survivors
from gauss_bench.runs.blocks import BlockElsewhere, calls_block
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.trajectory import RunFailure, Status


class Entry(NamedTuple):
    engine: str


def hang():
    time.sleep(60)


def fail():
    raise ValueError("no")


def entries():
    """Some that come to grief while they are built, or after the race."""
    troubles = {"aborts": os.abort, "hangs": hang, "raises": fail}
    for name in ("first", "aborts", "hangs", "late", "raises"):
        yield Entry(name), partial(made, troubles.get(name, int), os.abort if name == "late" else dict)


def made(make, facts):
    make()
    return replace(calls_block(None, int), facts=facts)


@pytest.mark.slow
def test_who_was_at_work_is_left_out_and_the_rest_race_again():
    rows, lost = list_survivors(race_here, (entries, (), 2), ["first", "aborts", "hangs", "late"], limit=4.0)
    assert [(r["engine"], r["round"]) for r in rows] == [("first", 0), ("first", 1)]
    expected = {"aborts": Status.CRASHED, "hangs": Status.TIMEOUT, "late": Status.CRASHED}
    assert {x: y.status for x, y in lost.items()} == expected
    assert "SIGABRT" in str(lost["aborts"])
    assert "while this one was running" in str(lost["aborts"])


def ends_early():
    raise RunFailure(Status.CRASHED, "its process ended")


def test_an_engine_whose_own_process_ends_during_a_race_is_a_row_and_the_others_have_times():
    lost = BlockElsewhere(None, dict, dict, 1, 1, timed=ends_early)
    rows = race_here(lambda: [(Entry("first"), partial(made, int, dict)), (Entry("lost"), lambda: lost)], (), 2)
    assert [(r["engine"], r.get("round"), r.get("status", "ok")) for r in rows] == [
        ("first", 0, "ok"), ("first", 1, "ok"), ("lost", None, Status.CRASHED),
    ]  # fmt: skip


def test_what_a_race_raises_of_itself_is_no_engines_fault():
    with pytest.raises(WorkerFailure, match="no") as raised:
        race_survivors(entries, (), 1, ["first", "raises"])
    assert raised.value.status is Status.ERROR
