"""The text of a linkage file, and how it changes: edits are made to plain tables, and only what differs is written into the text.

So comments, order and spelling of an opened file stay, and whoever edits meets dictionaries and lists alone.
"""

import tomllib
from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Table

from gauss_bench.linkage.limits import limit_faults
from gauss_bench.linkage.load import MAX_BYTES
from gauss_bench.linkage.schema import SECOND
from gauss_bench.studio.errors import Refused
from gauss_bench.untrusted import parse_toml

Document = dict[str, Any]

GROUPS = ("links", "welds", "cylinders", "joints", "constraints", "forces", "scenarios")  # of tables with names
ORDER = ("ground", "links", "welds", "cylinders", "joints", "constraints", "assembly", "observe", "measure", "forces", "scenarios")
EMPTY = f"""\
format = "{SECOND}"
name = "drawing"
gravity = [0.0, -9.81]

"""


def parse_text(text: str) -> Document:
    """The tables of a text.

    Raises:
        Refused: it is no TOML, or larger than any linkage file is.
    """
    try:
        if len(text.encode("utf-8")) > MAX_BYTES:
            raise Refused(f"larger than {MAX_BYTES} bytes; not a linkage file")
    except UnicodeEncodeError as error:
        raise Refused("not TOML: it has half a character, which no file can hold") from error
    try:
        document = parse_toml(text)
    except ValueError as error:
        raise Refused(f"not TOML: {str(error)[:200]}") from error
    if beyond := limit_faults(document):
        raise Refused(f"not a linkage file: {'; '.join(str(x) for x in beyond[:3])}")
    return document


def write_document(text: str, document: Document) -> str:
    """The text with the tables of `document`: what is the same in both stays as it is written."""
    try:
        kept = tomlkit.parse(text)
        _change(kept, tomllib.loads(text), document, 0)
        changed = tomlkit.dumps(kept)
        if tomllib.loads(changed) == document:
            return changed
    except (TOMLKitError, ValueError, KeyError, TypeError, AttributeError, IndexError):
        pass  # a spelling of tables that cannot be changed in place: it is written anew below
    return tomlkit.dumps(_fresh(document, 0))


def _change(kept: Any, old: Mapping[str, Any], new: Mapping[str, Any], depth: int) -> None:
    """Make the tables of `kept`, which say `old`, say `new`."""
    gone, come = [k for k in old if k not in new], [k for k in new if k not in old]
    if len(gone) == len(come) == 1 and isinstance(old[gone[0]], dict) and [*old].index(gone[0]) == [*new].index(come[0]):
        _rename(kept, gone[0], come[0])
        old = {come[0] if k == gone[0] else k: x for k, x in old.items()}
    for key in old:
        if key not in new:
            kept.remove(key)
    for key in sorted(new, key=_rank) if depth == 0 else new:
        value = new[key]
        if key not in old:
            kept.append(key, _item(value, depth, key))
        elif old[key] != value:
            under_head = isinstance(kept[key], (Table, OutOfOrderTableProxy)) or hasattr(kept[key], "is_super_table")
            if isinstance(value, dict) and isinstance(old[key], dict) and under_head:
                _change(kept[key], old[key], value, depth + 1)
            else:
                kept[key] = _item(value, depth + 1, key)


def _rank(key: str) -> int:
    """The rank of a table in a file that is written here."""
    return ORDER.index(key) if key in ORDER else -1


def _rename(kept: Any, old: str, new: str) -> None:
    """Another name for an entry, in its place; comments go with the entries."""
    entries = [(new if key == old else key, kept.item(key) if hasattr(kept, "item") else kept[key]) for key in [*kept]]
    for key in [*kept]:
        kept.remove(key)
    for key, item in entries:
        kept.append(key, item)


def _item(value: Any, depth: int, key: str) -> Any:
    """A value for the text: tables with names under their own heads, all else on one line."""
    if not isinstance(value, dict):
        return tomlkit.item(_one_line(value))
    if depth == 0 and key in GROUPS:
        group = tomlkit.table(is_super_table=True)
        for name, entry in value.items():
            group.append(name, _item(entry, 1, name))
        return group
    if depth <= 1 and key != "expect":
        table = tomlkit.table()
        for name, entry in value.items():
            table.append(name, _one_line(entry))
        table.add(tomlkit.nl())
        return table
    return _one_line(value)


def _one_line(value: Any) -> Any:
    if isinstance(value, dict):
        table = tomlkit.inline_table()
        for key, x in value.items():
            table.append(key, _one_line(x))
        return table
    if isinstance(value, list):
        array = tomlkit.array()
        for x in value:
            array.append(_one_line(x))
        return array
    return value


def _fresh(document: Document, depth: int) -> Any:
    whole = tomlkit.document()
    plain = {k: x for k, x in document.items() if not isinstance(x, dict) or k == "expect"}
    for key in [*plain, *sorted(document.keys() - plain.keys(), key=_rank)]:
        whole.append(key, _item(document[key], depth, key))
    return whole
