"""What a step and an acceleration cost, as ratios to one engine of the same run."""

from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes

from gauss_bench.report.content import (
    Cell,
    Finding,
    Picture,
    Section,
    Table,
    Text,
    columns,
    engine_cell,
    listed,
    ratio_cells,
    text_cell,
    time_cell,
    times,
)
from gauss_bench.report.palette import INK
from gauss_bench.report.plotting import Looks, logarithmic, panels, svg, titled
from gauss_bench.report.rows import Row, Run, costs, known, named, number, plain

PLACE = 50
TABLES = ("results",)
OWN, RIVAL = "gauss", "lagrange"
HEAD = (
    *("engine", "settings", "integrator", "stabilization"),
    *("step µs", "ratio", "spread"),
    *("own loop µs", "ratio", "spread"),
    *("acceleration µs", "ratio", "spread"),
    *("warm build ms", "cold build ms"),
)


def section(run: Run, name: str) -> Section | None:
    rows = costs(run.of(name))
    if not rows:
        return None
    baseline = run.environment.get("baseline_engine", "")
    words = (
        f"Lower quartiles of interleaved samples, and their ratio to `{baseline}` with its spread. **Step** is a step called from "
        "Python, **own loop** a step inside the engine's compiled loop. A ratio above 1 is slower. **Warm build** is a model and "
        "its first step where what is generated is stored, **cold build** the first one in a new process with nothing stored, "
        "once; engines without one generate no code."
    )
    head, numeric = columns(HEAD, 4)
    lines = []
    for row in rows:
        names = tuple(text_cell(row[key]) for key in ("settings", "integrator", "stabilization"))
        step = (time_cell(row, "step_time"), *ratio_cells(row, "step_ratio"))
        own = (time_cell(row, "native_step_time"), *ratio_cells(row, "native_step_ratio"))
        one = (time_cell(row, "acceleration_time"), *ratio_cells(row, "acceleration_ratio"))
        built = (milliseconds(row, x) for x in ("build_time", "cold_build_time"))
        lines.append((engine_cell(row), *names, *step, *own, *one, *built))
    note = "A spread is the range of the ratio from its 5 to its 95 percent point over resampled rounds."
    table = Table(f"{name}: cost", head, tuple(lines), numeric, note=note)
    svg = cost_ratios([row for row in rows if plain(row)], str(baseline))
    pictures = (Picture(f"cost_{name}", svg, f"Cost ratios of {name}, without stabilisation"),) if svg else ()
    return Section("Cost", f"{name}-cost", (Text(words), *pictures, table))


def milliseconds(row: Row, column: str) -> Cell:
    x = number(row, column)
    return Cell(f"{1e3 * x:.2f}", x) if known(x) else Cell("-")


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
            again = column == "acceleration_ratio" and any(named(r) == named(row) for r in order[i + 1 :])
            if known(row.get(column)) and not again:  # an acceleration has no integrator: once is enough
                _drawn(axes, i, row, column, looks)
        axes.axvline(1.0, color=INK, linewidth=1, linestyle=(0, (4, 3)), zorder=1)
        logarithmic(axes, "x")
        axes.set_xlim(min(*values, 1.0) / 1.5, max(*values, 1.0) * 4)  # room for the numbers
        titled(axes, RATIOS[column])
        axes.set_xlabel(f"ratio to {baseline}")
    names = [f"{named(row)} {row['integrator']}".strip() for row in order]
    grid[0].set_yticks(range(len(order)), names)
    grid[0].set_ylim(-0.6, len(order) - 0.4)
    total = figure.get_size_inches()[0]
    figure.subplots_adjust(left=(0.3 + 0.075 * max(map(len, names))) / total, right=1 - 0.2 / total)
    return svg(figure)


def _drawn(axes: Axes, i: int, row: Row, column: str, looks: Looks) -> None:
    """One ratio at height i: its spread as a bar, its value as a mark and a number."""
    x, low, high = (number(row, f"{column}{end}") for end in ("", "_low", "_high"))
    colour = looks.colours[row["engine"]]
    if known(low) and known(high):
        axes.plot([low, high], [i, i], color=colour, linewidth=6, alpha=0.35, solid_capstyle="butt")
    axes.plot(x, i, marker=looks.markers[row["settings"]], markersize=5.5, color=colour)
    place = max(x, high) if known(high) else x
    axes.annotate(times(x), (place, i), (6, 0), textcoords="offset points", va="center", fontsize=8.5, color=INK)


def findings(run: Run) -> Iterator[Finding]:
    """The suite's own formulation against Lagrange multipliers: the cost of a step and of an acceleration."""
    rows = [row for row in costs(run.results) if plain(row)]
    for quantity, what in (("step", "A step"), ("acceleration", "One acceleration")):
        spreads: dict[str, list[float]] = {}
        for row in (r for r in rows if r["engine"] == OWN):
            rival = next((r for r in rows if r["engine"] == RIVAL and _alike(r, row)), None)
            ratio = _ratio(run, row, rival, quantity) if rival is not None else []
            if ratio:  # an acceleration has no integrator: one per linkage
                spreads.setdefault(f"{row['mechanism']}{' ' + row['integrator'] if quantity == 'step' else ''}", ratio)
        if spreads:
            slower = sum(x[0] > 1 for x in spreads.values())
            told = listed(f"{name} {_with_spread(x)}" for name, x in spreads.items())
            yield Finding(
                f"Cost of {OWN} against {RIVAL}",
                f"{what} of `{OWN}` takes this multiple of the time of `{RIVAL}`: {told}; slower in {slower} of {len(spreads)}.",
                "warn" if slower > len(spreads) / 2 else "good",
            )


def _with_spread(x: list[float]) -> str:
    return f"{times(x[0])} ({times(x[1])}..{times(x[2])})" if len(x) > 1 else times(x[0])


def _alike(a: Row, b: Row) -> bool:
    return all(a[key] == b[key] for key in ("mechanism", "settings", "integrator"))


def _ratio(run: Run, own: Row, rival: Row, quantity: str) -> list[float]:
    """Ratio with low and high where the rival, or the row itself, is what ratios are taken to; else the quotient of two ratios."""
    x, low, high = (number(own, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    y, below, above = (number(rival, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    baseline = run.environment.get("baseline_engine")
    if baseline == RIVAL and y == 1 and known(low) and known(high):
        return [x, low, high]
    if baseline == OWN and x == 1 and below > 0 and above > 0:
        return [1 / y, 1 / above, 1 / below]
    return [x / y] if known(x) and y > 0 else []
