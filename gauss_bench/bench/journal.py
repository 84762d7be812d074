"""Finished tasks, one line each, appended and synced: a killed run loses nothing and repeats nothing.

A line counts only if it is whole and was made by the same code, linkage and libraries; a torn last line is cut off before the next
one is written.
"""

import fcntl
import hashlib
import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any

from gauss_bench.bench.provenance import package_versions
from gauss_bench.mechanism.digest import source_digest


class Busy(RuntimeError):
    """Another run writes to the same journal."""


def fingerprint() -> str:
    """Digest of the package's sources and data, and of the versions of what computes."""
    versions = json.dumps(package_versions(), sort_keys=True)
    sources = source_digest("", without=("report", "docs", "cli.py", "_mechanisms"))  # linkages are known by digests of their own
    return hashlib.sha256(f"{versions} {sources}".encode()).hexdigest()[:16]


class Journal:
    """The lines of one file, locked while open."""

    def __init__(self, path: Path):
        self.path = path
        self.entries: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> "Journal":
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.file = self.path.open("a+b")
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self.file.close()
            raise Busy(f"{self.path}: another run is writing there") from error
        self._read()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.file.close()

    def _read(self) -> None:
        self.file.seek(0)
        whole = 0
        for line in self.file:
            if not line.endswith(b"\n"):
                break
            whole += len(line)
            entry = json.loads(line)
            self.entries[entry["key"]] = entry
        self.file.truncate(whole)

    def finished(self, key: str, stamp: str) -> dict[str, Any] | None:
        """The rows of a task, by table, if they were made under the same stamp."""
        entry = self.entries.get(key)
        return entry["tables"] if entry and entry["stamp"] == stamp else None

    def add(self, key: str, stamp: str, tables: dict[str, Any]) -> None:
        """Append one finished task and wait until it is on disk."""
        entry = {"key": key, "stamp": stamp, "tables": tables}
        self.file.write(json.dumps(entry).encode() + b"\n")
        self.file.flush()
        os.fsync(self.file.fileno())
        self.entries[key] = entry
