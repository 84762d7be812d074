"""The data page: every table of the run as files, with the meaning of its columns; and the page on citing it."""

import lzma
from collections.abc import Mapping
from pathlib import Path

from gauss_bench.report.content import count, lay_out
from gauss_bench.report.rows import Row, Run
from gauss_bench.report.site.page import ENVIRONMENT, Page, plain_page
from gauss_bench.tables import TABLES, csv_text, digits_of, write_bytes, write_parquet

FOLDER = "tables"
LARGE = 1500  # numbers and words: the CSV file of a larger table is compressed
HUGE = 150_000  # numbers and words: a larger table is published as Parquet alone, to keep the site below 8 MB
PACKED = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 4, "pb": 0}]  # text of numbers: no bytes are aligned


def write_data(folder: Path, tables: Mapping[str, tuple[Row, ...]]) -> list[Path]:
    """Write every table with rows as Parquet, and as CSV unless it is huge; equal rows give equal bytes."""
    written = []
    for name, rows in tables.items():
        if rows:
            write_parquet(name, TABLES[name].columns, rows, folder / f"{name}.parquet")
            written.append(folder / f"{name}.parquet")
            if not is_huge(name, rows):
                text = csv_text(TABLES[name].columns, rows, digits_of(name)).encode()
                path = folder / csv_file(name, rows)
                write_bytes(path, lzma.compress(text, filters=PACKED) if path.suffix == ".xz" else text)
                written.append(path)
    return written


def is_huge(name: str, rows: tuple[Row, ...]) -> bool:
    return len(rows) * len(TABLES[name].columns) > HUGE


def csv_file(name: str, rows: tuple[Row, ...]) -> str:
    return f"{name}.csv.xz" if len(rows) * len(TABLES[name].columns) > LARGE else f"{name}.csv"


def data_page(tables: Mapping[str, tuple[Row, ...]]) -> Page:
    """Return the page with every table, its columns, units and meanings."""
    described = []
    for name, rows in sorted(tables.items()):
        if rows:
            columns = [vars(c) | {"column": f"`{c.name}`"} for c in TABLES[name].columns]
            csv = [] if is_huge(name, rows) else [(f"{FOLDER}/{csv_file(name, rows)}", "CSV")]
            summary = f"One row: {TABLES[name].meaning}. {count(len(rows), 'row')}."
            files = [*csv, (f"{FOLDER}/{name}.parquet", "Parquet")]
            described.append({"name": name, "said": summary, "files": files, "columns": lay_out("columns", columns, name=name)})
    return plain_page(
        "data", "Data", "Every table this site was built from, with what each column means.", "Data", described=described
    )


CITED = (
    "A number from this site belongs with the commit, the date and the processor it was measured on: costs hold for that machine "
    "alone."
)


def cite_page(run: Run) -> Page:
    e = run.environment
    versions = e.get("versions", {})
    facts = {"version": versions.get("gauss-bench", ""), "date": e.get("date", ""), "commit": str(e.get("commit", ""))[:12]}
    entry = ENVIRONMENT.get_template("citation.txt").render(facts, dirty=e.get("dirty"), cpu=e.get("cpu", ""))
    lead = "How to name these results, so that another can find the same rows."
    return plain_page("cite", "Cite", lead, "Cite", paragraphs=(CITED,), entry=entry)
