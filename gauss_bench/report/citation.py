"""The identifiers of the published rows in CITATION.cff: their checksums, and the commits that measured them.

`python -m gauss_bench.report.citation reports CITATION.cff` renews them; `make publish` and `make field` do so.
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
    """Return the identifier of the rows in a folder, as lines of CITATION.cff; `name` is its path in the project."""
    known = read_environment(folder)
    version = known["versions"]["gauss-bench"]
    words = f"rows in {name}/, measured by commit {known['commit']} (version {version}) on {known['date']}, {known['cpu']}"
    checksum = checksum_of_run(read_checksums(folder))
    words += f"; checksum of the lines of {name}/{FILE}, as sha256sum prints them"
    return f'  - type: other\n    value: "sha256:{checksum}"\n    description: "{words}"\n'


def renew(text: str, folder: Path) -> str:
    """Return the text of CITATION.cff with the identifiers of the rows in a folder, and of those of the run beside them."""
    described = [describe_rows(x, str(x.relative_to(folder.parent))) for x in folders_of(folder)]
    renewed, count = IDENTIFIERS.subn(lambda found: "identifiers:\n" + "".join(described), text)
    assert count == 1, "CITATION.cff has one list of identifiers"
    return renewed


if __name__ == "__main__":
    rows, page = map(Path, sys.argv[1:])
    write_text(page, renew(page.read_text(encoding="utf-8"), rows))
