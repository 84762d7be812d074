"""Specify charts in Vega-Lite, by the templates of `assets/charts.json`.

Colours are names of CSS variables, so that dark mode and printing need no second drawing. A specification contains no data; a
script of the page adds the rows.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gauss_bench.report.palette import SHAPES, assign_hues
from gauss_bench.report.rows import Row, is_known, number

GRAMMAR: Mapping[str, Any] = json.loads((Path(__file__).parent / "assets" / "charts.json").read_text(encoding="utf-8"))
VEGA_LITE = "6.4"  # version of the specifications
MOST_LINES = 6  # largest number of lines that have their names at their ends
APART = 0.065  # smallest distance of two names, as a share of the height
FLOOR = 1e-17  # drawn value of a zero error, because a logarithmic axis has no zero


def fill(part: Any, values: Mapping[str, Any]) -> Any:
    """Return a part of a template in which `values[name]`, filled in as well, replaces every text "$name"."""
    match part:
        case dict():
            return {k: fill(x, values) for k, x in part.items()}
        case list():
            return [fill(x, values) for x in part]
        case str() if part.startswith("$"):
            return fill(values[part[1:]], values)
    return part


def style_engines(engines: Sequence[str]) -> dict[str, Any]:
    """Return the values "engines", "colours" and "shapes" of a template; markers differ too, for readers who see no colours."""
    colours = [f"var(--{hue})" for hue in assign_hues(engines).values()]
    return {"engines": list(engines), "colours": colours, "shapes": [SHAPES[i % len(SHAPES)] for i in range(len(engines))]}


def specify_points(rows: Sequence[Row], x: str, y: str, height: int = 340, engines: Sequence[str] = ()) -> dict[str, Any]:
    """Return the specification of a chart of points on two logarithmic axes, joined by lines.

    Args:
        rows: points, of which only the key `engine` is used here; the page joins those with the same `line`.
        x, y: titles of the axes.
        engines: engines in the order of the legend; by default they are sorted by name.
    """
    values = style_engines(engines or sorted({str(r["engine"]) for r in rows})) | {"x": x, "y": y, "height": height}
    return dict(fill(GRAMMAR["points"], values))


def specify_lines(rows: Sequence[Row], y: str, logarithmic: bool = True, height: int = 300) -> dict[str, Any]:
    """Return the specification of a chart of lines against time, each with its name at its end.

    Args:
        rows: points as `place_names` returns them.
        y: title of the vertical axis.
        height: height of the chart [px].
    """
    kind = "log" if logarithmic else "linear"
    values = style_engines(list(dict.fromkeys(str(r["engine"]) for r in rows)))
    values |= {"last": max((number(r, "x") for r in rows), default=1.0), "y": y, "height": height}
    values |= {"level": GRAMMAR["levels"][kind], "names": GRAMMAR["levels"][f"{kind} names"]}
    return dict(fill(GRAMMAR["over_time"], values))


def place_names(lines: Sequence[Sequence[Mapping[str, Any]]], logarithmic: bool = True) -> list[dict[str, Any]]:
    """Return the rows of all lines of a chart, with the places of the lines' names; no rows if no value is finite.

    The last row of a line also has `end`, and `label_y`, the value on the vertical axis at which the line's name is written.

    Args:
        lines: for each line its rows, with x and y. Names of the first MOST_LINES lines are spaced so that none overlap.
    """

    def height(y: float) -> float:
        """Return the height of a value on the axis: its logarithm on a logarithmic axis."""
        return math.log10(max(y, FLOOR)) if logarithmic else y

    values = [float(r["y"]) for line in lines[:MOST_LINES] for r in line if is_known(r["y"])]
    if not values:
        return []
    span = max(height(max(values)) - height(min(values)), 1.0 if logarithmic else 1e-12)
    name_at = [height(float(line[-1]["y"])) for line in lines]  # beside the end of each line
    # from the lowest name upwards, keep each at least APART above the previous name
    below = -math.inf
    for i in sorted(range(len(lines[:MOST_LINES])), key=lambda i: name_at[i]):
        name_at[i] = below = max(name_at[i], below + APART * span)
    rows: list[dict[str, Any]] = []
    for line, place in zip(lines, name_at, strict=True):
        rows += [dict(r) for r in line]
        rows[-1] |= {"end": True, "label_y": 10**place if logarithmic else place}
    return rows


def specify_bars(
    rows: Sequence[Row], x: str, logarithmic: bool = False, rule: float | None = None, number_format: str = ""
) -> dict[str, Any]:
    """Return the specification of a chart with a bar for each row, from 0 to its `y`.

    Dots replace the bars if the axis is logarithmic, or if rows have `low` and `high`, which are drawn as ranges.
    `rule` is the value of a dashed line.
    """
    ranged = any(is_known(r.get("low")) for r in rows)
    shown = {"rule": rule is not None, "range": ranged, "dots": ranged or logarithmic, "bars": not (ranged or logarithmic)}
    values = {
        "axis": {"title": x, "tickCount": 5, "format": number_format or ("~e" if logarithmic else "~g")},
        "scale": {"type": "log"} if logarithmic else {},
        "names": {
            "field": "name",
            "type": "nominal",
            "sort": [str(r["name"]) for r in rows],
            "axis": {"title": None, "ticks": False, "domain": False},
        },
        "rule": rule,
        "height": 26 * len(rows) + 44,  # [px] of a row, and of the axis
        "layers": [GRAMMAR["layers"][name] for name, is_shown in shown.items() if is_shown],
    }
    return dict(fill(GRAMMAR["bars"], values))
