"""The journal: a file of the finished tasks of a run, from which a killed run is resumed.

Each finished task is one line, synced to disk, which ends with the checksum of its content. A line is used only if it matches its
checksum, and if code, linkage and libraries have not changed since. An incomplete last line is cut off before the next one is
written; a damaged line stays, is reported on stderr, and its task is run again.
"""

import fcntl
import hashlib
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from gauss_bench.bench.provenance import package_versions
from gauss_bench.linkage.digest import source_digest
from gauss_bench.untrusted import BadInput, harmless


class Busy(BadInput, RuntimeError):
    """Raised if another run writes to the same journal."""


def fingerprint() -> str:
    """Return a digest of the package's sources and data, and of the versions of its engines and libraries."""
    versions = json.dumps(package_versions(), sort_keys=True)
    sources = source_digest("", without=("report", "docs", "cli.py", "verbs", "_mechanisms"))  # linkages have digests of their own
    return hashlib.sha256(f"{versions} {sources}".encode()).hexdigest()[:16]


SUM, DIGITS = b', "sum": "', 16  # text before the checksum of a line, and length of the checksum


def line_of(entry: dict[str, Any]) -> bytes:
    """Return the data of one task as a line of the journal: JSON whose last key is the checksum of the other keys."""
    return _add_checksum(json.dumps(entry).encode())


def entry_of(line: bytes) -> dict[str, Any] | None:
    """Return the data of the task in a line of the journal, or None if the checksum does not agree."""
    content = line.rpartition(SUM)[0] + b"}"  # the JSON text without its last key, the checksum
    if line != _add_checksum(content):
        return None
    entry: dict[str, Any] = json.loads(content)
    return entry


def _add_checksum(content: bytes) -> bytes:
    """Return the text of a JSON object as a line, with the text's checksum as a last key."""
    # content[:-1]: without the closing brace
    return content[:-1] + SUM + hashlib.sha256(content).hexdigest()[:DIGITS].encode() + b'"}\n'


class Journal:
    """The journal of finished tasks: a file, which is locked while the journal is open.

    Raises:
        Busy: another run writes to the file.
        OSError: the folder cannot be written, or the disk is full; the lines already in the file stay.
    """

    def __init__(self, path: Path):
        self.path = path
        self.entries: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> "Journal":
        """Open and lock the file, read the finished tasks, and cut off an incomplete last line."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.file = self.path.open("a+b", buffering=0)
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self.file.close()
            raise Busy(f"{self.path}: another run is writing there") from error
        self.file.seek(0)
        content = self.file.read()
        *lines, torn = content.split(b"\n")
        self.file.truncate(len(content) - len(torn))
        entries = [entry_of(line + b"\n") for line in lines]
        self.entries = {entry["key"]: entry for entry in entries if entry}
        if damaged := entries.count(None):
            what = f"{damaged} of {len(lines)} lines are damaged; their tasks are run again"
            print(harmless(f"warning: {self.path}: {what}"), file=sys.stderr)
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def find(self, key: str, *stamps: str) -> dict[str, Any] | None:
        """Return the rows of a task (table -> rows) if the journal has the task with one of the given stamps, else None.

        A stamp is a digest of the code and data on which the rows depend.
        """
        entry = self.entries.get(key)
        return entry["tables"] if entry and entry["stamp"] in stamps else None

    def add(self, key: str, stamp: str, tables: dict[str, Any]) -> None:
        """Append a finished task (table -> rows), and return when it is on disk.

        Raises:
            OSError: the disk is full; the file stays as it was.
        """
        entry = {"key": key, "stamp": stamp, "tables": tables}
        line, end = memoryview(line_of(entry)), self.file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self.file.write(line) :]  # an unbuffered write may write only a part
            os.fsync(self.file.fileno())
        except OSError:
            with suppress(OSError):
                self.file.truncate(end)
            raise
        self.entries[key] = entry
