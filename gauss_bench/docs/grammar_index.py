"""Write the page with the index of the grammar: every table and key of a linkage file, from the types in `linkage/schema.py`."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic_core import PydanticUndefined

from gauss_bench.linkage import schema

GUIDE = Path(__file__).parents[2] / "mechanisms" / "README.md"
TOP = "Top level"  # heading of the guide for the tables that no other heading names
KINDS = ("type", "law")  # keys whose value decides which other keys a table has


@dataclass
class Entry:
    """A table of the grammar.

    Attributes:
        table: the class that checks the table.
        places: the paths at which the table may be in a file, such as `links.*`; * is any name, [*] any entry of a list.
        edition: the first edition of the grammar that has the table.
    """

    table: type[schema.Table]
    places: list[str]
    edition: int

    @property
    def deciding_key(self) -> str:
        """The key whose value distinguishes this table from other tables at the same place; empty if there are none."""
        return next((key for key in KINDS if key in self.table.model_fields), "")

    @property
    def kinds(self) -> tuple[str, ...]:
        """The values that the deciding key may have in this table; none without such a key."""
        return get_args(self.table.model_fields[self.deciding_key].annotation) if self.deciding_key else ()

    @property
    def address(self) -> str:
        """The table's HTML anchor, such as `forces.torque`: its first path without `.*` and `[*]`, then the first of its kinds."""
        return ".".join(filter(None, (re.sub(r"\.\*|\[\*\]", "", self.places[0]), *self.kinds[:1])))


def list_entries() -> list[Entry]:
    """Return an entry for each table of a linkage file, before the entries of the tables inside it."""
    entries: dict[type[schema.Table], Entry] = {}
    _add_entry(entries, schema.LinkageTable, "", 1)
    return list(entries.values())


def _add_entry(entries: dict[type[schema.Table], Entry], table: type[schema.Table], place: str, edition: int) -> None:
    """Add the table at the path `place`, and all tables inside it, to `entries`.

    If the table has an entry already, the path is added to this entry, which keeps its edition. `edition` is the first edition of
    the grammar that has the table at this path.
    """
    entry = entries.setdefault(table, Entry(table, [], edition))
    if place in entry.places:
        return
    entry.places.append(place)
    for name, info in table.model_fields.items():
        key = schema.key_of(table, name)
        for inner_place, inner_table in inner_tables(info.annotation, join_path(place, key)):
            _add_entry(entries, inner_table, inner_place, edition_of(entry, key))


def join_path(place: str, key: str) -> str:
    """Return the path of a key in the table at the path `place`; `place` is empty for the top level of the file."""
    return f"{place}.{key}".removeprefix(".")


def edition_of(entry: Entry, key: str) -> int:
    """Return the first edition of the grammar that has a key."""
    return 2 if key in entry.table.second else entry.edition


