"""Compute digests of everything that determines a result: the numbers of a mechanism, and the source files of the package."""

import hashlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.motion_laws import MotionLaw

PACKAGE = Path(__file__).parents[1]
# fields of a mechanism that do not affect its motion
NO_EFFECT = {"title", "scenarios", "source", "sha256", "digest", "warnings", "apart"}


def source_digest(*folders: str, without: Collection[str] = ()) -> str:
    """Return the SHA-256 of the names and contents of files of the package, and of all files in its folders ("": the package).

    `without` has the names to leave out: of folders directly in the package, and of files in any folder.

    Raises:
        FileNotFoundError: a folder is missing or has no files.
    """
    digest = hashlib.sha256()
    for folder in folders:
        place = PACKAGE / folder
        files = [place] if place.is_file() else sorted(x for x in place.rglob("*") if x.is_file())
        names = [x.relative_to(PACKAGE) for x in files]
        used = [x for x in names if "__pycache__" not in x.parts and not {x.parts[0], x.name} & {*without}]
        if not used:  # without files the digest would be the same for all versions
            raise FileNotFoundError(f"{place}: no sources whose digest would identify a version")
        for name in used:
            digest.update(f"{name.as_posix()}\n".encode() + (PACKAGE / name).read_bytes())
    return digest.hexdigest()


def content_digest(*values: Any) -> str:
    """Return the SHA-256 of values and of everything nested in them, without the fields NO_EFFECT of a mechanism.

    Raises:
        TypeError: a value contains an object whose content cannot be read, such as a function.
    """
    digest = hashlib.sha256()
    for part in _content(values):
        digest.update(part + b"\0")
    return digest.hexdigest()


def _content(x: Any) -> Iterator[bytes]:
    """Yield the content of a value as bytes, with types and lengths, so that different values give different bytes."""
    match x:
        case None | bool() | int() | float() | complex() | str():
            yield repr(x).encode()
        case np.ndarray() | np.generic() if x.dtype != object:
            yield f"{x.dtype} {x.shape}".encode() + x.tobytes()
        case MotionLaw():  # name and numbers determine the function of a law
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
                if not (isinstance(x, Mechanism) and field.name in NO_EFFECT):
                    yield from _content(getattr(x, field.name))
        case _:
            raise TypeError(f"no digest of the content of {type(x).__name__}")
