"""Compiled accelerations against the same formulations in numpy."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    Cell,
    Finding,
    Section,
    counts,
    error,
    exact_cell,
    goal,
    list_unmeasured,
    part,
    remark,
    small,
    texts,
)
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number

PLACE = 50
TABLES = ("kernel_agreement",)
AGREEMENT = (
    "Worst relative difference from the same formulation in numpy, at random states and close to where partitions fail; beside it "
    "the difference of two formulations in numpy from each other, which is what rounding leaves."
)
RATIO, GOAL = ("ratio", "spread"), ("target", "met", "remark")


def findings(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.table("kernel_agreement") if is_known(r.get("error"))]
    if rows:
        worst = max(rows, key=lambda r: number(r, "error"))
        text = (
            f"Accelerations of the compiled formulations differ from those in numpy by {error(number(worst, 'error'))} at most, on "
        )
        tone = "good" if all(r.get("met") for r in rows) else "warn"
        where = f"{worst['mechanism']} ({worst['formulation']}, {worst['place']})"
        yield Finding("The same accelerations", f"{text}{where}.{list_unmeasured(run.table('kernel_agreement'), 'error')}", tone)


def section(run: Run) -> Section | None:
    rows = run.table("kernel_agreement")
    head = ("linkage", "formulation", "where", "states", "error", "numpy's own", *GOAL)
    worst = [max(group, key=lambda r: number(r, "error")) for group in group_rows(rows, _formulate).values()]
    return part("Agreement with numpy", AGREEMENT, rows, head, 3, agree, worst)


def _formulate(row: Row) -> tuple[str, str]:
    return str(row.get("mechanism", "")), str(row.get("formulation", ""))


def agree(row: Row) -> tuple[Cell, ...]:
    errors = (exact_cell(row, "error"), exact_cell(row, "numpy_error"))
    return (*texts(row, "mechanism", "formulation", "place"), *counts(row, "states"), *errors, *goal(row, small), remark(row))
