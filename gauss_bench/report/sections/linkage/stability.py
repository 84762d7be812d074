"""The losses of a run with time: constraints and energy."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    Finding,
    error,
    tie,
)
from gauss_bench.report.rows import (
    Run,
    is_known,
    may_rank,
    number,
    plain,
)

PLACE = 40
TABLES = ("results", "series")


def findings(run: Run) -> Iterator[Finding]:
    rows = [row for row in run.results if may_rank(row) and is_known(row.get("position_drift"))]
    free = [row for row in rows if plain(row)]
    if free:
        row = max(free, key=lambda r: number(r, "position_drift"))
        what = tie(free, row, lambda r: number(r, "position_drift"))
        yield Finding(
            "Where drift is worst",
            f"Of the valid rows without stabilisation, constraints are left farthest by {what} on {row['mechanism']} "
            f"{row['scenario']}: {error(number(row, 'position_drift'))} in position and "
            f"{error(number(row, 'velocity_drift'))} in velocity.",
        )
