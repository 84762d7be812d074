"""Pictures of a sweep: the distribution of each figure, and the figure against each varied number."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gauss_bench.sweep.plan import Plan
from gauss_bench.terms import Array
from gauss_bench.trajectory import spread_evenly

SHOWN = 500  # largest number of points in a panel, since more points overlap
TICKS = 4  # largest number of intervals of an axis, since a small panel has no space for more
MOST = 8  # largest number of figures that are drawn
ROUNDING, SMALLEST = 1e-12, 1e-300  # a range below ROUNDING times the largest value, plus SMALLEST, is rounding


def plots(rows: Any, plan: Plan, figures: Sequence[str]) -> str:
    """Return an SVG with a row of panels for each figure (number of a row): its histogram, and its values over each varied number.

    Each engine has a colour. The figures `loops` and `energy_bar` (open loops, error bar of the energy) are not drawn.
    """
    from gauss_bench.report.palette import engine_colours
    from gauss_bench.report.plotting import give_title, panels, svg

    drawn = [name for name in figures if name not in ("loops", "energy_bar") and rows[name].notna().any()][:MOST]
    if not drawn:
        drawn = list(figures[:1])
    engines = list(dict.fromkeys(rows["engine"]))
    colours = engine_colours(engines)
    figure, axes = panels(1 + len(plan.paths), len(drawn), height=2.2)
    for name, line in zip(drawn, axes, strict=True):
        for engine in engines:
            part = rows[(rows["engine"] == engine) & (rows["status"] == "ok")].dropna(subset=[name])
            y = part[name].to_numpy(dtype=float)
            if not len(y):
                continue
            line[0].hist(y, bins=_bins(y), color=colours[engine], alpha=0.6, label=engine, histtype="stepfilled")
            few = spread_evenly(len(y), SHOWN)
            for axis, path in zip(line[1:], plan.paths, strict=True):
                axis.plot(part[path].to_numpy()[few], y[few], ".", markersize=2, color=colours[engine], rasterized=True)
        for axis in line:
            axis.locator_params(nbins=TICKS)
        give_title(line[0], name)
        line[0].set_ylabel("samples")
        if len(engines) > 1:
            line[0].legend(frameon=False, fontsize=7)
    for axis, path in zip(axes[-1][1:], plan.paths, strict=True):
        axis.set_xlabel(path)
    return svg(figure)


def _bins(y: Array) -> int:
    """Return the number of bins of a histogram of y (k,); 1 if its values differ by rounding alone."""
    if np.ptp(y) <= ROUNDING * np.abs(y).max() + SMALLEST:
        return 1
    return min(60, max(5, int(np.sqrt(len(y)))))
