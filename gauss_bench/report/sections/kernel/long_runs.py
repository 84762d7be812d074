"""Drift and energy of long runs."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    Cell,
    Finding,
    Section,
    counts,
    error,
    error_cell,
    exact_cell,
    goal,
    list_unmeasured,
    part,
    remark,
    run_of_numbers,
    small,
    texts,
)
from gauss_bench.report.rows import Row, Run, is_known, number

PLACE = 60
TABLES = ("kernel_long", "kernel_energy")
LONG = (
    "Long runs with projection where no energy is lost or gained: largest drift, kinetic energy, and largest error of the energy "
    "in tenths of the run, which grows with time, as Runge-Kutta's does. Order: of that error, from the run at twice the step. The "
    "target is of both drifts, and of an order of 4."
)
RATIO, GOAL = ("ratio", "spread"), ("target", "met", "remark")


def findings(run: Run) -> Iterator[Finding]:
    rows = [r for r in run.table("kernel_long") if is_known(r.get("position_drift"))]
    if rows:
        drifts = [max(number(r, f"{x}_drift") for r in rows) for x in ("position", "velocity")]
        orders = [number(r, "order") for r in rows if is_known(r.get("order"))]
        text = (
            f"Over {number(rows[0], 't_end'):g} s with projection the compiled kernel leaves the constraints by {error(drifts[0])} "
        )
        text += f"in position and {error(drifts[1])} in velocity at most"
        rest = list_unmeasured(run.table("kernel_long"), "position_drift")
        energy = f"; its energy error falls with order {run_of_numbers(orders)}" if orders else ""
        yield Finding("Long runs", f"{text}{energy}.{rest}")


def section(run: Run) -> Section | None:
    drifts, energies = ("position drift", "velocity drift"), ("energy [J]", "error, first tenth", "last tenth", "largest", "order")
    head = ("linkage", "formulation", "step [s]", "until s", *drifts, *energies, *GOAL)
    return part("Long runs", LONG, run.table("kernel_long"), head, 2, ran)


def ran(row: Row) -> tuple[Cell, ...]:
    drifts = (exact_cell(row, "position_drift"), exact_cell(row, "velocity_drift"))
    energies = tuple(error_cell(row, x) for x in ("energy", "energy_first", "energy_last", "energy_max"))
    order = Cell(f"{number(row, 'order'):.1f}", number(row, "order")) if is_known(row.get("order")) else Cell("-")
    kept = (*counts(row, "step", "t_end"), *drifts, *energies, order)
    return (*texts(row, "mechanism", "formulation"), *kept, *goal(row, small), remark(row))
