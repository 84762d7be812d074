"""Numbers of a linkage file by their paths: `links.rod.mass`, `forces.motor.value`, `links.rod.points.P.y`, `links.rod.length`.

A path consists of names of tables and keys. A zero-based index selects an entry of a list, and x and y select the entries of a
pair. One path is not a key of the file:

    links.NAME.length:   the distance between the two points of the link's first bar [m]

A change of this length moves every named point of the link along the bar, and also the link's `com` if the file gives it. Let P be
the first point of the bar, u the unit vector along the bar, p a point of the link, p_n the component of p - P across the bar, and
s = new length / old length. The point p moves to

    p' = P + s ((p - P) . u) u + p_n.

A mass or inertia that the file gives does not change. A mass or inertia that is computed from `kg_per_m` or from the bars changes
with the length.
"""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.linkage.build import resolve_points
from gauss_bench.sweep.errors import SweepError

Document = dict[str, Any]
AXES = {"x": 0, "y": 1}


def is_length(path: str) -> bool:
    """Tell whether a path names the length of a link: links.NAME.length."""
    parts = path.split(".")
    return len(parts) == 3 and parts[0] == "links" and parts[2] == "length"


def number_at(document: Document, path: str) -> float:
    """Return the number of a document at a path; at the path of a length, the length of the bar [m].

    Raises:
        SweepError: the document has no number at this path.
    """
    if is_length(path):
        return _bar(document, path).length
    owner, key = _find(document, path)
    value = owner[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SweepError(f"--vary {path}: is not a number, but {type(value).__name__}")
    return float(value)


def numbers_of(document: Document) -> list[str]:
    """Return the paths of all numbers of a document, the paths of lengths first."""
    bars = [f"links.{name}.length" for name, link in document.get("links", {}).items() if link.get("bars")]
    return [*bars, *_numbers(document, "")]


def _numbers(item: Any, path: str) -> Iterator[str]:
    """Yield the paths of all numbers in the table or list `item`, whose own path is `path`."""
    entries: Any = item.items() if isinstance(item, dict) else enumerate(item)
    for key, value in entries:
        inner_path = f"{path}.{key}" if path else str(key)
        if isinstance(value, (dict, list)):
            yield from _numbers(value, inner_path)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            yield inner_path


def change(document: Document, values: Mapping[str, float]) -> Document:
    """Return a copy of a document with the numbers `values` (path -> number); tables that do not change are not copied.

    Changes of lengths are made last, because they move points whose coordinates other paths may have changed.
    """
    changed = dict(document)
    for head, *rest in {tuple(path.split(".")[:2]) for path in values}:
        top = changed[head]  # such as the table `links`
        if rest and isinstance(top, dict):  # copy only the entry that changes, such as one link
            changed[head] = {key: deepcopy(x) if key in rest else x for key, x in top.items()}
        else:
            changed[head] = deepcopy(top)
    for path in sorted(values, key=is_length):
        if is_length(path):
            _stretch(changed, path, values[path])
        else:
            owner, key = _find(changed, path)
            owner[key] = values[path]
    return changed


def _find(document: Document, path: str) -> tuple[Any, Any]:
    """Return the table or list that contains the number at a path, and the number's key or index in it.

    Raises:
        SweepError: the document has no entry at this path; the message lists paths that hold numbers.
    """
    *keys, last = path.split(".")
    item: Any = document
    try:
        for key in keys:
            item = item[_key(item, key)]
        item[_key(item, last)]
    except (KeyError, IndexError, TypeError, ValueError):
        in_same_table = [x for x in numbers_of(document) if x.split(".")[:2] == path.split(".")[:2]]
        offered = (in_same_table or numbers_of(document))[:12]
        raise SweepError(f"--vary {path}: the file has no such number; there are {', '.join(offered)}") from None
    return item, _key(item, last)


def _key(item: Any, key: str) -> Any:
    """Return the index in the list `item`, or the key in the table `item`, for one word of a path; x and y stand for 0 and 1."""
    if not isinstance(item, list):
        return key
    return AXES[key] if key in AXES else int(key)


@dataclass(frozen=True)
class Bar:
    """The first bar of a link.

    Attributes:
        link: the link's table in the document.
        points: name of a point of the link -> its coordinates (2,) [m].
        ends: names of the points at the bar's ends.
        length: length of the bar [m].
    """

    link: dict[str, Any]
    points: dict[str, Any]
    ends: tuple[str, str]
    length: float


def _bar(document: Document, path: str) -> Bar:
    """Return the bar whose length has a path links.NAME.length.

    Raises:
        SweepError: there is no such link, or it has no bars.
    """
    name = path.split(".")[1]
    link = document.get("links", {}).get(name)
    if link is None:
        raise SweepError(f"--vary {path}: the file has no link {name!r}; there are {', '.join(document.get('links', {}))}")
    if not link.get("bars"):
        raise SweepError(f"--vary {path}: the link has no bars, and the length of a link is that of its first bar")
    points = resolve_points(link["points"])
    a, b = link["bars"][0]
    return Bar(link, points, (a, b), float(np.hypot(*(points[b] - points[a]))))


def _stretch(document: Document, path: str, length: float) -> None:
    """Give the first bar of a link another length [m], as described at the top of this file; the bar's first point stays."""
    bar = _bar(document, path)
    origin, end = (bar.points[x] for x in bar.ends)
    along = (end - origin) / bar.length

    def move(p: Any) -> list[float]:
        """Return the new position of a point (2,) [m] of the link."""
        shift = (length / bar.length - 1.0) * float((p - origin) @ along)  # along the bar [m]
        return (p + shift * along).tolist()  # type: ignore[no-any-return]

    bar.link["points"] = {name: move(p) for name, p in bar.points.items()}
    if "com" in bar.link:
        bar.link["com"] = move(np.asarray(bar.link["com"], dtype=float))
