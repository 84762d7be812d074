"""Turn reports on faults in engines' libraries into sections for the pages of these engines.

The reports are files in a folder beside the tables of a run. Their Markdown has only paragraphs, lists and tables.
"""

from collections.abc import Mapping

from gauss_bench.report.content import Block, Bullets, Section, Table, Text, text_cell


def faults_of(faults: Mapping[str, str], engine: str) -> list[Section]:
    """Return a section for each report on a fault in an engine's library, sorted by the names of the reports."""
    return [make_section(name, text) for name, text in sorted(faults.items()) if name.startswith(f"{engine}_")]


def make_section(name: str, text: str) -> Section:
    """Return a report as a section; the first line of its text is the title, and empty lines separate its blocks."""
    title, _, rest = text.partition("\n")
    return Section(title.removeprefix("# "), name, [make_block(x) for x in rest.strip().split("\n\n")])


def make_block(text: str) -> Block:
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
