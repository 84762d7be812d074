"""The report's diagrams: colour is the engine, marker the setting, line the integrator, everywhere.

Each function takes rows and returns SVG text, empty where there is nothing to draw.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullLocator

from gauss_bench.report.content import times
from gauss_bench.report.palette import INK, LINES, MARKERS, MUTED, cycle, engine_colours
from gauss_bench.report.plotting import band, decades, legend, panels, svg, titled
from gauss_bench.report.rows import (
    SAME_ACCELERATION,
    Row,
    Run,
    accelerations,
    end_bar,
    end_error,
    grouped,
    known,
    method,
    number,
    own_steps,
    ranked,
    run_time,
)

Line = tuple[Sequence[float], Sequence[float], Mapping[str, Any]]
Entries = list[tuple[str, Mapping[str, Any]]]
FLOOR = 1e-17  # an error of exactly zero is drawn here


class Looks:
    """Colour, marker and line of each case among the given rows."""

    def __init__(self, rows: Sequence[Row]):
        controls = {row["engine"] for row in rows if row.get("control")}
        self.colours = engine_colours((row["engine"] for row in rows), controls)
        self.markers = cycle((row["settings"] for row in rows), MARKERS)
        self.lines = cycle((row["integrator"] for row in rows), LINES)

    def of(self, row: Row, marker: bool = True) -> dict[str, Any]:
        found = {"color": self.colours[row["engine"]], "linestyle": self.lines[row["integrator"]]}
        return found | {"marker": self.markers[row["settings"]], "markeredgewidth": 0} if marker else found

    def keys(self, rows: Sequence[Row], marker: bool = True) -> list[tuple[str, Entries]]:
        """Legends for what is drawn of the rows."""
        drawn = [sorted({row[key] for row in rows}) for key in ("engine", "settings", "integrator")]
        engines: Entries = [(name, {"color": self.colours[name], "linewidth": 3}) for name in drawn[0]]
        settings: Entries = [(name, {"color": MUTED, "marker": self.markers[name], "linestyle": ""}) for name in drawn[1]]
        integrators: Entries = [(name or "own", {"color": MUTED, "linestyle": self.lines[name]}) for name in drawn[2]]
        return [("engine", engines), ("settings", settings if marker else []), ("integrator", integrators)]


def logarithmic(axes: Axes, which: str = "both") -> None:
    """Logarithmic axes with a label every decade or, over a wide range, every few."""
    if which in ("x", "both"):
        axes.set_xscale("log")
    if which in ("y", "both"):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(numticks=9))
        axes.yaxis.set_minor_locator(NullLocator())


def striped(axes: Axes, lines: Sequence[Line]) -> None:
    """Draw lines; of several that coincide the later are thinner, so that all of them are seen, as stripes."""
    for i, (x, y, look) in enumerate(lines):
        under = sum(coincide((x, y), (a, b)) for a, b, _ in lines[i + 1 :])
        width = 1.5 + 1.6 * min(under, 5)
        axes.plot(x, y, **look, linewidth=width, markersize=3.6 + width, zorder=2 + i / len(lines))


def coincide(one: tuple[Sequence[float], Sequence[float]], other: tuple[Sequence[float], Sequence[float]]) -> bool:
    """Whether two lines of a logarithmic figure cannot be told apart by eye: within 5 percent at all places."""
    (a, b), (c, d) = one, other
    if len(a) != len(c):
        return False
    pairs = [*zip(a, c, strict=True), *zip(b, d, strict=True)]
    return all(abs(x - y) <= 0.05 * max(abs(x), abs(y)) for x, y in pairs if known(x) and known(y))


def label_at(axes: Axes, places: Sequence[float]) -> None:
    """Ticks at the given places of a logarithmic x axis, at most six of them."""
    chosen = places[:: 1 + (len(places) - 1) // 6]
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(chosen, [f"{x:g}" for x in chosen])


def stabilizations(rows: Iterable[Row]) -> list[str]:
    return sorted({row["stabilization"] for row in rows}, key=lambda x: (x != "none", x))


def work_precision(rows: Sequence[Row]) -> str:
    """Crank error at the end against the time of the whole run, of runs without stabilisation; empty without costs."""
    timed = [row for row in rows if known(run_time(row))]
    return _errors(timed, run_time, "time of the run [s]") if any(ranked(row) for row in timed) else ""


def convergence(rows: Sequence[Row]) -> str:
    """Crank error at the end against the step, one panel for each stabilisation."""
    return _errors([row for row in rows if not own_steps(row)], lambda row: number(row, "step"), "step [s]", ticks=True)


def _errors(rows: Sequence[Row], x: Callable[[Row], float], xlabel: str, ticks: bool = False) -> str:
    drawn = [r for r in rows if ranked(r) and known(end_error(r)) and known(x(r)) and x(r) > 0]
    looks, names = Looks(rows), stabilizations(drawn)
    figure, grid = panels(max(len(names), 1), width=max(2.4, min(5.6, 8.6 / max(len(names), 1))))
    bar = max((end_bar(row) for row in drawn), default=0.0)
    values = [max(end_error(r), bar, FLOOR) for r in drawn] or [1e-6]
    low, high = decades(min(values) / (30 if bar and min(values) <= bar else 1), max(values))
    for i, axes in enumerate(grid[0]):
        if not drawn:
            axes.text(0.5, 0.5, "no valid row to draw", transform=axes.transAxes, ha="center", color=MUTED)
            continue
        lines = []
        for group in grouped((r for r in drawn if r["stabilization"] == names[i]), method).values():
            line = sorted(group, key=x)
            y = [bar / 3 if bar and end_error(r) < bar else max(end_error(r), FLOOR) for r in line]
            lines.append(([x(r) for r in line], y, looks.of(line[0])))
        striped(axes, lines)
        logarithmic(axes)
        if ticks:
            label_at(axes, sorted({x(r) for r in drawn}))
        axes.set_ylim(low, high)
        titled(axes, f"stabilisation: {names[i]}")
        axes.set_xlabel(xlabel if len(names) < 3 or i == 1 else "")
        if bar > low:
            band(axes, bar, "below reference" if i == len(names) - 1 else "")
    grid[0][0].set_ylabel("crank error at the end [rad]")
    legend(figure, looks.keys(drawn))
    return svg(figure)


def common_step(rows: Sequence[Row]) -> float:
    """The step most cases with a history have in common; of equals the smallest."""
    steps = [number(row, "step") for row in rows if not own_steps(row)]
    return max(sorted(set(steps)), key=steps.count, default=0.0)


def _histories(series: Sequence[Row], cases: Sequence[Row]) -> tuple[list[list[Row]], float]:
    """The histories at the common step, or at the engine's own, of cases that ended ok; with the flag of controls."""
    fine = {_case(row): row for row in cases if row["status"] in ("ok", "invalid")}
    step = common_step(list(fine.values()))
    found: list[list[Row]] = []
    for key, rows in grouped(series, _case).items():
        if key in fine and (own_steps(fine[key]) or number(rows[0], "step") == step):
            found.append([{**row, "control": fine[key]["control"]} for row in rows])
    return found, step


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


