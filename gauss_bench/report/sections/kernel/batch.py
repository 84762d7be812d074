"""Many trajectories at once, on one core."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    RANGE,
    Cell,
    Finding,
    Section,
    counts,
    error,
    exact_cell,
    goal,
    itemise,
    list_unmeasured,
    part,
    ratio_cells,
    remark,
    span,
    texts,
    time_of,
    times,
)
from gauss_bench.report.rows import Row, Run, is_known, number

PLACE = 30
TABLES = ("kernel_batch",)
BATCH = "Per step of one trajectory, on one core; all states differ. Lanes are checked against runs of single trajectories."
RATIO, GOAL = ("ratio", "spread"), ("target", "met", "remark")


def findings(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.table("kernel_batch") if is_known(r.get("ratio"))]
    if rows:
        said = itemise(f"{r['mechanism']} {times(number(r, 'ratio'))}" for r in rows)
        off = max(number(r, "lanes_error") for r in rows)
        states = max(int(number(r, "states")) for r in rows)
        text = (
            f"{states} trajectories from different states, on one core, are this many times faster than MuJoCo's rollout: {said}; "
        )
        rest = list_unmeasured(run.table("kernel_batch"), "ratio")
        apart = "nothing" if off == 0 else f"{error(off)} at most"
        yield Finding("Many trajectories", f"{text}lanes and single runs differ by {apart}.{rest}")


def section(run: Run) -> Section | None:
    head = ("linkage", "trajectories", "lanes", "step", RANGE, "MuJoCo's step", *RATIO, "lanes off by", *GOAL)
    return part("Many trajectories", BATCH, run.table("kernel_batch"), head, 1, batch_up)


def batch_up(row: Row) -> tuple[Cell, ...]:
    times_of = (time_of(row), span(row), time_of(row, "rival_seconds"), *ratio_cells(row, "ratio"))
    return (
        *texts(row, "mechanism"),
        *counts(row, "states", "lanes"),
        *times_of,
        exact_cell(row, "lanes_error"),
        *goal(row),
        remark(row),
    )
