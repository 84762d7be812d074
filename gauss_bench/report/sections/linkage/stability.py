"""What a run loses with time: constraints and energy."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gauss_bench.report.content import (
    Block,
    Finding,
    Picture,
    Section,
    Text,
    error,
    tied,
)
from gauss_bench.report.plotting import (
    FLOOR,
    Looks,
    decades,
    legend,
    logarithmic,
    panels,
    stabilizations,
    striped,
    svg,
    titled,
)
from gauss_bench.report.rows import (
    Row,
    Run,
    grouped,
    known,
    method,
    number,
    own_steps,
    plain,
    ranked,
)

PLACE = 40
TABLES = ("results", "series")
WORDS = (
    "Drift is how far a run has left its constraints, computed in absolute coordinates for every engine; the energy error "
    "is what is left of the balance of energy, work and losses. Drawn at one common step, negative controls included in "
    "grey: a small drift does not make a motion right."
)


def section(run: Run, name: str) -> Section | None:
    blocks: list[Block] = []
    for scenario, rows in grouped((r for r in run.table("series") if r["mechanism"] == name), lambda r: str(r["scenario"])).items():
        tag = f"{name}_{scenario}"
        cases = [row for row in run.of(name) if row["scenario"] == scenario]
        for kind, figure in (("drift", drift), ("energy", energy)):
            svg, step = figure(rows, cases)
            if svg:
                words = f"{kind.capitalize()} over time, {name} {scenario}"
                blocks.append(Picture(f"{kind}_{tag}", svg, words, f"At step {step:g} s, or the engine's own."))
    return Section("Drift and energy", f"{name}-drift", (Text(WORDS), *blocks)) if blocks else None


def common_step(rows: Sequence[Row]) -> float:
    """The step most cases with a history have in common; of equals the smallest."""
    steps = [number(row, "step") for row in rows if not own_steps(row)]
    return max(sorted(set(steps)), key=steps.count, default=0.0)


def _histories(series: Sequence[Row], cases: Sequence[Row]) -> tuple[list[list[Row]], float]:
    """The histories at the common step, or at the engine's own, of cases that ended ok; with the flag of controls."""
    fine = {_case(row): row for row in cases if row["status"] in ("ok", "invalid")}
    step = common_step(list(fine.values()))
    curves: list[list[Row]] = []
    for key, rows in grouped(series, _case).items():
        if key in fine and (own_steps(fine[key]) or number(rows[0], "step") == step):
            curves.append([{**row, "control": fine[key]["control"]} for row in rows])
    return curves, step


def _case(row: Row) -> tuple[Any, ...]:
    step = number(row, "step")
    return row["mechanism"], row["scenario"], *method(row), step if known(step) else 0.0


def drift(series: Sequence[Row], cases: Sequence[Row]) -> tuple[str, float]:
    """Position and velocity drift over time, one column for each stabilisation; and the step drawn."""
    levels = {"position_drift": "position drift [m, rad]", "velocity_drift": "velocity drift [m/s, rad/s]"}
    return _over_time(series, cases, levels)


def energy(series: Sequence[Row], cases: Sequence[Row]) -> tuple[str, float]:
    """Absolute energy error over time, one column for each stabilisation; and the step drawn."""
    return _over_time(series, cases, {"energy_error": "energy error [J]"})


def _over_time(series: Sequence[Row], cases: Sequence[Row], levels: Mapping[str, str]) -> tuple[str, float]:
    histories, step = _histories(series, cases)
    histories = [rows for rows in histories if any(abs(number(r, c)) > 0 for r in rows for c in levels)]
    if not histories:
        return "", step
    heads = [rows[0] for rows in histories]
    looks, names = Looks([*cases, *heads]), stabilizations(heads)
    figure, grid = panels(
        len(names), len(levels), width=max(2.4, min(5.6, 8.6 / len(names))), height=2.5 if len(levels) > 1 else 3.0
    )
    for column, axes_row in zip(levels, grid, strict=True):
        sizes = [abs(number(r, column)) for rows in histories for r in rows if abs(number(r, column)) > 0]
        for i, axes in enumerate(axes_row):
            lines = []
            for rows in (h for h in histories if h[0]["stabilization"] == names[i]):
                t, y = [number(r, "t") for r in rows], [abs(number(r, column)) or math.nan for r in rows]
                lines.append((t, y, looks.of(rows[0], marker=False)))
            striped(axes, lines)
            logarithmic(axes, "y")
            if sizes:
                axes.set_ylim(*decades(max(min(sizes), FLOOR), max(sizes)))
            if axes_row is grid[0]:
                titled(axes, f"stabilisation: {names[i]}")
            if axes_row is grid[-1]:
                axes.set_xlabel("t [s]")
        axes_row[0].set_ylabel(levels[column])
    legend(figure, looks.keys(heads, marker=False))
    return svg(figure), step


def findings(run: Run) -> Iterator[Finding]:
    rows = [row for row in run.results if ranked(row) and known(row.get("position_drift"))]
    free = [row for row in rows if plain(row)]
    if free:
        row = max(free, key=lambda r: number(r, "position_drift"))
        what = tied(free, row, lambda r: number(r, "position_drift"))
        yield Finding(
            "Where drift is worst",
            f"Of the valid rows without stabilisation, constraints are left farthest by {what} on {row['mechanism']} "
            f"{row['scenario']}: {error(number(row, 'position_drift'))} in position and "
            f"{error(number(row, 'velocity_drift'))} in velocity.",
        )