def acceleration_errors(run: Run, name: str) -> str:
    """Median (bar) and maximum (tick) of the relative acceleration error at the same states, with the gate."""
    rows = sorted(accelerations(run.of(name)), key=lambda r: -number(r, "acceleration_error_median"))
    looks = Looks(run.results)
    figure, ((axes,),) = panels(1, width=6.4, height=0.27 * len(rows) + 0.5)
    middle = [max(number(r, "acceleration_error_median"), FLOOR) for r in rows]
    most = [max(number(r, "acceleration_error_max"), FLOOR) for r in rows]
    low, high = decades(min(middle), max(*most, run.acceleration_gate))
    for i, row in enumerate(rows):
        colour = looks.colours[row["engine"]]
        axes.barh(i, middle[i] - low / 10, left=low / 10, height=0.62, color=colour)
        axes.plot([middle[i], most[i]], [i, i], color=colour, linewidth=1)
        axes.plot(most[i], i, marker="|", markersize=9, color=colour, markeredgewidth=1.6)
        axes.annotate(f"{middle[i]:.0e}", (most[i], i), (7, 0), textcoords="offset points", va="center", fontsize=8.5, color=INK)
    for place, word in ((SAME_ACCELERATION, "same model"), (run.acceleration_gate, "validity gate")):
        axes.axvline(place, color=INK, linewidth=1, linestyle=(0, (4, 3)))
        axes.text(place, len(rows) - 0.42, word, fontsize=8.5, va="bottom", ha="center", color=INK)
    axes.set_yticks(range(len(rows)), [_name(row) for row in rows])
    axes.set_ylim(-0.6, len(rows) - 0.4)
    logarithmic(axes, "x")
    axes.set_xlim(low, high * 30)
    axes.grid(False, axis="y")
    axes.set_xlabel("relative error of the acceleration: bar = median (printed), tick = maximum")
    figure.subplots_adjust(left=0.22, right=0.97)
    return svg(figure)


