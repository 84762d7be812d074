"""Charts in one grammar for screen and print: Vega-Lite specifications built by Altair, each with its numbers as a table.

Colours are names of CSS variables, so that a page turns dark, or is printed, without drawing anything again. The rows of a chart
travel beside its specification under the name `rows`; the page draws both.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from gauss_bench.report.palette import SHAPES, slots
from gauss_bench.report.rows import Row, is_known, number

DATA = alt.NamedData(name="rows")
MOST_LINES = 6  # with their names at the ends
APART = 0.065  # of the height: least distance of two names
NAMES = 120  # [px] beside an axis for names at the ends of lines
FLOOR = 1e-17  # an error of zero is drawn here
INK, MUTED, GRID = "var(--ink)", "var(--muted)", "var(--grid)"
CONFIG: Mapping[str, Any] = {
    "font": "system-ui, -apple-system, Segoe UI, Roboto, sans-serif",
    "background": "transparent",
    "aria": False,  # the figure around it has the description
    "view": {"stroke": None},
    "axis": {
        "labelColor": MUTED,
        "titleColor": INK,
        "labelFontSize": 12,
        "titleFontSize": 12,
        "titleFontWeight": 500,
        "titlePadding": 8,
        "gridColor": GRID,
        "domainColor": MUTED,
        "tickColor": MUTED,
        "labelLimit": 150,
    },
    "legend": {
        "orient": "top",
        "direction": "horizontal",
        "columns": 3,
        "labelColor": INK,
        "titleColor": MUTED,
        "labelFontSize": 12,
        "titleFontSize": 12,
        "symbolSize": 70,
        "labelLimit": 140,
        "title": None,
    },
    "text": {"fontSize": 12, "color": INK},
    "rule": {"color": MUTED},
}


def finish(chart: Any, height: int) -> dict[str, Any]:
    """The specification of an Altair chart that fills its figure's width."""
    spec: dict[str, Any] = chart.properties(width="container", height=height).to_dict(validate=False)
    for key in ("$schema", "config", "usermeta"):
        spec.pop(key, None)
    return spec | {"autosize": {"type": "fit", "contains": "padding"}}


def colour(engines: Sequence[str], legend: bool = True) -> Any:
    """Engines by colour."""
    scale = alt.Scale(domain=list(engines), range=[f"var(--{slot})" for slot in slots(engines).values()])
    return alt.Color("engine:N", scale=scale, legend=alt.Legend() if legend else None)


def shape(engines: Sequence[str], legend: bool = True) -> Any:
    """Engines by marker, distinct where colours are not seen."""
    marks = [SHAPES[i % len(SHAPES)] for i in range(len(engines))]
    return alt.Shape("engine:N", scale=alt.Scale(domain=list(engines), range=marks), legend=alt.Legend() if legend else None)


def log(title: str, axis: str = "y", **scale: Any) -> Any:
    """A logarithmic axis."""
    look = alt.Axis(format="~e", tickCount=6, title=title)
    kind = alt.Y if axis == "y" else alt.X
    return kind(axis, type="quantitative", scale=alt.Scale(type="log", **({"nice": False} | scale)), axis=look)


def points(rows: Sequence[Row], x: str, y: str, height: int = 340) -> dict[str, Any]:
    """Rows with x, y, engine and line (what a thin line joins) on two logarithmic axes."""
    engines = sorted({str(r["engine"]) for r in rows})
    base = alt.Chart(DATA)
    look = colour(engines)
    lines = base.mark_line(strokeWidth=1.2, opacity=0.55).encode(x=log(x, "x"), y=log(y), color=look, detail="line:N", order="x:Q")
    marks = base.mark_point(filled=True, size=60, opacity=0.95).encode(
        x=log(x, "x"), y=log(y), color=look, shape=shape(engines), tooltip=_tooltip(rows)
    )
    return finish(alt.layer(lines, marks), height)


def _tooltip(rows: Sequence[Row]) -> list[Any]:
    told = [alt.Tooltip("name:N", title="case")] if rows and "name" in rows[0] else []
    return [*told, alt.Tooltip("x:Q", format=".3g"), alt.Tooltip("y:Q", format=".2e")]


