"""Figures of the motion of points: for each point its path, and its velocity and acceleration against time."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from gauss_bench.mechanism.coordinates import acceleration, position, velocity
from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.report.palette import BODY_EDGE, CRANK_EDGE, TRACE
from gauss_bench.report.plotting import draw_legend, give_title, panels, svg
from gauss_bench.terms import Array

COMPONENTS: Mapping[str, Mapping[str, Any]] = {  # name of a component -> style of its line
    "x": {"color": BODY_EDGE, "linestyle": "-"},
    "y": {"color": CRANK_EDGE, "linestyle": "--"},
}
ARROW = 0.15  # distance of the arrow from the start of a path, as a share of the extent of the path


def draw_curves(mechanism: Mechanism, t: Array, q: Array, v: Array, a: Array, points: Sequence[Point]) -> str:
    """Return the SVG of three panels for each point: its path, its velocity and its acceleration.

    Args:
        t: times (k,) [s].
        q, v, a: states (k, n) of the mechanism at these times.

    Raises:
        ValueError: `points` is empty, or the shapes of the states do not fit the mechanism and the times.
    """
    if not points or not q.shape == v.shape == a.shape == (len(t), mechanism.n):
        raise ValueError("curves need a point, and a state of the mechanism at every time")
    figure, grid = panels(3, len(points), height=3.0)
    for point, (left, middle, right) in zip(points, grid, strict=True):
        give_title(left, point.name)
        draw_path(left, position(q, point))
        draw_components(middle, t, velocity(q, v, point), "velocity [m/s]")
        draw_components(right, t, acceleration(q, v, a, point), "acceleration [m/s²]")
    for axes in grid[-1][1:]:
        axes.set_xlabel("time [s]")
    figure.align_ylabels()
    marker = {"color": TRACE, "linestyle": "", "marker": "o"}
    draw_legend(figure, {**COMPONENTS, "start of the path": marker})
    return svg(figure)


def draw_path(axes: Axes, points: Array) -> None:
    """Draw a path (k, 2) [m] at equal scales, with its start and its direction."""
    axes.plot(*points.T, color=TRACE)
    axes.plot(*points[0], color=TRACE, marker="o")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.locator_params(nbins=5)
    travelled = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))  # (k,) [m] arc length
    extent = np.hypot(*np.ptp(points, axis=0))  # [m]
    head = int(np.searchsorted(travelled, ARROW * extent))  # index of the point at the head of the arrow
    if travelled[-1] > 0:  # a point at rest has no direction
        look = {"arrowstyle": "-|>", "color": TRACE, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 14}
        axes.annotate("", points[head], points[head - 1], arrowprops=look)


def draw_components(axes: Axes, t: Array, values: Array, label: str) -> None:
    """Draw both components of vectors (k, 2) against times t (k,)."""
    for style, component in zip(COMPONENTS.values(), values.T, strict=True):
        axes.plot(t, component, **style)
    axes.set_xlim(t[0], t[-1])
    axes.set_ylabel(label)
    axes.locator_params(axis="y", nbins=6)
