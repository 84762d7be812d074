"""What a result depends on, as digests: the physics of a linkage, the numbers of a mechanism, and the sources that computed.

A comment, a title or what is observed may change, a mass or a start may not. Which is which stands with every key in `schema.py`.
"""

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw

PACKAGE = Path(__file__).parents[1]
WORDS = {"title", "scenarios", "source", "sha256", "digest", "warnings", "apart"}  # of a mechanism: nothing is computed from these


def physics_digest(document: dict[str, Any], scenario: str) -> str:
    """SHA-256 of everything in a document, its scenario's override already merged, that the motion of the scenario follows from."""
    from gauss_bench.linkage.schema import SECOND, LinkageTable  # the grammar, which no other digest needs, is dear to import

    physics = _physics(LinkageTable.model_validate(document))
    chosen = physics.pop("scenarios")[scenario]
    acting = {name: physics["forces"][name] for name in chosen.get("forces", [])}
    physics |= {"forces": acting, "scenario": chosen}
    if document["format"] == SECOND:  # the first edition damps a shared pin between the neighbours in its list
        _mark_shared(physics, acting)
    return hashlib.sha256(json.dumps(physics, sort_keys=True).encode()).hexdigest()


def _mark_shared(physics: dict[str, Any], acting: dict[str, Any]) -> None:
    """Say of pins through several links how they are damped, where they are."""
    damped = [physics.get("joints", {}).get(f["joint"], {}) for f in acting.values() if f["type"] == "joint_damping"]
    if any(len(joint.get("at", ())) > 2 for joint in damped):
        physics["damping"] = "between every two links of a pin"


def _physics(item: Any) -> Any:
    """The given keys of a table's physics, at every depth; numbers as one decimal text, however they are written."""
    if hasattr(item, "model_fields_set"):  # a table of the grammar
        given = {type(item).model_fields[name].alias or name: getattr(item, name) for name in item.model_fields_set}
        return {key: _physics(value) for key, value in given.items() if key in item.physics}
    if isinstance(item, dict):
        return {key: _physics(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_physics(value) for value in item]
    if isinstance(item, float):
        return str(Decimal(repr(item)).normalize() + 0)
    return item


def source_digest(*rooms: str, without: Collection[str] = ()) -> str:
    """SHA-256 of the names and contents of all files of the package's rooms, at every depth; "" is the whole package.

    Raises:
        FileNotFoundError: a room has no files, so that nothing would tell its versions apart.
    """
    digest = hashlib.sha256()
    for room in rooms:
        files = [PACKAGE / room] if (PACKAGE / room).is_file() else sorted(x for x in (PACKAGE / room).rglob("*") if x.is_file())
        names = [x.relative_to(PACKAGE) for x in files]
        used = [x for x in names if "__pycache__" not in x.parts and not {*without} & {x.parts[0], x.name}]
        if not used:
            raise FileNotFoundError(f"{PACKAGE / room}: no sources there to tell one version from another")
        for name in used:
            digest.update(f"{name.as_posix()}\n".encode() + (PACKAGE / name).read_bytes())
    return digest.hexdigest()


def content_digest(*values: Any) -> str:
    """SHA-256 of all that values hold at every depth; of a mechanism, of what it computes with, changed in memory or not.

    Raises:
        TypeError: one of them holds something that does not tell what it is, as a function.
    """
    digest = hashlib.sha256()
    for part in _content(values):
        digest.update(part + b"\0")
    return digest.hexdigest()


def _content(x: Any) -> Iterator[bytes]:
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
