"""The published run and its findings, which all tests of a process share; the documentation of its site; faults of a page."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gauss_bench.report.build import all_findings, read_run
from gauss_bench.report.content import Finding, Section, Table
from gauss_bench.report.rows import Run
from tests.conftest import needs

REPORTS = Path(__file__).parents[1] / "reports"


@cache
def published() -> Run:
    return read_run(REPORTS)


@cache
def published_findings() -> tuple[Finding, ...]:
    return tuple(all_findings(published()))


def tables(sections: Sequence[Section]) -> Iterator[tuple[str, Table]]:
    """Yield every table of sections and of their parts, with the title of its section."""
    for section in sections:
        yield from ((section.title, x) for x in section.blocks if isinstance(x, Table))
        yield from tables(section.parts)


def watch(page: Any, *own: str) -> list[str]:
    """Return a list to which a page adds its errors, its warnings and its requests to addresses that begin with none of `own`."""
    wrong: list[str] = []
    page.on("console", lambda m: wrong.append(m.text) if m.type in ("error", "warning") else None)
    page.on("pageerror", lambda e: wrong.append(str(e)))
    page.on("request", lambda r: wrong.append(r.url) if not r.url.startswith((*own, "data:", "blob:")) else None)
    return wrong


def build_guide(folder: Path) -> None:
    """Build the documentation into a folder; without MkDocs the test is skipped."""
    if find_spec("mkdocs") is None:
        needs("mkdocs")
    root = REPORTS.parent
    files = ["-f", str(root / "gauss_bench/docs/mkdocs.yml"), "-d", str(folder)]
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", *files]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(root)})
    assert done.returncode == 0, done.stderr
