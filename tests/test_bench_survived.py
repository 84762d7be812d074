"""An engine that brings the process of a race down is a row with a reason, and the others are timed all the same."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import pytest

from gauss_bench.bench.survived import list_survivors, race_here, race_survivors
from gauss_bench.runs.blocks import Block, lasting
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.trajectory import Status
from tests.plugin import installed


class Entry(NamedTuple):
    engine: str


def hang() -> None:
    time.sleep(60)


def fail() -> None:
    raise ValueError("no")


def entries() -> Iterator[tuple[Entry, Callable[[], Block]]]:
    """Some that come to grief while they are built, or after the race."""
    troubles = {"aborts": os.abort, "hangs": hang, "raises": fail}
    for name in ("first", "aborts", "hangs", "late", "raises"):
        yield Entry(name), partial(made, troubles.get(name, int), os.abort if name == "late" else dict)


def made(make: Callable[[], object], facts: Callable[[], Any]) -> Block:
    make()
    return replace(lasting(None, int), facts=facts)


@pytest.mark.slow
def test_who_was_at_work_is_left_out_and_the_rest_race_again() -> None:
    rows, lost = list_survivors(race_here, (entries, (), 2), ["first", "aborts", "hangs", "late"], limit=4.0)
    assert [(r["engine"], r["round"]) for r in rows] == [("first", 0), ("first", 1)]
    expected = {"aborts": Status.CRASHED, "hangs": Status.TIMEOUT, "late": Status.CRASHED}
    assert {x: y.status for x, y in lost.items()} == expected
    assert "SIGABRT" in str(lost["aborts"])
    assert "while this one was at work" in str(lost["aborts"])


def test_what_a_race_raises_of_itself_is_no_engines_fault() -> None:
    with pytest.raises(WorkerFailure, match="no") as raised:
        race_survivors(entries, (), 1, ["first", "raises"])
    assert raised.value.status is Status.ERROR


CODE = """
import json
from gauss_bench.bench.measurements.cost import race_cost
from gauss_bench.suites.schema import Cost
part = Cost(linkages={}, engines=("gauss", "aborts"), integrators=1, step=1e-2, rounds=2)
print(json.dumps(race_cost("four_bar", "torque", part, 0)))
"""


@pytest.mark.long
def test_a_plug_in_that_aborts_in_the_race_of_costs_is_a_row_with_the_reason(tmp_path_factory: pytest.TempPathFactory) -> None:
    where = installed(tmp_path_factory.mktemp("plugin"))
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, env=where, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    tables = json.loads(done.stdout)
    assert {(r["engine"], r["quantity"]) for r in tables["samples"]} == {("gauss", x) for x in ("build", "acceleration", "step")}
    assert {(r["engine"], r["quantity"]) for r in tables["untimed"]} == {("aborts", x) for x in ("build", "acceleration", "step")}
    assert all(r["status"] == "crashed" and "SIGABRT" in r["message"] for r in tables["untimed"])
