"""Sentences on what changed between releases of an engine, from their rows: for a terminal, a file and the report."""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from gauss_bench.report.rows import is_known

Row = Mapping[str, Any]
MOST, LONGEST = 3, 80  # settings that a sentence names, and characters of what it says of each
NAMES = ("releases", "release_changes", "release_costs", "release_cost_changes")  # tables
TITLE = "# What changed between releases"
RULE = (
    "Each release is asked for accelerations at the same states and for a run of 1 s at steps of 1 ms. A difference between "
    "neighbours is real if it exceeds 50 times what a start changed by 1e-14 makes; else it is rounding. A cost changed if the "
    "range of its ratio lies more than 5 % from 1, and beyond what the newest release shows against itself."
)


def describe_changes(tables: Mapping[str, Sequence[Row]]) -> list[tuple[str, list[str]]]:
    """Return, for each pair of neighbours of the releases that have answers, a heading and its sentences."""
    pages = []
    usable = [row for row in tables["releases"] if row["status"] == "ok"]
    for before, after in pairwise(usable):
        if before["engine"] != after["engine"]:
            continue
        pair = {"engine": after["engine"], "before": before["version"], "after": after["version"]}
        found = [x for name in ("release_changes", "release_cost_changes") for x in tables[name] if pair.items() <= x.items()]
        heading = f"{pair['engine']} {pair['before']} -> {pair['after']}"
        pages.append((heading, [*describe_quantities(found), describe_rounding(after)]))
    return pages


def describe_unusable(rows: Iterable[Row]) -> list[str]:
    """Return a sentence for each release that has no answers."""
    return [f"{row['engine']} {row['version']}: {row['message']}" for row in rows if row["status"] != "ok"]


def describe_quantities(changes: Iterable[Row]) -> list[str]:
    """Return a sentence for each quantity that changed."""
    groups: dict[str, list[Row]] = {}
    for row in changes:
        groups.setdefault(row["quantity"], []).append(row)
    return [describe_group(quantity, rows) for quantity, rows in groups.items()]


def describe_group(quantity: str, rows: Sequence[Row]) -> str:
    """Return a sentence on all changes of one quantity between two neighbours: the largest, and how many there are."""
    sized = [row for row in rows if is_known(row.get("difference"))]
    timed = [row for row in rows if is_known(row.get("ratio"))]
    if timed:
        return f"{quantity}: " + "; ".join(f"{place_of(row)} times {ratio_text(row)}" for row in timed)
    parts = []
    if sized:
        worst = max(sized, key=lambda row: float(row["difference"]))
        errors = f"error against the truth {worst['error_before']:.1e} -> {worst['error_after']:.1e}"
        size = f"by up to {worst['difference']:.2g} of their size, where rounding makes {worst['rounding']:.0e}"
        parts.append(f"{len(sized)} differ, {size} ({place_of(worst)}: {errors})")
    others = [row for row in rows if not is_known(row.get("difference")) and not is_known(row.get("ratio"))]
    if others:
        named = "; ".join(f"{place_of(row)}: {row['was'][:LONGEST]} -> {row['now'][:LONGEST]}" for row in others[:MOST])
        more = f"; and {len(others) - MOST} more" if len(others) > MOST else ""
        parts.append(named + more)
    return f"{quantity}: " + "; ".join(parts)


def describe_rounding(after: Row) -> str:
    """Return a sentence on what is equal."""
    figures = f"{int(after['rounding'])} of {int(after['compared'])} figures"
    off = after["largest_rounding"]
    return f"equal but for rounding: {figures}, which differ by at most {off:.1e}" if off else f"equal to the last bit: {figures}"


def place_of(row: Row) -> str:
    """Return case and setting in words."""
    return ", ".join(filter(None, (row["case"], row["setting"])))


def ratio_text(row: Row) -> str:
    """Return a ratio with its range."""
    return f"{row['ratio']:.2f} ({row['ratio_low']:.2f} to {row['ratio_high']:.2f})"


def write_page(tables: Mapping[str, Sequence[Row]]) -> str:
    """Return the page in Markdown."""
    lines = [TITLE, "", RULE, ""]
    for heading, sentences in describe_changes(tables):
        lines += [f"## {heading}", "", *(f"- {x}" for x in sentences), ""]
    if unusable := describe_unusable(tables["releases"]):
        lines += ["## Without answers", "", *(f"- {x}" for x in unusable), ""]
    return "\n".join(lines)


def newest_first(releases: Iterable[Row]) -> list[Row]:
    """Return the rows of one engine's releases, the newest first."""
    return sorted(releases, key=lambda row: [int(x) for x in re.findall(r"\d+", row["version"])], reverse=True)
