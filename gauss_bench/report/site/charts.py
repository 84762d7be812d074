"""Charts as Vega-Lite specifications, filled in from the templates of `assets/charts.json`.

Colours are names of CSS variables, so that dark mode and printing need no second drawing. The rows of a chart are stored beside its
specification under the name `rows`; the page combines both.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gauss_bench.report.palette import SHAPES, slots
from gauss_bench.report.rows import Row, is_known, number

GRAMMAR: Mapping[str, Any] = json.loads((Path(__file__).parent / "assets" / "charts.json").read_text(encoding="utf-8"))
VEGA_LITE = "6.4"  # version of the specifications
MOST_LINES = 6  # largest number of lines that are named at their ends
APART = 0.065  # smallest distance of two names, as a share of the height
FLOOR = 1e-17  # a zero error is drawn here, since logarithmic axes have no zero


def fill(part: Any, values: Mapping[str, Any]) -> Any:
    """Return a part of a template with values in place of every "$name"."""
    match part:
        case dict():
            return {k: fill(x, values) for k, x in part.items()}
        case list():
            return [fill(x, values) for x in part]
        case str() if part.startswith("$"):
            return fill(values[part[1:]], values)
    return part


def look(engines: Sequence[str]) -> dict[str, Any]:
    """Return engines with their colours, and with markers that tell them apart without colour."""
    colours = [f"var(--{slot})" for slot in slots(engines).values()]
    return {"engines": list(engines), "colours": colours, "shapes": [SHAPES[i % len(SHAPES)] for i in range(len(engines))]}


def points(rows: Sequence[Row], x: str, y: str, height: int = 340, engines: Sequence[str] = ()) -> dict[str, Any]:
    """Plot rows (x, y, engine, line) on two logarithmic axes; rows with equal `line` are joined. Engines are sorted by default."""
    values = look(engines or sorted({str(r["engine"]) for r in rows})) | {"x": x, "y": y, "height": height}
    return dict(fill(GRAMMAR["points"], values))


def over_time(rows: Sequence[Row], y: str, logarithmic: bool = True, height: int = 300) -> dict[str, Any]:
    """Plot lines of y against time, each with its name at its end."""
    kind = "log" if logarithmic else "linear"
    values = look(list(dict.fromkeys(str(r["engine"]) for r in rows)))
    values |= {"last": max((number(r, "x") for r in rows), default=1.0), "y": y, "height": height}
    values |= {"level": GRAMMAR["levels"][kind], "names": GRAMMAR["levels"][f"{kind} names"]}
    return dict(fill(GRAMMAR["over_time"], values))


def place_names(
    lines: Sequence[Sequence[Mapping[str, Any]]], logarithmic: bool = True, most: int = MOST_LINES
) -> list[dict[str, Any]]:
    """Return the rows of all lines; the last row of a line gets a height `label_y` for its name, so that names do not overlap."""
    values = [float(r["y"]) for line in lines[:most] for r in line if is_known(r["y"])]
    if not values:
        return []
    height = (lambda v: math.log10(max(v, FLOOR))) if logarithmic else (lambda v: v)
    span = max(height(max(values)) - height(min(values)), 1.0 if logarithmic else 1e-12)
    places = sorted((height(float(line[-1]["y"])), i) for i, line in enumerate(lines[:most]))
    at = {i: height(float(line[-1]["y"])) for i, line in enumerate(lines)}
    # from the lowest name upwards, keep each at least APART above the one before
    below = -math.inf
    for h, i in places:
        at[i] = below = max(h, below + APART * span)
    rows: list[dict[str, Any]] = []
    for i, line in enumerate(lines):
        rows += [dict(r) for r in line]
        rows[-1] |= {"end": True, "label_y": 10 ** at[i] if logarithmic else at[i]}
    return rows


def bars(
    rows: Sequence[Row], x: str, logarithmic: bool = False, rule: float | None = None, number_format: str = ""
) -> dict[str, Any]:
    """Plot a bar per name; rows with low and high are drawn as a dot with its range instead."""
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
        "height": 26 * len(rows) + 44,
        "layers": [GRAMMAR["layers"][name] for name, is_shown in shown.items() if is_shown],
    }
    return dict(fill(GRAMMAR["bars"], values))
