"""The published run and its findings, which all tests of a process share, and the documentation of its site."""

import os
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from gauss_bench.report.build import all_findings, read_run
from gauss_bench.report.content import Finding
from gauss_bench.report.rows import Run
from tests.conftest import needs

REPORTS = Path(__file__).parents[1] / "reports"


@cache
def published() -> Run:
    return read_run(REPORTS)


@cache
def published_findings() -> tuple[Finding, ...]:
    return tuple(all_findings(published()))


def build_guide(folder: Path) -> None:
    """Build the documentation into a folder; without MkDocs the test is skipped."""
    if find_spec("mkdocs") is None:
        needs("mkdocs")
    root = REPORTS.parent
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--quiet",
        "-f",
        str(root / "gauss_bench/docs/mkdocs.yml"),
        "-d",
        str(folder),
    ]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(root)})
    assert done.returncode == 0, done.stderr
