"""What a run measured otherwise than another one, by the gate's own limits: a user's run against the published one."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss_bench.bench.gate import Verdict, compare, facts
from gauss_bench.bench.runner import frame
from gauss_bench.tables import KEY, TableError, read_table


@dataclass(frozen=True)
class Differences:
    """Accuracy figures of the cases that two runs share.

    Attributes:
        compared: how many figures both runs have.
        beyond: those that lie apart by more than the gate allows, and cases that ended otherwise.
        only_here, only_there: how many cases one run has and the other has not.
    """

    compared: int
    beyond: tuple[Verdict, ...]
    only_here: int
    only_there: int


def differences(here: Path, there: Path) -> Differences:
    """The figures in the folder `here` against those in the folder `there`.

    A figure that is better by as much as the gate calls worse lies apart too: between two runs neither is the measure.

    Raises:
        TableError: a folder holds no accuracy run, a table is damaged, or of a later format than is known here.
    """
    cases, found = [], []
    for folder in (here, there):
        rows = accuracy_rows(folder)
        cases.append({_key(row) for row in rows})
        found.append(facts(frame("results", rows), frame("references", read_table("references", folder))))
    shared = cases[0] & cases[1]
    truths = [{_key(row) for row in x[x["engine"] == "reference"].to_dict("records")} for x in found]
    common = shared | (truths[0] & truths[1])
    own, other = (x[[_key(row) in common for row in x.to_dict("records")]] for x in found)
    verdicts = compare(own, other)
    beyond = tuple(v for v in verdicts if v.outcome != "ok" and v.metric != "observed_order")
    return Differences(len(verdicts), beyond, len(cases[0] - shared), len(cases[1] - shared))


def _key(row: Mapping[Any, Any]) -> tuple[object, ...]:
    return tuple(row[k] for k in KEY)


def accuracy_rows(folder: Path) -> tuple[dict[str, Any], ...]:
    """The accuracy cases of a run.

    Raises:
        TableError: there are none, or they cannot be read.
    """
    rows = read_table("results", folder)
    if not rows:
        raise TableError(f"{folder}: no accuracy cases there: results.csv is missing or empty")
    return rows
