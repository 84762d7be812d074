"""Convert sections to a page of Markdown; texts of sections have `code` and **strong** as their only markup."""

import re
from collections.abc import Mapping, Sequence

import jinja2

from gauss_bench.report.content import Block, Bullets, Cell, Section, Table, Text, text_cell
from gauss_bench.report.rows import Run

SENTENCE = re.compile(r"(?<=[.*])\s+(?=[A-Z`\"*])")  # the space between two sentences of a finding
MARKED = re.compile(r"(\*\*[^*]+\*\*|`[^`]+`)")


def plain(text: str) -> str:
    """Escape a text for Markdown, except for `code` and **strong**, and replace line breaks by spaces."""
    parts = MARKED.split(" ".join(text.split()))
    return "".join(part if MARKED.fullmatch(part) else _quote(part) for part in parts)


def _quote(text: str) -> str:
    """Escape the characters that Markdown would read as markup."""
    text = re.sub(r"([\\`*#])", r"\\\1", text).replace("](", "]\\(")
    text = re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)
    return re.sub(r"<(?=[A-Za-z/!?])", r"&lt;", text)


def markdown_cell(cell: Cell) -> str:
    """Return the Markdown of a table's cell; vertical bars `|` are escaped, and values with the tone "bad" are bold."""
    text = plain(cell.text).replace("|", "\\|")
    return f"**{text}**" if cell.tone == "bad" else text


def make_environment(package: str, autoescape: bool = True) -> jinja2.Environment:
    """Return the Jinja environment of a package's templates, in which an unknown name is an error."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader(package, "templates"),
        undefined=jinja2.StrictUndefined,
        autoescape=autoescape,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def facts(run: Run) -> list[str]:
    """Return suite, date, commit and processor of a run, as far as it recorded them."""
    environment = run.environment
    suite = f"suite {environment['suite']}" if "suite" in environment else ""
    changes = " with changes" if environment.get("dirty") else ""  # the working tree had uncommitted changes
    commit = f"commit {environment['commit'][:10]}{changes}" if environment.get("commit") else ""
    return [str(x) for x in (suite, environment.get("date"), commit, environment.get("cpu")) if x]


def markdown_page(run: Run, content: Sequence[Section]) -> str:
    """Return the Markdown of a page with the facts of a run and with sections."""
    environment = make_environment("gauss_bench.report", autoescape=False)  # the filter `plain` escapes texts for Markdown
    environment.filters |= {"plain": plain, "md_cell": markdown_cell}
    text = environment.get_template("page.md").render(sections=content, facts=facts(run))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def faults_of(faults: Mapping[str, str], engine: str) -> list[Section]:
    """Return a section for each report on a fault in an engine's library, sorted by the names of the reports.

    Args:
        faults: name of a report, which begins with that of the engine and an underscore -> its text in Markdown, which has only
            paragraphs, lists and tables. The first line is the title, and empty lines separate blocks.
    """
    sections = []
    for name, text in sorted(faults.items()):
        if name.startswith(f"{engine}_"):
            title, _, rest = text.partition("\n")
            sections.append(Section(title.removeprefix("# "), name, [read_block(x) for x in rest.strip().split("\n\n")]))
    return sections


def read_block(text: str) -> Block:
    """Return the paragraph, list or table of a block in Markdown."""
    if text.startswith("- "):
        return Bullets([" ".join(x.split()) for x in text.removeprefix("- ").split("\n- ")])
    if not text.startswith("|"):
        return Text(" ".join(text.split()))
    # `rule` is the second line of a table in Markdown; there `--:` marks a column that is aligned right, which has numbers
    head, rule, *lines = [[x.strip() for x in line.strip("|").split("|")] for line in text.splitlines()]
    numeric = [i for i, x in enumerate(rule) if x.endswith(":")]
    # the title of the table lists its columns but the first
    return Table(", ".join(head[1:]), head, [[text_cell(x) for x in line] for line in lines], numeric)
