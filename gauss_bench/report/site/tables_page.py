"""The data: every table of the run as files, with what its columns mean; and how to cite it."""

import lzma
from collections.abc import Mapping
from pathlib import Path

from markupsafe import Markup

from gauss_bench.report.content import Cell, Table, count, text_cell
from gauss_bench.report.rows import Row, Run
from gauss_bench.report.site.page import Page, fold, heading, join_blocks, link, paragraph, rich, table
from gauss_bench.tables import TABLES, csv_text, digits_of, write_bytes, write_parquet

FOLDER = "tables"
LARGE = 1500  # numbers and words: the CSV file of a larger table is compressed
HUGE = 150_000  # a table with more is there as Parquet alone: the site stays below its 8 MB
PACKED = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 4, "pb": 0}]  # text of numbers: no bytes are aligned


def write_data(folder: Path, tables: Mapping[str, tuple[Row, ...]]) -> list[Path]:
    """Write every table that has rows as Parquet, and as CSV unless it is huge. The same rows give the same bytes."""
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
    """Every table with its columns, units and meaning, as the schema has them."""
    parts = []
    for name, rows in sorted(tables.items()):
        if not rows:
            continue
        lines = tuple(
            (Cell(f"`{c.name}`", c.name), text_cell(c.kind), text_cell(c.unit), text_cell(c.meaning)) for c in TABLES[name].columns
        )
        columns = table(Table(f"Columns of {name}", ("column", "kind", "unit", "meaning"), lines), caption=False, most=999)
        files = link(f"{FOLDER}/{name}.parquet", "Parquet")
        if not is_huge(name, rows):
            files = Markup("{} · {}").format(link(f"{FOLDER}/{csv_file(name, rows)}", "CSV"), files)
        said = rich(f"One row: {TABLES[name].meaning}. {count(len(rows), 'row')}.")
        parts.append(
            Markup("<section>{}<p>{} {}</p>{}</section>").format(
                heading(name, name, 2), said, files, fold(f"Columns of {name}", columns)
            )
        )
    lead = "Every table this site was built from, with what each column means."
    return Page("data", "Data", lead, join_blocks(parts), group="Data")


def cite_page(run: Run) -> Page:
    e = run.environment
    commit, date = str(e.get("commit", ""))[:12], str(e.get("date", ""))
    version = str(e.get("versions", {}).get("gauss-bench", "")) if isinstance(e.get("versions"), dict) else ""
    entry = "\n".join(
        [
            "@software{gauss_bench,",
            "  title   = {gauss\\_bench: validation and benchmarking of closed-loop linkage dynamics},",
            *([f"  version = {{{version}}},"] if version else []),
            *([f"  date    = {{{date}}},"] if date else []),
            *(
                [
                    "  note    = "
                    f"{{Results of commit {commit}{' with uncommitted changes' if e.get('dirty') else ''}, {e.get('cpu', '')}}},"
                ]
                if commit
                else []
            ),
            "}",
        ]
    )
    body = join_blocks(
        [
            paragraph(
                "A number from this site belongs with the commit, the date and the processor it was measured "
                "on: costs hold for that machine alone."
            ),
            Markup('<pre tabindex="0"><code>{}</code></pre>').format(entry),
            paragraph(
                "`CITATION.cff` of the project has the same in a form that tools read. The scripts that draw "
                "the figures are Vega, Vega-Lite and Vega-Embed; their licences stand in `THIRD_PARTY.md` of this folder."
            ),
        ]
    )
    return Page("cite", "Cite", "How to name these results, so that another can find the same rows.", body, group="Cite")
