"""Compiled kinematics over a turn of the crank."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    RANGE,
    Cell,
    Finding,
    Section,
    error,
    exact_cell,
    goal,
    itemise,
    list_unmeasured,
    part,
    remark,
    texts,
)
from gauss_bench.report.rows import Row, Run, is_known, number

PLACE = 80
TABLES = ("kernel_kinematics",)
KINEMATICS = "Positions, velocities and accelerations of all links over a turn in 3600 steps; errors against pure geometry."
RATIO, GOAL = ("ratio", "spread"), ("target", "met", "remark")


def findings(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.table("kernel_kinematics") if is_known(r.get("target")) and is_known(r.get("rate"))]
    if rows:
        said = itemise(f"{number(r, 'rate') / 1e6:.1f} million on {r['mechanism']}" for r in rows)
        off = max(number(r, f"{x}_error") for r in rows for x in ("position", "velocity", "acceleration"))
        yield Finding(
            "Kinematics",
            f"Positions with velocities and accelerations per second on one core: {said}; errors {error(off)} at most."
            f"{list_unmeasured(run.table('kernel_kinematics'), 'rate')}",
        )


def section(run: Run) -> Section | None:
    head = ("linkage", "way", "per second", RANGE, "position", "velocity", "acceleration", *GOAL)
    return part("Compiled kinematics", KINEMATICS, run.table("kernel_kinematics"), head, 2, list_turns)


def list_turns(row: Row) -> tuple[Cell, ...]:
    values = [number(row, f"rate{end}") for end in ("", "_low", "_high")]
    rates = Cell(f"{values[0]:.3g}", values[0]) if is_known(values[0]) else Cell("-")
    spread = Cell(f"{values[1]:.3g}..{values[2]:.3g}", values[1]) if is_known(values[1]) else Cell("-")
    errors = tuple(exact_cell(row, f"{level}_error") for level in ("position", "velocity", "acceleration"))
    return (*texts(row, "mechanism", "method"), rates, spread, *errors, *goal(row, "{:.2g}".format), remark(row))
