"""Make the rows of the tables on compared releases of an engine's library.

The table `releases` has one row for each release. `release_changes` and `release_cost_changes` have the differences of results and
of times between consecutive releases. `release_costs` has the times of all releases.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from gauss_bench.releases.asking import Answers
from gauss_bench.releases.compare import Change, compare_releases, real_changes
from gauss_bench.releases.costs import Rows
from gauss_bench.tables import TABLES, read_table, write_schema, write_table

NAMES = ("releases", "release_changes", "release_costs", "release_cost_changes")
SCHEMAS = {name: TABLES[name] for name in NAMES}
COST = "cost of"

Tables = dict[str, Rows]


def compare_neighbours(answers: Sequence[Answers]) -> list[tuple[Answers, Answers, list[Change]]]:
    """Return (before, after, comparisons) for each pair of consecutive releases that gave results, the oldest pair first."""
    usable = [x for x in answers if x.usable]
    return [(before, after, compare_releases(before.figures, after.figures)) for before, after in pairwise(usable)]


def make_tables(engine: str, answers: Sequence[Answers], costs: Rows, cost_changes: Rows, commit: str, date: str) -> Tables:
    """Return name of a table -> rows, for all tables (NAMES) of an engine.

    `answers` have the oldest release first; `costs` and `cost_changes` are those of `race_releases`.
    """
    compared = compare_neighbours(answers)
    by_version = {after.version: changes for _, after, changes in compared}
    releases = [release_row(engine, x, by_version.get(x.version)) | {"commit": commit, "date": date} for x in answers]
    changes: Rows = []
    for before, after, comparisons in compared:
        changes += [change_row(engine, before.version, after.version, x) for x in real_changes(comparisons)]
    cost_rows = [{"engine": engine} | row for row in costs]
    cost_change_rows = []
    for row in cost_changes:
        names = {"engine": engine, "after": row["version"], "quantity": f"{COST} {row['work']}"}
        copied = {name: row[name] for name in ("before", "case", "setting", "ratio", "ratio_low", "ratio_high")}
        cost_change_rows.append(names | copied)
    return dict(zip(NAMES, (releases, changes, cost_rows, cost_change_rows), strict=True))


def pick(record: Any, *names: str) -> dict[str, Any]:
    """Return name -> value of these attributes of a record, whose names are those of columns."""
    return {name: getattr(record, name) for name in names}


def release_row(engine: str, x: Answers, changes: Sequence[Change] | None) -> dict[str, Any]:
    """Return the row of a release in the table `releases`.

    `changes` are the comparisons with the release before; None if there is no such release.
    """
    row = {"engine": engine} | pick(x, "version", "status", "message", "library", "python", "numpy", "how", "left_out")
    if changes is not None:
        sized = [c for c in changes if not math.isnan(c.difference)]  # without texts and failures
        rounding = [c.difference for c in sized if not c.is_real]  # differences that rounding explains
        row |= {"compared": len(sized), "real": len(real_changes(changes)), "rounding": len(rounding)}
        row["largest_rounding"] = max(rounding, default=0.0)
    return row


def change_row(engine: str, before: str, after: str, x: Change) -> dict[str, Any]:
    """Return the row, in the table `release_changes`, of a result that differs between two releases by more than rounding."""
    row = {"engine": engine, "before": before, "after": after} | pick(x, "quantity", "case", "setting", "was", "now")
    numbers = pick(x, "difference", "rounding", "error_before", "error_after")
    return row | {name: float(f"{value:.3g}") for name, value in numbers.items()}


def write_tables(tables: Mapping[str, Rows], engine: str, folder: Any) -> list[Any]:
    """Write the rows of an engine into the folder of a run, replacing its earlier rows, and return the paths of the files."""
    files: list[Any] = []
    for name in NAMES:
        others = [dict(row) for row in read_table(name, folder) if row["engine"] != engine]
        files += write_table(name, sorted([*others, *tables[name]], key=lambda row: row["engine"]), folder)
    write_schema(folder)
    return files
