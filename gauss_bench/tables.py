"""Every table of a run: read, written and joined by the schema in `tables.toml`, which says what each column is.

A row is a mapping from column to value: a text, a number or a flag as the schema says. A missing text is empty, a missing number
NaN, a missing flag None. Writing refuses what the schema does not know, so that no column appears by accident. Reading takes the
schema's columns and leaves alone what others may have added to a file. The folder of a run carries the format's number and the
schema itself in `tables.json`; a folder without it is of format 1 and is brought up to date while it is read (`migrate_rows`), one
of a later format is refused.

Timed columns lie apart, in files of the folder `times` with the same names, rounded to the digits that their spread supports: a
repeated run changes those files and, in all others, only the rows whose figures moved. Reading a table joins both parts. The place,
time and versions of a run are in `environment.json` alone.
"""

import csv
import io
import json
import math
import os
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from gauss_bench.untrusted import BadInput

FORMAT = 5
APART = 4  # the first format in which what a clock decides lies in files of its own
BASELINE_FORMAT = 3  # of the accuracy gate's baseline, which tells its own
TIMES = "times"  # the folder of what a clock decides
SCHEMA_FILE = "tables.json"
ENVIRONMENT = "environment.json"  # where, when and with what a run was made
DIGITS = 10  # of a number in a CSV file: errors mean something in their first digits, and two runs differ where a number does
DRAWN = 4  # of a curve, whose values are kept to 13 bits
ENDS = ("", "_low", "_high")  # of the names of a value and its spread

Row = Mapping[str, Any]


