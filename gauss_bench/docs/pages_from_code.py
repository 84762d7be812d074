"""Pages that follow from code: the grammar of linkage files, the commands, and the formats. MkDocs calls the functions `on_...`."""

import argparse
import json
import os
import shutil
from pathlib import Path
from typing import Any

from pydantic_core import PydanticUndefined

from gauss_bench.api.options import VERBS, add_options
from gauss_bench.linkage import schema
from gauss_bench.verbs.formats import find_schema, list_formats

GUIDE = Path(__file__).parents[2] / "mechanisms" / "README.md"
BEGINS = "## A complete example"


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the schemas, as files of the site."""
    from mkdocs.structure.files import File  # imported late: only a build of the site has mkdocs

    for name in list_formats():
        files.append(File.generated(config, f"formats/{name}.json", content=json.dumps(find_schema(name), indent=1)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the text of a page, followed by the part that is computed from code."""
    computed = {"grammar.md": write_grammar, "commands.md": write_commands, "formats.md": write_formats}.get(page.file.src_uri)
    return f"{markdown}\n{computed()}" if computed else markdown


def on_post_build(config: Any, **_: Any) -> None:
    """Remove files that no page uses: maps of sources, and the theme's search, which only works from a server."""
    scripts = Path(config["site_dir"]) / "assets"
    for path in scripts.rglob("*.map"):
        path.unlink()
    for folder in ("lunr", "workers"):
        shutil.rmtree(scripts / "javascripts" / folder, ignore_errors=True)


def write_grammar() -> str:
    """Return the guide from its complete example on, and every key of the schema with its default and edition."""
    text = GUIDE.read_text(encoding="utf-8")
    lines = ["## Every key", "", "| table | key | default | edition |", "| --- | --- | --- | --- |"]
    for name, table in list_tables().items():
        for field, info in table.model_fields.items():
            key, edition = info.alias or field, 2 if (info.alias or field) in table.second else 1
            lines.append(f"| {name} | `{key}` | {print_default(info.default)} | {edition} |")
    return "\n".join([text[text.index(BEGINS) :], *lines, ""])


def print_default(default: Any) -> str:
    """Return the default of a key as the table prints it; a dash for an empty one."""
    if default is PydanticUndefined:
        return "required"
    return "-" if default in (None, {}, []) or isinstance(default, schema.Table) else f"`{default}`"


def list_tables() -> dict[str, type[schema.Table]]:
    """Return the tables that a linkage file may have, by the name of their class in words."""
    classes = {n: x for n, x in vars(schema).items() if isinstance(x, type) and issubclass(x, schema.Table)}
    bases = {schema.Table, schema.AngledTable, schema.LinearTable, schema.VaryingTable, schema.DrivenTable}
    return {"".join(f" {c.lower()}" if c.isupper() else c for c in n).strip(): x for n, x in classes.items() if x not in bases}


def write_commands() -> str:
    """Return every verb with its help."""
    os.environ["COLUMNS"] = "100"
    lines = []
    for name, table in VERBS.items():
        verb, summary = argparse.ArgumentParser(prog=f"gauss-bench {name}"), table["help"]
        add_options(verb, table)
        lines += [f"## {name}", "", f"{summary[0].upper()}{summary[1:]}.", "", "```text", verb.format_help().rstrip(), "```", ""]
    return "\n".join(lines)


def write_formats() -> str:
    """Return a table of all schemas, with links to their files."""
    rows = [f"| [{name}](formats/{name}.json) | {meaning} |" for name, meaning in list_formats().items()]
    return "\n".join(["| schema | of |", "| --- | --- |", *rows, ""])
