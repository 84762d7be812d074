"""Pages that follow from code: the grammar of linkage files with the index of its keys, the commands, and the formats.

MkDocs calls the functions `on_...`.
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

BEGINS = "## A complete example"
INDEX = "search/search_index.json"  # where the site's search page looks for the headings of the documentation
HEADINGS: list[dict[str, str]] = []


def on_pre_build(**_: Any) -> None:
    """Forget the headings of an earlier build."""
    HEADINGS.clear()


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the schemas, as files of the site."""
    from mkdocs.structure.files import File  # imported late: only a build of the site has mkdocs

    for name in list_formats():
        files.append(File.generated(config, f"formats/{name}.json", content=json.dumps(find_schema(name))))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the text of a page with the parts that are computed from code."""
    match page.file.src_uri:
        case "grammar.md":
            return f"{markdown}\n{write_grammar()}"
        case "keys.md":
            return f"{markdown}\n{write_index()}"
        case "commands.md":
            return write_commands(markdown)
        case "formats.md":
            return f"{markdown}\n{write_formats()}"
    return markdown


def on_page_content(html: str, page: Any, **_: Any) -> None:
    """Note the headings of a page for the search of the site; for the index of keys, each key; for the commands, each option."""
    page_name = page.title
    HEADINGS.append({"location": page.url, "title": page_name})
    found = [(heading.url, heading.title) for heading in flatten(page.toc)]
    if page.file.src_uri == "keys.md":
        found = [(f"#{address}", describe_key(entry, key)) for entry, key, address in list_keys()]
    elif page.file.src_uri == "commands.md":
        found += list_options()
    HEADINGS.extend({"location": f"{page.url}{anchor}", "title": f"{page_name}: {words}"} for anchor, words in found)


def list_options() -> list[tuple[str, str]]:
    """Return each option of each verb, with the address of the verb on the page of commands."""
    return [(f"#{verb}", f"{verb} {x}") for verb, given in VERBS.items() for x in given.get("options", {}) if x.startswith("-")]


def flatten(headings: Iterable[Any]) -> Iterator[Any]:
    """Yield headings of a page and all below them, except its title."""
    for heading in headings:
        if heading.level > 1:
            yield heading
        yield from flatten(heading.children)


def on_post_build(config: Any, **_: Any) -> None:
    """Write the headings that the site's search page lists, and remove files that no page uses.

    The theme's own search works only from a server, and finds nothing outside the documentation.
    """
    index = Path(config["site_dir"]) / INDEX
    index.parent.mkdir(exist_ok=True)
    index.write_text(json.dumps({"docs": HEADINGS}, ensure_ascii=False), encoding="utf-8")
    scripts = Path(config["site_dir"]) / "assets"
    for path in scripts.rglob("*.map"):
        path.unlink()
    for folder in ("lunr", "workers"):
        shutil.rmtree(scripts / "javascripts" / folder, ignore_errors=True)


def write_grammar() -> str:
    """Return the guide from its complete example on."""
    text = GUIDE.read_text(encoding="utf-8")
    return text[text.index(BEGINS) :]


def write_commands(page: str) -> str:
    """Return the page with the summary of each verb below its heading, and its help below its example."""
    os.environ["COLUMNS"] = "100"
    start, *rest = re.split(r"^## ([\w-]+)\n", page, flags=re.MULTILINE)
    lines = [start]
    for name, example in zip(rest[::2], rest[1::2], strict=True):
        verb, summary = argparse.ArgumentParser(prog=f"gauss-bench {name}"), VERBS[name]["help"]
        add_options(verb, VERBS[name])
        lines += [
            f"## {name}",
            "",
            f"{summary[0].upper()}{summary[1:]}.",
            example,
            "```text",
            verb.format_help().rstrip(),
            "```",
            "",
        ]
    return "\n".join(lines)


def write_formats() -> str:
    """Return a table of all schemas, with links to their files."""
    rows = [f"| [{name}](formats/{name}.json) | {meaning} |" for name, meaning in list_formats().items()]
    return "\n".join(["| schema | of |", "| --- | --- |", *rows, ""])
