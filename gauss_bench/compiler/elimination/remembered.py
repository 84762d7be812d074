"""The elimination that a search found cheapest, kept on disk: a later process eliminates once instead of some 140 times.

A choice is kept under the digest of everything that the search follows from: the mechanism's numbers, what was asked for, and the
sources. Mechanisms that hold something else than numbers, texts and tables of them are not remembered.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np

from gauss_bench.compiler import user_cache
from gauss_bench.compiler.elimination.formulations import Plan
from gauss_bench.compiler.elimination.lu import Search
from gauss_bench.mechanism.digest import source_digest
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw

ROOMS = ("mechanism", "compiler/expressions", "compiler/equations", "compiler/elimination")
WORDS = {"title", "scenarios", "source", "sha256", "digest", "warnings", "apart"}  # of a mechanism: nothing is computed from these


def name_of(mechanism: Mechanism, *asked: Any) -> str | None:
    """What the choice for a mechanism is kept under; None where it cannot be remembered."""
    digest = hashlib.sha256(_sources().encode())
    try:
        for part in _content((mechanism, asked)):
            digest.update(part + b"\0")
    except TypeError:
        return None
    return f"{digest.hexdigest()}.json"


def recall(name: str | None) -> tuple[Plan, Search] | None:
    """The choice kept under a name, or None."""
    kept = user_cache.load(name) if name else None
    if kept is None:
        return None
    plan, search = json.loads(kept)
    return Plan(plan["formulation"], tuple(plan["independent"]), plan["drop"]), Search(**search)


def remember(name: str | None, plan: Plan, search: Search) -> None:
    """Keep a choice, where there is a name and a place for it."""
    if name:
        user_cache.store(name, json.dumps([asdict(plan), asdict(search)]).encode())


@cache
def _sources() -> str:
    return source_digest(*ROOMS)


def _content(x: Any) -> Iterator[bytes]:
    """All that a value holds, at every depth, without a way to mistake one for another.

    Raises:
        TypeError: of a value that does not tell what it holds, as a function.
    """
    match x:
        case None | bool() | int() | float() | complex() | str():
            yield repr(x).encode()
        case np.ndarray() | np.generic() if x.dtype != object:
            yield f"{x.dtype} {x.shape}".encode() + x.tobytes()
        case MotionLaw():  # its function is made from these
            yield from _content((x.name, x.numbers))
        case Mapping():
            yield from _content([*x.items()])
        case tuple() | list():
            yield f"{len(x)} parts".encode()
            for part in x:
                yield from _content(part)
        case _ if is_dataclass(x):
            yield type(x).__name__.encode()
            for field in fields(x):
                if not (isinstance(x, Mechanism) and field.name in WORDS):
                    yield from _content(getattr(x, field.name))
        case _:
            raise TypeError(f"nothing is known of the content of {type(x).__name__}")
