"""Draw the results of the survey (the atlas) as a picture and as a page.

Each axis, a family of linkages that become harder to simulate as one number changes, has a panel. A panel has a bar for each engine
with its setting, whose length shows the hardest value that the engine passes. All panels have the width of a phone.
"""

import math
from collections.abc import Sequence
from typing import Any

from jinja2 import Environment, PackageLoader
from markupsafe import Markup

from gauss_bench.atlas.families import FAMILIES, Axis
from gauss_bench.atlas.survey import Reach, describe
from gauss_bench.atlas.verdict import RULE, Verdict
from gauss_bench.report.palette import ENGINES, GRID, INK, MUTED, PAPER, inline

TITLE = "How far each engine goes"  # title of the picture and of the page
PASS, DEGRADED, FAILED = ENGINES["lagrange"], ENGINES["gauss_pinv"], "#e9c3bd"
WIDTH, NAMES, BAR, ROW, HEAD, FOOT, TOP = 372, 182, 126, 19, 58, 24, 78  # [px] sizes of a panel and of the picture's head
ABREAST = 4  # panels in a row of a single picture
LEGEND = (("passes", PASS), ("degraded", DEGRADED), ("fails", FAILED), ("unknown or no model", GRID))
SIZES = {"names": NAMES, "bar": BAR, "each": ROW, "head": HEAD, "top": TOP, "width": WIDTH}
COLOURS = {"ink": INK, "muted": MUTED, "paper": PAPER}
TEMPLATES = Environment(loader=PackageLoader("gauss_bench.atlas", "."), autoescape=True)


def fraction(axis: Axis, value: float | None) -> float:
    """Return the place of a value on its axis as a fraction of the axis's length: 1 for the last, hardest value, 0 for None."""
    return 0.0 if value is None else (axis.values.index(value) + 1) / len(axis.values)


def number(value: float) -> str:
    """Return a number as a short text: 300, 0.01, 1e6."""
    if value and (abs(value) >= 1e4 or abs(value) < 1e-3):
        digits, power = f"{value:.0e}".split("e")
        return f"{digits}e{int(power)}"
    return f"{value:g}"


def bar(axis: Axis, x: Reach) -> dict[str, Any]:
    """Return the horizontal bar of one engine and setting for the template: name, coloured spans (from, to, colour), and text.

    The ends of a span are fractions of the length of the axis; later spans are painted over earlier ones.
    """
    passes, ends = fraction(axis, x.passes_to), fraction(axis, x.ends_at)
    beyond = GRID if x.last in (Verdict.CANNOT, Verdict.OPEN) else FAILED
    spans = ((0.0, 1.0, beyond), (0.0, max(passes, ends), DEGRADED), (0.0, passes, PASS))
    if x.passes_to is None:
        text = {Verdict.OPEN: "?", Verdict.CANNOT: "no model"}.get(x.last, "none")
    elif x.passes_to == axis.values[-1]:
        text = "all"
    else:
        text = ("≥ " if x.last is Verdict.OPEN else "") + number(x.passes_to)
    return {"name": x.setting.name, "spans": spans, "said": text, "known": x.passes_to is not None}


def group_by_axis(reaches: Sequence[Reach]) -> list[tuple[Axis, list[Reach]]]:
    """Return each axis with its results, in the order of the survey."""
    return [(FAMILIES[axis], [x for x in reaches if x.axis == axis]) for axis in dict.fromkeys(x.axis for x in reaches)]


def chart(reaches: Sequence[Reach], alone: bool = False) -> str:
    """Return an SVG of how far each engine reaches, with a panel for each axis; if `alone`, the only panel fills the picture."""
    drawn = [(axis, [bar(axis, x) for x in entries]) for axis, entries in group_by_axis(reaches)]
    height = HEAD + FOOT + ROW * max((len(rows) for _, rows in drawn), default=0)
    abreast = min(ABREAST, max(1, len(drawn)))
    wide, tall = abreast * (WIDTH + 24) + 24, TOP + height * math.ceil(len(drawn) / abreast)  # 24 px between panels
    if alone:
        wide, tall = WIDTH, height - FOOT + 6  # a margin of 6 px in place of the space below a panel
    values = {"wide": wide, "tall": tall, "height": height, "abreast": abreast, "panels": drawn, "alone": alone}
    template = TEMPLATES.get_template("chart.svg.j2")
    return template.render(**COLOURS, **SIZES, **values, number=number, legend=LEGEND, title=TITLE) + "\n"


def page(reaches: Sequence[Reach]) -> str:
    """Return an HTML page with one panel for each axis and a sentence on each bar; the page loads nothing from other sites."""
    swatch = '<svg viewBox="0 0 1 1"><rect width="1" height="1" fill="{}"/></svg>'
    legend = [(name, Markup(inline(swatch.format(colour), ""))) for name, colour in LEGEND]
    shown = [
        (Markup(inline(chart(entries, alone=True), f"axis{k}")), [(x.setting.name, describe(x)) for x in entries])
        for k, (_, entries) in enumerate(group_by_axis(reaches))
    ]
    return TEMPLATES.get_template("page.html.j2").render(title=TITLE, rule=RULE, legend=legend, panels=shown) + "\n"
