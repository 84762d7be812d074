"""One right-hand side against a library's own."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    Cell,
    Finding,
    Section,
    goal,
    itemise,
    list_unmeasured,
    part,
    ratio_cells,
    remark,
    run_of_numbers,
    texts,
    time_of,
)
from gauss_bench.report.rows import Row, Run, is_known, number

PLACE = 40
TABLES = ("kernel_rhs",)
RHS = (
    "A state in, its accelerations out. In its own loop: a quarter of the kernel's step. Less the call: without what calling a "
    "function of Pinocchio from Python costs. Called from Python, both mostly wait for Python."
)
RATIO, GOAL = ("ratio", "spread"), ("target", "met", "remark")


def findings(run: Run) -> Iterator[Finding]:
    """In its own loop, and where it loses: called from Python."""
    rows = [r for r in run.table("kernel_rhs") if is_known(r.get("ratio"))]
    inside = [number(r, "ratio") for r in rows if r["own"] == "in its own loop" and r["rival"] == "less the call"]
    called = [r for r in rows if r["own"] == "called from Python" and r["rival"] == "as called"]
    if inside and called:
        slower = sorted({str(r["mechanism"]) for r in called if number(r, "ratio") < 1})
        rest = list_unmeasured(run.table("kernel_rhs"), "ratio")
        outside = [number(r, "ratio") for r in called]
        text = (
            f"Pinocchio's right-hand side, without its call from Python, takes {run_of_numbers(inside)} times as long as the "
            f"kernel's in its own loop. Called from Python for one state, it takes {run_of_numbers(outside)} times as long"
        )
        yield Finding(
            "One right-hand side", f"{text}{f': there the kernel is slower on {itemise(slower)}' if slower else ''}.{rest}"
        )


def section(run: Run) -> Section | None:
    rows = run.table("kernel_rhs")
    head = ("linkage", "kernel", "constraintDynamics", "settings", "kernel's", "Pinocchio's", *RATIO, *GOAL)
    alike = (("in its own loop", "less the call"), ("called from Python", "as called"))
    fair = [row for row in rows if (row.get("own"), row.get("rival")) in alike or row.get("status") != "ok"]
    return part("One right-hand side against Pinocchio", RHS, rows, head, 4, list_asked, fair)


def list_asked(row: Row) -> tuple[Cell, ...]:
    names = texts(row, "mechanism", "own", "rival", "settings")
    return (*names, time_of(row), time_of(row, "rival_seconds"), *ratio_cells(row, "ratio"), *goal(row), remark(row))
