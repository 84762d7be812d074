"""The style of all Matplotlib figures, and their SVG and PNG, which are reproducible byte for byte."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib import rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gauss_bench.report.palette import INK

STYLE = rc_params_from_file(Path(__file__).with_name("figure.mplstyle"), use_default_template=False)
LEGEND = 2.1  # [inch] width of the legend at the right


def panels(columns: int, rows: int = 1, height: float = 3.3) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure of rows x columns panels with room for a legend at the right, and the axes of its panels row by row.

    Args:
        height: height of a panel [inch].
    """
    left, bottom, top = 0.75, 0.6, 0.4  # [inch] margins
    total = left + max(columns * 3.0, 5.2) + LEGEND  # [inch] width of the figure
    tall = rows * height + bottom  # [inch] its height
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(total, tall))
        axes = figure.subplots(rows, columns, squeeze=False)
    edges = {"left": left / total, "right": 1 - LEGEND / total, "bottom": bottom / tall, "top": 1 - top / tall}
    figure.subplots_adjust(**edges, wspace=0.3, hspace=0.24)
    return figure, [list(row) for row in axes]


def svg(figure: Figure) -> str:
    """Return the figure as SVG without a date and with fixed identifiers."""
    buffer = io.StringIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n"


def png(figure: Figure) -> bytes:
    """Return the figure as PNG at 200 dpi, without metadata that change from one release of Matplotlib to the next."""
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, format="png", dpi=200, metadata={"Software": None})
    return buffer.getvalue()


def legend(figure: Figure, entries: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw a legend at the right; `entries` maps the name of a line to its style."""
    width, height = figure.get_size_inches()
    # the upper left corner, 0.12 inch to the right of the panels and 0.36 inch below the upper edge, as fractions of the figure
    corner = (1 - (LEGEND - 0.12) / width, 1 - 0.36 / height)
    handles = [Line2D([], [], label=name, **style) for name, style in entries.items()]
    with matplotlib.rc_context(STYLE):
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=corner, fontsize=9)


def give_title(axes: Axes, text: str) -> None:
    """Write a bold title above the left end of a panel."""
    axes.set_title(text, fontsize=10, fontweight="bold", loc="left", color=INK)
