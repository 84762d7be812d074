"""Trajectories: every engine, setting, integrator, stabilisation and step against the reference."""

from gauss_bench.report.content import (
    BELOW_LEGEND,
    Block,
    Cell,
    Picture,
    Section,
    Table,
    columns,
    engine_cell,
    error_cell,
    status_cell,
    step_cell,
    text_cell,
)
from gauss_bench.report.figures import convergence, work_precision
from gauss_bench.report.rows import (
    CRANK_ERRORS,
    Row,
    Run,
    below_reference,
    crank_bar,
    end_error,
    grouped,
    known,
    method,
    number,
    plain,
    ranked,
    run_time,
)

HEAD = (
    "engine",
    "settings",
    "integrator",
    "stabilization",
    "step [s]",
    *(f"crank {t:g} s" for t in CRANK_ERRORS.values()),
    "position",
    "velocity",
    "pos. drift",
    "vel. drift",
    "acc. residual",
    "energy [J]",
    "order",
    "status",
)
COSTED = (
    "Cost is the measured time of a step, in the engine's own loop where it has one, times the steps; steps are timed without "
    "stabilisation, so only such runs are drawn. Lines that coincide show as stripes."
)
NOTE = (
    "Errors against the reference: of the crank angle [rad] at three times, and the worst over the run of any position [m, "
    "rad] and velocity [m/s, rad/s]. Drift: worst constraint residual [m, rad] and its rate. Order: observed from this and "
    "the next larger step. "
)


def section(run: Run, name: str) -> Section | None:
    blocks: list[Block] = []
    for scenario, rows in grouped(run.of(name), lambda r: str(r["scenario"])).items():
        tag = f"{name}_{scenario}"
        if any(known(end_error(row)) for row in rows):
            svg = work_precision(rows)
            if svg:
                blocks.append(
                    Picture(f"work_precision_{tag}", svg, f"Error against cost, {name} {scenario}", COSTED + left_out(rows, True))
                )
            caption = "Only valid rows are drawn; lines that coincide show as stripes." + left_out(rows)
            blocks.append(Picture(f"convergence_{tag}", convergence(rows), f"Error against step, {name} {scenario}", caption))
            blocks.append(best(f"{name}, {scenario}: the most accurate valid row of each engine and its settings", rows))
        blocks.append(whole(f"{name}, {scenario}: all trajectories", rows))
    return Section("Trajectories", f"{name}-trajectories", tuple(blocks)) if blocks else None


def left_out(rows: list[Row], costs: bool = False) -> str:
    """How many rows no figure draws, in a sentence."""
    failed = sum(row["status"] not in ("ok", "invalid", "skip") for row in rows)
    skipped = sum(row["status"] == "skip" for row in rows)
    invalid = sum(row["status"] in ("ok", "invalid") and not ranked(row) for row in rows)
    reasons = [(failed, "failed"), (skipped, "skipped"), (invalid, "not valid or a control")]
    if costs:
        reasons.append((sum(ranked(row) and plain(row) and not known(run_time(row)) for row in rows), "without a measured cost"))
    parts = [f"{n} {word}" for n, word in reasons if n]
    return f" Left out: {', '.join(parts)}." if parts else ""


def line(row: Row) -> tuple[Cell, ...]:
    order = row.get("observed_order")
    return (
        engine_cell(row),
        *(text_cell(row[key]) for key in ("settings", "integrator", "stabilization")),
        step_cell(row),
        *(error_cell(row, column, crank_bar(row, column)) for column in CRANK_ERRORS),
        *(error_cell(row, column, number(row, f"{column}_bar")) for column in ("position_error", "velocity_error")),
        *(error_cell(row, column) for column in ("position_drift", "velocity_drift", "acceleration_residual")),
        error_cell(row, "energy_error", number(row, "energy_error_bar")),
        Cell(f"{order:.1f}", order) if known(order) and order is not None else Cell("-"),
        status_cell(row),
    )


def whole(title: str, rows: list[Row]) -> Table:
    head, numeric = columns(HEAD, 4, last_text=1)
    return Table(title, head, tuple(line(row) for row in rows), numeric, folded=True, note=NOTE + BELOW_LEGEND)


def best(title: str, rows: list[Row]) -> Table:
    """One line for each engine and its settings; below the reference the largest step stands for all."""

    def rank(row: Row) -> tuple[bool, float, float]:
        below = below_reference(row)
        return not below, 0.0 if below else end_error(row), -row["step"] if known(row["step"]) else 0.0

    found = [row for row in rows if ranked(row) and known(end_error(row))]
    lines = [line(min(group, key=rank)) for group in grouped(found, lambda r: method(r)[:2]).values()]
    head, numeric = columns(HEAD, 4, last_text=1)
    return Table(title, head, tuple(lines), numeric, note=BELOW_LEGEND)
