"""Writes the whole site of a run into one folder; built twice from the same rows, every file is the same byte for byte."""

from pathlib import Path

from gauss_bench.report.rows import Run
from gauss_bench.tables import write_text

SITE = "site"


def write_site(out: Path, run: Run) -> list[Path]:
    """Write the site of a run under `out`/site; returns what was written."""
    page = out / SITE / "index.html"
    page.parent.mkdir(parents=True, exist_ok=True)
    write_text(page, '<!doctype html><html lang="en"><title>gauss_bench</title></html>\n')
    return [page]