def over_time(rows: Sequence[Row], y: str, logarithmic: bool = True, height: int = 300) -> dict[str, Any]:
    """Lines of y against time, each with its name at its end."""
    engines = list(dict.fromkeys(str(r["engine"]) for r in rows))
    last = max((number(r, "x") for r in rows), default=1.0)
    level = log(y) if logarithmic else alt.Y("y:Q", axis=alt.Axis(title=y, tickCount=6, format="~g"))
    where = alt.Y("label_y", type="quantitative", scale=alt.Scale(type="log") if logarithmic else alt.Undefined, title=y)
    time = alt.X("x:Q", scale=alt.Scale(domain=[0, last], nice=False), axis=alt.Axis(title="time [s]", tickCount=6))
    base = alt.Chart(DATA)
    lines = base.mark_line(strokeWidth=1.8).encode(x=time, y=level, color=colour(engines, legend=False), detail="line:N")
    ends = base.transform_filter("datum.end")
    marks = ends.mark_point(filled=True, size=55).encode(
        x=time, y=level, color=colour(engines, legend=False), shape=shape(engines, legend=False)
    )
    names = ends.mark_text(align="left", dx=8, fontSize=12).encode(
        x=time, y=where, text="name:N", color=colour(engines, legend=False)
    )
    return finish(alt.layer(lines, marks, names), height) | {"padding": {"left": 5, "top": 5, "bottom": 5, "right": NAMES}}


def label(
    lines: Sequence[Sequence[Mapping[str, Any]]], logarithmic: bool = True, most: int = MOST_LINES
) -> tuple[dict[str, Any], ...]:
    """Rows of lines, the last of each marked as its end with a height for its name at which no two of the first names meet."""
    values = [float(r["y"]) for line in lines[:most] for r in line if is_known(r["y"])]
    if not values:
        return ()
    height = (lambda v: math.log10(max(v, FLOOR))) if logarithmic else (lambda v: v)
    span = max(height(max(values)) - height(min(values)), 1.0 if logarithmic else 1e-12)
    places = sorted((height(float(line[-1]["y"])), i) for i, line in enumerate(lines[:most]))
    at = {i: height(float(line[-1]["y"])) for i, line in enumerate(lines)}
    below = -math.inf
    for h, i in places:
        at[i] = below = max(h, below + APART * span)
    rows: list[dict[str, Any]] = []
    for i, line in enumerate(lines):
        rows += [dict(r) for r in line]
        rows[-1] |= {"end": True, "label_y": 10 ** at[i] if logarithmic else at[i]}
    return tuple(rows)


def bars(
    rows: Sequence[Row], x: str, logarithmic: bool = False, height: int = 0, rule: float | None = None, written: str = ""
) -> dict[str, Any]:
    """A bar for each name with its value; where rows have low and high, a dot with its range in the place of the bar."""
    ranged = any(is_known(r.get("low")) for r in rows)
    scale = alt.Scale(type="log") if logarithmic else alt.Undefined
    axis = alt.Axis(title=x, tickCount=5, format=written or ("~e" if logarithmic else "~g"))
    order = [str(r["name"]) for r in rows]
    names = alt.Y("name:N", sort=order, axis=alt.Axis(title=None, ticks=False, domain=False))
    fill = "var(--accent)"
    base = alt.Chart(DATA)
    layers = []
    if rule is not None:
        layers.append(
            alt.Chart(alt.InlineData(values=[{"rule": rule}])).mark_rule(strokeDash=[4, 3]).encode(x=alt.X("rule:Q", scale=scale))
        )
    if ranged:
        layers.append(base.mark_rule(strokeWidth=5, opacity=0.35, color=fill).encode(y=names, x=alt.X("low:Q"), x2="high:Q"))
    if ranged or logarithmic:
        dots = alt.X("y:Q", scale=scale, axis=axis)
        layers.append(base.mark_point(filled=True, size=70, color=fill, opacity=1).encode(y=names, x=dots))
    else:
        layers.append(base.mark_bar(color=fill, height={"band": 0.6}).encode(y=names, x=alt.X("y:Q", axis=axis)))
    return finish(alt.layer(*layers), height or 26 * len(rows) + 44)
