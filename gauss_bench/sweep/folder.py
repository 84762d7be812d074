"""The folder of a sweep: its arguments, the rows of each batch in a Parquet file of its own (a part), and the summary.

    plan.json:                         the arguments of the sweep; a later call with equal arguments continues the sweep
    samples/part-00000.parquet, ...:   the rows of each batch and engine, in the order of the sweep's plan
    summary.json, summary.svg:         the summary and its picture, written at the end

A part is written under another name, synced, and renamed, so that it is either complete or absent. If the part file of a batch
cannot be read, the batch is run again.
"""

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from gauss_bench.atomic import atomically, write_text
from gauss_bench.bench.journal import Busy
from gauss_bench.sweep.errors import SweepError
from gauss_bench.tables import refuse_foreign

PLAN, PARTS, PICTURE = "plan.json", "samples", "summary.svg"
SIGN = "<!-- drawn by gauss-bench sweep -->\n"  # last line of a picture that a sweep drew
TEXTS = ("engine", "status", "message")  # columns of texts; all other columns are numbers


class Folder:
    """A sweep's folder, which is locked inside a `with` statement.

    Attributes:
        stamp: plain data that determine all rows of the sweep's table.
        schema: columns of a part file: index of the sample, columns of texts, and columns of numbers with their units.
    """

    def __init__(self, path: Path, stamp: Mapping[str, Any], columns: Mapping[str, str]):
        """Set up the folder of a sweep; `with` makes and locks it. `columns`: name of a column of numbers -> its unit."""
        # through JSON and back, so that the stamp compares equal to one that is read from a file: tuples become lists
        self.path, self.stamp = path, json.loads(json.dumps(stamp))
        fields = [pa.field("sample", pa.int64(), nullable=False)]
        fields += [pa.field(name, pa.string(), nullable=False) for name in TEXTS]
        fields += [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in columns.items()]
        self.schema = pa.schema(fields)

    def __enter__(self) -> "Folder":
        """Check, make and lock the folder, and remove unfinished files of a killed sweep."""
        check(self.path, self.stamp)
        (self.path / PARTS).mkdir(parents=True, exist_ok=True)
        self.lock = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self.lock)
            raise Busy(f"{self.path}: another sweep is writing there") from error
        if not (self.path / PLAN).exists():
            write_text(self.path / PLAN, json.dumps(self.stamp, indent=1) + "\n")
        for unfinished in [*self.path.glob(".*.part"), *(self.path / PARTS).glob(".*.part")]:
            unfinished.unlink()  # left by a killed sweep: a running one would hold the lock
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Release the lock."""
        os.close(self.lock)

    def part(self, number: int) -> Path:
        """Return the path of the part file of the batch with this number."""
        return self.path / PARTS / f"part-{number:05d}.parquet"

    def has(self, number: int, rows: int) -> bool:
        """Tell whether a batch of this many rows is stored completely and without damage."""
        try:
            table = _read_part(self.part(number))
        except (OSError, pa.ArrowException):
            return False
        return bool(table.num_rows == rows and table.schema.equals(self.schema))

    def write(self, number: int, rows: Mapping[str, Any]) -> None:
        """Write the rows (name of a column -> values) of a batch; NaN is stored as a missing value."""
        columns = {name: pa.array(rows[name], from_pandas=True) for name in self.schema.names}
        table = pa.table(columns, schema=self.schema)
        atomically(self.part(number), lambda path: pq.write_table(table, path, write_page_checksum=True))

    def read(self) -> Any:
        """Return the rows of all stored batches as a pandas DataFrame, in the order of the samples in the sweep's plan."""
        files = sorted((self.path / PARTS).glob("part-*.parquet"))
        return pa.concat_tables([_read_part(x) for x in files]).to_pandas()


def _read_part(path: Path) -> Any:
    """Return a part file as a pyarrow table, with verified checksums."""
    # file by file, because pyarrow.dataset, which reads several files at once, takes long to import
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        return file.read()


def check(path: Path, stamp: Mapping[str, Any]) -> None:
    """Raise an error unless a folder is new, empty, or of a sweep with an equal `stamp` (the data that determine all rows).

    Raises:
        SweepError: the parent folder is missing, or the folder holds another sweep or something else.
        FileExistsError: the folder holds a picture that no sweep drew.
    """
    if not path.parent.is_dir():
        raise SweepError(f"--out {path}: there is no folder {path.parent}")
    if path.exists() and not path.is_dir():
        raise SweepError(f"--out {path}: is a file; a sweep takes a folder")
    content = {x.name for x in path.iterdir() if x.suffix != ".part"} if path.exists() else set()
    if not content:
        return
    if PLAN not in content:  # a sweep that was killed before it wrote its plan leaves an empty folder PARTS
        if content != {PARTS} or any((path / PARTS).iterdir()):
            raise SweepError(f"--out {path}: holds something other than a sweep; take an empty or a new folder")
        return
    try:
        stored = json.loads((path / PLAN).read_text(encoding="utf-8"))
    except ValueError:
        stored = None
    if not isinstance(stored, dict):
        raise SweepError(f"--out {path}: its {PLAN} cannot be read; take another folder")
    different = [key for key in dict.fromkeys([*stamp, *stored]) if stamp.get(key) != stored.get(key)]
    if different:
        changes = "; ".join(f"{key} was {_shorten(stored.get(key))}, is now {_shorten(stamp.get(key))}" for key in different)
        raise SweepError(f"--out {path}: holds another sweep ({changes}); take another folder, or the same arguments")
    refuse_foreign({path / PICTURE: SIGN})  # a picture that does not end in SIGN was drawn by another program


def _shorten(x: object) -> str:
    """Return a value as JSON, cut to 80 characters."""
    text = json.dumps(x)
    return text if len(text) < 80 else f"{text[:76]} ..."
