"""Make the rows of compared releases.

The tables are `releases` with one row for each release, `release_changes` and `release_cost_changes` with the differences between
neighbours, and `release_costs`.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from gauss_bench.releases.asking import Answers
from gauss_bench.releases.compare import Change, compare_releases, real
from gauss_bench.releases.costs import Cost
from gauss_bench.tables import TABLES, read_table, write_schema, write_table

NAMES = ("releases", "release_changes", "release_costs", "release_cost_changes")
SCHEMAS = {name: TABLES[name] for name in NAMES}
COST = "cost of"

Rows = list[dict[str, Any]]
Tables = dict[str, Rows]


def compare_neighbours(answers: Sequence[Answers]) -> list[tuple[Answers, Answers, list[Change]]]:
    """Return (before, after, comparisons) for all neighbours among the releases with answers, the oldest first."""
    usable = [x for x in answers if x.usable]
    return [(before, after, compare_releases(before.figures, after.figures)) for before, after in pairwise(usable)]


def make_tables(
    engine: str, answers: Sequence[Answers], costs: Sequence[Cost], cost_changes: Sequence[Cost], commit: str, date: str
) -> Tables:
    """Return name of a table -> rows, for all tables of an engine; `costs` and `cost_changes` are those of `race_releases`."""
    compared = compare_neighbours(answers)
    by_version = {after.version: changes for _, after, changes in compared}
    releases = [release_row(engine, x, by_version.get(x.version)) | {"commit": commit, "date": date} for x in answers]
    changes = [change_row(engine, a.version, b.version, x) for a, b, found in compared for x in real(found)]
    cost_rows, changed = [cost_row(engine, x) for x in costs], [cost_change_row(engine, x) for x in cost_changes]
    return dict(zip(NAMES, (releases, changes, cost_rows, changed), strict=True))


def release_row(engine: str, x: Answers, changes: Sequence[Change] | None) -> dict[str, Any]:
    """Return the row of a release; `changes` are its comparisons with the release before, or None for the first."""
    row: dict[str, Any] = {"engine": engine, "version": x.version, "status": x.status, "message": x.message}
    row |= {"library": x.library, "python": x.python, "numpy": x.numpy, "how": x.how, "left_out": x.left_out}
    if changes is not None:
        sized = [c for c in changes if not math.isnan(c.difference)]
        rounding = [c.difference for c in sized if not c.is_real]
        row |= {"compared": len(sized), "real": len(real(changes)), "rounding": len(rounding)}
        row["largest_rounding"] = max(rounding, default=0.0)
    return row


def change_row(engine: str, before: str, after: str, x: Change) -> dict[str, Any]:
    """Return the row of a real change."""
    row = {"engine": engine, "before": before, "after": after, "quantity": x.quantity, "case": x.case, "setting": x.setting}
    row |= {"was": x.was, "now": x.now}
    numbers = {"difference": x.difference, "rounding": x.rounding, "error_before": x.error_before, "error_after": x.error_after}
    return row | {name: float(f"{value:.3g}") for name, value in numbers.items()}


def cost_change_row(engine: str, x: Cost) -> dict[str, Any]:
    """Return the row of a change of cost."""
    row = {"engine": engine, "before": x.other, "after": x.version, "quantity": f"{COST} {x.work}", "case": x.linkage}
    return row | {"setting": x.setting, "ratio": x.ratio, "ratio_low": x.low, "ratio_high": x.high}


def cost_row(engine: str, x: Cost) -> dict[str, Any]:
    """Return the row of a release's cost in one setting."""
    row = {"engine": engine, "version": x.version, "case": x.linkage, "setting": x.setting, "work": x.work}
    return row | {"seconds": x.seconds, "ratio": x.ratio, "ratio_low": x.low, "ratio_high": x.high, "verdict": x.verdict}


def write_tables(tables: Mapping[str, Rows], engine: str, folder: Any) -> list[Any]:
    """Write the rows of an engine into the folder of a run, replacing its earlier rows, and return the paths of the files."""
    files: list[Any] = []
    for name in NAMES:
        others = [dict(row) for row in read_table(name, folder) if row["engine"] != engine]
        files += write_table(name, sorted([*others, *tables[name]], key=lambda row: row["engine"]), folder)
    write_schema(folder)
    return files
