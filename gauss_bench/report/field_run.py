"""The run of the suite `field` that is published beside another run, in its folder `field`: its rows and its machine are its own.

`python -m gauss_bench.report.field_run reports/field` removes the tables that no page reads, such as single times and curves;
`make field` does so.
"""

import sys
from pathlib import Path

from gauss_bench.atomic import write_text
from gauss_bench.checksums import FILE, with_files
from gauss_bench.tables import TABLES, files_of, write_schema

FOLDER = "field"
READ = ("field", "results", "search_winners", "search_times", "search_ladder", "search_space", "search_knobs")  # tables


def folders_of(folder: Path) -> list[Path]:
    """Return the folder of a run, and that of the run of the suite `field` beside it if there is one."""
    beside = folder / FOLDER
    return [folder, beside] if files_of("field", beside) else [folder]


def drop_unread(folder: Path) -> None:
    """Remove the tables of a run that are not in READ, and write checksums and schema of the others."""
    for path in [path for name in TABLES if name not in READ for path in files_of(name, folder)]:
        path.unlink()
    write_text(folder / FILE, with_files(folder, ()))
    write_schema(folder, READ)


if __name__ == "__main__":
    drop_unread(Path(sys.argv[1]))
