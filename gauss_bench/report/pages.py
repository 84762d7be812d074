"""Convert sections to a page of Markdown by a template; texts of sections have only `code` and **strong** as markup."""

import re
from collections.abc import Sequence

import jinja2

from gauss_bench.report.content import Cell, Section
from gauss_bench.report.rows import Run

SENTENCE = re.compile(r"(?<=[.*])\s+(?=[A-Z`\"*])")  # the space between two sentences of a finding
MARKED = re.compile(r"(\*\*[^*]+\*\*|`[^`]+`)")


def plain(text: str) -> str:
    """Escape a text for Markdown, except for `code` and **strong**."""
    parts = [part if MARKED.fullmatch(part) else _quote(part) for part in MARKED.split(" ".join(text.split()))]
    return "".join(parts)


def _quote(text: str) -> str:
    """Escape what Markdown would read as markup."""
    text = re.sub(r"([\\`*#])", r"\\\1", text).replace("](", "]\\(")
    text = re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)
    return re.sub(r"<(?=[A-Za-z/!?])", r"&lt;", text)


def markdown_cell(cell: Cell) -> str:
    """Return a cell in Markdown, without bars; bad values are bold."""
    text = plain(cell.text).replace("|", "\\|")
    return f"**{text}**" if cell.tone == "bad" else text


def make_environment(package: str, autoescape: bool = True) -> jinja2.Environment:
    """Return the environment that fills in the templates of a package; an unknown name in a template is an error."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader(package, "templates"),
        undefined=jinja2.StrictUndefined,
        autoescape=autoescape,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def facts(run: Run) -> list[str]:
    """Return suite, date, commit and processor of a run, for headers; what the run did not record is left out."""
    known = run.environment
    suite = f"suite {known['suite']}" if "suite" in known else ""
    changes = " with changes" if known.get("dirty") else ""
    commit = f"commit {known['commit'][:10]}{changes}" if known.get("commit") else ""
    return [str(x) for x in (suite, known.get("date"), commit, known.get("cpu")) if x]


def markdown_page(run: Run, content: Sequence[Section]) -> str:
    """Return a page of Markdown with the facts of a run and sections."""
    environment = make_environment("gauss_bench.report", autoescape=False)  # the filter `plain` escapes texts for Markdown
    environment.filters |= {"plain": plain, "md_cell": markdown_cell}
    text = environment.get_template("page.md").render(sections=content, facts=facts(run))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"
