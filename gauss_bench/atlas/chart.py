"""The atlas as a picture: one panel for each axis, one bar for each way, which ends where the way does.

Panels are of one width that a phone has; a page sets them side by side as far as there is room, a single picture four abreast.
"""

import math
from collections.abc import Sequence
from xml.sax.saxutils import escape

from gauss_bench.atlas.families import FAMILIES, Family
from gauss_bench.atlas.survey import Reach
from gauss_bench.atlas.verdict import Verdict
from gauss_bench.report.palette import ENGINES, GRID, INK, MUTED, PAPER

PASS, DEGRADED, FAILED = ENGINES["lagrange"], ENGINES["gauss_pinv"], "#e9c3bd"
WIDTH, NAMES, BAR, ROW, HEAD, FOOT = 372.0, 182.0, 126.0, 19.0, 58.0, 24.0  # [px]
ABREAST = 4  # panels of a single picture
LEGEND = (("passes", PASS), ("degraded", DEGRADED), ("fails", FAILED), ("not known, or cannot", GRID))
FONT = 'font-family="Helvetica, Arial, sans-serif"'


def panel(family: Family, reaches: Sequence[Reach]) -> tuple[list[str], float]:
    """SVG elements of one axis, and their height [px]."""
    shapes = [
        _text(0, 15, family.title, INK, 14, "bold"),
        _text(0, 31, family.meaning + (f" [{family.unit}]" if family.unit else ""), MUTED, 11),
        _text(NAMES, 49, number(family.values[0]), MUTED, 10),
        _text(NAMES + BAR, 49, number(family.values[-1]), MUTED, 10, anchor="end"),
        _text(NAMES + BAR / 2, 49, "harder →", MUTED, 10, anchor="middle"),
        _text(NAMES + BAR + 8, 49, "passes to", MUTED, 10),
    ]
    for i, x in enumerate(reaches):
        y = HEAD + ROW * i
        shapes.append(_text(NAMES - 8, y + 12, x.way.name, INK, 11, anchor="end"))
        shapes += _bar(family, x, y + 2)
        known = x.passes_to is not None
        shapes.append(_text(NAMES + BAR + 8, y + 12, _said(family, x), INK if known else MUTED, 11, "bold" if known else ""))
    return shapes, HEAD + ROW * len(reaches) + FOOT


def _bar(family: Family, x: Reach, y: float) -> list[str]:
    """Up to where it passes, from there to where it is degraded, and the rest."""
    passes, ends = (part(family, value) * BAR for value in (x.passes_to, x.ends_at))
    unknown = x.last in (Verdict.CANNOT, Verdict.OPEN)
    spans = [(0.0, BAR, GRID if unknown else FAILED), (0.0, max(passes, ends), DEGRADED), (0.0, passes, PASS)]
    return [
        f'<rect x="{NAMES + a:.1f}" y="{y:.1f}" width="{b - a:.1f}" height="{ROW - 5:g}" fill="{colour}"/>'
        for a, b, colour in spans
        if b > a
    ]


def part(family: Family, value: float | None) -> float:
    """The share of an axis up to a value: a rung of its ladder each."""
    return 0.0 if value is None else (family.values.index(value) + 1) / len(family.values)


def _said(family: Family, x: Reach) -> str:
    if x.passes_to is None:
        return {Verdict.OPEN: "?", Verdict.CANNOT: "cannot"}.get(x.last, "nothing")
    if x.passes_to == family.values[-1]:
        return "all"
    return ("≥ " if x.last is Verdict.OPEN else "") + number(x.passes_to)


def number(value: float) -> str:
    """A number as short as it can be said."""
    if value and (abs(value) >= 1e4 or abs(value) < 1e-3):
        digits, power = f"{value:.0e}".split("e")
        return f"{digits}e{int(power)}"
    return f"{value:g}"


def panels(reaches: Sequence[Reach]) -> list[tuple[Family, list[Reach]]]:
    """The ways of each axis, in the order in which they were surveyed."""
    return [(FAMILIES[axis], [x for x in reaches if x.axis == axis]) for axis in dict.fromkeys(x.axis for x in reaches)]


def chart(reaches: Sequence[Reach]) -> str:
    """All panels in one picture."""
    drawn = [panel(family, some) for family, some in panels(reaches)]
    abreast = min(ABREAST, max(1, len(drawn)))
    tall = max((height for _, height in drawn), default=0.0)
    rows = math.ceil(len(drawn) / abreast)
    wide, top = abreast * (WIDTH + 24) + 24, 78.0
    parts = [_text(24, 32, "How far each engine goes", INK, 20, "bold")]
    x = 24.0
    for name, colour in LEGEND:
        parts.append(f'<rect x="{x:.1f}" y="48" width="14" height="14" fill="{colour}"/>')
        parts.append(_text(x + 20, 60, name, INK, 12))
        x += 40 + 6.6 * len(name)
    for k, (shapes, _) in enumerate(drawn):
        place = f"{24 + (k % abreast) * (WIDTH + 24):.1f} {top + (k // abreast) * tall:.1f}"
        parts += [f'<g transform="translate({place})">', *shapes, "</g>"]
    return _svg(wide, top + rows * tall, parts)


def alone(family: Family, reaches: Sequence[Reach]) -> str:
    """One panel as a picture."""
    shapes, height = panel(family, reaches)
    return _svg(WIDTH, height - FOOT + 6, shapes)


def _svg(wide: float, tall: float, parts: Sequence[str]) -> str:
    size = f'viewBox="0 0 {wide:.0f} {tall:.0f}" width="{wide:.0f}" height="{tall:.0f}"'
    paper = f'<rect width="100%" height="100%" fill="{PAPER}"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" {FONT}>{paper}\n' + "\n".join(parts) + "\n</svg>\n"


def _text(x: float, y: float, text: str, colour: str, size: float, weight: str = "", anchor: str = "") -> str:
    more = (f' font-weight="{weight}"' if weight else "") + (f' text-anchor="{anchor}"' if anchor else "")
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" fill="{colour}"{more}>{escape(text)}</text>'
