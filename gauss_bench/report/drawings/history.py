"""Plot a run as a column of panels over time: lines are named at their ends, and the part that is not trusted is shaded."""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.optimize import isotonic_regression

from gauss_bench.report.palette import CONTROL, CRANK, CRANK_EDGE, CURVES, GRID, INK, MUTED
from gauss_bench.report.plotting import STYLE
from gauss_bench.terms import Array
from gauss_bench.trajectory import Curve, Group, History, Told

WIDTH, PANEL, HEAD, FOOT = 6.0, 1.12, 0.38, 0.5  # [inch]: width; heights of a panel, its title, the time axis
MORE, FEW = 0.13, 4  # [inch] for each line beyond FEW
LEFT, RIGHT = 0.72, 1.5  # [inch] beside the panels: numbers, names
NAMED = 8  # lines of a panel that have a colour and a name; the others are grey
SAMPLES = 800  # drawn samples of a curve: more than its width in pixels
LETTERS = 78  # characters in a line of the head
GAP = 10.5  # [pt] between names


@dataclass(frozen=True, eq=False)
class Trace:
    """A line of a panel with its name, values (k,) and colour; the second component of a vector is dashed in the same colour."""

    name: str
    values: Array
    colour: int
    dashed: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines with one unit; `limits` fixes the range of the axis."""

    title: str
    traces: tuple[Trace, ...]
    limits: tuple[float, float] | None = None

    @property
    def height(self) -> float:
        """Height [inch], title included."""
        return HEAD + PANEL + MORE * max(0, min(len(self.traces), NAMED) - FEW)


def panels_of(history: History) -> list[Panel]:
    """Return the panels of a history; speeds and joint forces are drawn as magnitudes."""
    panels = [
        Panel("angle [rad]", _each(x for x in history.of(Group.LINK) if x.key == "theta")),
        Panel("position [m]", _places(history)),
        Panel("speed [m/s]", _lengths(history.of(Group.POINT), "vx", "vy")),
        Panel("energy [J]", _each((x for x in history.of(Group.ENERGY) if x.key != "gained"), True)),
        Panel("energy gained beyond the work done [J]", _each((x for x in history.of(Group.ENERGY) if x.key == "gained"), True)),
        Panel("joint force [N]", _lengths(history.of(Group.JOINT), "fx", "fy")),
        Panel("torque: motors, moments of slides [N m]", _each(_turning(history))),
        Panel("driving force [N]", _each(x for x in history.of(Group.MOTOR) if x.unit == "N")),
        Panel("transmission angle [deg]", _each(history.of(Group.TRANSMISSION)), (0.0, 92.0)),
    ]
    return [panel for panel in panels if panel.traces]


def _each(curves: Iterable[Curve], by_key: bool = False) -> tuple[Trace, ...]:
    return tuple(Trace(x.key if by_key else x.of, x.values, i) for i, x in enumerate(curves))


def _turning(history: History) -> list[Curve]:
    motors = [x for x in history.of(Group.MOTOR) if x.unit == "N m"]
    return [*motors, *(x for x in history.of(Group.JOINT) if x.key == "moment")]


def _places(history: History) -> tuple[Trace, ...]:
    names = list(dict.fromkeys(x.of for x in history.of(Group.POINT)))
    curves = [x for x in history.of(Group.POINT) if x.key in ("x", "y")]
    return tuple(Trace(f"{x.of} {x.key}", x.values, names.index(x.of), x.key == "y") for x in curves)


def _lengths(curves: Sequence[Curve], first: str, second: str) -> tuple[Trace, ...]:
    """Return the magnitude of each vector with the components `first` and `second`."""
    parts = {(x.of, x.key): x.values for x in curves}
    names = dict.fromkeys(x.of for x in curves)
    return tuple(Trace(name, np.hypot(parts[name, first], parts[name, second]), i) for i, name in enumerate(names))


def plot(history: History, told: Told, head: bool = True) -> Figure:
    """Return the figure of a history with at least one sample.

    Args:
        told: the texts of the head, the end of the time axis, and the start of the shaded part, which does not affect axis limits.
        head: whether to write the texts of the head.
    """
    drawn = panels_of(history)
    lines = [(line, MUTED) for line in textwrap.wrap(told.how, LETTERS)]
    lines += [(line, CRANK_EDGE) for line in textwrap.wrap(told.verdict, LETTERS)]
    top = 0.36 + 0.165 * len(lines) if head else 0.0
    tall = top + sum(panel.height for panel in drawn) + FOOT
    kept = np.unique(np.linspace(0, len(history.t) - 1, SAMPLES).round().astype(int))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, tall))
        if head:
            figure.text(0.12 / WIDTH, 1 - 0.25 / tall, told.title, fontsize=12, fontweight="bold", color=INK)
            for i, (line, colour) in enumerate(lines):
                figure.text(0.12 / WIDTH, 1 - (0.45 + 0.165 * i) / tall, line, fontsize=8.5, color=colour)
        low = tall - top
        for panel in drawn:
            low -= panel.height
            axes = figure.add_axes((LEFT / WIDTH, low / tall, (WIDTH - LEFT - RIGHT) / WIDTH, (panel.height - HEAD) / tall))
            _draw(axes, panel, history.t, kept, told.until, told.trusted)
            axes.tick_params(labelbottom=panel is drawn[-1], labelsize=8, length=2)
        axes.set_xlabel("time [s]", fontsize=9)
    return figure


def _draw(axes: Axes, panel: Panel, t: Array, kept: Array, until: float, trusted: float | None) -> None:
    sure = t <= (until if trusted is None else max(trusted, float(t[0])))
    limits = panel.limits or _limits([x.values[sure] for x in panel.traces])
    most = sorted(panel.traces, key=lambda x: -float(np.abs(x.values[sure]).max(initial=0.0)))
    named = most[:NAMED] if len(panel.traces) > NAMED else list(panel.traces)
    order = {id(x): i for i, x in enumerate(x for x in panel.traces if x in named)}
    ends = []
    for x in panel.traces:
        shown = x in named
        index = x.colour if len(panel.traces) <= NAMED else order.get(id(x), 0)
        colour = CURVES[index % len(CURVES)] if shown else GRID
        line = "--" if x.dashed else "-"
        with np.errstate(all="ignore"):
            # far outside the axis, values are clipped: a diverged run would overflow the drawing library
            values = np.clip(x.values[kept], limits[0] - 9 * (limits[1] - limits[0]), limits[1] + 9 * (limits[1] - limits[0]))
        axes.plot(t[kept], values, color=colour, linestyle=line, linewidth=1.3, zorder=2 + shown)
        if shown:
            ends.append((x.name, colour, float(np.clip(x.values[sure][-1], *limits))))
    axes.set_ylim(*limits)
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
    if len(panel.traces) > len(named):
        remainder = f"and {len(panel.traces) - len(named)} smaller ones (grey)"
        axes.set_title(remainder, fontsize=7.5, loc="right", color=CONTROL, y=1.0, pad=4)


def _limits(values: Sequence[Array]) -> tuple[float, float]:
    """Return axis limits around all finite values, with a margin; a constant gets a wide margin, so that it looks constant."""
    every = np.concatenate([np.ravel(x) for x in values])
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
    room = 0.07 * (high - low) or 0.5 * abs(high) or 1.0
    return low - room, high + room


def label_ends(axes: Axes, ends: Sequence[tuple[str, str, float]]) -> None:
    """Write the name of each line beside its end; names that would overlap are moved apart and joined to the end by a thin line."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    tall = axes.get_position().height * float(figure.get_size_inches()[1]) * 72
    low, high = axes.get_ylim()
    wanted = np.array([(y - low) / (high - low) * tall for _, _, y in ends])
    for (name, colour, y), place in zip(ends, apart(wanted, GAP, tall), strict=True):
        shown = name if len(name) <= 20 else f"{name[:19]}…"
        lead = [(y - low) / (high - low), place / tall]
        axes.plot([1.0, 1.035], lead, transform=axes.transAxes, color=colour, linewidth=0.7, clip_on=False)
        axes.text(1.045, place / tall, shown, transform=axes.transAxes, color=colour, fontsize=8, va="center", ha="left")


def apart(wanted: Array, gap: float, tall: float) -> Array:
    """Return places (k,) nearest to the wanted ones in least squares, in the same order and at least `gap` apart."""
    # with x_i = y_i + i gap the spacing becomes monotonicity of y: isotonic regression
    order = np.argsort(wanted, kind="stable")
    offsets = gap * np.arange(len(wanted))
    flat = isotonic_regression(wanted[order] - offsets).x if len(wanted) else np.zeros(0)
    room = tall - gap * (len(wanted) - 1)
    flat = np.clip(flat, 0.0, room) if room >= 0 else np.full(len(flat), room / 2)
    placed = np.empty(len(wanted))
    placed[order] = flat + offsets
    return placed
