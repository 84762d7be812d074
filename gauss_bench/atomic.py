"""Files that appear as a whole: each is written beside its place under another name, and moved there when it is complete."""

import os
import threading
from collections.abc import Callable
from pathlib import Path

PART = ".part"  # ending of files that are not complete; a killed process leaves one


def atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file beside `path`, then put it in place in one move; if `write` fails, nothing is left."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}{PART}")
    try:
        write(part)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: Path, content: str) -> None:
    """Write a text file atomically."""
    atomically(path, lambda part: part.write_text(content, encoding="utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    atomically(path, lambda part: part.write_bytes(content))
