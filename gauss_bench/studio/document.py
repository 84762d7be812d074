"""The text of a linkage file and its tables.

Edits change plain dictionaries. Only their differences are written into the text, so that a file keeps its comments, order and
spelling.
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
from gauss_bench.studio.errors import Refused
from gauss_bench.untrusted import parse_toml

Document = dict[str, Any]

ORDER = ("ground", *GROUPS[:5], "assembly", "observe", "measure", *GROUPS[5:])  # of tables in a text that is written anew
EMPTY = f"""\
format = "{SECOND}"
name = "drawing"
gravity = [0.0, -9.81]

"""


def split_path(path: str) -> list[str | int]:
    """Split a path such as "links.bar.points[2]" into its keys: names, and indices of lists."""
    return [int(x[1:-1]) if x[0] == "[" else x for x in re.findall(r"\[\d+\]|[^.\[\]]+", path)]


def is_driven(scenario: Mapping[str, Any]) -> bool:
    """Tell whether the table of a scenario has drivers."""
    return not scenario.keys().isdisjoint(("driver", "drivers"))


def parse_text(text: str) -> Document:
    """Parse a text into tables.

    Raises:
        Refused: the text is not TOML, or larger than a linkage file may be.
    """
    if len(text.encode("utf-8", "replace")) > MAX_BYTES:
        raise Refused(f"larger than {MAX_BYTES} bytes; not a linkage file")
    try:
        document = parse_toml(text)
    except ValueError as error:
        raise Refused(f"not TOML: {str(error)[:200]}") from error
    if beyond := limit_faults(document):
        raise Refused(f"not a linkage file: {'; '.join(str(x) for x in beyond[:3])}")
    return document


def write_document(text: str, document: Document) -> str:
    """Return the text with the content of `document`; unchanged parts keep their spelling."""
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
    """Change a table of tomlkit, at `path`, from the content `old` to the content `new`."""
    removed, added = [k for k in old if k not in new], [k for k in new if k not in old]
    # one key removed and one added at the same position are a renamed table, which keeps its position and its comments
    if len(removed) == len(added) == 1 and isinstance(old[removed[0]], dict) and [*old].index(removed[0]) == [*new].index(added[0]):
        _rename(parsed, removed[0], added[0])
        old = {added[0] if k == removed[0] else k: x for k, x in old.items()}
    for key in old:
        if key not in new:
            parsed.remove(key)
    for key in new if path else sorted(new, key=_rank):
        value = new[key]
        if key not in old:
            parsed.append(key, _item(value, (*path, key)))
        elif old[key] != value:
            has_heading = isinstance(parsed[key], (Table, OutOfOrderTableProxy)) or hasattr(parsed[key], "is_super_table")
            if isinstance(value, dict) and isinstance(old[key], dict) and has_heading:
                _change(parsed[key], old[key], value, (*path, key))
            else:
                parsed[key] = tomlkit.value(write_value(value))


def _rank(key: str) -> int:
    """Return the position of a table in a file that is written anew."""
    return ORDER.index(key) if key in ORDER else -1


def _rename(parsed: Any, old: str, new: str) -> None:
    """Rename an entry of a table of tomlkit; it keeps its position, and comments stay with their entries."""
    items = {key: parsed.item(key) if hasattr(parsed, "item") else parsed[key] for key in parsed}
    for key in items:
        parsed.remove(key)
    for key, item in items.items():
        parsed.append(new if key == old else key, item)


def _item(value: Any, path: tuple[str, ...]) -> Any:
    """Return a value as tomlkit writes it at a path: tables of the file and of its groups have [headings], others are inline."""
    if not isinstance(value, dict) or len(path) > 2 - (path[0] not in GROUPS) or path == ("expect",):
        return tomlkit.value(write_value(value))
    nested: Any = value
    for key in reversed(path):
        nested = {key: nested}
    item: Any = tomlkit.parse(toml(nested, ()) + "\n")
    for key in path:
        item = item[key]
    return item
