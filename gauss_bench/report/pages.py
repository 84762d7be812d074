"""Sections -> the two pages, by templates; the text between backticks and double stars is the only markup sections may use."""

import re
from collections.abc import Sequence
from typing import Any

import jinja2
from markupsafe import Markup, escape

from gauss_bench.report.content import Cell, Picture, Section
from gauss_bench.report.palette import engine_colours, inline
from gauss_bench.report.rows import Run

MARKED = re.compile(r"(\*\*[^*]+\*\*|`[^`]+`)")


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


def plain(text: str) -> str:
    """Text that Markdown leaves alone except for `code` and **strong**."""
    parts = [part if MARKED.fullmatch(part) else _quoted(part) for part in MARKED.split(" ".join(text.split()))]
    return "".join(parts)


def _quoted(text: str) -> str:
    text = re.sub(r"([\\`*#])", r"\\\1", text).replace("](", "]\\(")
    text = re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)
    return re.sub(r"<(?=[A-Za-z/!?])", r"&lt;", text)


def markdown_cell(cell: Cell) -> str:
    """A table's entry: no line breaks, no bars; what is wrong stands out."""
    text = plain(cell.text).replace("|", "\\|")
    return f"**{text}**" if cell.tone == "bad" else text


def css_name(text: str) -> str:
    return re.sub(r"[^a-z0-9-]+", "-", text.lower()).strip("-")


def inline_picture(picture: Picture) -> Markup:
    return Markup(inline(picture.svg, css_name(picture.name)))


def _environment(autoescape: bool) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("gauss_bench.report", "templates"),
        undefined=jinja2.StrictUndefined,
        autoescape=autoescape,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"rich": rich, "plain": plain, "md_cell": markdown_cell, "css": css_name, "inline": inline_picture}
    return environment


def _context(run: Run, content: Sequence[Section]) -> dict[str, Any]:
    environment = run.environment
    controls = {row["engine"] for row in run.results if row["control"]}
    return {
        "sections": content,
        "facts": [x for x in (_suite(run), str(environment.get("date", "")), _commit(run), str(environment.get("cpu", ""))) if x],
        "colours": engine_colours((row["engine"] for row in run.results), controls),
    }


def _suite(run: Run) -> str:
    return f"suite {run.environment['suite']}" if "suite" in run.environment else ""


def _commit(run: Run) -> str:
    commit = str(run.environment.get("commit") or "")[:10]
    return f"commit {commit}{' with changes' if run.environment.get('dirty') else ''}" if commit else ""


def markdown_page(run: Run, content: Sequence[Section]) -> str:
    text = _environment(autoescape=False).get_template("page.md").render(_context(run, content))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def html_page(run: Run, content: Sequence[Section]) -> str:
    environment = _environment(autoescape=True)
    assets = {name: Markup(_source(environment, file)) for name, file in (("style", "page.css"), ("script", "page.js"))}
    return environment.get_template("page.html").render(_context(run, content) | assets)


def _source(environment: jinja2.Environment, name: str) -> str:
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]
