"""The data page: every table of the run as files, with the meaning of its columns; and the page on citing it."""

import lzma
from collections.abc import Mapping
from pathlib import Path

from gauss_bench.atomic import write_bytes
from gauss_bench.report.content import count, lay_out
from gauss_bench.report.rows import Row, Run
from gauss_bench.report.site.page import ENVIRONMENT, Page, plain_page
from gauss_bench.tables import TABLES, csv_text, digits_of, write_parquet

FOLDER = "tables"
LARGE = 1500  # numbers and words: the CSV file of a larger table is compressed
HUGE = 150_000  # numbers and words: a larger table is published as Parquet alone, to keep the site below 8 MB
PACKED = [
    {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 4, "pb": 0}
]  # parameters for text, whose bytes are not aligned


def write_data(folder: Path, tables: Mapping[str, tuple[Row, ...]]) -> list[Path]:
    """Write every table with rows as Parquet, and as CSV unless it is huge; equal rows give equal bytes."""
    paths = []
    for name, rows in tables.items():
        columns = TABLES[name].columns
        for file in data_files(name, rows):
            paths.append(folder / file)
            if file.endswith(".parquet"):
                write_parquet(name, columns, rows, folder / file)
            else:
                text = csv_text(columns, rows, digits_of(name)).encode()
                write_bytes(folder / file, lzma.compress(text, filters=PACKED) if file.endswith(".xz") else text)
    return paths


def data_files(name: str, rows: tuple[Row, ...]) -> list[str]:
    """Return the names of a table's files: CSV, compressed if large, none if huge, and Parquet; none for a table without rows."""
    size = len(rows) * len(TABLES[name].columns)
    if size == 0:
        return []
    csv = [] if size > HUGE else [f"{name}.csv.xz" if size > LARGE else f"{name}.csv"]
    return [*csv, f"{name}.parquet"]


def data_page(tables: Mapping[str, tuple[Row, ...]]) -> Page:
    """Return the page with every table, its columns, units and meanings."""
    described = []
    for name, rows in sorted(tables.items()):
        links = [(f"{FOLDER}/{file}", "Parquet" if file.endswith(".parquet") else "CSV") for file in data_files(name, rows)]
        if links:
            columns = [vars(c) | {"column": f"`{c.name}`"} for c in TABLES[name].columns]
            words = f"One row: {TABLES[name].meaning}. {count(len(rows), 'row')}."
            described.append({"name": name, "said": words, "files": links, "columns": lay_out("columns", columns, name=name)})
    lead = "All tables of this site, with the meaning of each column."
    return plain_page("data", "Data", lead, "Data", described=described)


CITED = "Quote a number of this site with its commit, date and processor, because costs hold for that machine alone."


def cite_page(run: Run) -> Page:
    """Return the page on how to cite the run."""
    known = run.environment
    version = known.get("versions", {}).get("gauss-bench", "")
    facts = {"version": version, "date": known.get("date", ""), "commit": str(known.get("commit", ""))[:12]}
    facts["checksum"] = run.checksum
    entry = ENVIRONMENT.get_template("citation.txt").render(facts, dirty=known.get("dirty"), cpu=known.get("cpu", ""))
    lead = "How to cite these results, so that a reader can find the same rows."
    return plain_page("cite", "Cite", lead, "Cite", paragraphs=(CITED,), entry=entry)
