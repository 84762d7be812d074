"""Same state in, acceleration out: what an engine makes of the equations of motion, apart from any integrator."""

from gauss_bench.report.content import (
    Cell,
    Picture,
    Section,
    Table,
    Text,
    columns,
    engine_cell,
    error,
    error_cell,
    ratio_cells,
    text_cell,
    time_cell,
)
from gauss_bench.report.figures import acceleration_errors
from gauss_bench.report.rows import SAME_ACCELERATION, Run, accelerations

WORDS = (
    "Every engine is given the same 200 states and asked for the acceleration there; the error is relative to the reference's. "
    "No step and no integrator is involved, so what differs here is the model."
)


def section(run: Run, name: str) -> Section | None:
    rows = accelerations(run.of(name))
    if not rows:
        return None
    head, numeric = columns(("engine", "settings", "median", "max", "same model", "µs", "ratio", "spread"), 2)
    lines = []
    for row in rows:
        ratio, spread = ratio_cells(row, "acceleration_ratio")
        same = row["acceleration_error_median"] <= SAME_ACCELERATION
        lines.append(
            (
                engine_cell(row),
                text_cell(row["settings"]),
                error_cell(row, "acceleration_error_median"),
                error_cell(row, "acceleration_error_max"),
                Cell("yes", "yes", "good") if same else Cell("no", "no", "bad"),
                time_cell(row, "acceleration_time"),
                ratio,
                spread,
            )
        )
    baseline = run.environment.get("baseline_engine", "")
    note = f"Relative errors; same model: median <= {error(SAME_ACCELERATION)}. Ratio: the cost of one to that of `{baseline}`."
    table = Table(f"{name}: same state in, acceleration out", head, tuple(lines), numeric - {4}, note=note)
    svg = acceleration_errors(run, name)
    picture = Picture(f"acceleration_{name}", svg, f"Acceleration errors of {name}")
    return Section("Same state in, acceleration out", f"{name}-acceleration", (Text(WORDS), picture, table))
