"""Parse the text of a linkage file into tables, and write changed tables back into the text.

Edits change plain dictionaries. Only differences are written into the text, so that a file keeps its comments, order and spelling.
"""

import re
import tomllib
from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.container import OutOfOrderTableProxy
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Table

from gauss_bench.exchange.toml import GROUPS, toml, write_value
from gauss_bench.linkage.limits import limit_faults
from gauss_bench.linkage.load import MAX_BYTES
from gauss_bench.linkage.schema import SECOND
from gauss_bench.studio.messages import Refused
from gauss_bench.untrusted import parse_toml

Document = dict[str, Any]

# the order of tables in a text that is written anew; GROUPS[:5] ends with "constraints"
ORDER = ("ground", *GROUPS[:5], "assembly", "observe", "measure", *GROUPS[5:])
# the text of a new drawing
EMPTY = f"""\
format = "{SECOND}"
name = "drawing"
gravity = [0.0, -9.81]

"""


def split_path(path: str) -> list[str | int]:
    """Split a path into keys and indices of lists: "links.bar.points[2]" into ["links", "bar", "points", 2]."""
    return [int(x[1:-1]) if x[0] == "[" else x for x in re.findall(r"\[\d+\]|[^.\[\]]+", path)]


def is_driven(scenario: Mapping[str, Any]) -> bool:
    """Tell whether the table of a scenario has drivers."""
    return not scenario.keys().isdisjoint(("driver", "drivers"))


def parse_text(text: str) -> Document:
    """Return the tables of a text; refuse a text that is no TOML, or exceeds a limit of linkage files."""
    if len(text.encode("utf-8", "replace")) > MAX_BYTES:
        raise Refused(f"larger than {MAX_BYTES} bytes; not a linkage file")
    try:
        document = parse_toml(text)
    except ValueError as error:
        raise Refused(f"not TOML: {str(error)[:200]}") from error
    faults = limit_faults(document)
    if faults:
        raise Refused(f"not a linkage file: {'; '.join(str(x) for x in faults[:3])}")
    return document


def write_document(text: str, document: Document) -> str:
    """Return `text` changed so that it holds the tables `document`; unchanged parts keep their spelling."""
    try:
        parsed = tomlkit.parse(text)
        _change(parsed, tomllib.loads(text), document, ())
        changed = tomlkit.dumps(parsed)
        if tomllib.loads(changed) == document:
            return changed
    except (TOMLKitError, ValueError, KeyError, TypeError, AttributeError, IndexError):
        pass  # tomlkit cannot change some spellings of tables in place: the whole text is written anew
    return toml({key: document[key] for key in sorted(document, key=_rank)}, ())


def _change(parsed: Any, old: Mapping[str, Any], new: Mapping[str, Any], path: tuple[str, ...]) -> None:
    """Change the table of tomlkit at the keys `path` from the content `old` to the content `new`."""
    removed, added = [k for k in old if k not in new], [k for k in new if k not in old]
    if len(removed) == len(added) == 1:
        old_key, new_key = removed[0], added[0]
        # a table that disappears where another one appears was renamed: rename it in place, so that it keeps its comments
        if isinstance(old[old_key], dict) and [*old].index(old_key) == [*new].index(new_key):
            _rename(parsed, old_key, new_key)
            old = {new_key if k == old_key else k: x for k, x in old.items()}
    for key in old:
        if key not in new:
            parsed.remove(key)
    for key in new if path else sorted(new, key=_rank):  # path: () at the top level, where values must stand before tables
        value = new[key]
        if key not in old:
            parsed.append(key, _as_item(value, (*path, key)))
        elif old[key] != value:
            has_heading = isinstance(parsed[key], (Table, OutOfOrderTableProxy))
            if isinstance(value, dict) and isinstance(old[key], dict) and has_heading:
                _change(parsed[key], old[key], value, (*path, key))
            else:
                parsed[key] = tomlkit.value(write_value(value))


def _rank(key: str) -> int:
    """Return the position of a top-level key in ORDER; -1 for other keys, whose plain values must stand before any table."""
    return ORDER.index(key) if key in ORDER else -1


def _rename(parsed: Any, old: str, new: str) -> None:
    """Rename an entry of a table of tomlkit; all entries keep their positions and comments."""
    # tomlkit adds entries at the end: remove all entries and append them again in their order
    items = {key: parsed.item(key) if hasattr(parsed, "item") else parsed[key] for key in parsed}
    for key in items:
        parsed.remove(key)
    for key, item in items.items():
        parsed.append(new if key == old else key, item)


def _as_item(value: Any, path: tuple[str, ...]) -> Any:
    """Return a value as an item of tomlkit at a path of keys: a table gets a [heading] at the top level or in a table of GROUPS.

    Any other table, and `expect`, becomes an inline table.
    """
    has_heading = path != ("expect",) and (len(path) == 1 or (len(path) == 2 and path[0] in GROUPS))
    if not isinstance(value, dict) or not has_heading:
        return tomlkit.value(write_value(value))
    # parse a text with the table at its path, so that tomlkit knows the heading
    nested: Any = value
    for key in reversed(path):
        nested = {key: nested}
    item: Any = tomlkit.parse(toml(nested, ()) + "\n")
    for key in path:
        item = item[key]
    return item
