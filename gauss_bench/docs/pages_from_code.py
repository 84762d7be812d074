"""Write the pages that are computed from code: the grammar of linkage files, the index of its keys, the commands, and the formats.

MkDocs calls the functions `on_...` while it builds the documentation.
"""

import argparse
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from gauss_bench.api.options import VERBS, add_options
from gauss_bench.docs.grammar_index import GUIDE, describe_key, list_keys, write_index
from gauss_bench.verbs.formats import find_schema, list_formats

START = "## A complete example"  # heading of the guide with which the page of the grammar begins
INDEX = "search/search_index.json"  # file with the headings, which the site's search page reads
HEADINGS: list[dict[str, str]] = []  # address ("location") and text ("title") of each heading of the build


def on_pre_build(**_: Any) -> None:
    """Remove the headings of an earlier build in the same process."""
    HEADINGS.clear()


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the JSON Schemas to the files of the documentation."""
    from mkdocs.structure.files import File  # imported late: only a build of the site has mkdocs

    for name in list_formats():
        files.append(File.generated(config, f"formats/{name}.json", content=json.dumps(find_schema(name), separators=(",", ":"))))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the Markdown of a page with the parts that are computed from code."""
    if page.file.src_uri == "commands.md":
        return write_commands(markdown)
    write = {"grammar.md": write_grammar, "keys.md": write_index, "formats.md": write_formats}.get(page.file.src_uri)
    return f"{markdown}\n{write()}" if write else markdown


def on_page_content(html: str, page: Any, **_: Any) -> None:
    """Add the title and headings of a page to HEADINGS; of keys.md the keys instead of headings, of commands.md options too."""
    HEADINGS.append({"location": page.url, "title": page.title})
    entries = [(heading.url, heading.title) for heading in list_headings(page.toc)]
    if page.file.src_uri == "keys.md":
        entries = [(f"#{anchor}", describe_key(entry, key)) for entry, key, anchor in list_keys()]
    elif page.file.src_uri == "commands.md":
        for verb, declaration in VERBS.items():
            entries += [(f"#{verb}", f"{verb} {option}") for option in declaration.get("options", {}) if option.startswith("-")]
    HEADINGS.extend({"location": f"{page.url}{anchor}", "title": f"{page.title}: {text}"} for anchor, text in entries)


def list_headings(headings: Iterable[Any]) -> Iterator[Any]:
    """Yield the headings of a page at all levels, except its title (level 1)."""
    for heading in headings:
        if heading.level > 1:
            yield heading
        yield from list_headings(heading.children)


def on_post_build(config: Any, **_: Any) -> None:
    """Write the headings for the site's search page, and remove files that no page uses.

    The site's search replaces that of the theme, which works only from a server and finds nothing outside the documentation.
    """
    index = Path(config["site_dir"]) / INDEX
    index.parent.mkdir(exist_ok=True)
    index.write_text(json.dumps({"docs": HEADINGS}, ensure_ascii=False), encoding="utf-8")
    assets = Path(config["site_dir"]) / "assets"
    for path in assets.rglob("*.map"):
        path.unlink()
    for folder in ("lunr", "workers"):  # of the theme's search
        shutil.rmtree(assets / "javascripts" / folder, ignore_errors=True)


def write_grammar() -> str:
    """Return the guide to linkage files from its complete example of a file to the end."""
    text = GUIDE.read_text(encoding="utf-8")
    return text[text.index(START) :]


def write_commands(page: str) -> str:
    """Return `page`, which has examples of commands, with summary and help of each verb."""
    os.environ["COLUMNS"] = "100"  # width of the help
    # `rest` has the names of verbs and their examples in turn
    start, *rest = re.split(r"^## ([\w-]+)\n", page, flags=re.MULTILINE)
    lines = [start]
    for name, example in zip(rest[::2], rest[1::2], strict=True):
        parser, summary = argparse.ArgumentParser(prog=f"gauss-bench {name}"), VERBS[name]["help"]
        add_options(parser, VERBS[name])
        lines += [f"## {name}", "", f"{summary[0].upper()}{summary[1:]}.", example]
        lines += ["```text", parser.format_help().rstrip(), "```", ""]
    return "\n".join(lines)


def write_formats() -> str:
    """Return the Markdown of a table of all JSON Schemas, with links to their files."""
    rows = [f"| [{name}](formats/{name}.json) | {meaning} |" for name, meaning in list_formats().items()]
    return "\n".join(["| schema | content |", "| --- | --- |", *rows, ""])
