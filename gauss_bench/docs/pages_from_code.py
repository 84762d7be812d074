"""Pages that follow from code: the grammar of linkage files, and the commands. MkDocs calls the functions `on_...`."""

import argparse
import os
import shutil
from pathlib import Path
from typing import Any

from pydantic_core import PydanticUndefined

from gauss_bench.api.options import VERBS, add_options
from gauss_bench.linkage import schema

GUIDE = Path(__file__).parents[2] / "mechanisms" / "README.md"
BEGINS = "## A complete example"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Add to a page's text the part that code says."""
    more = {"grammar.md": grammar, "commands.md": commands}.get(page.file.src_uri)
    return f"{markdown}\n{more()}" if more else markdown


def on_post_build(config: Any, **_: Any) -> None:
    """Takes out what no page uses: maps of sources, and the search, which works from a server alone."""
    scripts = Path(config["site_dir"]) / "assets"
    for path in scripts.rglob("*.map"):
        path.unlink()
    for folder in ("lunr", "workers"):
        shutil.rmtree(scripts / "javascripts" / folder, ignore_errors=True)


def grammar() -> str:
    """The guide from its complete example on, and every key of the schema with its default and edition."""
    text = GUIDE.read_text(encoding="utf-8")
    lines = ["## Every key", "", "| table | key | default | edition |", "| --- | --- | --- | --- |"]
    for name, table in tables().items():
        for field, info in table.model_fields.items():
            key = info.alias or field
            default = info.default
            told = "required" if default is PydanticUndefined else "-" if default in (None, {}, []) else f"`{default}`"
            if isinstance(default, schema.Table):
                told = "-"
            lines.append(f"| {name} | `{key}` | {told} | {2 if key in table.second else 1} |")
    return "\n".join([text[text.index(BEGINS) :], *lines, ""])


def tables() -> dict[str, type[schema.Table]]:
    """Every table of the grammar that a file may have, by the name of its class in words."""
    classes = {n: x for n, x in vars(schema).items() if isinstance(x, type) and issubclass(x, schema.Table)}
    bases = {schema.Table, schema.AngledTable, schema.LinearTable, schema.VaryingTable, schema.DrivenTable}
    return {"".join(f" {c.lower()}" if c.isupper() else c for c in n).strip(): x for n, x in classes.items() if x not in bases}


def commands() -> str:
    """Every verb with its help."""
    os.environ["COLUMNS"] = "100"
    lines = []
    for name, table in VERBS.items():
        verb, summary = argparse.ArgumentParser(prog=f"gauss-bench {name}"), table["help"]
        add_options(verb, table)
        lines += [f"## {name}", "", f"{summary[0].upper()}{summary[1:]}.", "", "```text", verb.format_help().rstrip(), "```", ""]
    return "\n".join(lines)
