"""The run of the suite `field` that is published in the folder `field` of another run.

It has its own rows and its own environment. `python -m gauss_bench.report.field_run reports/field` removes the tables that no page
reads, such as single times and curves; `make field` calls it.
"""

import sys
from pathlib import Path

from gauss_bench.atomic import write_text
from gauss_bench.checksums import FILE, with_files
from gauss_bench.tables import TABLES, files_of, write_schema

FOLDER = "field"
READ = ("field", "results", "search_winners", "search_times", "search_ladder", "search_space", "search_knobs")  # tables for pages


def folders_of(folder: Path) -> list[Path]:
    """Return the folder of a run, then the folder of the run of the suite `field` beside it if there is one."""
    beside = folder / FOLDER
    return [folder, beside] if files_of("field", beside) else [folder]


def drop_unread(folder: Path) -> None:
    """Remove the tables of a run that are not in READ, and write checksums and schema of the others."""
    for name in TABLES.keys() - set(READ):
        for path in files_of(name, folder):
            path.unlink()
    write_text(folder / FILE, with_files(folder, ()))
    write_schema(folder, READ)


if __name__ == "__main__":
    drop_unread(Path(sys.argv[1]))
