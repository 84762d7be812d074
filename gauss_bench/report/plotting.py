"""The setting of every figure: type, grid, legend, and SVG text that is the same each time."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gauss_bench.report.palette import GRID, INK, MUTED, PAPER

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


def give_title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10, fontweight="bold", loc="left", color=INK)
