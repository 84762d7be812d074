"""The frame and navigation that all pages share, and the conversion of a section's blocks to HTML by the folder `templates`.

The templates escape texts from files; `script_text` escapes data in scripts.
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

LONG, LONGEST_LABEL = 60, 40  # [characters] a cell longer than LONG is folded behind a label of at most LONGEST_LABEL
SHORTEST_LABEL = 12  # [characters] the beginning of a cell is no label if it is as short as this, such as a time
HEADLINE = 260  # [characters] longest headline of a finding
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
TAGS = {"bad": "where we lose", "warn": "note", "good": "holds"}  # tone of a finding -> word before its title


@dataclass(frozen=True)
class Page:
    """A page of the site.

    Attributes:
        name: name of the page's file, without suffix.
        data: name -> data for the scripts of the page, such as charts.
        later: name of a file -> data that a script loads only on demand.
        group: the page's group in the table of contents; empty for a page that has no entry there.
        facts: facts of the run from which the rows of the page come; empty if that is the run of the whole site.
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
        """The name of the page's file."""
        return f"{self.name}.html"


def file_name(text: str) -> str:
    """Return a text as a file name that is safe in addresses; an altered text gets a checksum, to be distinct."""
    safe = re.sub(r"[^a-z0-9_]+", "-", text.lower()).strip("-") or "x"
    return safe if safe == text else f"{safe}-{sum(ord(c) * (i + 7) for i, c in enumerate(text)) % 99991}"


def script_text(value: Any) -> str:
    """Return a value as JSON without the characters <, > and &, which could end a script element."""
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
    """Return the CSS class that tables with this head and these numeric columns share."""
    return f"h{zlib.crc32(repr((*content.head, *sorted(content.numeric))).encode()):x}"


def table_style(content: Table) -> Markup:
    """Return the CSS rules for all tables of the class of this table (`table_class`), which have the same columns.

    One rule for a column is shorter than attributes in every cell, which would make up a tenth of the site's size. On phones the
    cells of a row are below each other, each with the heading of its column.
    """
    name = table_class(content)
    labels = [f".{name} td:nth-child({i})::before{{content:{css_label(head)}}}" for i, head in enumerate(content.head, 1)]
    cells = ",".join(f".{name} td:nth-child({i + 1})" for i in sorted(content.numeric))
    numbers = f"@media(min-width:761px){{{cells}{{text-align:right;white-space:nowrap}}}}" if cells else ""
    return Markup(f"<style>@media(max-width:760px){{{''.join(labels)}}}{numbers}</style>")


def css_label(head: str) -> Markup:
    """Return the heading of a column as a quoted string of CSS, without marks of Markdown."""
    return Markup(json.dumps(re.sub(r"[`*<>\\\\]", "", head), ensure_ascii=False))


def sort_attribute(cell: Cell) -> Markup:
    """Return the attribute with the sort key of a cell; empty if the page can sort by the cell's text."""
    if not isinstance(cell.sort, float) or NUMBER.fullmatch(cell.text):
        return Markup("")
    return Markup(' data-sort="{:.7g}"').format(cell.sort)


def cell_html(cell: Cell) -> Markup:
    """Return the HTML of a cell; a missing value is a dash with the reason, and a long text is folded behind a label."""
    text = cell.text or NOTHING
    if text == NOTHING:
        why = cell.why or UNMEASURED
        if len(why) <= LONGEST_LABEL:
            return Markup("<small>- {}</small>").format(why)
        return Markup("<details><summary>- {}</summary>{}</details>").format(short_label(why), why)
    if cell.tone == "formula" and is_formula(text):
        return mathml(text)
    if re.fullmatch(r"https://[^\s\"<>]+", text):
        html = Markup('<a href="{}">{}</a>').format(text, text.removeprefix("https://").partition("/")[0])
    elif len(text) <= LONG:
        html = rich(text)
    else:
        html = Markup("<details><summary>{}</summary>{}</details>").format(short_label(text), rich(text))
    return Markup('<span class="t-{}">{}</span>').format(cell.tone, html) if cell.tone in ("bad", "warn", "good", "below") else html


def short_label(text: str) -> str:
    """Return a label for a long text: its words up to a colon or semicolon.

    If these words have at most SHORTEST_LABEL or more than LONGEST_LABEL characters, the label has as many words of the text as fit
    into LONGEST_LABEL characters, followed by " ...".
    """
    first = re.split(r"[:;]", text, maxsplit=1)[0].strip()
    if SHORTEST_LABEL < len(first) <= LONGEST_LABEL:
        return first
    return text[:LONGEST_LABEL].rpartition(" ")[0].rstrip(",;:") + " ..."


def sentence_of(finding: Finding) -> str:
    """Return a finding in one sentence: its own short form, or the headline of its text."""
    return finding.short or headline(finding.text)


def headline(text: str) -> str:
    """Return the first sentence of the text of a finding, shortened to about HEADLINE characters.

    A longer sentence loses its texts in parentheses. If it is still too long, it ends at the last colon or semicolon that lies
    within the limit, so that the list after it is left out, or else between two words.
    """
    first = SENTENCE.split(text.replace("**", ""))[0]
    if len(first) <= HEADLINE:
        return first
    short = re.sub(r"\s\((?:[^()]|\([^()]*\))*\)", "", first)  # parentheses may be nested
    if len(short) <= HEADLINE:
        return short
    ends = [m.start() for m in re.finditer(r": |; ", short) if m.start() <= HEADLINE] or [short.rfind(" ", 0, HEADLINE)]
    return f"{short[: ends[-1]].rstrip('.,;: ')}."


ENVIRONMENT = make_environment("gauss_bench.report.site")
ENVIRONMENT.filters |= {f.__name__: f for f in (table_class, table_style, sort_attribute, cell_html, rich, headline, sentence_of)}
ENVIRONMENT.filters |= {
    "plain": lambda text: text.replace("**", ""),
    "sentences": lambda text: [x for x in re.split(r"(?<=[;.])\s+", text) if x],
    "plain_text": lambda text: rich(text).striptags(),
    "tag": lambda tone: TAGS.get(tone, ""),
    "mathml": mathml,
}


def render(template: str, **context: Any) -> Markup:
    """Return the HTML of a template of the folder `templates`, filled in with `context`."""
    return Markup(ENVIRONMENT.get_template(template).render(context))


# parts that the template `plain.html` prints in this order; each may be left out
PARTS = ("opening", "paragraphs", "sections", "findings", "back", "tables", "engines", "described", "entry", "headings")


def plain_page(name: str, title: str, lead: str, group: str = "", charts: Mapping[str, Any] | None = None, **parts: Any) -> Page:
    """Return a page without scripts of its own; `charts` has the data of its figures, `parts` those of PARTS."""
    body = render("plain.html", **dict.fromkeys(PARTS, ()) | parts)
    return Page(name, title, lead, body, {"charts": charts} if charts else {}, group)


def render_page(page: Page, pages: Sequence[Page], facts: Sequence[str], guide: str = "") -> str:
    """Return the complete HTML of a page; `guide` is the address of the documentation, empty if there is none."""
    groups: dict[str, list[Page]] = {}
    for other in pages:
        if other.group:
            groups.setdefault(other.group, []).append(other)
    data = [f"data/{page.name}.js"] if page.data else []
    charts = ["vega.js", "charts.js"] if page.data.get("charts") else []
    scripts = ["site.js", *data, *page.scripts, *charts]
    return str(render("page.html", page=page, groups=groups, facts=facts, guide=guide, scripts=scripts))
