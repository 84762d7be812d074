"""Draw the results of the survey (the atlas) as a picture and as a page.

There is one panel for each axis, a family of linkages that become harder to simulate as one number changes, with one bar for each
engine with its settings, up to the value that the engine passes. All panels have the width of a phone.
"""

import math
from collections.abc import Sequence
from typing import Any

from jinja2 import Environment, PackageLoader
from markupsafe import Markup

from gauss_bench.atlas.families import FAMILIES, Axis
from gauss_bench.atlas.survey import Reach, sentence
from gauss_bench.atlas.verdict import RULE, Verdict
from gauss_bench.report.palette import ENGINES, GRID, INK, MUTED, PAPER, inline

TITLE = "How far each engine goes"  # title of the picture and of the page
PASS, DEGRADED, FAILED = ENGINES["lagrange"], ENGINES["gauss_pinv"], "#e9c3bd"
WIDTH, NAMES, BAR, ROW, HEAD, FOOT, TOP = 372, 182, 126, 19, 58, 24, 78  # [px] sizes of a panel and of the picture's head
ABREAST = 4  # panels in a row of a single picture
LEGEND = (("passes", PASS), ("degraded", DEGRADED), ("fails", FAILED), ("not known, or cannot", GRID))
SIZES = {"names": NAMES, "bar": BAR, "each": ROW, "head": HEAD, "top": TOP, "width": WIDTH}
COLOURS = {"ink": INK, "muted": MUTED, "paper": PAPER}
TEMPLATES = Environment(loader=PackageLoader("gauss_bench.atlas", "."), autoescape=True)


def part(axis: Axis, value: float | None) -> float:
    """Return the place of a value on its axis as a fraction of the axis's length: 1 for the last, hardest value, 0 for None."""
    return 0.0 if value is None else (axis.values.index(value) + 1) / len(axis.values)


def number(value: float) -> str:
    """Return a number as a short text."""
    if value and (abs(value) >= 1e4 or abs(value) < 1e-3):
        digits, power = f"{value:.0e}".split("e")
        return f"{digits}e{int(power)}"
    return f"{value:g}"


def bar(axis: Axis, x: Reach) -> dict[str, Any]:
    """Return the horizontal bar of one engine and setting for the template: name, coloured spans (from, to, colour), and text.

    The ends of a span are fractions of the length of the axis; later spans are painted over earlier ones.
    """
    passes, ends = part(axis, x.passes_to), part(axis, x.ends_at)
    beyond = GRID if x.last in (Verdict.CANNOT, Verdict.OPEN) else FAILED
    spans = ((0.0, 1.0, beyond), (0.0, max(passes, ends), DEGRADED), (0.0, passes, PASS))
    if x.passes_to is None:
        text = {Verdict.OPEN: "?", Verdict.CANNOT: "cannot"}.get(x.last, "nothing")
    elif x.passes_to == axis.values[-1]:
        text = "all"
    else:
        text = ("≥ " if x.last is Verdict.OPEN else "") + number(x.passes_to)
    return {"name": x.way.name, "spans": spans, "said": text, "known": x.passes_to is not None}


def panels(reaches: Sequence[Reach]) -> list[tuple[Axis, list[Reach]]]:
    """Return for each axis the results of the survey on this axis, in their order."""
    return [(FAMILIES[axis], [x for x in reaches if x.axis == axis]) for axis in dict.fromkeys(x.axis for x in reaches)]


def chart(reaches: Sequence[Reach], alone: bool = False) -> str:
    """Return an SVG of how far each engine reaches, with a panel for each axis; if `alone`, the only panel fills the picture."""
    drawn = [(axis, [bar(axis, x) for x in some]) for axis, some in panels(reaches)]
    height = HEAD + FOOT + ROW * max((len(rows) for _, rows in drawn), default=0)
    abreast = min(ABREAST, max(1, len(drawn)))
    wide, tall = abreast * (WIDTH + 24) + 24, TOP + height * math.ceil(len(drawn) / abreast)  # 24 px between panels
    if alone:
        wide, tall = WIDTH, height - FOOT + 6  # a margin of 6 px in place of the space below a panel
    given = {"wide": wide, "tall": tall, "height": height, "abreast": abreast, "panels": drawn, "alone": alone}
    return (
        TEMPLATES.get_template("chart.svg.j2").render(**COLOURS, **SIZES, **given, number=number, legend=LEGEND, title=TITLE) + "\n"
    )


def page(reaches: Sequence[Reach]) -> str:
    """Return an HTML page with one panel for each axis and a sentence on each bar; the page loads nothing from other sites."""
    swatch = '<svg viewBox="0 0 1 1"><rect width="1" height="1" fill="{}"/></svg>'
    legend = [(name, Markup(inline(swatch.format(colour), ""))) for name, colour in LEGEND]
    shown = [
        (Markup(inline(chart(some, alone=True), f"axis{k}")), [(x.way.name, sentence(x)) for x in some])
        for k, (_, some) in enumerate(panels(reaches))
    ]
    return TEMPLATES.get_template("page.html.j2").render(title=TITLE, rule=RULE, legend=legend, panels=shown) + "\n"
