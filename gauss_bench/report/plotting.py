"""How every figure is set: type, grid, legend, and SVG text that is the same each time."""

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from gauss_bench.report.palette import GRID, INK, LINES, MARKERS, MUTED, PAPER, cycle, engine_colours
from gauss_bench.report.rows import Row, known

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "gauss_bench",
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.facecolor": PAPER,
    "axes.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "lines.linewidth": 1.5,
    "lines.markersize": 5,
    "legend.frameon": False,
    "axes.formatter.useoffset": False,
}
Line = tuple[Sequence[float], Sequence[float], Mapping[str, Any]]
Entries = list[tuple[str, Mapping[str, Any]]]
FLOOR = 1e-17  # an error of exactly zero is drawn here
LEGEND = 2.1  # width kept for the legend at the right [inch]


def panels(
    columns: int, rows: int = 1, width: float = 3.0, height: float = 3.3, share: bool = True
) -> tuple[Figure, list[list[Axes]]]:
    """A figure of rows x columns panels with room for a legend at the right."""
    left, bottom, top = 0.75, 0.6, 0.4
    total = left + max(columns * width, 5.2) + LEGEND
    tall = rows * height + bottom
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(total, tall))
        axes = figure.subplots(rows, columns, sharex=share, sharey="row" if share else False, squeeze=False)
    edges = {"left": left / total, "right": 1 - LEGEND / total, "bottom": bottom / tall, "top": 1 - top / tall}
    figure.subplots_adjust(**edges, wspace=0.15 if share else 0.3, hspace=0.24)
    return figure, [list(row) for row in axes]


def svg(figure: Figure) -> str:
    """The figure as SVG text: no date, the same identifiers each time."""
    buffer = io.StringIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n"


def png(figure: Figure) -> bytes:
    """The figure as PNG, sharp on paper; the same bytes each time."""
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=200, metadata={"Software": None})
    return buffer.getvalue()


def legend(figure: Figure, keys: Sequence[tuple[str, Sequence[tuple[str, Mapping[str, Any]]]]]) -> None:
    """Legends one under another at the right, each a title with (name, line style) entries; a single entry needs no legend."""
    keys = [(title, entries) for title, entries in keys if entries]
    width, height = _grown(figure, 0.5 + sum(0.19 * len(entries) + 0.36 for _, entries in keys))
    y = 1 - 0.36 / height
    for title, entries in keys:
        handles = [Line2D([], [], **style) for _, style in entries]
        with matplotlib.rc_context(STYLE):
            figure.legend(
                handles,
                [name for name, _ in entries],
                title=title,
                loc="upper left",
                bbox_to_anchor=(1 - (LEGEND - 0.12) / width, y),
                alignment="left",
                title_fontproperties={"weight": "bold", "size": 9},
                fontsize=9,
                borderpad=0,
                borderaxespad=0,
            )
        y -= (0.19 * len(entries) + 0.36) / height


def _grown(figure: Figure, least: float) -> tuple[float, float]:
    """Width and height [inch] after the figure, margins kept, has grown to a least height."""
    width, height = (float(x) for x in figure.get_size_inches())
    if height < least:
        margins = figure.subplotpars
        bottom, top = margins.bottom * height / least, 1 - (1 - margins.top) * height / least
        figure.set_size_inches(width, least)
        figure.subplots_adjust(bottom=bottom, top=top)
    return width, max(height, least)


def titled(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10, fontweight="bold", loc="left", color=INK)


def decades(low: float, high: float) -> tuple[float, float]:
    """Limits of a logarithmic axis around positive values, at least a decade apart."""
    lower, upper = math.floor(math.log10(low) - 0.15), math.ceil(math.log10(high) + 0.15)
    return 10.0**lower, 10.0 ** max(upper, lower + 1)


def band(axes: Axes, bar: float, text: str) -> None:
    """A marked band from the bottom of a logarithmic axis up to the reference's bar."""
    low, _ = axes.get_ylim()
    axes.axhspan(low, bar, color=GRID, alpha=0.6, linewidth=0, zorder=0)
    if text:
        axes.text(0.985, bar, text, transform=axes.get_yaxis_transform(), ha="right", va="top", fontsize=8, color=MUTED, zorder=1)


class Looks:
    """Colour, marker and line of each case among the given rows."""

    def __init__(self, rows: Sequence[Row]):
        controls = {row["engine"] for row in rows if row.get("control")}
        self.colours = engine_colours((row["engine"] for row in rows), controls)
        self.markers = cycle((row["settings"] for row in rows), MARKERS)
        self.lines = cycle((row["integrator"] for row in rows), LINES)

    def of(self, row: Row, marker: bool = True) -> dict[str, Any]:
        style = {"color": self.colours[row["engine"]], "linestyle": self.lines[row["integrator"]]}
        return style | {"marker": self.markers[row["settings"]], "markeredgewidth": 0} if marker else style

    def keys(self, rows: Sequence[Row], marker: bool = True) -> list[tuple[str, Entries]]:
        """Legends for what is drawn of the rows."""
        drawn = [sorted({row[key] for row in rows}) for key in ("engine", "settings", "integrator")]
        engines: Entries = [(name, {"color": self.colours[name], "linewidth": 3}) for name in drawn[0]]
        settings: Entries = [(name, {"color": MUTED, "marker": self.markers[name], "linestyle": ""}) for name in drawn[1]]
        integrators: Entries = [(name or "own", {"color": MUTED, "linestyle": self.lines[name]}) for name in drawn[2]]
        return [("engine", engines), ("settings", settings if marker else []), ("integrator", integrators)]


def logarithmic(axes: Axes, which: str = "both") -> None:
    """Logarithmic axes with a label every decade or, over a wide range, every few; written as tables write it."""
    if which in ("x", "both"):
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(_power))
    if which in ("y", "both"):
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(_power))
        axes.yaxis.set_major_locator(LogLocator(numticks=9))
        axes.yaxis.set_minor_locator(NullLocator())


def _power(value: float, _: int | None) -> str:
    return f"{value:.0e}"


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
