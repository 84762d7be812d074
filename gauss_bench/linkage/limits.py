"""Limits on counts, magnitudes and characters of a linkage file; `limits.toml` lists each limit with its reason.

Limits are checked before anything else, in one pass without recursion, so that an oversized file is refused at once. Values in a
scenario's override have the limits of the values that they replace.
"""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from gauss_bench.linkage.errors import Fault
from gauss_bench.untrusted import DEEPEST, harmless, unprintable

LONGEST_KEY = 200  # [characters]
LONGEST_TEXT = 10_000  # [characters]
CHAINED = 100  # largest number of points in a chain in which each is given relative to the next
SHOWN = 50  # largest number of faults that `limit_faults` returns
MOST = 5000  # largest number of entries of a table or list whose name has no limit of its own
ENTRIES = 60_000  # largest number of entries of a file: the largest generated file, n_four_bar_400, has 17,000
SQUARES = "beyond that, a sum with it or with its square loses all digits of the other numbers"  # reason in messages


@dataclass(frozen=True)
class Range:
    """The range of a number: 0, or a magnitude between `least` and `most`, with the reason for the upper limit."""

    most: float
    reason: str = SQUARES
    least: float = 0.0


_bounds = tomllib.loads(Path(__file__).with_name("limits.toml").read_text(encoding="utf-8"))
COUNTS: dict[str, int] = _bounds["counts"]
RANGES = {key: Range(**{k: x for k, x in bound.items() if k != "keys"}) for bound in _bounds["ranges"] for key in bound["keys"]}
ANY = Range(1e15, least=1e-30)  # the range of numbers whose key has no range of its own


def limit_faults(document: Mapping[str, Any]) -> list[Fault]:
    """Return at most SHOWN faults of values that are too large, too small or not printable, else that of a too long chain.

    A table or list that has too many entries or is nested too deeply ends the search at once: its fault alone is returned.
    """
    faults: list[Fault] = []
    entries = 0
    # a loop: with recursion a deeply nested file could exceed Python's recursion limit
    waiting: list[tuple[str, str, Any, int]] = [("", "", document, 0)]  # path, nearest key that has limits, value, depth
    while waiting:
        path, key, item, depth = waiting.pop()
        if isinstance(item, str):
            faults += _text_faults(path, item)
        elif isinstance(item, (int, float, Decimal)) and not isinstance(item, bool):
            faults += _number_faults(path, key, item)
        elif isinstance(item, (dict, list)):
            entries += len(item)
            if depth > DEEPEST:
                return [Fault(".".join(path.split(".")[:4]), f"tables lie more than {DEEPEST} deep")]
            most = COUNTS.get(key, MOST)
            if len(item) > most:
                return [Fault(path, f"{len(item)} entries; at most {most} are read")]
            if entries > ENTRIES:
                return [Fault("", f"more than {ENTRIES} entries in all")]
            if isinstance(item, list):
                waiting += [(f"{path}[{i}]", key, x, depth + 1) for i, x in enumerate(item)]
                continue
            for name, x in item.items():
                if len(name) > LONGEST_KEY or any(map(unprintable, name)):
                    text = f"a key {_show(name)}: keys are printable and have at most {LONGEST_KEY} characters"
                    faults.append(Fault(path, text))
                    continue
                limited = name if name in RANGES or name in COUNTS else key  # else the limits of the table hold
                waiting.append((f"{path}.{name}" if path else name, limited, x, depth + 1))
    return sorted(faults[:SHOWN]) or list(_chain_faults(document))


def _text_faults(path: str, text: str) -> list[Fault]:
    """Return a list with the fault of a text that is too long or not printable; it is empty if there is none."""
    if len(text) > LONGEST_TEXT:
        return [Fault(path, f"a text of {len(text)} characters; at most {LONGEST_TEXT} are read")]
    if any(unprintable(x) for x in text):
        return [Fault(path, f"{_show(text)} contains characters that cannot be printed")]
    return []


def _number_faults(path: str, key: str, x: Any) -> list[Fault]:
    """Return a list with the fault of a number out of the range of its key; it is empty if there is none."""
    if x - x != 0:
        return []  # infinite or NaN: the grammar refuses it
    bound = RANGES.get(key, ANY)
    size = abs(x)
    if size > bound.most:
        return [Fault(path, f"{_describe(x)} is larger than {bound.most:g}: {bound.reason}")]
    if 0 < size < bound.least:
        return [Fault(path, f"{_describe(x)} is smaller than {bound.least:g}, and not 0: {SQUARES}")]
    return []


def _describe(x: Any) -> str:
    """Return a number as text; of a whole number above 10^15, which may be very long, return the number of its digits."""
    if isinstance(x, int) and abs(x) > 10**15:
        return f"a number of {x.bit_length() * 30103 // 100_000 + 1} digits"  # log10(2) = 0.30103
    return f"{x:g}"


def _chain_faults(document: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield a fault for the first point that begins a chain of more than CHAINED points, each given relative to the next.

    Circular references are found by `references.py`.
    """
    links = document.get("links")
    owners = {"ground": document.get("ground")}
    if isinstance(links, dict):
        owners |= {f"links.{key}": link for key, link in links.items()}
    for path, owner in owners.items():
        points = owner.get("points") if isinstance(owner, dict) else None
        if not isinstance(points, dict):
            continue
        for name in points:
            chain, closing = follow(points, name)
            if len(chain) > CHAINED and closing is None:
                yield Fault(f"{path}.points.{name}.from", f"follows from a chain of more than {CHAINED} points")
                return


def follow(points: Mapping[str, Any], name: Any) -> tuple[list[str], str | None]:
    """Follow the key `from` of unchecked `points` from the point `name` on.

    Return the visited points, `name` first, and the first point that would occur twice, or None if the chain ends.
    """
    chain: dict[str, None] = {}  # a set that keeps its order
    while isinstance(name, str) and name not in chain:
        chain[name] = None
        name = points[name].get("from") if isinstance(points.get(name), dict) else None
    return [*chain], name if isinstance(name, str) else None


def _show(text: str) -> str:
    """Return the beginning of an untrusted text, in quotes and without control characters."""
    return harmless(repr(text[:40])) + (" ..." if len(text) > 40 else "")
