"""Time to solution at equal accuracy, each engine by its best way."""

import math
from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes

from gauss_bench.report.content import (
    Block,
    Cell,
    Finding,
    Picture,
    Section,
    Text,
    count,
    error_cell,
    ratio_cells,
    remark,
    run_of_numbers,
    small,
    text_cell,
    texts,
    time_of,
    times,
    titled_table,
)
from gauss_bench.report.palette import INK, engine_colours
from gauss_bench.report.plotting import (
    legend,
    logarithmic,
    panels,
    svg,
    titled,
)
from gauss_bench.report.rows import (
    Row,
    Run,
    grouped,
    known,
    measure,
    number,
    unit,
)

PLACE = 20
TABLES = ("kernel_accuracy", "kernel_ladder")
ACCURACY = (
    "Equal steps are not equal accuracy. Each method takes the largest of the halved steps with which the linkage's measured "
    "coordinate is as near the certified one after one second; then all race over that second. Long runs are cut to their first "
    "part and scaled. The multiple is of the kernel's fastest way. Pinocchio has no integrator for closed loops: its steps are the "
    "suite's, in Python, which is most of their time."
)
CAPTION = (
    "Each engine's fastest way of those tried, with its multiple of the kernel's; cannot: none reached it within the time allowed."
)
OWN = "gauss-native"
LANE = 0.19  # height of an engine within a linkage
CANNOT = "cannot reach"


def findings(run: Run) -> Iterator[Finding]:
    """What other engines' best ways take to the same accuracy."""
    rows = [r for r in run.table("kernel_accuracy") if known(r.get("accuracy"))]
    for target, group in sorted(grouped(rows, lambda r: number(r, "accuracy")).items(), reverse=True):
        parts = []
        for engine, some in grouped((r for r in group if r["engine"] != OWN), lambda r: str(r["engine"])).items():
            ratios = [number(r, "ratio") for r in some if r["best"] and known(r.get("ratio"))]
            linkages = {r["mechanism"] for r in some if r["status"] in ("ok", CANNOT)}
            without = len(linkages - {r["mechanism"] for r in some if r["best"]})
            cannot = f" and does not reach it on {count(without, 'linkage')}" if without else ""
            if ratios or without:
                parts.append(
                    f"`{engine}` {run_of_numbers(ratios)}{cannot}" if ratios else f"`{engine}`{cannot.removeprefix(' and')}"
                )
        if parts:
            text = (
                f"To bring the measured coordinate within {target:.0e} {unit(group)} after one second, the best way of other "
                f"engines takes this multiple of the compiled kernel's time: {'; '.join(parts)}. Pinocchio is stepped from Python, "
                "the others step themselves."
            )
            yield Finding("Equal accuracy", text)


def section(run: Run) -> Section | None:
    rows = run.table("kernel_accuracy")
    names = ("linkage", "measured", "within", "engine", "settings", "integrator", "stabilization")
    head = (*names, *("step [s]", "error", "lengths [m]", "angles [rad]", "time", "multiple", "spread", "remark"))
    if not rows:
        return None
    blocks: list[Block] = [Text(ACCURACY)]
    if drawn := figure_of(rows):
        blocks.append(Picture("kernel_accuracy", drawn, "Time to solution at equal accuracy", CAPTION))
    blocks.append(titled_table("Equal accuracy, each engine's best", head, 7, best_of_engines(rows), solved))
    blocks.append(titled_table("Equal accuracy, every way", head, 7, rows, solved, folded=True))
    return Section("Time to solution at equal accuracy", "kernel-accuracy", tuple(blocks))


def best_of_engines(rows: Sequence[Row]) -> list[Row]:
    """Each engine's fastest way to an accuracy; where it has none, the one that came nearest."""

    def key(row: Row) -> tuple[str, float, str]:
        return str(row.get("mechanism", "")), -number(row, "accuracy"), str(row.get("engine", ""))

    def rank(row: Row) -> tuple[bool, float]:
        return not row.get("best"), number(row, "error") if known(row.get("error")) else math.inf

    return [min(group, key=rank) for _, group in sorted(grouped(rows, key).items())]


def solved(row: Row) -> tuple[Cell, ...]:
    """A way to a solution, or how near it came."""
    names = texts(row, "settings", "integrator", "stabilization")
    within = Cell(small(number(row, "accuracy")), number(row, "accuracy"))
    reached = (
        Cell(f"{number(row, 'step'):.3g}", number(row, "step")) if known(row.get("step")) else Cell("-"),
        *(error_cell(row, x) for x in ("error", "length_error", "angle_error")),
        time_of(row),
        *ratio_cells(row, "ratio"),
    )
    return (
        *texts(row, "mechanism"),
        text_cell(measure([row])),
        within,
        text_cell(row.get("engine", ""), "engine"),
        *names,
        *reached,
        remark(row),
    )


def figure_of(rows: Sequence[Row]) -> str:
    """SVG text: the time each engine's best way takes to reach an accuracy, a panel for each; empty without rows."""
    drawn = [row for row in rows if row.get("best")]
    if not drawn:
        return ""
    rows = [row for row in rows if known(row.get("accuracy"))]
    targets = sorted({number(row, "accuracy") for row in rows}, reverse=True)
    linkages = sorted({str(row["mechanism"]) for row in rows}, reverse=True)
    engines = sorted({str(row["engine"]) for row in rows}, key=lambda x: (x != OWN, x))
    colours = engine_colours(engines)
    figure, (grid,) = panels(len(targets), width=4.1, height=0.95 * len(linkages) + 0.5)
    seconds = [number(row, "seconds") for row in drawn]
    for target, axes in zip(targets, grid, strict=True):
        for place, linkage in enumerate(linkages):
            for lane, engine in enumerate(engines):
                y = place + LANE * ((len(engines) - 1) / 2 - lane)
                here = [r for r in drawn if (r["mechanism"], r["engine"], number(r, "accuracy")) == (linkage, engine, target)]
                _reached(axes, y, here[0] if here else None, colours[engine], max(seconds))
        logarithmic(axes, "x")
        axes.set_xlim(min(seconds) / 2, max(seconds) * 12)
        titled(axes, f"within {target:.0e} {unit(rows)} after 1 s")
        axes.set_xlabel("time to solution [s], and its multiple")
        axes.grid(False, axis="y")
    grid[0].set_yticks(range(len(linkages)), linkages)
    grid[0].set_ylim(-0.55, len(linkages) - 0.45)
    total = figure.get_size_inches()[0]
    figure.subplots_adjust(left=1.1 / total)
    marks = [(name, {"color": colours[name], "marker": "o", "linestyle": ""}) for name in engines]
    legend(figure, [("engine, its best way", marks)])
    return svg(figure)


def _reached(axes: Axes, y: float, row: Row | None, colour: str, longest: float) -> None:
    """A mark with the multiple of the fastest at height y, or the word that there is none."""
    if row is None:
        axes.text(longest * 11, y, "cannot", color=colour, va="center", ha="right", fontsize=8)
        return
    x, low, high = (number(row, f"seconds{end}") for end in ("", "_low", "_high"))
    if known(low) and known(high):
        axes.plot([low, high], [y, y], color=colour, linewidth=5, alpha=0.35, solid_capstyle="butt")
    axes.plot(x, y, marker="o", markersize=5, color=colour)
    axes.annotate(times(number(row, "ratio")), (x, y), (6, 0), textcoords="offset points", va="center", fontsize=8, color=INK)
