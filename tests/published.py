"""The published run and its findings, which all tests of a process share."""

from functools import cache
from pathlib import Path

from gauss_bench.report.build import all_findings, read_run
from gauss_bench.report.content import Finding
from gauss_bench.report.rows import Run

REPORTS = Path(__file__).parents[1] / "reports"


@cache
def published() -> Run:
    return read_run(REPORTS)


@cache
def published_findings() -> tuple[Finding, ...]:
    return tuple(all_findings(published()))
