"""Checksums of the tables of a run: they show if a row was changed after the run.

The file `checksums.json` in the folder of a run maps each table's file to the SHA-256 of its bytes. A run of an older version has
no such file, and its tables are read without this check. A run is cited by the SHA-256 of the list of all its checksums.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from gauss_bench.untrusted import BadInput, read_bytes

FILE = "checksums.json"
LARGEST = 1 << 20  # largest size of FILE [bytes]


class ChangedRows(BadInput, ValueError):
    """A table was changed after its run, or is missing; the message names its file."""


def read_checksums(folder: Path) -> dict[str, str]:
    """Return {path of a table relative to the folder: its checksum}; empty for a folder without checksums.

    Raises:
        ChangedRows: the list of checksums is damaged.
    """
    path = folder / FILE
    try:
        listed = json.loads(read_bytes(path, LARGEST))
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise ChangedRows(f"{path}: no JSON: {error}") from error
    if not (isinstance(listed, dict) and all(isinstance(x, str) for x in listed.values())):
        raise ChangedRows(f"{path}: not a JSON object whose values are texts")
    return listed


def with_files(folder: Path, paths: Iterable[Path]) -> str:
    """Return the text of `checksums.json` with new checksums of the files `paths`, and without files that no longer exist."""
    renewed = read_checksums(folder) | {str(path.relative_to(folder)): checksum_of(path) for path in paths}
    existing = {name: x for name, x in sorted(renewed.items()) if (folder / name).is_file()}
    return json.dumps(existing, indent=1) + "\n"


def require_unchanged(folder: Path) -> None:
    """Check that the tables of a run are unchanged since they were written.

    Raises:
        ChangedRows: a table was changed or is missing, or the list is damaged.
    """
    for name, checksum in read_checksums(folder).items():
        path = folder / name
        if not path.is_file():
            raise ChangedRows(f"{path}: is missing, although {FILE} lists it")
        if checksum_of(path) != checksum:
            raise ChangedRows(f"{path}: a row was changed after the run: its checksum is not the one in {FILE}; run it again")


def checksum_of(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def checksum_of_run(checksums: Mapping[str, str]) -> str:
    """Return the SHA-256 of the lines "CHECKSUM  FILE", sorted by file, as `sha256sum` prints them."""
    lines = [f"{checksum}  {name}\n" for name, checksum in sorted(checksums.items())]
    return hashlib.sha256("".join(lines).encode()).hexdigest()