def inner_tables(annotation: Any, place: str) -> Iterator[tuple[str, type[schema.Table]]]:
    """Yield (path, table class) for every table in the type annotation of the value at the path `place`."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, schema.Table):
        yield place, annotation
    elif origin is dict:
        yield from inner_tables(arguments[1], f"{place}.*")
    elif origin is list:
        yield from inner_tables(arguments[0], f"{place}[*]")
    elif origin is not Literal:
        # of Annotated the first argument is the type, of a union all arguments are types
        for part in arguments[:1] if origin is Annotated else arguments:
            yield from inner_tables(part, place)


def print_type(value: dict[str, Any], place: str) -> str:
    """Return the type of the value at the path `place` in words, such as "[number, number]", from its JSON Schema.

    A text that names a part of the linkage is printed as the kind of this part, such as "link"; the table `named` in `grammar.toml`
    gives the kind for each path. In paths `.*` is the value of any key of a table, `.~` the key itself, `[*]` any entry of a list.
    """
    named = schema.GRAMMAR["named"]
    alternatives = value.get("anyOf", value.get("oneOf", ()))
    if alternatives:  # without null, which stands for a key that is left out
        return " or ".join(dict.fromkeys(print_type(x, place) for x in alternatives if x != {"type": "null"}))
    if "$ref" in value:
        return "table"
    if "const" in value or "enum" in value:
        return " or ".join(f'`"{x}"`' for x in value.get("enum", [value.get("const")]))
    if value["type"] == "array":
        inner = print_type(value["items"], f"{place}[*]")
        is_pair = value.get("minItems") == value.get("maxItems") == 2
        return f"[{inner}, {inner}]" if is_pair else f"[{inner}, ...]"
    if value["type"] == "object":
        by_name = [*value.get("patternProperties", {}).values(), value.get("additionalProperties")]
        if by_name[0] is True:  # in JSON Schema this allows any value of a key
            return "table"
        return f"{named.get(f'{place}.~', 'name')} → {print_type(by_name[0], f'{place}.*')}"
    if value["type"] == "string":
        return str(named.get(place, "name" if "pattern" in value else "text"))
    bounds = [f" {sign} {value[x]:g}" for x, sign in (("exclusiveMinimum", ">"), ("minimum", ">=")) if x in value]
    return {"number": "number", "integer": "whole number"}[str(value["type"])] + "".join(bounds)


def print_default(default: Any) -> str:
    """Return the default of a key as code, "-" if it is empty, or "required" if there is none."""
    if default is PydanticUndefined:
        return "required"
    return "-" if default in (None, "", {}, []) or isinstance(default, schema.Table) else f"`{default}`"


def heading_of(place: str) -> str:
    """Return the heading of the guide that explains the table at a path, or the innermost table around it."""
    headings = {"": TOP}  # path of a table -> heading
    for heading in re.findall(r"^### (.+)$", GUIDE.read_text(encoding="utf-8"), re.MULTILINE):
        for name in re.findall(r"`([^`]+)`", heading):
            # a single capital, as in `links.L`, stands for any name
            headings[re.sub(r"\.[A-Z](?=\.|$)", ".*", name)] = heading
    # "" is the path of the whole file; with the dots, `links` does not enclose `links_other`
    enclosing = [outer for outer in headings if not outer or f"{place}.".startswith(f"{outer}.")]
    return headings[max(enclosing, key=len)]


def print_place(place: str) -> str:
    """Return a path as it is printed: NAME replaces * (any name), and [] replaces [*] (any entry of a list)."""
    return place.replace("[*]", "[]").replace("*", "NAME")


def describe_place(entry: Entry) -> str:
    """Return the heading of a table: all its paths, and the values of its key `type` or `law` if it has one."""
    words = " and ".join(f"`{print_place(x)}`" for x in entry.places if x) or "The file"
    return f"{words}, {entry.deciding_key} {', '.join(f'`{x}`' for x in entry.kinds)}" if entry.deciding_key else words


def describe_key(entry: Entry, key: str) -> str:
    """Return a key with its path, such as "links.NAME.mass", and its `type` or `law`."""
    kinds = f" ({entry.deciding_key} {', '.join(entry.kinds)})" if entry.deciding_key else ""
    return join_path(print_place(entry.places[0]), key) + kinds


def list_keys() -> Iterator[tuple[Entry, str, str]]:
    """Yield (table, key, anchor on the page) for every key of the grammar."""
    for entry in list_entries():
        for name in entry.table.model_fields:
            key = schema.key_of(entry.table, name)
            yield entry, key, join_path(entry.address, key)


def write_index() -> str:
    """Return the Markdown of the page: a table of keys, with anchors such as `links.mass`, for each table."""
    lines: list[str] = []
    for entry in list_entries():
        table, place = entry.table, entry.places[0]
        heading = heading_of(place)
        properties = table.model_json_schema()["properties"]
        lines += ["", f"## {describe_place(entry)} {{ #table.{entry.address or 'file'} }}", ""]
        anchor = re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())  # the anchor that MkDocs gives the heading
        lines += [f"Explained in [{heading.replace('`', '')}](grammar.md#{anchor}).", ""]
        lines += ["| key | type | unit | default | edition |", "| --- | --- | --- | --- | --- |"]
        for name, info in table.model_fields.items():
            key = schema.key_of(table, name)
            kind, unit, first = print_type(properties[key], join_path(place, key)), table.units.get(key, ""), edition_of(entry, key)
            cells = (f'<a id="{join_path(entry.address, key)}"></a>`{key}`', kind, unit, print_default(info.default), str(first))
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])