def _name(row: Row) -> str:
    mark = " (control)" if row["control"] else ""
    return f"{row['engine']} {row['settings'] if row['settings'] != 'default' else ''}".strip() + mark


RATIOS = {"step_ratio": "step from Python", "native_step_ratio": "step in own loop", "acceleration_ratio": "one acceleration"}


def cost_ratios(rows: Sequence[Row], baseline: str) -> str:
    """Ratios to the baseline with their spread: a step from Python, a step in the own loop, one acceleration."""
    shown = [r for r in rows if any(known(r.get(c)) for c in RATIOS)]
    columns = [c for c in RATIOS if any(known(r.get(c)) for r in shown)]
    if not columns:
        return ""
    looks = Looks(rows)
    values = [number(r, c) for r in shown for c in columns if known(r.get(c))]
    order = sorted(shown, key=lambda r: (r["engine"], r["settings"], r["integrator"]), reverse=True)
    figure, (grid,) = panels(len(columns), width=2.7, height=0.25 * len(order) + 0.6)
    for column, axes in zip(columns, grid, strict=True):
        for i, row in enumerate(order):
            again = column == "acceleration_ratio" and any(_name(r) == _name(row) for r in order[i + 1 :])
            if known(row.get(column)) and not again:  # an acceleration has no integrator: once is enough
                _ratio(axes, i, row, column, looks)
        axes.axvline(1.0, color=INK, linewidth=1, linestyle=(0, (4, 3)), zorder=1)
        logarithmic(axes, "x")
        axes.set_xlim(min(*values, 1.0) / 1.5, max(*values, 1.0) * 4)  # room for the numbers
        titled(axes, RATIOS[column])
        axes.set_xlabel(f"ratio to {baseline}")
    names = [f"{_name(row)} {row['integrator']}".strip() for row in order]
    grid[0].set_yticks(range(len(order)), names)
    grid[0].set_ylim(-0.6, len(order) - 0.4)
    total = figure.get_size_inches()[0]
    figure.subplots_adjust(left=(0.3 + 0.075 * max(map(len, names))) / total, right=1 - 0.2 / total)
    return svg(figure)


def _ratio(axes: Axes, i: int, row: Row, column: str, looks: Looks) -> None:
    """One ratio at height i: its spread as a bar, its value as a mark and a number."""
    x, low, high = (number(row, f"{column}{end}") for end in ("", "_low", "_high"))
    colour = looks.colours[row["engine"]]
    if known(low) and known(high):
        axes.plot([low, high], [i, i], color=colour, linewidth=6, alpha=0.35, solid_capstyle="butt")
    axes.plot(x, i, marker=looks.markers[row["settings"]], markersize=5.5, color=colour)
    place = max(x, high) if known(high) else x
    axes.annotate(times(x), (place, i), (6, 0), textcoords="offset points", va="center", fontsize=8.5, color=INK)
