"""The section on kinematics: three independent methods, and the positions at which a linkage reverses."""

from collections.abc import Sequence

from gauss_bench.report.content import Section, Text, blocks_of
from gauss_bench.report.rows import Row, Run

PLACE = 40
TABLES = ("agreement", "singular", "basins", "driving")


def section(run: Run) -> Section:
    """Return the section with the tables of kinematics; one task makes all of them, so that a run has all or none."""
    tables: dict[str, Sequence[Row]] = {name: run.table(name) for name in TABLES}
    if not tables["agreement"]:
        return Section("Kinematics", "kinematics", (Text("The run compared no kinematics."),))
    tables["basins"] = [{**row, "method": row["method"].replace("_", " ")} for row in tables["basins"]]
    return Section("Kinematics", "kinematics", [x for name, rows in tables.items() for x in blocks_of(name, rows)])
