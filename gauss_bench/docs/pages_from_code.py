"""Pages that follow from code: the grammar of linkage files with the index of its keys, and the commands.

MkDocs calls the functions `on_...`.
"""

import argparse
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from gauss_bench.api.options import VERBS, add_options
from gauss_bench.docs.grammar_index import GUIDE, describe_key, list_keys, write_index

BEGINS = "## A complete example"
INDEX = "search/search_index.json"  # where the site's search page looks for the headings of the documentation
HEADINGS: list[dict[str, str]] = []


def on_pre_build(**_: Any) -> None:
    """Forget the headings of an earlier build."""
    HEADINGS.clear()


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the text of a page, followed by the part that is computed from code."""
    computed = {"grammar.md": write_grammar, "keys.md": write_index, "commands.md": write_commands}.get(page.file.src_uri)
    return f"{markdown}\n{computed()}" if computed else markdown


def on_page_content(html: str, page: Any, **_: Any) -> None:
    """Note the headings of a page for the search of the site; for the index of keys, each key."""
    page_name = page.title
    HEADINGS.append({"location": page.url, "title": page_name})
    if page.file.src_uri == "keys.md":
        found = [(f"#{address}", describe_key(entry, key)) for entry, key, address in list_keys()]
    else:
        found = [(heading.url, heading.title) for heading in flatten(page.toc)]
    HEADINGS.extend({"location": f"{page.url}{anchor}", "title": f"{page_name}: {words}"} for anchor, words in found)


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


def write_commands() -> str:
    """Return every verb with its help."""
    os.environ["COLUMNS"] = "100"
    lines = []
    for name, table in VERBS.items():
        verb, summary = argparse.ArgumentParser(prog=f"gauss-bench {name}"), table["help"]
        add_options(verb, table)
        lines += [f"## {name}", "", f"{summary[0].upper()}{summary[1:]}.", "", "```text", verb.format_help().rstrip(), "```", ""]
    return "\n".join(lines)
