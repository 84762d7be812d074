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


def panels(columns: int, rows: int = 1, height: float = 3.3) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure of rows x columns panels, and the axes of its panels row by row.

    Args:
        height: height of a panel and its labels [inch].
    """
    size = max(columns * 3.0, 5.2) + 2.85, rows * height + 0.6  # [inch]; 2.85 at the right for a legend
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        return figure, figure.subplots(rows, columns, squeeze=False).tolist()


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


def draw_legend(figure: Figure, entries: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw a legend at the right of all panels; `entries` maps the name of a line to its style."""
    handles = [Line2D([], [], label=name, **style) for name, style in entries.items()]
    with matplotlib.rc_context(STYLE):
        figure.legend(handles=handles, loc="outside right upper", fontsize=9)


def give_title(axes: Axes, text: str) -> None:
    """Write a bold title above the left end of a panel."""
    axes.set_title(text, fontsize=10, fontweight="bold", loc="left", color=INK)
