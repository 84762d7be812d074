"""The shell that every page shares, its way through the site, and how blocks of a section become HTML.

Text of files reaches a page through `markupsafe` alone, and a script through `script_text`.
"""

import json
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from markupsafe import Markup, escape

from gauss_bench.report.content import NOTHING, Bullets, Cell, Chart, Finding, Findings, Section, Table, Text
from gauss_bench.report.site.formulas import is_formula, mathml

MARKED = re.compile(r"(\*\*[^*]+\*\*|`[^`]+`)")
SHORT = 10  # rows of a table that are seen at once
LONG, LABEL = 60, 40  # characters: a longer cell opens from a label of at most so many
HEADLINE = 260  # characters of a finding before its reader opens the rest
SENTENCE = re.compile(r"(?<=[.*])\s+(?=[A-Z`\"*])")
DASH = "A dash: not measured there, or without sense for that row."
WORDS = {"bad": "where we lose", "warn": "to know", "good": "holds", "": ""}


@dataclass(frozen=True)
class Page:
    """One page.

    Attributes:
        name: of its file, without suffix.
        title: of the page.
        lead: the sentence below it.
        body: what it shows.
        data: what its scripts read: charts by name, and what else.
        scripts: of the site that it needs besides.
        later: name -> what a script fetches only when a reader asks for it.
        group: of the contents, empty for pages that others lead to.
    """

    name: str
    title: str
    lead: str
    body: Markup
    data: Mapping[str, Any] = field(default_factory=dict)
    group: str = ""
    scripts: tuple[str, ...] = ()
    later: Mapping[str, Any] = field(default_factory=dict)

    @property
    def file(self) -> str:
        return f"{self.name}.html"


def file_name(text: str) -> str:
    """A name that any file system and address can carry; two names give two files."""
    plain = re.sub(r"[^a-z0-9_]+", "-", text.lower()).strip("-") or "x"
    return plain if plain == text else f"{plain}-{sum(ord(c) * (i + 7) for i, c in enumerate(text)) % 99991}"


