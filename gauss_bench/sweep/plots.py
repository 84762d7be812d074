"""Pictures of a sweep: the distribution of each figure, and the figure against each varied number."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gauss_bench.sweep.plan import Plan
from gauss_bench.terms import Array
from gauss_bench.trajectory import spread_evenly

SHOWN = 500  # largest number of points in a panel: more points would overlap
TICKS = 4  # largest number of intervals of an axis: a small panel has no space for more
MOST = 8  # largest number of figures that are drawn
ROUNDING, SMALLEST = 1e-12, 1e-300  # a range below ROUNDING times the largest value, plus SMALLEST, is rounding


def plots(rows: Any, plan: Plan, figures: Sequence[str]) -> str:
    """Return an SVG with a row of panels for each figure: a histogram, and the values of the figure over each varied number.

    A figure is a number in a row of the table. Each engine has a colour. The figures `loops` and `energy_bar` (open loops, error
    bar of the energy) are not drawn.
    """
    from gauss_bench.report.palette import engine_colours
    from gauss_bench.report.plotting import give_title, panels, svg

    with_values = [name for name in figures if name not in ("loops", "energy_bar") and rows[name].notna().any()]
    drawn = with_values[:MOST] or list(figures[:1])
    engines = list(dict.fromkeys(rows["engine"]))
    colours = engine_colours(engines)
    figure, axes = panels(1 + len(plan.paths), len(drawn), height=2.2)
    for name, panel_row in zip(drawn, axes, strict=True):
        for engine in engines:
            samples = rows[(rows["engine"] == engine) & (rows["status"] == "ok")].dropna(subset=[name])
            y = samples[name].to_numpy(dtype=float)
            if not len(y):
                continue
            panel_row[0].hist(y, bins=_bins(y), color=colours[engine], alpha=0.6, label=engine, histtype="stepfilled")
            few = spread_evenly(len(y), SHOWN)
            for axis, path in zip(panel_row[1:], plan.paths, strict=True):
                axis.plot(samples[path].to_numpy()[few], y[few], ".", markersize=2, color=colours[engine], rasterized=True)
        for axis in panel_row:
            axis.locator_params(nbins=TICKS)
        give_title(panel_row[0], name)
        panel_row[0].set_ylabel("samples")
        if len(engines) > 1:
            panel_row[0].legend(frameon=False, fontsize=7)
    for axis, path in zip(axes[-1][1:], plan.paths, strict=True):
        axis.set_xlabel(path)
    return svg(figure)


def _bins(y: Array) -> int:
    """Return the number of bins of a histogram of y (k,); 1 if its values differ by rounding alone."""
    if np.ptp(y) <= ROUNDING * np.abs(y).max() + SMALLEST:
        return 1
    return min(60, max(5, int(np.sqrt(len(y)))))
