"""Atomic writing: a file is written under another name in the same folder, and renamed when it is complete."""

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
PART = ".part"  # ending of incomplete files; only a killed process leaves one behind


def atomically(path: Path, write: Callable[[Path], T]) -> T:
    """Call `write` with a temporary path in the folder of `path`, rename that file to `path`, and return the result of `write`.

    If `write` fails, the temporary file is removed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}{PART}")
    try:
        result = write(part)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
        return result
    finally:
        part.unlink(missing_ok=True)


def write_text(path: Path, content: str) -> None:
    """Write a text file atomically."""
    atomically(path, lambda part: part.write_text(content, encoding="utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    atomically(path, lambda part: part.write_bytes(content))
