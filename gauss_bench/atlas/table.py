"""The atlas as rows, as text, and as a page around the chart."""

from collections.abc import Sequence
from html import escape
from typing import Any

from gauss_bench.atlas.chart import LEGEND, alone, panels
from gauss_bench.atlas.families import FAMILIES
from gauss_bench.atlas.survey import Reach, sentence
from gauss_bench.atlas.verdict import RULE
from gauss_bench.report.palette import inline

TITLE = "How far each engine goes"  # of the chart and of the page
HEAD = "axis,engine,"  # of the table's file


def row(x: Reach) -> dict[str, Any]:
    """One way along one axis; `breaks_at` is the first value that does not pass."""
    family = FAMILIES[x.axis]
    rank = -1 if x.passes_to is None else family.values.index(x.passes_to)
    known = x.last.value not in ("cannot", "open")
    breaks = family.values[rank + 1] if rank + 1 < len(family.values) and known else None
    cells = {"axis": x.axis, "unit": family.unit, **vars(x.way)}
    cells |= {"easiest": family.values[0], "hardest": family.values[-1], "passes_to": x.passes_to, "ends_at": x.ends_at}
    cells |= {"breaks_at": breaks, "last": str(x.last), "error": x.error, "runs": x.runs, "reason": x.reason}
    return cells


def rows_of(reaches: Sequence[Reach], commit: str) -> list[dict[str, Any]]:
    """The rows of the table `atlas`; of an error three digits mean something."""
    return [row(x) | {"error": float(f"{x.error:.3g}"), "commit": commit} for x in reaches]


def text(reaches: Sequence[Reach]) -> str:
    """The same for people."""
    lines = [RULE]
    for family, some in panels(reaches):
        lines += ["", f"{family.title}: {family.meaning}"]
        lines += [f"  {x.way.name:28} {sentence(x)}" for x in some]
    return "\n".join(lines)


STYLE = """
:root { color-scheme: light dark; --paper: #ffffff; --page: #f6f7f9; --ink: #1f2328; --muted: #5d6670; --grid: #dfe3e8;
  --engine-lagrange: #0072b2; --engine-gauss-pinv: #e69f00; }
@media (prefers-color-scheme: dark) { :root { --paper: #181b20; --page: #101215; --ink: #e6e8eb; --muted: #9aa4af; --grid: #30363d;
  --engine-lagrange: #4aa8e8; --engine-gauss-pinv: #f0b840; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); font: 16px/1.5 system-ui, "Segoe UI", Roboto, Arial, sans-serif; }
main { max-width: 100rem; margin: 0 auto; padding: clamp(.6rem, 3vw, 2.4rem); }
h1 { margin: 0 0 .4rem; font-size: clamp(1.4rem, 3vw, 2rem); }
p { margin: .3rem 0; max-width: 60rem; color: var(--muted); }
.key { display: flex; flex-wrap: wrap; gap: .4rem 1.2rem; margin: .8rem 0 1.2rem; padding: 0; list-style: none; font-size: .9rem; }
.key i { display: inline-block; width: .9rem; height: .9rem; margin-right: .4rem; vertical-align: -.1rem; }
.panels { display: grid; gap: 1rem; grid-template-columns: repeat(auto-fill, minmax(min(100%, 21.5rem), 1fr)); }
figure { margin: 0; padding: .7rem; background: var(--paper); border: 1px solid var(--grid); border-radius: 8px; }
svg { display: block; width: 100%; height: auto; }
details { margin-top: .5rem; font-size: .82rem; color: var(--muted); overflow-wrap: anywhere; }
li { margin: .2rem 0; }
"""


def page(reaches: Sequence[Reach]) -> str:
    """A page of all panels, each with its reasons; it asks for nothing from elsewhere."""
    colour = {f'"{x}"': inline(f'<svg fill="{x}"/>', "").partition('"')[2].partition('"')[0] for _, x in LEGEND}
    key = "".join(f'<li><i style="background:{colour[chr(34) + x + chr(34)]}"></i>{name}</li>' for name, x in LEGEND)
    parts = []
    for k, (family, some) in enumerate(panels(reaches)):
        reasons = "".join(f"<li><b>{escape(x.way.name)}</b>: {escape(sentence(x))}</li>" for x in some)
        picture = inline(alone(family, some), f"axis{k}")
        parts.append(f"<figure>{picture}<details><summary>where and why</summary><ul>{reasons}</ul></details></figure>")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{TITLE}</title><style>{STYLE}</style></head>\n<body><main><h1>{TITLE}</h1>"
        f"<p>{escape(RULE)}.</p><p>Each rung of an axis is as wide as the next; engines run with their first integrator.</p>"
        f'<ul class="key">{key}</ul><div class="panels">\n' + "\n".join(parts) + "\n</div></main></body></html>\n"
    )
