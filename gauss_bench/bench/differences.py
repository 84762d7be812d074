"""Compare two runs of a suite: accuracies by the limits of the accuracy gate (`gate.py`), ratios of times by their spreads."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss_bench.bench.gate import Verdict, compare, figures_of
from gauss_bench.checksums import require_unchanged
from gauss_bench.tables import ENDS, TABLES, Row, TableError, case_of, key_of, read_table


@dataclass(frozen=True)
class Differences:
    """The differences in accuracy between two runs.

    Attributes:
        compared: number of figures (measured numbers, and statuses of cases) that both runs have.
        beyond: figures that differ by more than the accuracy gate allows, and cases with different statuses.
        only_here, only_there: number of cases that only one of the runs has.
    """

    compared: int
    beyond: tuple[Verdict, ...]
    only_here: int
    only_there: int


def differences(here: Path, there: Path) -> Differences:
    """Compare the numbers and statuses of the accuracy cases stored in the folder `here` with those in the folder `there`.

    Because neither run is a baseline, a number that is better by more than the gate's factor counts as a difference too.

    Raises:
        TableError: a folder holds no accuracy run, a table is damaged, or a table has a newer format than this version can read.
    """
    own, other = read_figures(here), read_figures(there)
    # every case has at least one figure: its status
    own_cases, other_cases = (set(map(case_of, x)) for x in (own, other))
    shared = own_cases & other_cases
    metrics = {row["metric"] for row in own} & {row["metric"] for row in other}  # a table of an earlier format may lack a metric
    here_rows, there_rows = ([row for row in x if case_of(row) in shared and row["metric"] in metrics] for x in (own, other))
    verdicts = compare(here_rows, there_rows)
    # observed orders of convergence are left out: they follow from the errors, which are compared
    beyond = tuple(v for v in verdicts if v.outcome != "ok" and v.metric != "observed_order")
    return Differences(len(verdicts), beyond, count_cases(own_cases - shared), count_cases(other_cases - shared))


def read_figures(folder: Path) -> list[Row]:
    """Return the figures of the accuracy cases and of the references that are stored in a folder; errors as in `differences`."""
    return figures_of(accuracy_rows(folder), read_table("references", folder))


def count_cases(keys: set[tuple[Any, ...]]) -> int:
    """Return the number of keys that belong to cases; the others belong to references."""
    return sum(engine != "reference" for _, _, engine, *_ in keys)


@dataclass(frozen=True)
class Clocked:
    """A ratio of times, or a conclusion from times (target met, claim true), that differs between two runs.

    Attributes:
        what: names of the table, the row and the column.
        here, there: the values of both runs as texts; a ratio is followed by its spread.
        matters: whether a reader's conclusion changes: a target is met in one run only, a claim has another verdict, or a ratio is
            above 1 in one run only.
        factor: the ratio of the run `here` divided by the ratio of the run `there`; 1 for targets and claims.
    """

    what: str
    here: str
    there: str
    matters: bool
    factor: float = 1.0

    @property
    def row(self) -> tuple[str, str, str]:
        """The cells of the row that this difference gets in a table of differences."""
        return self.what, self.here, self.there


def compare_times(here: Path, there: Path) -> tuple[int, tuple[Clocked, ...]]:
    """Return the number of ratios, targets and claims that both runs have, and a list of those that differ.

    Ratios differ if their spreads do not overlap. Differences that change a reader's conclusion come first, then the others; in
    both groups, the largest factor comes first.

    Raises:
        TableError: a table is damaged, or has a newer format than this version can read.
    """
    found: list[Clocked | None] = []  # None for each pair that agrees
    for name, table in TABLES.items():
        # "met": whether a target is met; "verdict": verdict on a claim; "ratio": ratio of two times
        columns = [c.name for c in table.columns if c.timed and c.name.endswith(("met", "verdict", "ratio"))]
        if not table.keys or not columns:
            continue
        other = {key_of(table, row): row for row in read_table(name, there)}
        for row in read_table(name, here):
            key = key_of(table, row)
            if key in other:
                what = f"{name}: {' '.join(filter(None, key))}"
                found += [x for column in columns for x in _apart(what, column, row, other[key])]
    apart = [x for x in found if x is not None]
    return len(found), tuple(sorted(apart, key=lambda x: (not x.matters, -abs(math.log(x.factor)), x.what)))


def _apart(what: str, column: str, row: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[Clocked | None]:
    """Yield the difference of a column of two rows, or None if the values agree; yield nothing if a row lacks the value.

    Two ratios agree if their spreads overlap. Two targets, or two verdicts on a claim, agree if they are equal. `what` names the
    table and the row.
    """
    what = f"{what}: {column}"
    if not column.endswith("ratio"):
        if row[column] not in (None, "") and other[column] not in (None, ""):
            here, there = ({True: "yes", False: "no"}.get(x, x) for x in (row[column], other[column]))  # a flag or a word
            yield None if row[column] == other[column] else Clocked(what, here, there, matters=True)
        return
    spreads = [[x[f"{column}{end}"] for end in ENDS] for x in (row, other)]  # value, lower and upper end of each row
    if all(math.isfinite(x) and x > 0 for values in spreads for x in values):
        (x, low, high), (y, other_low, other_high) = spreads
        here, there = (f"{value:.3g} ({least:.3g}..{most:.3g})" for value, least, most in spreads)
        is_crossed = (x > 1) != (y > 1)  # the runs differ in which of the two is faster
        overlap = low <= other_high and other_low <= high
        yield None if overlap else Clocked(what, here, there, matters=is_crossed, factor=x / y)


def accuracy_rows(folder: Path) -> tuple[dict[str, Any], ...]:
    """Return the rows of the accuracy cases of a run.

    Raises:
        TableError: the folder has no rows of accuracy cases, or they cannot be read.
        ChangedRows: a table of the run has changed since the run.
    """
    rows = read_table("results", folder)
    if not rows:
        raise TableError(f"{folder}: no accuracy cases there: results.csv is missing or empty")
    require_unchanged(folder)
    return rows
