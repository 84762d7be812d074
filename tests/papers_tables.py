"""The tables about the papers, computed once for all tests that read them."""

from functools import cache
from typing import Any

from gauss_bench.papers.audit import audit
from gauss_bench.papers.reproduction import reproduction

Rows = tuple[dict[str, Any], ...]


@cache
def audited() -> Rows:
    return tuple(audit()["audit"])


@cache
def reproduced() -> Rows:
    return tuple(reproduction()["reproduction"])
