"""How the time of a right-hand side grows with the number of loops."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gauss_bench.report.content import (
    RANGE,
    Block,
    Cell,
    Finding,
    Picture,
    Section,
    Text,
    counts,
    error_cell,
    listed,
    remark,
    span,
    texts,
    time_of,
    titled_table,
)
from gauss_bench.report.palette import INK, MUTED, engine_colours
from gauss_bench.report.plotting import (
    label_at,
    legend,
    logarithmic,
    panels,
    svg,
)
from gauss_bench.report.rows import (
    Row,
    Run,
    grouped,
    known,
    number,
)

PLACE = 70
TABLES = ("scaling", "kernel_growth")
SCALING = (
    "Chains of N windows, (n - m) = 1: one right-hand side of the same state. Exponents p of time ~ N^p are least squares of the "
    "logarithms; own kernels in their own loop, engines as called. Errors against the closed form."
)
CAPTION_SCALING = "Exponents p of time ~ windows^p stand at the ends of the lines."
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
BUILDING = ("generate_seconds", "compile_seconds")


def findings(run: Run) -> Iterator[Finding]:
    """Exponents of whatever is asked in the way that costs least."""
    rows = run.table("kernel_growth")
    looped = {r["engine"] for r in rows if r["quantity"] == "in its own loop"}
    shown = [r for r in rows if r["quantity"] == "in its own loop" or r["engine"] not in looped]
    if shown:
        said = listed(f"`{r['engine']}` {number(r, 'exponent'):.2f}" for r in shown)
        text = f"The time of a right-hand side of N windows grows like N^p from {number(shown[0], 'from'):g} on, with p of {said}."
        yield Finding("Growth with size", text)


def section(run: Run) -> Section | None:
    rows, growth = run.table("scaling"), run.table("kernel_growth")
    if not rows:
        return None
    blocks: list[Block] = [Text(SCALING)]
    if drawn := figure_of(rows, growth):
        blocks.append(Picture("kernel_scaling", drawn, "Time of a right-hand side against size", CAPTION_SCALING))
    if growth:
        blocks.append(titled_table("Growth", ("engine", "asked", "sizes", "exponent"), 2, growth, grown, last_text=0))
    ordered = sorted(rows, key=lambda r: number(r, "size"))
    head = ("engine", "asked", "windows", "n", "time", RANGE, "error", "generate s", "compile s", "remark")
    blocks.append(titled_table("Every size", head, 2, ordered, sized, folded=True))
    return Section("Size", "kernel-size", tuple(blocks))


def grown(row: Row) -> tuple[Cell, ...]:
    exponent = number(row, "exponent")
    return (*texts(row, "engine", "quantity"), *counts(row, "sizes"), Cell(f"{exponent:.2f}", exponent))


def sized(row: Row) -> tuple[Cell, ...]:
    times_of = (time_of(row), span(row, "low", "high"), error_cell(row, "error"))
    made = tuple(Cell(f"{number(row, x):.2f}", number(row, x)) if known(row.get(x)) else Cell("-") for x in BUILDING)
    return (*texts(row, "engine", "quantity"), *counts(row, "size", "n"), *times_of, *made, remark(row))


def figure_of(rows: Sequence[Row], growth: Sequence[Row]) -> str:
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
