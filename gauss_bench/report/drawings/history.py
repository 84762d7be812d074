"""Plot the curves of a run over time, in a column of panels; lines have their names at their ends."""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from gauss_bench.report.palette import CONTROL, CRANK, CRANK_EDGE, CURVES, GRID, INK, MUTED
from gauss_bench.report.plotting import STYLE
from gauss_bench.terms import Array
from gauss_bench.trajectory import Caption, Curve, Group, History

WIDTH, PANEL, HEAD, FOOT = 6.0, 1.12, 0.38, 0.5  # [inch]: width; heights of a panel, its title, the time axis
MORE, FEW = 0.13, 4  # [inch] further height of a panel for each line beyond FEW
LEFT, RIGHT = 0.72, 1.5  # [inch] at the sides of the panels, for numbers and names
NAMED = 8  # largest number of lines of a panel that have a colour and a name; the others are grey
SAMPLES = 800  # largest number of drawn samples of a curve, more than its width in pixels
LETTERS = 78  # characters in a line of the texts above the panels
GAP = 10.5  # [pt] smallest distance of two names


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a panel: its name, its values (k,), the index of its colour, and whether it is dashed, as for y components."""

    name: str
    values: Array
    colour: int
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """A plot of lines with the same unit; `limits` is the range of the vertical axis if it is fixed."""

    title: str
    lines: tuple[Line, ...]
    limits: tuple[float, float] | None = None

    @property
    def height(self) -> float:
        """Height [inch], with the title."""
        return HEAD + PANEL + MORE * max(0, min(len(self.lines), NAMED) - FEW)


def panels_of(history: History) -> list[Panel]:
    """Return the panels of a history that have lines; speeds are magnitudes of velocities."""
    energies = history.of(Group.ENERGY)
    joints, motors = history.of(Group.JOINT), history.of(Group.MOTOR)
    torques = [x for x in motors if x.unit == "N m"] + [x for x in joints if x.key == "moment"]
    panels = [
        Panel("angle [rad]", _curve_lines(x for x in history.of(Group.LINK) if x.key == "theta")),
        Panel("position [m]", _component_lines(history.of(Group.POINT))),
        Panel("speed [m/s]", _magnitude_lines(history.of(Group.POINT), "vx", "vy")),
        Panel("energy [J]", _curve_lines((x for x in energies if x.key != "gained"), by_key=True)),
        Panel("energy gained beyond the work done [J]", _curve_lines((x for x in energies if x.key == "gained"), by_key=True)),
        Panel("joint force [N]", _curve_lines(x for x in joints if x.key in ("force", "normal"))),
        Panel("torque: motors, moments of slides [N m]", _curve_lines(torques)),
        Panel("driving force [N]", _curve_lines(x for x in motors if x.unit == "N")),
        Panel("transmission angle [deg]", _curve_lines(history.of(Group.TRANSMISSION)), (0.0, 92.0)),
    ]
    return [panel for panel in panels if panel.lines]


def _curve_lines(curves: Iterable[Curve], by_key: bool = False) -> tuple[Line, ...]:
    """Return a line for each curve, named by its key or, by default, by its link, point, joint or motor."""
    return tuple(Line(x.key if by_key else x.of, x.values, i) for i, x in enumerate(curves))


def _component_lines(curves: Sequence[Curve]) -> tuple[Line, ...]:
    """Return two lines for each point, its x and its dashed y, in the colour of the point."""
    points = list(dict.fromkeys(x.of for x in curves))
    places = [x for x in curves if x.key in ("x", "y")]
    return tuple(Line(f"{x.of} {x.key}", x.values, colour=points.index(x.of), dashed=x.key == "y") for x in places)


def _magnitude_lines(curves: Sequence[Curve], first: str, second: str) -> tuple[Line, ...]:
    """Return a line for each point: the magnitude of its vector with the components `first` and `second`."""
    values = {(x.of, x.key): x.values for x in curves}
    names = dict.fromkeys(x.of for x in curves)
    return tuple(Line(name, np.hypot(values[name, first], values[name, second]), i) for i, name in enumerate(names))


def plot(history: History, caption: Caption, head: bool = True) -> Figure:
    """Return the plot of all curves of a run, in panels one below the other; the caption's texts are above if `head`."""
    panels = panels_of(history)
    texts = [(line, MUTED) for line in textwrap.wrap(caption.how, LETTERS)]
    texts += [(line, CRANK_EDGE) for line in textwrap.wrap(caption.verdict, LETTERS)]
    # in inches: 0.36 for the title, 0.165 for each further line, 0.12 for the left margin; the baseline of the title is 0.25 from
    # the top, that of the first further line 0.45
    top = 0.36 + 0.165 * len(texts) if head else 0.0  # height of the texts
    height = top + sum(panel.height for panel in panels) + FOOT  # [inch]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, height))
        if head:
            figure.text(0.12 / WIDTH, 1 - 0.25 / height, caption.title, fontsize=12, fontweight="bold", color=INK)
            for i, (line, colour) in enumerate(texts):
                figure.text(0.12 / WIDTH, 1 - (0.45 + 0.165 * i) / height, line, fontsize=8.5, color=colour)
        low = height - top  # [inch] lower edge of the panel above
        for panel in panels:
            low -= panel.height
            axes = figure.add_axes((LEFT / WIDTH, low / height, (WIDTH - LEFT - RIGHT) / WIDTH, (panel.height - HEAD) / height))
            _draw_panel(axes, panel, history.t, caption)
            axes.tick_params(labelbottom=panel is panels[-1], labelsize=8, length=2)
        axes.set_xlabel("time [s]", fontsize=9)
    return figure


