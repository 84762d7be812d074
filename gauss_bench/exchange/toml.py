"""Write the document of a linkage, which consists of nested tables, as the TOML text of its file."""

import re
from collections.abc import Mapping, Sequence
from datetime import date, time
from typing import Any

from gauss_bench.exchange.text import python_comment, toml_string

GROUPS = ("links", "welds", "cylinders", "joints", "constraints", "forces", "scenarios")  # tables whose entries get [headings]


def toml(document: Mapping[str, Any], head: Sequence[str]) -> str:
    """Return the text of a document; the sentences `head` are comments at its beginning."""
    return python_comment(head) + "\n".join(_write_lines(document, ())) + "\n"


def _write_lines(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    """Return the lines of the table at a path of keys: its heading, its values, then the tables in it that have headings."""
    # tables of the whole document and of GROUPS get headings; tables deeper in the document, and `expect`, are written on one line
    gives_headings = not path or (len(path) == 1 and path[0] in GROUPS)
    values: list[str] = []
    headed: list[str] = []
    for name, entry in table.items():
        if gives_headings and isinstance(entry, dict) and name != "expect":
            headed += _write_lines(entry, (*path, name))
        else:
            values.append(f"{write_key(name)} = {write_value(entry)}")
    if path and (values or not headed):  # an empty table still gets its heading, so that it is in the file
        values = ["", f"[{'.'.join(map(write_key, path))}]", *values]
    return values + headed


def write_key(name: str) -> str:
    """Return a key of TOML, in quotes if it needs them."""
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else toml_string(name)


def write_value(x: Any) -> str:
    """Return a value as one line of TOML; TypeError is raised for a type that a linkage file cannot hold."""
    match x:
        case bool():
            return str(x).lower()
        case str():
            return toml_string(x)
        case int() | float():
            return repr(x)
        case date() | time():
            return x.isoformat()
        case dict():
            return "{ " + ", ".join(f"{write_key(k)} = {write_value(v)}" for k, v in x.items()) + " }"
        case list():
            return "[" + ", ".join(map(write_value, x)) + "]"
    raise TypeError(f"a linkage file has no {type(x).__name__}")
