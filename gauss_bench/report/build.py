"""Builds the report of a run: README.md for the forge, index.html for the browser, figures for both.

The page is a list of sections; each is one file in `sections` with one function of the run, and one line here. Built twice from the
same folder, every file comes out the same byte for byte.
"""

import json
import math
from pathlib import Path
from typing import Any

import pandas as pd

from gauss_bench.report.content import Block, Picture, Section
from gauss_bench.report.pages import html_page, markdown_page
from gauss_bench.report.rows import KEYS, Row, Run
from gauss_bench.report.sections import (
    acceleration,
    claim,
    cost,
    drawing,
    environment,
    failures,
    findings,
    kernels,
    kinematics,
    limitations,
    papers,
    references,
    reproduction,
    settings,
    stability,
    trajectories,
)
from gauss_bench.tables import KERNEL_TABLES, SIDE_TABLES, write_text

FIRST = (findings.section,)
PER_LINKAGE = (drawing.section, acceleration.section, trajectories.section, stability.section, cost.section)
LAST = (
    claim.section,
    kernels.section,
    kinematics.section,
    references.section,
    reproduction.section,
    papers.section,
    failures.section,
    limitations.section,
    settings.section,
    environment.section,
)

OUTCOMES = (
    "status",
    "message",
    "note",
    "flag",
    "link_errors",
    "method",
    "quantity",
    "first",
    "second",
    "coordinate",
    "kind",
    "form",
    *("paper", "equation", "name", "printed", "intended", "verdict", "measured", "reason", "sentence", "faults", "example"),
    *("group", "key", "unit", "statement", "published", "certified"),
    *(f"{pipeline}_{x}" for pipeline in ("taylor", "collocation") for x in ("stopped", "method")),
    "file",
    *("formulation", "place", "own", "rival", "against", "ended"),
)
TEXTS = (*(k for k in KEYS if k not in ("step", "t_end")), *OUTCOMES)
FLAGS = ("valid", "control", "complete", "stands", "met", "best")


def read_run(folder: Path) -> Run:
    """The rows and the environment the runner left in a folder; a missing table is an empty one."""
    path = folder / "environment.json"
    environment = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    tables = {name: _read_table(folder, name) for name in ("results", "series", "samples", *SIDE_TABLES)}
    kernels = {name: _read_table(folder, name) for name in KERNEL_TABLES}
    return Run(**tables, kernels=kernels, environment=environment)


def _read_table(folder: Path, name: str) -> tuple[Row, ...]:
    """Rows of a CSV or, without one, Parquet file, sorted by key; the status "nan" stays a text."""
    path = folder / f"{name}.csv"
    if path.exists():
        empty = not path.read_text(encoding="utf-8").strip()
        frame = pd.DataFrame() if empty else pd.read_csv(path, dtype=str, keep_default_na=False)
    else:
        path = path.with_suffix(".parquet")
        frame = pd.read_parquet(path) if path.exists() else pd.DataFrame()
    rows = [{str(k): _value(str(k), x) for k, x in row.items()} for row in frame.to_dict("records")]
    return tuple(sorted(rows, key=_order))


def _value(column: str, value: Any) -> Any:
    if column in TEXTS:
        return value if isinstance(value, str) else ""
    if column in FLAGS:
        return str(value).lower() in ("true", "1", "1.0")
    return float(value) if value not in ("", None) else math.nan


def _order(row: Row) -> tuple[Any, ...]:
    """The key in order; larger steps first, as an error falls with them."""
    words = tuple(str(row.get(k, "")) for k in KEYS if k not in ("step", "t_end"))
    numbers = (-float(row.get("step", 0.0)), float(row.get("t", row.get("round", 0.0))))
    return (*words, *(0.0 if math.isnan(x) else x for x in numbers))


def sections(run: Run) -> tuple[Section, ...]:
    """Everything the report says, in order."""
    whole = [make(run) for make in FIRST]
    chapters = []
    for name in run.linkages:
        parts = tuple(part for make in PER_LINKAGE if (part := make(run, name)) is not None)
        chapters.append(Section(name, name, parts=parts))
    linkages = [Section("Linkages", "linkages", parts=tuple(chapters))] if chapters else []
    return (*whole, *linkages, *(make(run) for make in LAST))


def build_report(folder: Path) -> list[Path]:
    """Write README.md, index.html and figures/*.svg into the folder of a run; returns what was written."""
    run = read_run(folder)
    content = sections(run)
    pictures = {picture.name: picture.svg for section in content for picture in _pictures(section)}
    files = {folder / "figures" / f"{name}.svg": svg for name, svg in sorted(pictures.items())}
    files[folder / "README.md"] = markdown_page(run, content)
    files[folder / "index.html"] = html_page(run, content)
    for path, text in files.items():
        write_text(path, text)
    for stale in set((folder / "figures").glob("*.svg")) - files.keys():
        stale.unlink()
    return list(files)


def _pictures(section: Section) -> list[Picture]:
    blocks: list[Block] = [*section.blocks]
    return [b for b in blocks if isinstance(b, Picture)] + [p for part in section.parts for p in _pictures(part)]
