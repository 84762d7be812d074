"""Diagrams of the kernel suite: time to solution at equal accuracy, and how time grows with the size of a linkage."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes

from gauss_bench.report.content import times
from gauss_bench.report.figures import label_at, logarithmic
from gauss_bench.report.palette import INK, MUTED, engine_colours
from gauss_bench.report.plotting import legend, panels, svg, titled
from gauss_bench.report.rows import Row, grouped, known, number

OWN = "gauss-native"
LANE = 0.19  # height of an engine within a linkage
LOOKS = {
    "loops, gauss": ("gauss", "o"),
    "loops, lagrange": ("lagrange", "o"),
    "straight line, gauss": ("gauss", "s"),
    "pinocchio, constraintDynamics": ("pinocchio", "o"),
    "pinocchio, lcaba": ("pinocchio", "^"),
    "mujoco, sparse": ("mujoco", "o"),
    "mujoco, dense": ("mujoco", "s"),
    "exudyn, sparse": ("exudyn", "o"),
}
WAYS = {"in its own loop": "-", "one implicit step": ":", "called from Python": "--"}


def equal_accuracy(rows: Sequence[Row]) -> str:
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
        titled(axes, f"crank within {target:.0e} rad after 1 s")
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


def scaling(rows: Sequence[Row], growth: Sequence[Row]) -> str:
    """SVG text: time of one right-hand side against the number of windows, with the exponents; empty without rows."""
    drawn = [row for row in rows if known(row.get("seconds")) and number(row, "seconds") > 0]
    if not drawn:
        return ""
    exponents = {(row["engine"], row["quantity"]): number(row, "exponent") for row in growth}
    figure, ((axes,),) = panels(1, width=6.2, height=4.6)
    entries: dict[str, Mapping[str, Any]] = {}
    for (engine, quantity), line in grouped(sorted(drawn, key=_order), lambda r: (str(r["engine"]), str(r["quantity"]))).items():
        look = _look(engine) | {"linestyle": WAYS.get(quantity, "-.")}
        x, y = ([number(r, column) for r in line] for column in ("size", "seconds"))
        axes.plot(x, y, **look)
        p = exponents.get((engine, quantity), math.nan)
        if known(p) and engine not in entries:
            axes.annotate(f"{p:.2f}", (x[-1], y[-1]), (7, 0), textcoords="offset points", va="center", fontsize=8.5, color=INK)
        entries.setdefault(engine, look | {"linestyle": "-"})
    logarithmic(axes)
    label_at(axes, sorted({number(r, "size") for r in drawn}))
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * 1.6)  # room for the numbers
    axes.set_xlabel("windows")
    axes.set_ylabel("one right-hand side [s]")
    words = [(way, {"color": MUTED, "linestyle": style}) for way, style in WAYS.items() if any(r["quantity"] == way for r in drawn)]
    legend(figure, [("engine", [(_short(name), look) for name, look in entries.items()]), ("asked", words)])
    return svg(figure)


def _short(engine: str) -> str:
    """A name that fits beside the figure."""
    return engine.removesuffix(", constraintDynamics")


def _order(row: Row) -> tuple[Any, ...]:
    """By engine as in LOOKS, the own loop first, then by size."""
    engines, ways = [*LOOKS, row["engine"]], [*WAYS, row["quantity"]]
    return engines.index(row["engine"]), ways.index(row["quantity"]), number(row, "size")


def _look(engine: str) -> dict[str, Any]:
    """Colour by the engine before the comma, marker by the variant after it."""
    name, marker = LOOKS.get(engine, (engine.partition(", ")[0], "D"))
    return {"color": engine_colours([name])[name], "marker": marker, "markeredgewidth": 0}
