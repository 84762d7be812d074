"""The identifiers of the published rows in CITATION.cff: their checksums, and the commits that measured them.

`python -m gauss_bench.report.citation reports CITATION.cff` renews the identifiers; `make publish` and `make field` call it.
"""

import re
import sys
from pathlib import Path

from gauss_bench.atomic import write_text
from gauss_bench.checksums import FILE, checksum_of_run, read_checksums
from gauss_bench.report.field_run import folders_of
from gauss_bench.tables import read_environment

IDENTIFIERS = re.compile(r"(?m)^identifiers:\n(?:  .*\n)+")


def describe_rows(folder: Path, name: str = "reports") -> str:
    """Return lines of CITATION.cff that identify the rows in a folder by checksum; `name` is the folder's path in the project."""
    environment = read_environment(folder)
    commit, date, cpu = (environment[key] for key in ("commit", "date", "cpu"))
    words = f"rows in {name}/, measured by commit {commit} (version {environment['versions']['gauss-bench']}) on {date}, {cpu}"
    checksum = checksum_of_run(read_checksums(folder))
    words += f"; checksum of the lines of {name}/{FILE}, as sha256sum prints them"
    return f'  - type: other\n    value: "sha256:{checksum}"\n    description: "{words}"\n'


def renew(text: str, folder: Path) -> str:
    """Return the text of CITATION.cff with the checksums of the runs in a folder and in its subfolder `field`."""
    identifiers = "identifiers:\n" + "".join(describe_rows(x, str(x.relative_to(folder.parent))) for x in folders_of(folder))
    renewed, count = IDENTIFIERS.subn(lambda _: identifiers, text)  # a function, since a text would be searched for \1
    assert count == 1, "CITATION.cff has one list of identifiers"
    return renewed


if __name__ == "__main__":
    rows, page = map(Path, sys.argv[1:])
    write_text(page, renew(page.read_text(encoding="utf-8"), rows))
