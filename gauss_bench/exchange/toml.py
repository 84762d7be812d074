"""The document of a linkage as the text of its file."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from gauss_bench.exchange.text import python_comment, toml_string

TABLES = ("links", "joints", "forces", "scenarios")  # whose entries are tables of their own


def toml(document: Mapping[str, Any], head: Sequence[str]) -> str:
    """The text, with sentences at its head."""
    lines = [f"{key(name)} = {said(x)}" for name, x in document.items() if not isinstance(x, dict) or name == "expect"]
    for name, x in document.items():
        if name in TABLES:
            for entry, table in x.items():
                lines += ["", f"[{key(name)}.{key(entry)}]", *(f"{key(k)} = {said(v)}" for k, v in table.items())]
        elif isinstance(x, dict) and name != "expect":
            lines += ["", f"[{key(name)}]", *(f"{key(k)} = {said(v)}" for k, v in x.items())]
    return python_comment(head) + "\n".join(lines) + "\n"


def key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else toml_string(name)


def said(x: Any) -> str:
    """A value on one line."""
    match x:
        case bool():
            return str(x).lower()
        case str():
            return toml_string(x)
        case int() | float():
            return repr(x)
        case dict():
            return "{ " + ", ".join(f"{key(k)} = {said(v)}" for k, v in x.items()) + " }"
        case list():
            return "[" + ", ".join(map(said, x)) + "]"
    raise TypeError(f"a linkage file has no {type(x).__name__}")
