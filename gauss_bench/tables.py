"""Read and write the tables of a run by the schema in `tables.toml`, which describes each column.

A row maps column to value: a text, a number or a flag. A missing text is empty, a missing number NaN, a missing flag None. Writing
refuses a column that the schema does not have; reading ignores it. `tables.json` states the number of the format; a folder without
it is of format 1. Rows of older formats are converted while they are read (`migrate_row`); newer formats are refused.

Timed columns, which depend on measured times, are stored in files of the same names in the folder `times`, and rounded to the
digits that are significant in view of their spread. A repeated run therefore changes these files, and in others only rows whose
numbers changed.
"""

import csv
import io
import json
import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from gauss_bench import checksums
from gauss_bench.atomic import atomically, write_text
from gauss_bench.untrusted import BadInput

FORMAT = 5
APART = 4  # the first format with timed columns in files of their own
BASELINE_FORMAT = 3  # format of the accuracy gate's baseline, stated in one of its columns
TIMES = "times"  # the folder of timed columns
SCHEMA_FILE = "tables.json"
ENVIRONMENT = "environment.json"  # machine, date and versions of a run
DIGITS = 10  # digits of a number in a CSV file, more than an error needs
CURVE_DIGITS, CURVE_BITS = 4, 13  # digits and bits of a curve's points: a relative error of 1.2e-4, less than the width of a line
ENDS = ("", "_low", "_high")  # endings of the columns of a value and its spread
FLAGS = {"": None, "true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}  # text in a file -> flag
TYPES = {"text": str, "number": float, "flag": bool}  # kind of a column -> Python type of its values

Row = Mapping[str, Any]


class TableError(BadInput, ValueError):
    """A file does not have the content that its table requires; the message names the file and, where there is one, the column."""


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        name: heading of the column in files.
        kind: type of the values.
        meaning: explanation for readers.
        unit: unit of the numbers; "" for texts, flags, counts and ratios.
        exact: whether a number keeps all its digits in a CSV file.
        timed: whether the column depends on measured time; a timed column is stored in a separate file, and rounded.
        added: whether the column was added after the first release of the present format, so that files of this format may lack it.
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
    """A table.

    Attributes:
        meaning: explanation of a row for readers.
        columns: all columns.
        keys: number of leading columns that distinguish rows.
        suffix: ending of the names of the table's files.
        timed: whether measured times decide which rows the table has; the whole table is then stored in the folder TIMES.
        curves: whether the numbers are points of curves, which are stored with as few digits as a drawing can show.
    """

    meaning: str
    columns: tuple[Column, ...]
    keys: int = 0
    suffix: Literal["csv", "parquet"] = "csv"
    timed: bool = False
    curves: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the table's columns."""
        return tuple(c.name for c in self.columns)

    @property
    def key(self) -> tuple[Column, ...]:
        """The columns that distinguish rows."""
        return self.columns[: self.keys]

    @property
    def timed_columns(self) -> tuple[Column, ...]:
        """The columns that depend on measured time."""
        return tuple(c for c in self.columns if c.timed)

    @property
    def parts(self) -> "dict[str, tuple[Column, ...]]":
        """The columns of each file of this table, by the folder of the file: "" for the folder of the run, or `times`.

        A file in `times` repeats the key of each row; it has all columns if measured times decide which rows there are (`timed`).
        """
        if self.timed:
            return {TIMES: self.columns}
        parts = {"": tuple(c for c in self.columns if not c.timed)}
        if self.timed_columns:
            parts[TIMES] = (*self.key, *self.timed_columns)
        return parts


SCHEMA = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def read_columns(entries: Iterable[Any]) -> Iterator[Column]:
    """Yield the columns that entries of `tables.toml` describe. An entry has one of three forms.

    "GROUP" (a text): the columns of the group with this name.
    {number = "step", meaning = "..."}: one column, with its kind as the first key.
    {spread = "ratio", meaning = "..."}: the columns ratio, ratio_low and ratio_high, a measured value with both ends of its range.
        The first key, here "spread", is a key of the table `ends` of `tables.toml`, which has the words to add to the three
        meanings.
    """
    for entry in entries:
        if isinstance(entry, str):
            yield from read_columns(SCHEMA["groups"][entry])
            continue
        (kind, name), *others = entry.items()  # the first key of a column is its kind, with its name as the value
        facts = dict(others)
        if kind in SCHEMA["ends"]:
            meaning = facts.pop("meaning")
            for end, words in zip(ENDS, SCHEMA["ends"][kind], strict=True):
                yield Column(name + end, "number", meaning + words, **facts)
        else:
            yield Column(name, kind, **facts)


TABLES = {name: Table(**facts | {"columns": tuple(read_columns(facts["columns"]))}) for name, facts in SCHEMA["tables"].items()}
KEY = tuple(c.name for c in read_columns(["case"]))  # the columns that identify a case


def case_of(row: Mapping[Any, Any]) -> tuple[Any, ...]:
    """Return the values of the columns KEY of a row, which identify its case."""
    return tuple(row[column] for column in KEY)


def row_of(table: Table, values: Row) -> dict[str, Any]:
    """Return a row with every column of the table, each value in its column's type.

    Raises:
        KeyError: `values` has a column that is not in the schema.
        TypeError, ValueError: a value is not of its column's type.
    """
    strange = values.keys() - set(table.names)
    if strange:
        raise KeyError(f"columns that are not in the schema: {', '.join(sorted(map(str, strange)))}")
    return {column.name: type_value(column, values.get(column.name)) for column in table.columns}


def type_value(column: Column, value: Any) -> Any:
    """Convert a value, or its text in a file, to its column's type.

    Raises:
        TypeError, ValueError: it cannot be converted.
    """
    missing = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
    if column.kind == "text":
        return "" if missing else str(value)
    if column.kind == "number":
        return math.nan if missing else float(value)
    word = "" if missing else str(value).lower()
    if word not in FLAGS:
        raise ValueError(f"{value!r} is neither true nor false")
    return FLAGS[word]


def type_column(column: Column, values: Sequence[Any]) -> Sequence[Any]:
    """Convert the values of a column, or their texts in a file, to the column's type.

    Raises:
        ValueError: a value is not of the column's type; the message names the column, and the row, counted from 1.
    """
    # most columns need no conversion of each value
    if all(type(value) is TYPES[column.kind] for value in values):  # Parquet files have typed values
        return values
    if all(value is None for value in values):  # this file lacks the column: a table can have two files
        return [type_value(column, None)] * len(values)
    typed = []
    for count, value in enumerate(values, 1):
        try:
            typed.append(type_value(column, value))
        except (TypeError, ValueError) as error:
            raise ValueError(f"row {count}, column {column.name!r}: {error}") from error
    return typed


def print_value(column: Column, value: Any, digits: int = DIGITS) -> str:
    """Return a typed value as text for a CSV file."""
    if value is None or (column.kind == "number" and math.isnan(value)):
        return ""
    if column.kind == "number":
        return repr(value) if column.exact else f"{value:.{digits}g}"
    return str(value)


def round_times(table: Table, row: Row) -> dict[str, Any]:
    """Return a typed row with rounded times and ratios of times.

    A value and the two ends of its range are rounded to multiples of the largest power of ten that is at most a hundredth of the
    width of the range. The value keeps at least four significant digits, and exactly four if no range is known. Reports print only
    three digits, so that no number is rounded twice to the same digit.
    """
    rounded = dict(row)
    for column in table.timed_columns:
        x = row[column.name]
        if column.kind != "number" or not math.isfinite(x) or x == 0 or column.name.endswith(ENDS[1:]):
            continue  # the ends of a range are rounded with its value
        names = [column.name + end for end in ENDS if column.name + end in row]
        last = math.floor(math.log10(abs(x))) - 3  # power of ten of the fourth digit
        if len(names) == len(ENDS):
            _, low, high = (row[name] for name in names)
            if math.isfinite(high - low) and high > low:
                last = min(last, math.floor(math.log10((high - low) / 100)))
        rounded |= {name: round(row[name], -last) for name in names}
    return rounded


def csv_text(columns: Sequence[Column], rows: Iterable[Row], digits: int = DIGITS) -> str:
    """Return typed rows as the text of a CSV file: a line of names, and one line for each row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([c.name for c in columns])
    writer.writerows([print_value(c, row[c.name], digits) for c in columns] for row in rows)
    return out.getvalue()


def write_table(name: str, rows: Iterable[Row], folder: Path) -> tuple[Path, ...]:
    """Write the files of a table into a folder, each atomically, and return their paths.

    Equal rows give equal bytes. Files of this table that an earlier format stored under other paths are removed.

    Raises:
        KeyError: there is no such table, or a row has a column that is not in the table.
        ValueError: two rows that have measured times have the same key, so that reading could not tell whose times are whose.
    """
    table = TABLES[name]
    typed = [round_times(table, row_of(table, row)) for row in rows]
    contents = {}  # path -> columns and rows of the file
    for subfolder, columns in table.parts.items():
        chosen = typed
        if subfolder and not table.timed:  # the second file of a table, which has only the rows that have times
            chosen = [row for row in typed if any(print_value(c, row[c.name]) for c in table.timed_columns)]
            if len({key_of(table, row) for row in chosen}) < len(chosen):
                raise ValueError(f"table {name}: two rows with times have the same key")
            if not chosen:
                continue
        contents[folder / subfolder / f"{name}.{table.suffix}"] = columns, chosen
    for path, (columns, chosen) in contents.items():
        if table.suffix == "csv":
            write_text(path, csv_text(columns, chosen))
        else:
            write_parquet(name, columns, chosen, path)
    if name == "baseline":  # not a table of a run; it has no checksum, because it changes whenever figures are accepted
        return tuple(contents)
    for stale in files_of(name, folder):
        if stale not in contents:
            stale.unlink()
    write_text(folder / checksums.FILE, checksums.with_files(folder, contents))
    return tuple(contents)


def files_of(name: str, folder: Path) -> tuple[Path, ...]:
    """Return the existing files of a table in the folder of a run, of any format."""
    places = [folder / part / f"{name}.{suffix}" for part in ("", TIMES) for suffix in ("csv", "parquet")]
    return tuple(path for path in places if path.exists())


def key_of(table: Table, row: Row) -> tuple[str, ...]:
    """Return the key of a row: the texts in the columns that distinguish rows."""
    return tuple(print_value(c, row[c.name]) for c in table.key)


def write_parquet(name: str, columns: Sequence[Column], rows: Sequence[Row], path: Path) -> None:
    """Write typed rows as Parquet, the format's number as metadata; points of curves are rounded to CURVE_BITS significant bits."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = TABLES[name]
    kinds = {"text": pa.string(), "number": pa.float64(), "flag": pa.bool_()}
    measured = [c.name for c in columns if c.kind == "number" and c.name not in KEY]
    drawn = measured if table.curves else []  # columns with points of curves, which need few digits
    schema = pa.schema([(c.name, pa.float32() if c.name in drawn else kinds[c.kind]) for c in columns])
    schema = schema.with_metadata({"gauss_bench": json.dumps({"table": name, "format": FORMAT})})
    rounded = set(drawn) - {c.name for c in table.key}
    content = pa.Table.from_pylist([{k: round_bits(x) if k in rounded else x for k, x in row.items()} for row in rows], schema)
    options = {
        "compression": "zstd",
        "compression_level": 19,
        "use_dictionary": [c.name for c in columns if c.name not in measured],
        "use_byte_stream_split": measured,
        "write_statistics": False,  # statistics let readers skip parts of large files; they would be half of a small file
    }
    atomically(path, lambda part: pq.write_table(content, part, **options))


def digits_of(name: str) -> int:
    """Return the number of digits that a table's numbers have in a CSV file."""
    return CURVE_DIGITS if TABLES[name].curves else DIGITS


def round_bits(x: float) -> float:
    """Round a number to CURVE_BITS binary digits, so that it compresses well."""
    if not math.isfinite(x):
        return x
    mantissa, exponent = math.frexp(x)
    return math.ldexp(round(math.ldexp(mantissa, CURVE_BITS)), exponent - CURVE_BITS)


def write_schema(folder: Path, names: Iterable[str] = ()) -> None:
    """Write `tables.json` into a folder: the format, and the meaning of every column of the named tables, by default of all."""
    tables = {
        name: {
            "meaning": t.meaning,
            "keys": t.keys,
            "files": [str(Path(part) / f"{name}.{t.suffix}") for part in t.parts],
            "columns": [{k: x for k, x in asdict(c).items() if x} for c in t.columns],
        }
        for name, t in TABLES.items()
        if name in (names or TABLES)
    }
    write_text(folder / SCHEMA_FILE, json.dumps({"format": FORMAT, "tables": tables}, indent=1) + "\n")


def read_environment(folder: Path) -> dict[str, Any]:
    """Return the content of `environment.json` of a run; empty without such a file.

    Raises:
        TableError: the file is damaged.
    """
    path = folder / ENVIRONMENT
    try:
        environment = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except ValueError as error:
        raise TableError(f"{path}: no JSON: {error}") from error
    if not isinstance(environment, dict):
        raise TableError(f"{path}: not an object")
    return environment


def format_of(folder: Path) -> int:
    """Return the format of the tables in a folder; 1 without `tables.json`.

    Raises:
        TableError: the format is later than FORMAT, the latest one that this version reads, or `tables.json` is damaged.
    """
    path = folder / SCHEMA_FILE
    if not path.exists():
        return 1
    try:
        version = json.loads(path.read_text(encoding="utf-8"))["format"]
        if not isinstance(version, int) or isinstance(version, bool) or version < 1:
            raise ValueError(f"{version!r} is not a format")
    except (ValueError, KeyError, TypeError) as error:
        raise TableError(f"{path}: does not state the format of the tables beside it: {error}") from error
    refuse_later(version, path)
    return version


def refuse_later(version: int, path: Path) -> None:
    """Check that this version of gauss-bench can read the format with the number `version`, which the file `path` states.

    Raises:
        TableError: the format is later than FORMAT, the latest one that this version reads.
    """
    if version > FORMAT:
        raise TableError(f"{path}: format {version} is later than {FORMAT}, the latest that this version reads")


def read_table(name: str, folder: Path) -> tuple[dict[str, Any], ...]:
    """Return the typed rows of a table in the folder of a run, in the order of the file; none if there is no such file.

    Raises:
        TableError: a file is damaged, lacks a column, has a value of the wrong type, or is of a later format; or the file of
            measured times has a key that no row of the main file has.
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
    rows, timed = parts
    names = [c.name for c in table.timed_columns]
    times = {key_of(table, row): {n: row[n] for n in names} for row in timed}  # by the key of the row
    strange = times.keys() - {key_of(table, row) for row in rows}
    if strange or len(times) < len(timed):
        key = " ".join(filter(None, min(strange, default=key_of(table, timed[0]))))
        path = folder / TIMES / f"{name}.{table.suffix}"
        raise TableError(f"{path}: a row of times has no matching row in the table beside it: {key}")
    return tuple(row | times.get(key_of(table, row), {}) for row in rows)


def read_file(
    name: str, path: Path, version: int | None = None, columns: Sequence[Column] | None = None
) -> tuple[dict[str, Any], ...]:
    """Return the typed rows of a table in one file.

    Args:
        version: number of the file's format; by default the number in the file's column `format`.
        columns: the table's columns that this file should have, by default all. Columns with the attribute `added` may be missing,
            and more columns in older formats. In the returned rows the values of columns that the file lacks are missing.

    Raises:
        TableError: for the same reasons as in `read_table`.
    """
    table = TABLES[name]
    head, lines = read_lines(path)
    if not head:  # even a table without rows has the names of its columns
        raise TableError(f"{path}: table {name}: is empty, without the names of its columns; it was cut off or never written")
    if version is None:
        try:
            version = max((int(float(line.get("format", 1))) for line in lines), default=FORMAT if "format" in head else 1)
        except (TypeError, ValueError) as error:
            raise TableError(f"{path}: column 'format': {error}") from error
        refuse_later(version, path)
    if version < FORMAT:
        head, lines = [SCHEMA["renamed"].get(x, x) for x in head], [migrate_row(name, line, version) for line in lines]
    # an older format may lack any column but the first, by which a table is recognised
    wanted = (columns or table.columns) if version == FORMAT else table.columns[:1]
    for column in (x for x in wanted if not x.added):
        if column.name not in head:
            raise TableError(f"{path}: table {name}: column {column.name!r} is missing")
    typed = []
    for column in table.columns:
        try:
            typed.append(type_column(column, [line.get(column.name) for line in lines]))
        except ValueError as error:
            raise TableError(f"{path}: table {name}, {error}") from error
    names = table.names
    return tuple(dict(zip(names, values, strict=True)) for values in zip(*typed, strict=True))


def migrate_row(name: str, line: dict[str, Any], version: int) -> dict[str, Any]:
    """Convert a line of an older format: rename columns, and leave out values whose meaning has changed."""
    names = SCHEMA["renamed"]
    fresh = {names.get(k, k): x for k, x in line.items()}
    if "measured" in TABLES[name].names:
        fresh = SCHEMA["always"] | fresh  # values that were the same in every row of format 1, which did not store them
    if name == "samples":  # samples were of a single process before format 5
        fresh = {"process": 0} | fresh
    if name == "baseline":  # a row of the baseline names a column
        fresh["metric"] = names.get(fresh.get("metric", ""), fresh.get("metric", ""))
    if name == "results" and version < 3:
        stale = ["build_time"]  # builds did not include the first step
        if version == 1 and fresh.get("stabilization") not in ("none", ""):  # steps were timed without stabilisation
            stale += ["step_", "native_step_"]
        return {k: x for k, x in fresh.items() if not k.startswith(tuple(stale))}
    return fresh


def migrate(folder: Path) -> tuple[Path, ...]:
    """Bring every table in the folder of a run, and a baseline in it, to the present format, and return the written files.

    Nothing is written before all tables are read. Measured times are rounded to the digits that their spread justifies.

    Raises:
        TableError: for the same reasons as in `read_table`.
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
    """Return the names of the columns and the untyped rows of a CSV or Parquet file.

    Raises:
        TableError: the file is damaged.
    """
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


def refuse_foreign(signs: Mapping[Path, str]) -> None:
    """Check that only files which gauss-bench wrote itself would be overwritten.

    `signs` maps the path of a file to a text that the file contains if gauss-bench wrote it.

    Raises:
        FileExistsError: a file exists and does not contain its text; the message names the file.
    """
    for path, sign in signs.items():
        if path.exists() and sign not in path.read_text(encoding="utf-8", errors="replace"):
            raise FileExistsError(f"{path}: is there already, and gauss-bench did not write it; move it or take another folder")
