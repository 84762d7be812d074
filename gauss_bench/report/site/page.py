"""The shell that every page shares, its way through the site, and how blocks of a section become HTML: by `templates`.

Text of files reaches a page through their escaping alone, and a script through `script_text`.
"""

import json
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jinja2
from markupsafe import Markup, escape

from gauss_bench.report.content import NOTHING, Cell, Chart, Section, Table
from gauss_bench.report.pages import MARKED, SENTENCE
from gauss_bench.report.site.formulas import is_formula, mathml

LONG, LABEL = 60, 40  # characters: a longer cell opens from a label of at most so many
HEADLINE = 260  # characters of a finding before its reader opens the rest
DASH = "A dash: not measured there, or without sense for that row."
TAGS = {"bad": "where we lose", "warn": "to know", "good": "holds"}


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


def column_classes(content: Table) -> list[Markup]:
    """The class attribute of each column: numbers, the first of which comes first where there is little room."""
    lead = min(content.numeric, default=-1)
    names = [f"n{' first' if i == lead else ''}" if i in content.numeric else "" for i in range(len(content.head))]
    return [Markup(' class="{}"').format(x) if x else Markup("") for x in names]


def label_class(content: Table) -> str:
    """The class of tables with the same head, whose cells are labelled by it where they stand below each other on a phone."""
    return f"h{zlib.crc32(repr(content.head).encode()):x}"


def label(head: str) -> Markup:
    return Markup(json.dumps(re.sub(r"[`*<>\\\\]", "", head), ensure_ascii=False))


def note_of(content: Table) -> str:
    dashes = DASH if any(cell.text in ("", NOTHING) for row in content.rows for cell in row) else ""
    return " ".join(filter(None, (content.note, dashes)))


def sort_by(cell: Cell) -> Markup:
    """A number that rows are sorted by, where the text does not say it."""
    told = f"{cell.sort:.7g}" if isinstance(cell.sort, float) else cell.text
    return Markup("") if told == cell.text else Markup(' data-sort="{}"').format(told)


def shown(cell: Cell) -> Markup:
    """What a cell shows: a formula typeset, an address as a link, a long text behind a short label, a dash for nothing."""
    text = cell.text or NOTHING
    if cell.tone == "formula" and is_formula(text):
        return mathml(text)
    if re.fullmatch(r"https://[^\s\"<>]+", text):
        made = Markup('<a href="{}">{}</a>').format(text, text.removeprefix("https://").partition("/")[0])
    elif len(text) <= LONG:
        made = rich(text)
    else:
        made = Markup("<details><summary>{}</summary>{}</details>").format(short_label(text), rich(text))
    return Markup('<span class="t-{}">{}</span>').format(cell.tone, made) if cell.tone in ("bad", "warn", "good", "below") else made


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


def _environment() -> jinja2.Environment:
    loader = jinja2.PackageLoader("gauss_bench.report.site", "templates")
    strict = jinja2.StrictUndefined
    environment = jinja2.Environment(loader=loader, undefined=strict, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {f.__name__: f for f in (column_classes, label_class, label, note_of, sort_by, shown, rich, headline)}
    environment.filters["plain"] = lambda text: text.replace("**", "")
    environment.filters["sentences"] = lambda text: [x for x in re.split(r"(?<=[;.])\s+", text) if x]
    environment.filters["plain_text"] = lambda text: rich(text).striptags()
    environment.filters["tag"] = lambda tone: TAGS.get(tone, "")
    return environment


ENVIRONMENT = _environment()


def render(template: str, **context: Any) -> Markup:
    """A file of `templates` with its names filled in."""
    return Markup(ENVIRONMENT.get_template(template).render(context))


PARTS = ("paragraphs", "sections", "findings", "back", "tables", "engines", "described", "entry", "found")


def plain_page(name: str, title: str, lead: str, group: str = "", charts: Mapping[str, Any] | None = None, **parts: Any) -> Page:
    """A page of a few of PARTS: sections, tables, findings, a list."""
    body = render("plain.html", **dict.fromkeys(PARTS, ()) | parts)
    return Page(name, title, lead, body, {"charts": charts} if charts else {}, group)


def charts_in(content: Section) -> dict[str, Any]:
    """Name -> data of every figure of a section."""
    own = {x.name: x.data() for x in content.blocks if isinstance(x, Chart)}
    return own | {name: data for part in content.parts for name, data in charts_in(part).items()}


def document(page: Page, pages: Sequence[Page], facts: Sequence[str], guide: str = "") -> str:
    """The whole text of a page; `guide` is where the documentation lies, if it does."""
    groups: dict[str, list[Page]] = {}
    for other in pages:
        if other.group:
            groups.setdefault(other.group, []).append(other)
    data = [f"data/{page.name}.js"] if page.data else []
    drawn = ["vega.js", "charts.js"] if page.data.get("charts") else []
    scripts = ["site.js", *data, *page.scripts, *drawn]
    return str(render("page.html", page=page, groups=groups, facts=facts, guide=guide, scripts=scripts))
