"""The frame that all pages share, with navigation, and the conversion of a section's blocks to HTML by `templates`.

Texts from files are escaped by the templates; data in scripts is escaped by `script_text`.
"""

import json
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from markupsafe import Markup, escape

from gauss_bench.report.content import UNMEASURED, Cell, Finding, Table
from gauss_bench.report.pages import MARKED, SENTENCE, make_environment
from gauss_bench.report.site.formulas import is_formula, mathml
from gauss_bench.report.words import NOTHING

LONG, LABEL = 60, 40  # characters: a cell longer than LONG is folded behind a label of at most LABEL
LEAST_LABEL = 12  # characters: shorter beginnings, such as a time, do not say what is behind them
HEADLINE = 260  # largest number of characters of a finding that is not unfolded
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
TAGS = {"bad": "where we lose", "warn": "note", "good": "holds"}


@dataclass(frozen=True)
class Page:
    """One page.

    Attributes:
        name: name of its file, without suffix.
        lead: the sentence below the title.
        body: HTML content.
        data: data of its scripts, such as charts by name.
        scripts: further scripts that it needs.
        later: name -> data that a script loads only on demand.
        group: its group in the table of contents; empty for pages that are only linked from others.
        facts: of the run of its rows; empty for that of the site.
    """

    name: str
    title: str
    lead: str
    body: Markup
    data: Mapping[str, Any] = field(default_factory=dict)
    group: str = ""
    scripts: tuple[str, ...] = ()
    later: Mapping[str, Any] = field(default_factory=dict)
    facts: tuple[str, ...] = ()

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"{self.name}.html"


def file_name(text: str) -> str:
    """Return a file name that is safe on file systems and in addresses; an altered name gets a checksum, to stay distinct."""
    plain = re.sub(r"[^a-z0-9_]+", "-", text.lower()).strip("-") or "x"
    return plain if plain == text else f"{plain}-{sum(ord(c) * (i + 7) for i, c in enumerate(text)) % 99991}"


def script_text(value: Any) -> str:
    """Return JSON that is safe inside a script element: it contains no character that could end the element."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"), sort_keys=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def rich(text: str) -> Markup:
    """Escape a text and convert `code` and **strong** to HTML."""
    parts = []
    for part in MARKED.split(text):
        if part.startswith("**"):
            parts.append(Markup("<strong>{}</strong>").format(rich(part[2:-2])))
        elif MARKED.fullmatch(part):
            parts.append(Markup("<code>{}</code>").format(part[1:-1]))
        else:
            parts.append(escape(part))
    return Markup("").join(parts)


def table_class(content: Table) -> str:
    """Return the CSS class of tables with this head; `table_style` describes it."""
    return f"h{zlib.crc32(repr((*content.head, *sorted(content.numeric))).encode()):x}"


def table_style(content: Table) -> Markup:
    """Return the style of a table's class: numbers are aligned right; on phones cells stand below each other, with labels.

    It stands once for a column, since an attribute of each cell would take a tenth of the site.
    """
    name = table_class(content)
    labels = [f".{name} td:nth-child({i})::before{{content:{label(x)}}}" for i, x in enumerate(content.head, 1)]
    cells = ",".join(f".{name} td:nth-child({i + 1})" for i in sorted(content.numeric))
    numbers = f"@media(min-width:761px){{{cells}{{text-align:right;white-space:nowrap}}}}" if cells else ""
    return Markup(f"<style>@media(max-width:760px){{{''.join(labels)}}}{numbers}</style>")


def label(head: str) -> Markup:
    """Return the head of a column as a CSS string."""
    return Markup(json.dumps(re.sub(r"[`*<>\\\\]", "", head), ensure_ascii=False))


def sort_by(cell: Cell) -> Markup:
    """Return the sort attribute of a cell, unless its text is a number already, with the digits that a reader sees."""
    if not isinstance(cell.sort, float) or NUMBER.fullmatch(cell.text):
        return Markup("")
    return Markup(' data-sort="{:.7g}"').format(cell.sort)


def shown(cell: Cell) -> Markup:
    """Return the HTML of a cell: formulas are typeset, addresses become links, long texts are folded, a dash has its reason."""
    text = cell.text or NOTHING
    if text == NOTHING:
        why = cell.why or UNMEASURED
        if len(why) <= LABEL:
            return Markup("<small>- {}</small>").format(why)
        return Markup("<details><summary>- {}</summary>{}</details>").format(short_label(why), why)
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
    """Return the first words of a text, up to a colon or semicolon unless these say too little, as its label."""
    first = re.split(r"[:;]", text, maxsplit=1)[0].strip()
    if LEAST_LABEL < len(first) <= LABEL:
        return first
    return text[:LABEL].rpartition(" ")[0].rstrip(",;:") + " ..."


def sentence_of(finding: Finding) -> str:
    """Return a finding in one sentence."""
    return finding.short or headline(finding.text)


def headline(text: str) -> str:
    """Return the first sentence of a finding; a long one loses its brackets and its list."""
    first = SENTENCE.split(text.replace("**", ""))[0]
    if len(first) <= HEADLINE:
        return first
    short = re.sub(r"\s\((?:[^()]|\([^()]*\))*\)", "", first)
    if len(short) <= HEADLINE:
        return short
    ends = [m.start() for m in re.finditer(r": |; ", short) if m.start() <= HEADLINE] or [short.rfind(" ", 0, HEADLINE)]
    return f"{short[: ends[-1]].rstrip('.,;: ')}."


ENVIRONMENT = make_environment("gauss_bench.report.site")
ENVIRONMENT.filters |= {f.__name__: f for f in (table_class, table_style, sort_by, shown, rich, headline, sentence_of)}
ENVIRONMENT.filters |= {
    "plain": lambda text: text.replace("**", ""),
    "sentences": lambda text: [x for x in re.split(r"(?<=[;.])\s+", text) if x],
    "plain_text": lambda text: rich(text).striptags(),
    "tag": lambda tone: TAGS.get(tone, ""),
    "mathml": mathml,
}


def render(template: str, **context: Any) -> Markup:
    """Fill in a template of the folder `templates`."""
    return Markup(ENVIRONMENT.get_template(template).render(context))


PARTS = ("opening", "paragraphs", "sections", "findings", "back", "tables", "engines", "described", "entry", "found")


def plain_page(name: str, title: str, lead: str, group: str = "", charts: Mapping[str, Any] | None = None, **parts: Any) -> Page:
    """Make a page from some of PARTS, such as sections, tables or findings."""
    body = render("plain.html", **dict.fromkeys(PARTS, ()) | parts)
    return Page(name, title, lead, body, {"charts": charts} if charts else {}, group)


def document(page: Page, pages: Sequence[Page], facts: Sequence[str], guide: str = "") -> str:
    """Return the complete HTML of a page; `guide` is the address of the documentation, if it was built."""
    groups: dict[str, list[Page]] = {}
    for other in pages:
        if other.group:
            groups.setdefault(other.group, []).append(other)
    data = [f"data/{page.name}.js"] if page.data else []
    drawn = ["vega.js", "charts.js"] if page.data.get("charts") else []
    scripts = ["site.js", *data, *page.scripts, *drawn]
    return str(render("page.html", page=page, groups=groups, facts=facts, guide=guide, scripts=scripts))
