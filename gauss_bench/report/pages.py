"""Convert sections to a page of Markdown by a template; texts of sections have only `code` and **strong** as markup."""

import re
from collections.abc import Sequence

import jinja2

from gauss_bench.report.content import Cell, Section
from gauss_bench.report.rows import Run

SENTENCE = re.compile(r"(?<=[.*])\s+(?=[A-Z`\"*])")  # between two of a finding
MARKED = re.compile(r"(\*\*[^*]+\*\*|`[^`]+`)")


def plain(text: str) -> str:
    """Escape a text for Markdown, except for `code` and **strong**."""
    parts = [part if MARKED.fullmatch(part) else _quote(part) for part in MARKED.split(" ".join(text.split()))]
    return "".join(parts)


def _quote(text: str) -> str:
    text = re.sub(r"([\\`*#])", r"\\\1", text).replace("](", "]\\(")
    text = re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)
    return re.sub(r"<(?=[A-Za-z/!?])", r"&lt;", text)


def markdown_cell(cell: Cell) -> str:
    """Return a cell in Markdown, without bars; bad values are bold."""
    text = plain(cell.text).replace("|", "\\|")
    return f"**{text}**" if cell.tone == "bad" else text


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("gauss_bench.report", "templates"),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # what Markdown needs is escaped by `plain`
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"plain": plain, "md_cell": markdown_cell}
    return environment


def facts(run: Run) -> list[str]:
    """Return suite, date, commit and processor of a run, for headers."""
    known = run.environment
    suite = f"suite {known['suite']}" if "suite" in known else ""
    commit = f"commit {known['commit'][:10]}{' with changes' if known.get('dirty') else ''}" if known.get("commit") else ""
    return [x for x in (suite, str(known.get("date", "")), commit, str(known.get("cpu", ""))) if x]


def markdown_page(run: Run, content: Sequence[Section]) -> str:
    text = _environment().get_template("page.md").render(sections=content, facts=facts(run))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"