def _draw_panel(axes: Axes, panel: Panel, t: Array, caption: Caption) -> None:
    """Draw the lines of a panel with their names; shade the times at which the run is not trusted, and mark an early end.

    Args:
        t: times (k,) of the samples [s].
    """
    until, trusted = caption.until, caption.trusted
    # (k,) whether a sample is trusted: the judge has no objection to the run up to the time of the sample
    is_trusted = t <= (until if trusted is None else max(trusted, float(t[0])))
    # only trusted values determine the limits of the axis
    low, high = panel.limits or _axis_limits([x.values[is_trusted] for x in panel.lines])
    colours = _choose_colours(panel, is_trusted)
    shown = np.unique(np.linspace(0, len(t) - 1, SAMPLES).round().astype(int))  # indices of the drawn samples
    ends = []
    for x in panel.lines:
        colour = CURVES[colours[x] % len(CURVES)] if x in colours else GRID
        with np.errstate(all="ignore"):
            # far outside the axis, values are clipped: a diverged run would overflow the drawing library
            values = np.clip(x.values[shown], low - 9 * (high - low), high + 9 * (high - low))
        style = "--" if x.dashed else "-"
        axes.plot(t[shown], values, color=colour, linestyle=style, linewidth=1.3, zorder=3 if x in colours else 2)
        if x in colours:
            ends.append((x.name, colour, float(np.clip(x.values[is_trusted][-1], low, high))))
    axes.set_ylim(low, high)
    axes.set_xlim(float(t[0]), until)
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 3, 5, 10]))
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useMathText=True)
    axes.yaxis.get_offset_text().set(fontsize=7.5, color=MUTED, horizontalalignment="right", x=-0.012)  # beside the title
    axes.set_title(panel.title, fontsize=9, fontweight="bold", loc="left", color=INK, y=1.0, pad=4)
    if trusted is not None:
        axes.axvspan(trusted, until, facecolor=CRANK, alpha=0.45, linewidth=0, zorder=1)
        axes.axvline(trusted, color=CRANK_EDGE, linewidth=0.9, zorder=4)
    if float(t[-1]) < until:
        axes.axvline(float(t[-1]), color=MUTED, linewidth=0.9, linestyle=":", zorder=4)
    label_ends(axes, ends)
    if len(panel.lines) > len(colours):
        remainder = f"and {len(panel.lines) - len(colours)} smaller ones (grey)"
        axes.set_title(remainder, fontsize=7.5, loc="right", color=CONTROL, y=1.0, pad=4)


def _choose_colours(panel: Panel, is_trusted: NDArray[np.bool_]) -> dict[Line, int]:
    """Return line -> index of its colour; if there are more than NAMED lines, for those with the largest trusted values.

    Args:
        is_trusted: (k,) whether a sample is trusted.
    """
    if len(panel.lines) <= NAMED:
        return {x: x.colour for x in panel.lines}
    largest = sorted(panel.lines, key=lambda x: -float(np.abs(x.values[is_trusted]).max(initial=0.0)))[:NAMED]
    return {x: i for i, x in enumerate(sorted(largest, key=panel.lines.index))}


def _axis_limits(values: Sequence[Array]) -> tuple[float, float]:
    """Return limits (low, high) of an axis around all finite values, with a margin."""
    numbers = np.concatenate([np.ravel(x) for x in values])
    finite = numbers[np.isfinite(numbers)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    margin = 0.07 * (high - low) or 0.5 * abs(high) or 1.0  # 0.5 abs(high) for a constant, 1.0 for zero
    return low - margin, high + margin


def label_ends(axes: Axes, ends: Sequence[tuple[str, str, float]]) -> None:
    """Write the names of lines beside their `ends` (name, colour, value), moved apart and joined to the ends by thin lines."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    height = axes.get_position().height * float(figure.get_size_inches()[1]) * 72  # [pt] of the panel
    low, high = axes.get_ylim()
    wanted = np.array([(y - low) / (high - low) * height for _, _, y in ends])  # [pt]
    for (name, colour, _), end, place in zip(ends, wanted, move_apart(wanted, GAP, height), strict=True):
        text = name if len(name) <= 20 else f"{name[:19]}…"
        look: dict[str, Any] = {"transform": axes.transAxes, "color": colour}
        axes.plot([1.0, 1.035], [end / height, place / height], linewidth=0.7, clip_on=False, **look)
        axes.text(1.045, place / height, text, fontsize=8, va="center", ha="left", **look)


def move_apart(wanted: Array, gap: float, top: float) -> Array:
    """Return heights (k,) for labels, between 0 and `top`, at least `gap` apart and nearest to `wanted` in least squares.

    The heights are in the same order as the wanted heights. If `top` is too small for k labels, the heights are exactly `gap`
    apart around the middle `top` / 2.
    """
    # heights x_i = y_i + i gap are at least `gap` apart if the y_i do not decrease; isotonic regression finds the best such y_i
    order = np.argsort(wanted, kind="stable")
    offsets = gap * np.arange(len(wanted))
    flat = isotonic_regression(wanted[order] - offsets).x if len(wanted) else np.zeros(0)
    room = top - gap * (len(wanted) - 1)  # largest y_i
    flat = np.clip(flat, 0.0, room) if room >= 0 else np.full(len(flat), room / 2)
    places = np.empty(len(wanted))
    places[order] = flat + offsets
    return places
