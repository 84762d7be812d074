"""The identifier of the published rows in CITATION.cff: their checksum, and the commit that measured them.

`python -m gauss_bench.report.citation reports CITATION.cff` renews it; `make publish` does so.
"""

import re
import sys
from pathlib import Path

from gauss_bench.atomic import write_text
from gauss_bench.checksums import FILE, checksum_of_run, read_checksums
from gauss_bench.tables import read_environment

IDENTIFIER = re.compile(r'(?m)^    value: "sha256:.*"\n    description: ".*"$')


def describe_rows(folder: Path) -> str:
    """Return the value and the description of the identifier of the rows in a folder, as lines of CITATION.cff."""
    known = read_environment(folder)
    version = known["versions"]["gauss-bench"]
    words = f"rows in reports/, measured by commit {known['commit']} (version {version}) on {known['date']}, {known['cpu']}"
    checksum = checksum_of_run(read_checksums(folder))
    words += f"; checksum of the lines of reports/{FILE}, as sha256sum prints them"
    return f'    value: "sha256:{checksum}"\n    description: "{words}"'


def renew(text: str, folder: Path) -> str:
    """Return the text of CITATION.cff with the identifier of the rows in a folder."""
    renewed, count = IDENTIFIER.subn(lambda found: describe_rows(folder), text)
    assert count == 1, "CITATION.cff has one identifier of rows"
    return renewed


if __name__ == "__main__":
    rows, page = map(Path, sys.argv[1:])
    write_text(page, renew(page.read_text(encoding="utf-8"), rows))