class TableError(BadInput, ValueError):
    """A file that cannot be read as the table it should be; the message names file and column."""


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        name: the heading in files.
        kind: what its values are.
        meaning: in words.
        unit: "" for texts, flags, counts and ratios.
        exact: whether a number keeps all its digits in a CSV file.
        timed: whether it depends on measured time: it is then stored apart, and rounded.
        added: whether files of this format may lack it, since it was added later; rows of such files miss it.
    """

    name: str
    kind: Literal["text", "number", "flag"]
    meaning: str
    unit: str = ""
    exact: bool = False
    timed: bool = False
    added: bool = False


@dataclass(frozen=True)
class Table:
    """A table: what a row is, and its columns; the first `keys` of them tell rows apart.

    Attributes:
        timed: whether measured time decides which rows there are: the whole table is then stored apart.
        curves: whether its numbers are points of curves, which are kept as exactly as they are drawn.
    """

    meaning: str
    columns: tuple[Column, ...]
    keys: int = 0
    suffix: Literal["csv", "parquet"] = "csv"
    timed: bool = False
    curves: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(c.name for c in self.columns)

    @property
    def parts(self) -> "dict[str, tuple[Column, ...]]":
        """The columns of its files, by the folder that each lies in: "" or `times`, the latter with the key and what is timed."""
        apart = tuple(c for c in self.columns if c.timed)
        if self.timed:
            return {TIMES: self.columns}
        plain = {"": tuple(c for c in self.columns if not c.timed)}
        return plain | {TIMES: (*self.key, *apart)} if apart else plain

    @property
    def key(self) -> tuple[Column, ...]:
        """Return the columns that distinguish rows."""
        return self.columns[: self.keys]


SCHEMA = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def read_columns(entries: Iterable[Any]) -> Iterator[Column]:
    """Read the columns that `tables.toml` declares: by group, alone, or with the ends of a spread."""
    for entry in entries:
        if isinstance(entry, str):
            yield from read_columns(SCHEMA["groups"][entry])
            continue
        (kind, name), *others = entry.items()
        facts = dict(others)
        if kind in SCHEMA["ends"]:
            meaning = facts.pop("meaning")
            for end, words in zip(ENDS, SCHEMA["ends"][kind], strict=True):
                yield Column(name + end, "number", meaning + words, **facts)
        else:
            yield Column(name, kind, **facts)


TABLES = {name: Table(**facts | {"columns": tuple(read_columns(facts["columns"]))}) for name, facts in SCHEMA["tables"].items()}
KEY = tuple(c.name for c in read_columns(["case"]))


def row_of(table: Table, values: Row) -> dict[str, Any]:
    """Return a row with every column of the table, each of its type.

    Raises:
        KeyError: a given column is not in the schema.
        TypeError, ValueError: a value is not of its column's type.
    """
    strange = values.keys() - set(table.names)
    if strange:
        raise KeyError(f"columns without a place in the schema: {', '.join(sorted(map(str, strange)))}")
    return {column.name: type_column(column, values.get(column.name)) for column in table.columns}


def type_column(column: Column, value: Any) -> Any:
    """Convert a value, or its text in a file, to its column's type."""
    missing = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
    if column.kind == "text":
        return "" if missing else str(value)
    if column.kind == "number":
        return math.nan if missing else float(value)
    words = {"": None, "true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}
    word = "" if missing else str(value).lower()
    if word not in words:
        raise ValueError(f"{value!r} is neither true nor false")
    return words[word]


def write_value(column: Column, value: Any, digits: int = DIGITS) -> str:
    """Return a typed value as text for a CSV file."""
    if column.kind == "number":
        return "" if math.isnan(value) else repr(value) if column.exact else f"{value:.{digits}g}"
    return "" if value is None else str(value)


def round_times(table: Table, row: Row) -> dict[str, Any]:
    """Return a typed row whose times and ratios keep the digits that their spread supports.

    A value and the ends of its spread are rounded to the power of ten that is not above a hundredth of that spread, but keep four
    digits, one more than reports print, so that nothing printed is rounded twice; four where no spread is known.
    """
    rounded = dict(row)
    for column in table.columns:
        x = row[column.name]
        if not column.timed or column.kind != "number" or not math.isfinite(x) or x == 0 or column.name.endswith(ENDS[1:]):
            continue
        names = [column.name + end for end in ENDS if column.name + end in row]
        wide = row[names[-1]] - row[names[1]] if len(names) == len(ENDS) else math.nan
        last = math.floor(math.log10(abs(x))) - 3
        if math.isfinite(wide) and wide > 0:
            last = min(last, math.floor(math.log10(wide / 100)))
        rounded |= {name: round(row[name], -last) for name in names}
    return rounded


def csv_text(columns: Sequence[Column], rows: Iterable[Row], digits: int = DIGITS) -> str:
    """Return typed rows as the text of a CSV file: a head, and one line for each row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([c.name for c in columns])
    writer.writerows([write_value(c, row[c.name], digits) for c in columns] for row in rows)
    return out.getvalue()


def write_table(name: str, rows: Iterable[Row], folder: Path) -> tuple[Path, ...]:
    """Write a table of the schema into a folder, in as many files and of such a kind as the schema says; each atomic.

    Two writings of the same rows are the same bytes. What an earlier format wrote of this table elsewhere is taken away.

    Raises:
        KeyError: there is no such table, or a row has a column that is not in the table.
        ValueError: two rows with times of their own have the same key.
    """
    table = TABLES[name]
    whole = [round_times(table, row_of(table, row)) for row in rows]
    clocked = [c for c in table.columns if c.timed]
    paths = {}
    for part, columns in table.parts.items():
        some = whole
        if part and not table.timed:
            some = [row for row in whole if any(write_value(c, row[c.name]) for c in clocked)]
            if len({key_of(table, row) for row in some}) < len(some):
                raise ValueError(f"table {name}: two rows with times have the same key")
            if not some:  # nothing was timed
                continue
        paths[folder / part / f"{name}.{table.suffix}"] = columns, some
    for path, (columns, some) in paths.items():
        if table.suffix == "csv":
            write_text(path, csv_text(columns, some))
        else:
            write_parquet(name, columns, some, path)
    for stale in files_of(name, folder):
        if stale not in paths and name != "baseline":
            stale.unlink()
    return tuple(paths)


def files_of(name: str, folder: Path) -> tuple[Path, ...]:
    """Return the files of a table in the folder of a run, of any format."""
    places = [folder / part / f"{name}.{kind}" for part in ("", TIMES) for kind in ("csv", "parquet")]
    return tuple(path for path in places if path.exists())


def key_of(table: Table, row: Row) -> tuple[str, ...]:
    """Return the key of a row: the texts of the columns that distinguish it from others."""
    return tuple(write_value(c, row[c.name]) for c in table.key)


def write_parquet(name: str, columns: Sequence[Column], rows: Sequence[Row], path: Path) -> None:
    """Typed rows as Parquet, with the format in its metadata; all digits are kept but those of curves."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = TABLES[name]
    kinds = {"text": pa.string(), "number": pa.float64(), "flag": pa.bool_()}
    measured = [c.name for c in columns if c.kind == "number" and c.name not in KEY]
    arrays = {}
    for c in columns:
        curve = table.curves and c.name in measured
        values = [pick_drawn(row[c.name]) if curve and c not in table.key else row[c.name] for row in rows]
        arrays[c.name] = pa.array(values, type=pa.float32() if curve else kinds[c.kind])
    content = pa.table(arrays).replace_schema_metadata({b"gauss_bench": json.dumps({"table": name, "format": FORMAT}).encode()})
    packed = {"compression": "zstd", "compression_level": 19, "use_dictionary": [n for n in arrays if n not in measured]}
    packed |= {"write_statistics": False}  # for readers that skip parts of large files; of a small one they are half
    atomically(path, lambda part: pq.write_table(content, part, use_byte_stream_split=measured, **packed))


def digits_of(name: str) -> int:
    """Digits of a table's numbers: curves are kept as they are drawn."""
    return DRAWN if TABLES[name].curves else DIGITS


def pick_drawn(x: float) -> float:
    """A value to 1.2e-4, as a binary fraction of 13 bits: a pen's width is 1e-3."""
    if not math.isfinite(x):
        return x
    mantissa, exponent = math.frexp(x)
    return math.ldexp(round(mantissa * 2**13), exponent - 13)


def write_schema(folder: Path) -> None:
    """Write what every column means, and the format of the tables beside it."""
    tables = {
        name: {
            "meaning": t.meaning,
            "keys": t.keys,
            "files": [str(Path(part) / f"{name}.{t.suffix}") for part in t.parts],
            "columns": [{k: x for k, x in asdict(c).items() if x} for c in t.columns],
        }
        for name, t in TABLES.items()
    }
    write_text(folder / SCHEMA_FILE, json.dumps({"format": FORMAT, "tables": tables}, indent=1) + "\n")


def read_environment(folder: Path) -> dict[str, Any]:
    """Read the provenance of the run in a folder; nothing where it has none.

    Raises:
        TableError: the file is damaged.
    """
    path = folder / ENVIRONMENT
    try:
        told = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except ValueError as error:
        raise TableError(f"{path}: no JSON: {error}") from error
    if not isinstance(told, dict):
        raise TableError(f"{path}: not an object")
    return told


def format_of(folder: Path) -> int:
    """The format of the tables in a folder; 1 where it does not say.

    Raises:
        TableError: it is a later one than is known here, or `tables.json` is damaged.
    """
    path = folder / SCHEMA_FILE
    if not path.exists():
        return 1
    try:
        version = json.loads(path.read_text(encoding="utf-8"))["format"]
        if not isinstance(version, int) or isinstance(version, bool) or version < 1:
            raise ValueError(f"{version!r} is no format")
    except (ValueError, KeyError, TypeError) as error:
        raise TableError(f"{path}: does not tell the format of the tables beside it: {error}") from error
    return check(version, path)


def check(version: int, path: Path) -> int:
    """A format that can be read.

    Raises:
        TableError: it is later than FORMAT.
    """
    if version > FORMAT:
        raise TableError(f"{path}: format {version} is later than this version of gauss-bench can read, which is {FORMAT}")
    return version


def read_table(name: str, folder: Path) -> tuple[dict[str, Any], ...]:
    """Rows of a table in the folder of a run, typed, in the order of the file; none where there is no such file.

    Raises:
        TableError: a file is damaged, lacks a column, holds a value of the wrong type, is of a later format, or has times
            of a row that does not exist.
    """
    version, table = format_of(folder), TABLES[name]
    if name == "baseline":
        path = folder / "baseline.csv"
        return read_file(name, path) if path.exists() else ()
    if version < APART:
        old = files_of(name, folder)
        return read_file(name, old[0], version) if old else ()
    paths = {folder / part / f"{name}.{table.suffix}": columns for part, columns in table.parts.items()}
    parts = [read_file(name, path, version, columns) if path.exists() else () for path, columns in paths.items()]
    if len(parts) == 1:
        return parts[0]
    rows, times = parts
    timed = [c.name for c in table.columns if c.timed]
    clocked = {key_of(table, row): {n: row[n] for n in timed} for row in times}
    strange = clocked.keys() - {key_of(table, row) for row in rows}
    if strange or len(clocked) < len(times):
        which = " ".join(x for x in min(strange, default=key_of(table, times[0])) if x)
        raise TableError(f"{[*paths][1]}: a row of times has no row of its own in the table beside it: {which}")
    return tuple(row | clocked.get(key_of(table, row), {}) for row in rows)


def read_file(
    name: str, path: Path, form: int | None = None, columns: Sequence[Column] | None = None
) -> tuple[dict[str, Any], ...]:
    """Rows of a table in a file of the given format, or of the one that its own column `format` tells.

    Args:
        columns: that lie in this file; all of the table, if not given. What it does not hold is missing in every row.

    Raises:
        TableError: as `read_table`.
    """
    table = TABLES[name]
    head, lines = read_lines(path)
    if not head:  # a table without rows has its columns
        raise TableError(f"{path}: table {name}: is empty, without the names of its columns; it was cut off or never written")
    if form is None:
        try:
            form = max((int(float(line.get("format", 1))) for line in lines), default=FORMAT if "format" in head else 1)
        except (TypeError, ValueError) as error:
            raise TableError(f"{path}: column 'format': {error}") from error
        check(form, path)
    if form < FORMAT:
        head, lines = [SCHEMA["renamed"].get(x, x) for x in head], [migrate_row(table, name, line, form) for line in lines]
    wanted = [c for c in columns or table.columns if not c.added] if form == FORMAT else table.columns[:1]
    for column in wanted:
        if column.name not in head:
            raise TableError(f"{path}: table {name}: column {column.name!r} is missing")
    rows = []
    for count, line in enumerate(lines, 1):
        row = {}
        for column in table.columns:
            try:
                row[column.name] = type_column(column, line.get(column.name))
            except (TypeError, ValueError) as error:
                raise TableError(f"{path}: table {name}, row {count}, column {column.name!r}: {error}") from error
        rows.append(row)
    return tuple(rows)


def migrate_row(table: Table, name: str, line: dict[str, Any], form: int) -> dict[str, Any]:
    """Read a line of an older format under today's names; columns that it lacks are missing."""
    names = SCHEMA["renamed"]
    fresh = {names.get(k, k): x for k, x in line.items()}
    stale: tuple[str, ...] = ()
    if name == "results" and form < 3:  # whose builds did not include the first step before format 3
        stale = ("build_time",)
        if form == 1 and fresh.get("stabilization") not in ("none", ""):  # given the times of steps without stabilisation
            stale += ("step_", "native_step_")
    if name == "samples":  # which were of a single process before format 5
        fresh = {"process": 0} | fresh
    if name == "baseline":  # whose rows tell of columns
        fresh["metric"] = names.get(fresh.get("metric", ""), fresh.get("metric", ""))
    if "measured" in table.names:
        fresh = SCHEMA["always"] | fresh
    return {k: x for k, x in fresh.items() if not (stale and k.startswith(stale))}


def migrate(folder: Path) -> tuple[Path, ...]:
    """Bring every table of a run's folder, and a baseline beside them, to today's format in its place; the files written.

    Nothing is written before all can be read. Texts stay as they are, dates and reasons of a baseline among them; times keep what
    their spread supports. What an older format wrote twice or elsewhere is taken away.

    Raises:
        TableError: as `read_table`.
    """
    read = {name: read_table(name, folder) for name in TABLES if files_of(name, folder)}
    files: list[Path] = []
    for name, rows in read.items():
        fresh = [row | {"format": BASELINE_FORMAT} for row in rows] if name == "baseline" else rows
        files += write_table(name, fresh, folder)
    if read.keys() - {"baseline"}:
        write_schema(folder)
    return tuple(files)


def read_lines(path: Path) -> tuple[list[str], list[dict[str, Any]]]:
    """The head and the lines of a CSV or Parquet file, as they are written."""
    if path.suffix == ".csv":
        try:
            with path.open(encoding="utf-8", newline="") as file:
                reader = csv.DictReader(file, strict=True)
                lines = [{k: x for k, x in line.items() if k is not None} for line in reader]
                return list(reader.fieldnames or []), lines
        except (csv.Error, UnicodeDecodeError) as error:
            raise TableError(f"{path}: no CSV file: {error}") from error
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        content = pq.read_table(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise TableError(f"{path}: no Parquet file: {error}") from error
    return content.column_names, content.to_pylist()


def atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file beside `path`, then put it in place in one move."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(part)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def refuse_foreign(signs: Mapping[Path, str]) -> None:
    """Refuse to overwrite a file that gauss-bench did not write, that is, one without the given sign.

    Raises:
        FileExistsError: a file is not gauss-bench's; the message names it.
    """
    for path, sign in signs.items():
        if path.exists() and sign not in path.read_text(encoding="utf-8", errors="replace"):
            raise FileExistsError(f"{path}: is there already, and gauss-bench did not write it; move it or take another folder")


def write_text(path: Path, content: str) -> None:
    atomically(path, lambda part: part.write_text(content, encoding="utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    atomically(path, lambda part: part.write_bytes(content))
