"""A step of the compiled formulations in their own loop, against another engine's."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    RANGE,
    Cell,
    Finding,
    Section,
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
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number

PLACE = 10
TABLES = ("kernel_steps",)
STEPS = (
    "A Runge-Kutta step of 1e-4 s in the engine's own loop, forces, springs and guards included, from the scenario's start. "
    "Targets were set before the kernel was built."
)
RATIO, GOAL = ("ratio", "spread"), ("target", "met", "remark")


def findings(run: Run) -> Iterator[Finding]:
    """State how many times faster a step is than MuJoCo's, at its fastest setting."""
    asked = [r for r in run.table("kernel_steps") if r.get("formulation") == "gauss"]
    rows = [r for r in asked if is_known(r.get("ratio"))]
    for stabilization, group in group_rows(rows, lambda r: str(r["stabilization"])).items():
        least = [min(some, key=lambda r: number(r, "ratio")) for some in group_rows(group, lambda r: str(r["mechanism"])).values()]
        said = itemise(f"{r['mechanism']} {times(number(r, 'ratio'))}" for r in least)
        how = "with projection" if stabilization == "projection" else "without stabilisation"
        text = f"A compiled Runge-Kutta step {how} is this many times faster than MuJoCo's at the faster of its settings: {said}."
        rest = list_unmeasured([r for r in asked if r["stabilization"] == stabilization], "ratio")
        yield Finding("A step in its own loop", f"{text} Steps are equal here, accuracy is not.{rest}")


def section(run: Run) -> Section | None:
    rows = run.table("kernel_steps")
    names, times = ("linkage", "formulation", "stabilization", "MuJoCo"), ("step", RANGE, "MuJoCo's step")
    best = [row for row in rows if row.get("settings") != "default"]
    return part("A step against MuJoCo", STEPS, rows, (*names, *times, *RATIO, *GOAL), 4, list_steps, best)


def list_steps(row: Row) -> tuple[Cell, ...]:
    names = texts(row, "mechanism", "formulation", "stabilization", "settings")
    times_of = (time_of(row), span(row), time_of(row, "rival_seconds"))
    return (*names, *times_of, *ratio_cells(row, "ratio"), *goal(row), remark(row))
