"""Numbers of a linkage file by their paths: `links.rod.mass`, `forces.motor.value`, `links.rod.points.P.y`, `links.rod.length`.

A path names tables and keys as the file does; an entry of a list is named by its place from 0, or x and y of a pair. One path names
no key of the file:

    links.NAME.length   the distance of the two points of the link's first bar [m]

Another length moves every named point of the link, and its `com` where that is given, along the bar: with P the first point of the
bar, u its direction and s = new length / old length,

    p' = P + s ((p - P) . u) u + what p has across the bar

What lies beside the bar stays as far beside it. A mass or an inertia that is given stays; what follows from `kg_per_m` or from the
bars follows.
"""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any

import numpy as np

from gauss_bench.linkage.build import resolve_points
from gauss_bench.sweep.errors import SweepError

Document = dict[str, Any]
AXES = {"x": 0, "y": 1}


def is_length(path: str) -> bool:
    """Tell whether a path is the length of a link."""
    parts = path.split(".")
    return len(parts) == 3 and parts[0] == "links" and parts[2] == "length"


def number_at(document: Document, path: str) -> float:
    """The number that a path names.

    Raises:
        SweepError: there is none.
    """
    if is_length(path):
        return _bar(document, path)[3]
    owner, key = _place(document, path)
    value = owner[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SweepError(f"--vary {path}: is no number of the file, but {type(value).__name__}")
    return float(value)


def numbers_of(document: Document) -> list[str]:
    """Every path that names a number, lengths of links first."""
    bars = [f"links.{name}.length" for name, link in document.get("links", {}).items() if link.get("bars")]
    return [*bars, *_numbers(document, "")]


def _numbers(item: Any, path: str) -> Iterator[str]:
    pairs = item.items() if isinstance(item, dict) else enumerate(item) if isinstance(item, list) else ()
    for key, value in pairs:
        where = f"{path}.{key}" if path else str(key)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            yield where
        yield from _numbers(value, where)


def change(document: Document, values: Mapping[str, float]) -> Document:
    """The document with other numbers at some paths, lengths last; what is not touched is shared."""
    made = dict(document)
    for head, *rest in {tuple(path.split(".")[:2]) for path in values}:  # what they touch becomes the document's own
        whole = made[head]
        shared = {key: x for key, x in whole.items() if key not in rest} if rest and isinstance(whole, dict) else {}
        own = deepcopy({key: x for key, x in whole.items() if key in rest} if shared else whole)
        made[head] = {key: shared.get(key, own.get(key)) for key in whole} if shared else own
    for path in sorted(values, key=is_length):
        if is_length(path):
            _stretch(made, path, values[path])
        else:
            owner, key = _place(made, path)
            owner[key] = values[path]
    return made


def _place(document: Document, path: str) -> tuple[Any, Any]:
    """The table or list that holds the number of a path, and its key there."""
    *way, last = path.split(".")
    item: Any = document
    try:
        for key in way:
            item = item[_key(item, key)]
        item[_key(item, last)]
    except (KeyError, IndexError, TypeError, ValueError):
        near = [x for x in numbers_of(document) if x.split(".")[:2] == path.split(".")[:2]] or numbers_of(document)
        raise SweepError(f"--vary {path}: the file has no such number; there are {', '.join(near[:12])}") from None
    return item, _key(item, last)


def _key(item: Any, key: str) -> Any:
    return (AXES[key] if key in AXES else int(key)) if isinstance(item, list) else key


def _bar(document: Document, path: str) -> tuple[dict[str, Any], dict[str, Any], str, float]:
    """Link, its points, the first one of its first bar, and length [m]."""
    name = path.split(".")[1]
    link = document.get("links", {}).get(name)
    if link is None:
        raise SweepError(f"--vary {path}: the file has no link {name!r}; there are {', '.join(document.get('links', {}))}")
    if not link.get("bars"):
        raise SweepError(f"--vary {path}: the link has no bars, and the length of a link is that of its first bar")
    points = resolve_points(link["points"])
    a, b = link["bars"][0]
    return link, points, a, float(np.hypot(*(points[b] - points[a])))


def _stretch(document: Document, path: str, length: float) -> None:
    link, points, first, old = _bar(document, path)
    origin, along = points[first], (points[link["bars"][0][1]] - points[first]) / old

    def moved(p: Any) -> list[float]:
        return (p + ((length / old - 1.0) * float((p - origin) @ along)) * along).tolist()  # type: ignore[no-any-return]

    link["points"] = {name: moved(p) for name, p in points.items()}
    if "com" in link:
        link["com"] = moved(np.asarray(link["com"], dtype=float))
