"""Charts in one grammar for screen and print: Vega-Lite specifications out of `assets/charts.json`, each with a table of numbers.

Colours are names of CSS variables, so that a page turns dark, or is printed, without drawing anything again. The rows of a chart
travel beside its specification under the name `rows`; the page draws both.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gauss_bench.report.palette import SHAPES, slots
from gauss_bench.report.rows import Row, is_known, number

GRAMMAR: Mapping[str, Any] = json.loads((Path(__file__).parent / "assets" / "charts.json").read_text(encoding="utf-8"))
VEGA_LITE = "6.4"  # whose grammar that is
MOST_LINES = 6  # with their names at the ends
APART = 0.065  # of the height: least distance of two names
FLOOR = 1e-17  # an error of zero is drawn here


def fill(part: Any, values: Mapping[str, Any]) -> Any:
    """A part of the grammar with values in the place of every "$name"."""
    match part:
        case dict():
            return {k: fill(x, values) for k, x in part.items()}
        case list():
            return [fill(x, values) for x in part]
        case str() if part.startswith("$"):
            return fill(values[part[1:]], values)
    return part


def look(engines: Sequence[str]) -> dict[str, Any]:
    """Engines with their colours, and their markers, which are distinct where colours are not seen."""
    colours = [f"var(--{slot})" for slot in slots(engines).values()]
    return {"engines": list(engines), "colours": colours, "shapes": [SHAPES[i % len(SHAPES)] for i in range(len(engines))]}


def points(rows: Sequence[Row], x: str, y: str, height: int = 340, engines: Sequence[str] = ()) -> dict[str, Any]:
    """Rows with x, y, engine and line (what a thin line joins) on two logarithmic axes; engines by name if no order is given."""
    values = look(engines or sorted({str(r["engine"]) for r in rows})) | {"x": x, "y": y, "height": height}
    return dict(fill(GRAMMAR["points"], values))


def over_time(rows: Sequence[Row], y: str, logarithmic: bool = True, height: int = 300) -> dict[str, Any]:
    """Lines of y against time, each with its name at its end."""
    kind = "log" if logarithmic else "linear"
    values = look(list(dict.fromkeys(str(r["engine"]) for r in rows)))
    values |= {"last": max((number(r, "x") for r in rows), default=1.0), "y": y, "height": height}
    values |= {"level": GRAMMAR["levels"][kind], "names": GRAMMAR["levels"][f"{kind} names"]}
    return dict(fill(GRAMMAR["over_time"], values))


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


def bars(rows: Sequence[Row], x: str, logarithmic: bool = False, rule: float | None = None, written: str = "") -> dict[str, Any]:
    """A bar for each name with its value; where rows have low and high, a dot with its range in the place of the bar."""
    ranged = any(is_known(r.get("low")) for r in rows)
    shown = {"rule": rule is not None, "range": ranged, "dots": ranged or logarithmic, "bars": not (ranged or logarithmic)}
    values = {
        "axis": {"title": x, "tickCount": 5, "format": written or ("~e" if logarithmic else "~g")},
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
