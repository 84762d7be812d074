"""The page on data, with every table of the run as a file and the meaning of its columns; and the page on citation."""

import lzma
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gauss_bench.atomic import write_bytes
from gauss_bench.report.content import lay_out
from gauss_bench.report.field_run import FOLDER as BESIDE
from gauss_bench.report.pages import list_facts
from gauss_bench.report.rows import Row, Run
from gauss_bench.report.site.page import ENVIRONMENT, Page, plain_page
from gauss_bench.report.words import count
from gauss_bench.tables import TABLES, csv_text, digits_of, write_parquet

FOLDER = "tables"
LARGE = 1500  # [cells] the CSV file of a larger table is compressed
HUGE = 150_000  # [cells] a larger table is published as Parquet
# LZMA parameters for text, whose bytes are not aligned; the highest preset takes four times as long and saves 2 % of the size
PACKED = [{"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 4, "pb": 0}]


def write_data(folder: Path, tables: Mapping[str, tuple[Row, ...]]) -> list[Path]:
    """Write each table with rows to a file, and return the paths; equal rows give equal bytes."""
    paths = []
    for name, rows in tables.items():
        if not rows:
            continue
        columns, path = TABLES[name].columns, folder / data_file(name, rows)
        paths.append(path)
        if path.suffix == ".parquet":
            write_parquet(name, columns, rows, path)
        else:
            text = csv_text(columns, rows, digits_of(name)).encode()
            write_bytes(path, lzma.compress(text, filters=PACKED) if path.suffix == ".xz" else text)
    return paths


def data_file(name: str, rows: tuple[Row, ...]) -> str:
    """Return the name of a table's file, which depends on the number of its cells.

    The file is Parquet if the table has more than HUGE cells, compressed CSV if it has more than LARGE cells, and else CSV.
    """
    size = len(rows) * len(TABLES[name].columns)  # [cells]
    if size > HUGE:
        return f"{name}.parquet"
    return f"{name}.csv.xz" if size > LARGE else f"{name}.csv"


def data_page(run: Run) -> Page:
    """Return the page that offers all tables of a run as files and explains their columns."""
    described = []
    for name, rows in sorted(run.tables.items()):
        if rows:
            file = data_file(name, rows)
            kind = "Parquet" if file.endswith(".parquet") else "CSV"
            described.append(describe_table(name, rows) | {"files": [(f"{FOLDER}/{file}", kind)]})
    if run.beside:
        files = {name: f"{FOLDER}/{BESIDE}/{data_file(name, rows)}" for name, rows in run.beside.tables.items() if rows}
        words = "All tables of its run, whose columns are those of the tables of the same names:"
        links = [(file, name) for name, file in sorted(files.items())]
        described.append(describe_table("field", run.beside.table("field"), words) | {"files": links})
    lead = "All tables of this site, with the meaning of each column."
    return plain_page("data", "Data", lead, "Data", described=described)


def describe_table(name: str, rows: tuple[Row, ...], words: str = "") -> dict[str, Any]:
    """Return what the page says on a table: its `name`, sentences as `text`, and a table of its `columns`."""
    columns = [vars(c) | {"column": f"`{c.name}`"} for c in TABLES[name].columns]
    text = f"One row: {TABLES[name].meaning}. {count(len(rows), 'row')}. {words}"
    return {"name": name, "text": text.strip(), "columns": lay_out("columns", columns, name=name)}


CITED = "Quote a number of this site with its commit, date and processor, because costs hold for that machine alone."
FIELD_CITED = "The field, and the engines that run in it alone, come from another run: {}, rows sha256:{}."


def cite_page(run: Run) -> Page:
    """Return the page on how to cite the run."""
    facts = {key: run.environment.get(key, "") for key in ("date", "cpu", "dirty")}
    facts |= {"commit": str(run.environment.get("commit", ""))[:12], "checksum": run.checksum}
    facts["version"] = run.environment.get("versions", {}).get("gauss-bench", "")
    entry = ENVIRONMENT.get_template("citation.txt").render(facts)
    lead = "How to cite these results, so that a reader can find the same rows."
    paragraphs = [CITED]
    if run.beside:  # the run of the suite `field`, whose rows the site shows too
        paragraphs.append(FIELD_CITED.format(", ".join(list_facts(run.beside)), run.beside.checksum))
    return plain_page("cite", "Cite", lead, "Cite", paragraphs=paragraphs, entry=entry)
