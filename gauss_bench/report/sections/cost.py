"""What a step and an acceleration cost, as ratios to one engine of the same run."""

from gauss_bench.report.content import Cell, Picture, Section, Table, Text, columns, engine_cell, ratio_cells, text_cell, time_cell
from gauss_bench.report.figures import cost_ratios
from gauss_bench.report.rows import Row, Run, costs, known, number

HEAD = (
    *("engine", "settings", "integrator"),
    *("step µs", "ratio", "spread"),
    *("own loop µs", "ratio", "spread"),
    *("acceleration µs", "ratio", "spread"),
    "build ms",
)


def section(run: Run, name: str) -> Section | None:
    rows = costs(run.of(name))
    if not rows:
        return None
    baseline = run.environment.get("baseline_engine", "")
    words = (
        f"Lower quartiles of interleaved samples, and their ratio to `{baseline}` with its spread. **Step** is a step called from "
        "Python, **own loop** a step inside the engine's compiled loop. A ratio above 1 is slower."
    )
    head, numeric = columns(HEAD, 3)
    lines = []
    for row in rows:
        names = tuple(text_cell(row[key]) for key in ("settings", "integrator"))
        step = (time_cell(row, "step_time"), *ratio_cells(row, "step_ratio"))
        own = (time_cell(row, "native_step_time"), *ratio_cells(row, "native_step_ratio"))
        one = (time_cell(row, "acceleration_time"), *ratio_cells(row, "acceleration_ratio"))
        lines.append((engine_cell(row), *names, *step, *own, *one, milliseconds(row)))
    note = "A spread is the range of the ratio from its 5 to its 95 percent point over resampled rounds."
    table = Table(f"{name}: cost", head, tuple(lines), numeric, note=note)
    svg = cost_ratios(rows, str(baseline))
    pictures = (Picture(f"cost_{name}", svg, f"Cost ratios of {name}"),) if svg else ()
    return Section("Cost", f"{name}-cost", (Text(words), *pictures, table))


def milliseconds(row: Row) -> Cell:
    x = number(row, "build_time")
    return Cell(f"{1e3 * x:.2f}", x) if known(x) else Cell("-")
