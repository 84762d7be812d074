"""Find the run of the suite `field`, which is stored in the subfolder `field` of another run's folder.

`make field` runs `python -m gauss_bench.report.field_run reports/field`, which removes the tables that no page reads.
"""

import sys
from pathlib import Path

from gauss_bench.atomic import write_text
from gauss_bench.checksums import FILE, with_files
from gauss_bench.tables import TABLES, files_of, write_schema

FOLDER = "field"
# tables that pages read
READ = ("field", "results", "search_winners", "search_times", "search_ladder", "search_space", "search_knobs")


def folders_of(folder: Path) -> list[Path]:
    """Return the folder of a run and, if it has a run of the suite `field`, its subfolder `field`."""
    beside = folder / FOLDER
    return [folder, beside] if files_of("field", beside) else [folder]


def drop_unread(folder: Path) -> None:
    """Remove the tables of a run that no page reads, and renew checksums and schema."""
    for name in TABLES.keys() - set(READ):
        for path in files_of(name, folder):
            path.unlink()
    write_text(folder / FILE, with_files(folder, ()))
    write_schema(folder, READ)


if __name__ == "__main__":
    drop_unread(Path(sys.argv[1]))
