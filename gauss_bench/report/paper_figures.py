"""The figures of Yuan & Ge (2016), section 4, drawn from a reference: crank and slider against time."""

from collections.abc import Sequence

from matplotlib.axes import Axes

from gauss_bench.report.palette import BODY_EDGE, CRANK_EDGE
from gauss_bench.report.plotting import panels, svg, titled
from gauss_bench.report.rows import Row, number

PANELS = (
    ("x1", "crank's centre, x", "m", CRANK_EDGE),
    ("y1", "crank's centre, y", "m", CRANK_EDGE),
    ("theta1", "crank's angle", "rad", CRANK_EDGE),
    ("x3", "slider, x", "m", BODY_EDGE),
)
FIRST = 2  # the paper's figure 1 is the drawing
MARGIN = 0.2  # [inch] at the right, where these panels have no legend


def paper_figures(rows: Sequence[Row]) -> str:
    """SVG text of eight panels numbered as in the paper: a position and its speed in each row; empty without rows."""
    if not rows:
        return ""
    figure, grid = panels(2, len(PANELS), width=3.7, height=1.75, share=False)
    t = [number(row, "t") for row in rows]
    for k, ((column, name, unit, colour), pair) in enumerate(zip(PANELS, grid, strict=True)):
        rates = ((column, name, unit), (f"{column}_rate", f"{name}: speed", f"{unit}/s"))
        for i, (axes, (key, title, label)) in enumerate(zip(pair, rates, strict=True)):
            draw(axes, t, [number(row, key) for row in rows], colour)
            titled(axes, f"{FIRST + 2 * k + i}  {title}")
            axes.set_ylabel(label)
    for axes in grid[-1]:
        axes.set_xlabel("t [s]")
    width = float(figure.get_size_inches()[0])
    figure.subplots_adjust(right=1 - MARGIN / width, hspace=0.55, wspace=0.28)
    figure.align_ylabels()
    return svg(figure)


def draw(axes: Axes, t: Sequence[float], y: Sequence[float], colour: str) -> None:
    """One curve over the whole time."""
    axes.plot(t, y, color=colour, linewidth=1.1)
    axes.set_xlim(t[0], t[-1])
    axes.locator_params(axis="y", nbins=5)
