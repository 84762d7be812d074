"""Failed, skipped and invalid cases, grouped by the reason."""

import re
from collections.abc import Iterator, Sequence

from gauss_bench.report.cases import has_ended
from gauss_bench.report.content import Finding, Section, Table, Text, blocks_of, lay_out, layouts
from gauss_bench.report.rows import Row, Run, group_by, is_known
from gauss_bench.report.words import count, itemise

PLACE = 80
NUMBER = re.compile(r"\d[\d.e+-]*")
NONE = "None: every case of the run ended and is valid."


def section(run: Run) -> Section:
    """Return the section with tables of failed, skipped and invalid cases, and of costs that could not be measured."""
    stopped = [row for row in run.results if not has_ended(row)]
    invalid = [row for row in run.results if has_ended(row) and not row["valid"]]
    # the judge's reason is the message of an invalid case
    judged: list[Row] = [{**row, "message": row.get("flag", ""), "status": "not valid"} for row in invalid]
    kinds: dict[str, list[Row]] = {
        "Failed": [row for row in stopped if row["status"] != "skip"],
        "Skipped: not modelled, with the adapter's reason": [row for row in stopped if row["status"] == "skip"],
        "Ended, but not valid: the judge's reason": judged,
    }
    tables = [list_reasons(title, rows) for title, rows in kinds.items() if rows]
    untimed = blocks_of("untimed", [row for row in run.table("untimed") if row["status"] != "skip"])
    blocks = (Text(layouts()["texts"]["failures"]), *tables, *untimed) if tables or untimed else (Text(NONE),)
    return Section("Skipped and failed cases", "failures", blocks)


def list_reasons(title: str, rows: Sequence[Row]) -> Table:
    """Return a table with a line for each engine, status and message; messages that differ only in numbers share a line."""
    lines = []
    for group in group_by(rows, lambda r: (r["engine"], r["status"], NUMBER.sub("#", r["message"]))).values():
        line = {**group[0], "where": describe_cases(group), "cases": len(group)}
        line["status_tone"] = "warn" if line["status"] == "skip" else "bad"
        if len({row["message"] for row in group}) > 1:
            line["message"] += " (numbers of the first)"
        lines.append(line)
    return lay_out("failures", lines, what=title, cases=count(len(rows), "case"))


def describe_cases(rows: Sequence[Row]) -> str:
    """Return the linkages, settings and steps of cases in words, separated by semicolons."""
    parts = [itemise(sorted({f"{r['mechanism']} {r['scenario']}" for r in rows}))]
    for key in ("settings", "integrator", "stabilization"):
        parts.append("/".join(sorted({r[key] for r in rows} - {""})))
    steps = sorted({row["step"] for row in rows if is_known(row["step"])})
    parts.append(f"step {', '.join(f'{x:g}' for x in steps)}" if steps else "")
    return "; ".join(filter(None, parts))


def findings(run: Run) -> Iterator[Finding]:
    """Yield a finding on the number of failed cases, with an example for each engine and kind of failure."""
    rows = [row for row in run.results if not has_ended(row) and row["status"] != "skip"]
    parts = []
    for (name, status), group in group_by(rows, "engine", "status").items():
        row = group[0]
        message = " ".join(row["message"].split()).rstrip(".").replace("`", "") or "no message"
        example = f'{row["mechanism"]} {row["scenario"]} ("{message}")'
        parts.append(f"`{name}` {status} in {count(len(group), 'case')}, such as {example}")
    if rows:
        short = f"{count(len(rows), 'case')} of {len(run.results)} ended without a trajectory"
        yield Finding("Failed cases", f"{short}: {'; '.join(parts)}.", "bad", f"{short}.", (lay_out("behind_failed", rows),))
