"""Atomic writing: a file is written under another name in the same folder, and renamed when it is complete."""

import os
import threading
from collections.abc import Callable
from pathlib import Path

PART = ".part"  # ending of incomplete files; only a killed process leaves one behind


def atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary path in the folder of `path`, then rename that file to `path`; if it fails, remove the file."""
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
