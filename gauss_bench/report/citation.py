"""Renew the identifiers of the published rows in CITATION.cff: their checksums, and the commits of the code that measured them.

`make publish` and `make field` run `python -m gauss_bench.report.citation reports CITATION.cff`.
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
    """Return the entry of CITATION.cff that identifies the rows in a folder; `name` is the path of the folder in the project."""
    environment = read_environment(folder)
    commit, date, cpu = (environment[key] for key in ("commit", "date", "cpu"))
    version, checksum = environment["versions"]["gauss-bench"], checksum_of_run(read_checksums(folder))
    description = f"rows in {name}/, measured by commit {commit} (version {version}) on {date}, {cpu}"
    description += f"; checksum of the lines of {name}/{FILE}, as sha256sum prints them"
    return f'  - type: other\n    value: "sha256:{checksum}"\n    description: "{description}"\n'


def renew(text: str, folder: Path) -> str:
    """Return the text of CITATION.cff with the checksums of the runs in a folder and in its subfolder `field`."""
    identifiers = "identifiers:\n" + "".join(describe_rows(x, str(x.relative_to(folder.parent))) for x in folders_of(folder))
    # a function, because `subn` would interpret backslashes in a string
    renewed, count = IDENTIFIERS.subn(lambda _: identifiers, text)
    assert count == 1, "CITATION.cff has one list of identifiers"
    return renewed


if __name__ == "__main__":
    rows, page = map(Path, sys.argv[1:])
    write_text(page, renew(page.read_text(encoding="utf-8"), rows))
