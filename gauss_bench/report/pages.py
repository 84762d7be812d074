"""Convert sections to a page of Markdown; texts of sections have `code` and **strong** as their only markup."""

import re
from collections.abc import Mapping, Sequence

import jinja2

from gauss_bench.report.content import Block, Bullets, Cell, Section, Table, Text, text_cell
from gauss_bench.report.rows import Run

SENTENCE = re.compile(r"(?<=[.*])\s+(?=[A-Z`\"*])")  # the space between two sentences of a finding
MARKED = re.compile(r"(\*\*[^*]+\*\*|`[^`]+`)")


def escape_markdown(text: str) -> str:
    """Escape a text for Markdown, except for `code` and **strong**, and replace line breaks by spaces."""
    parts = MARKED.split(" ".join(text.split()))  # every second part is `code` or **strong**
    return "".join(part if MARKED.fullmatch(part) else _escape_part(part) for part in parts)


def _escape_part(text: str) -> str:
    """Escape the characters that Markdown would read as markup."""
    text = re.sub(r"([\\`*#])", r"\\\1", text).replace("](", "]\\(")  # `](` would make a link
    text = re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)  # an underscore inside a word is no markup
    return re.sub(r"<(?=[A-Za-z/!?])", r"&lt;", text)  # `<` before these characters would begin HTML


def markdown_cell(cell: Cell) -> str:
    """Return the Markdown of a table's cell; vertical bars `|` are escaped, and values with the tone "bad" are bold."""
    text = escape_markdown(cell.text).replace("|", "\\|")
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


def list_facts(run: Run) -> list[str]:
    """Return the suite, date, commit and processor that a run recorded."""
    environment = run.environment
    suite = f"suite {environment['suite']}" if "suite" in environment else ""
    changes = " with changes" if environment.get("dirty") else ""  # the working tree had uncommitted changes
    commit = f"commit {environment['commit'][:10]}{changes}" if environment.get("commit") else ""
    facts = (suite, environment.get("date"), commit, environment.get("cpu"))
    return [str(fact) for fact in facts if fact]


def markdown_page(run: Run, sections: Sequence[Section]) -> str:
    """Return the Markdown of a page: one line with the facts of a run, then sections."""
    environment = make_environment("gauss_bench.report", autoescape=False)  # the filter `plain` escapes texts for Markdown
    environment.filters |= {"plain": escape_markdown, "md_cell": markdown_cell}
    text = environment.get_template("page.md").render(sections=sections, facts=list_facts(run))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def fault_sections(faults: Mapping[str, str], engine: str) -> list[Section]:
    """Return a section for each report on a fault in the library of an engine, sorted by the names of the reports.

    Args:
        faults: name of a report -> its text in Markdown. The name begins with the engine's name and an underscore. The text has a
            title in its first line, then paragraphs, lists and tables, separated by empty lines.
    """
    sections = []
    for name, text in sorted(faults.items()):
        if name.startswith(f"{engine}_"):
            title, _, rest = text.partition("\n")
            blocks = [read_block(block) for block in rest.strip().split("\n\n")]
            sections.append(Section(title.removeprefix("# "), name, blocks))
    return sections


def read_block(text: str) -> Block:
    """Convert a block of Markdown to a paragraph, list or table."""
    if text.startswith("- "):
        return Bullets([" ".join(x.split()) for x in text.removeprefix("- ").split("\n- ")])
    if not text.startswith("|"):
        return Text(" ".join(text.split()))
    # `rule`, the second line of a table in Markdown, has `--:` for each column of numbers, which are aligned right
    head, rule, *lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    numeric = [i for i, mark in enumerate(rule) if mark.endswith(":")]
    # the title lists the heads of all columns except the first
    return Table(", ".join(head[1:]), head, [[text_cell(cell) for cell in line] for line in lines], numeric)
