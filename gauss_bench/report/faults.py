"""Reports on faults in engines' libraries, which lie beside the rows as Markdown, as sections for the pages of these engines."""

from collections.abc import Mapping

from gauss_bench.report.content import Block, Bullets, Section, Table, Text, text_cell


def faults_of(faults: Mapping[str, str], engine: str) -> list[Section]:
    """Return the reports on an engine's library; `faults` maps ENGINE_WORDS to a text."""
    return [make_section(name, text) for name, text in sorted(faults.items()) if name.startswith(f"{engine}_")]


def make_section(name: str, text: str) -> Section:
    """Return a report as a section: its first line is the title, empty lines part its paragraphs, lists and tables."""
    title, _, rest = text.partition("\n")
    return Section(title.removeprefix("# "), name, [make_block(x) for x in rest.strip().split("\n\n")])


def make_block(text: str) -> Block:
    """Return a paragraph, a list or a table."""
    if text.startswith("- "):
        return Bullets([" ".join(x.split()) for x in text.removeprefix("- ").split("\n- ")])
    if not text.startswith("|"):
        return Text(" ".join(text.split()))
    head, rule, *lines = [[x.strip() for x in line.strip("|").split("|")] for line in text.splitlines()]
    numeric = [i for i, x in enumerate(rule) if x.endswith(":")]
    return Table(", ".join(head[1:]), head, [[text_cell(x) for x in line] for line in lines], numeric)