def script_text(value: Any) -> str:
    """JSON that can stand in a script: no character of it ends one."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"), sort_keys=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def rich(text: str) -> Markup:
    """Escaped text with `code` and **strong** as HTML."""
    parts = []
    for part in MARKED.split(text):
        if part.startswith("**"):
            parts.append(Markup("<strong>{}</strong>").format(rich(part[2:-2])))
        elif MARKED.fullmatch(part):
            parts.append(Markup("<code>{}</code>").format(part[1:-1]))
        else:
            parts.append(escape(part))
    return Markup("").join(parts)


def join_blocks(parts: Iterable[Markup]) -> Markup:
    return Markup("\n").join(parts)


def paragraph(text: str, css: str = "") -> Markup:
    return Markup('<p class="{}">{}</p>').format(css, rich(text)) if css else Markup("<p>{}</p>").format(rich(text))


def heading(text: str, anchor: str, level: int = 2) -> Markup:
    return Markup('<h{0} id="{1}">{2}</h{0}>').format(level, anchor, rich(text))


def link(page: str, text: str, css: str = "") -> Markup:
    return Markup('<a href="{}"{}>{}</a>').format(page, Markup(' class="{}"').format(css) if css else "", text)


def table(content: Table, caption: bool = True, most: int = SHORT) -> Markup:
    """A table that scrolls by itself; numbers of the first numeric column come first where there is little room.

    Rows beyond `most` are one click further.
    """
    lead = min(content.numeric, default=-1)
    head = Markup("").join(
        Markup('<th scope="col"{}><button type="button">{}</button></th>').format(_class(i, content, lead), rich(x))
        for i, x in enumerate(content.head)
    )
    rows = [
        Markup("<tr{}>{}</tr>").format(Markup(" hidden") if k >= most else "", _row(r, content, lead))
        for k, r in enumerate(content.rows)
    ]
    more = (
        Markup('<button type="button" class="more">Show all {} rows</button>').format(len(rows)) if len(rows) > most else Markup("")
    )
    title = Markup("<caption>{}</caption>").format(rich(content.title)) if caption else Markup("")
    dashes = DASH if any(cell.text in ("", NOTHING) for row in content.rows for cell in row) else ""
    said = " ".join(filter(None, (content.note, dashes)))
    note = paragraph(said, "note") if said else Markup("")
    labels = f"h{zlib.crc32(repr(content.head).encode()):x}"
    name = Markup(' tabindex="0" role="region" aria-label="{}"').format(content.title)
    return Markup(
        '<div class="table"><style>{}</style><div class="scroll"{}><table class="{}">{}<thead><tr>{}</tr></thead>'
        "<tbody>\n{}\n</tbody></table></div>{}{}</div>"
    ).format(_labels(labels, content.head), name, labels, title, head, join_blocks(rows), more, note)


def _labels(css: str, head: Sequence[str]) -> Markup:
    """The heads of columns as labels of cells, which stand below each other on a phone."""
    plain = (json.dumps(re.sub(r"[`*<>\\\\]", "", x), ensure_ascii=False) for x in head)
    rules = "".join(f".{css} td:nth-child({i})::before{{content:{x}}}" for i, x in enumerate(plain, 1))
    return Markup(f"@media(max-width:760px){{{rules}}}")


def _class(i: int, content: Table, lead: int) -> Markup:
    names = [x for x, on in (("n", i in content.numeric), ("first", i == lead)) if on]
    return Markup(' class="{}"').format(" ".join(names)) if names else Markup("")


def _row(cells: Sequence[Cell], content: Table, lead: int) -> Markup:
    return Markup("").join(
        Markup("<td{}{}>{}</td>").format(
            _class(i, content, lead),
            _sort_by(cell),
            _tone(cell),
        )
        for i, cell in enumerate(cells)
    )


def _sort_by(cell: Cell) -> Markup:
    """A number that rows are sorted by, where the text does not say it."""
    told = f"{cell.sort:.7g}" if isinstance(cell.sort, float) else cell.text
    return Markup("") if told == cell.text else Markup(' data-sort="{}"').format(told)


def _tone(cell: Cell) -> Markup:
    if cell.tone == "formula" and is_formula(cell.text):
        return mathml(cell.text)
    text = _shown(cell.text)
    return Markup('<span class="t-{}">{}</span>').format(cell.tone, text) if cell.tone in ("bad", "warn", "good", "below") else text


def _shown(text: str) -> Markup:
    """The text of a cell: an address as a link, a long one behind a short label, a dash for nothing."""
    if re.fullmatch(r"https://[^\s\"<>]+", text):
        return link(text, text.removeprefix("https://").partition("/")[0])
    if len(text) <= LONG:
        return rich(text or NOTHING)
    return fold(short_label(text), rich(text))


def short_label(text: str) -> str:
    """The first words of a text, up to where it explains itself."""
    first = re.split(r"[:;(]", text, maxsplit=1)[0].strip()
    if 3 < len(first) <= LABEL:
        return first
    return text[:LABEL].rpartition(" ")[0].rstrip(",;:") + " ..."


def headline(text: str) -> str:
    """The first sentence of a finding; of a long one without what stands in brackets, and up to its list."""
    first = SENTENCE.split(text.replace("**", ""))[0]
    if len(first) <= HEADLINE:
        return first
    short = re.sub(r"\s\((?:[^()]|\([^()]*\))*\)", "", first)
    if len(short) <= HEADLINE:
        return short
    ends = [m.start() for m in re.finditer(r": |; ", short) if m.start() <= HEADLINE] or [short.rfind(" ", 0, HEADLINE)]
    return f"{short[: ends[-1]].rstrip('.,;: ')}."


def fold(title: str, inside: Markup) -> Markup:
    return Markup("<details><summary>{}</summary>{}</details>").format(title, inside)


def chart(one: Chart) -> Markup:
    """A figure with its title, description, drawing, toggles and numbers."""
    toggles = Markup("").join(
        Markup('<label><input type="checkbox" data-engine="{}"{}> {}</label>').format(
            x, Markup(" checked") if x in one.shown else "", x
        )
        for x in one.toggles
    )
    choice = (
        Markup('<fieldset class="toggles" data-for="{}"><legend>Lines</legend>{}</fieldset>').format(one.name, toggles)
        if toggles
        else Markup("")
    )
    return Markup(
        '<figure class="chart{}" id="{}"><figcaption><strong>{}</strong> <span>{}</span></figcaption>{}'
        '<div class="plot" role="img" aria-label="{}" data-chart="{}"></div>{}</figure>'
    ).format(
        " small" if one.small else "",
        f"figure-{one.name}",
        rich(one.title),
        rich(one.description),
        choice,
        f"{one.title}. {one.description}",
        one.name,
        fold("Numbers of this figure", table(one.table(), caption=False)),
    )


def finding(one: Finding, level: int = 3) -> Markup:
    tag = WORDS.get(one.tone, "")
    mark = Markup('<span class="tag t-{}">{}</span> ').format(one.tone, tag) if tag else Markup("")
    first, whole = headline(one.text), one.text.replace("**", "")
    parts = [x for x in re.split(r"(?<=[;.])\s+", whole) if x]
    listed = Markup("<ul>{}</ul>").format(join_blocks(Markup("<li>{}</li>").format(rich(x)) for x in parts))
    rest = fold("All of it", listed) if whole != first else Markup("")
    return Markup("<li><h{0}>{1}{2}</h{0}><p>{3}</p>{4}</li>").format(level, mark, rich(one.title), rich(first), rest)


def block(content: Any, level: int = 3) -> Markup:
    """A block of a section."""
    match content:
        case Text(text=text):
            return paragraph(text)
        case Bullets(items=items):
            return Markup("<ul>{}</ul>").format(join_blocks(Markup("<li>{}</li>").format(rich(x)) for x in items))
        case Table():
            return fold(content.title, table(content, caption=False)) if content.folded else table(content)
        case Findings(items=items):
            return Markup('<ul class="findings">{}</ul>').format(join_blocks(map(finding, items)))
        case Chart():
            return chart(content)
    raise TypeError(f"no way to show a {type(content).__name__}")


def section(content: Section, level: int = 2) -> Markup:
    """A section and those below it."""
    inside = [block(x) for x in content.blocks]
    below = [section(part, min(level + 1, 4)) for part in content.parts]
    return Markup("<section>{}\n{}\n{}</section>").format(
        heading(content.title, content.anchor, level), join_blocks(inside), join_blocks(below)
    )


def charts_in(content: Section) -> list[Chart]:
    own = [x for x in content.blocks if isinstance(x, Chart)]
    return own + [x for part in content.parts for x in charts_in(part)]


def document(page: Page, pages: Sequence[Page], facts: Sequence[str], guide: str = "") -> str:
    """The whole text of a page; `guide` is where the documentation lies, if it does."""
    groups: dict[str, list[Page]] = {}
    for other in pages:
        if other.group:
            groups.setdefault(other.group, []).append(other)
    contents = Markup("").join(_group(name, some, page) for name, some in groups.items())
    if guide:
        contents += Markup('<ul class="single"><li><a href="{}">Guide</a></li></ul>').format(guide)
    wanted = [f"data/{page.name}.js"] if page.data else []
    drawn = ["vega.js"] if page.data.get("charts") else []
    scripts = Markup("").join(Markup('<script src="{}"></script>').format(x) for x in ("site.js", *wanted, *page.scripts, *drawn))
    scripts += Markup('<script src="charts.js"></script>') if drawn else Markup("")
    return str(
        Markup(SHELL).format(
            title=page.title,
            home=page.name == "index",
            contents=contents,
            lead=rich(page.lead),
            heading=rich(page.title),
            body=page.body,
            scripts=scripts,
            facts=" · ".join(facts),
        )
    )


def _group(name: str, pages: Sequence[Page], here: Page) -> Markup:
    items = Markup("").join(
        Markup('<li><a href="{}"{}>{}</a></li>').format(
            x.file, Markup(' aria-current="page"') if x.name == here.name else "", x.title
        )
        for x in pages
    )
    if len(pages) == 1:
        return Markup('<ul class="single">{}</ul>').format(items)
    mark = Markup(" data-here") if any(x.name == here.name for x in pages) else Markup("")
    return Markup('<details class="menu"{}><summary>{}</summary><ul>{}</ul></details>').format(mark, name, items)


SHELL = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title} · gauss_bench</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="site.css">
<script src="theme.js"></script>
</head>
<body>
<a class="skip" href="#main">Skip to the content</a>
<header class="top"><a class="brand" href="index.html">gauss<span>_</span>bench</a>
<nav aria-label="Pages">{contents}</nav>
<button type="button" id="theme" aria-label="Switch between light and dark">◐</button></header>
<main id="main">
<h1>{heading}</h1>
<p class="lead">{lead}</p>
{body}
</main>
<footer><p>{facts}</p></footer>
{scripts}
</body>
</html>
"""
