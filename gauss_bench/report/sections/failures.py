"""Failed, skipped and invalid cases, grouped by their reason."""

import re
from collections.abc import Iterator, Sequence

from gauss_bench.report.cases import has_ended
from gauss_bench.report.content import Finding, Section, Table, Text, blocks_of, lay_out
from gauss_bench.report.rows import Row, Run, group_by, is_known
from gauss_bench.report.words import count, itemise

PLACE = 80
NUMBER = re.compile(r"\d[\d.e+-]*")
NONE = "None: every case of the run ended and is valid."
SHARED = "Cases that ended for the same reason share a line; none of them is in a figure or a ranking."


def section(run: Run) -> Section:
    """Return the tables of failed, skipped and invalid cases, and of costs that could not be measured."""
    lost = [row for row in run.results if not has_ended(row)]
    invalid = [row for row in run.results if has_ended(row) and not row["valid"]]
    kinds: dict[str, list[Row]] = {
        "Failed": [row for row in lost if row["status"] != "skip"],
        "Skipped: not modelled, with the adapter's reason": [row for row in lost if row["status"] == "skip"],
        "Ended, but not valid: the judge's reason": [
            {**row, "message": row.get("flag", ""), "status": "not valid"} for row in invalid
        ],
    }
    tables = [list_reasons(title, rows) for title, rows in kinds.items() if rows]
    untimed = blocks_of("untimed", [row for row in run.table("untimed") if row["status"] != "skip"])
    blocks = (Text(SHARED), *tables, *untimed) if tables or untimed else (Text(NONE),)
    return Section("Skipped and failed cases", "failures", blocks)


def list_reasons(title: str, rows: Sequence[Row]) -> Table:
    """Return a table with one line per engine, status and sentence; sentences that differ only in numbers are one."""
    lines = []
    for group in group_by(rows, lambda r: (r["engine"], r["status"], NUMBER.sub("#", r["message"]))).values():
        first = group[0]
        message = first["message"] + (" (numbers of the first)" if len({r["message"] for r in group}) > 1 else "")
        tone = "warn" if first["status"] == "skip" else "bad"
        lines.append({**first, "status_tone": tone, "where": describe_cases(group), "cases": len(group), "message": message})
    return lay_out("failures", lines, what=title, cases=count(len(rows), "case"))


def describe_cases(rows: Sequence[Row]) -> str:
    """Return the linkages and settings of a group of cases."""
    parts = [itemise(sorted({f"{r['mechanism']} {r['scenario']}" for r in rows}))]
    for key in ("settings", "integrator", "stabilization"):
        parts.append("/".join(sorted({r[key] for r in rows} - {""})))
    steps = sorted({row["step"] for row in rows if is_known(row["step"])})
    parts.append(f"step {', '.join(f'{x:g}' for x in steps)}" if steps else "")
    return "; ".join(filter(None, parts))


def findings(run: Run) -> Iterator[Finding]:
    """Yield the number of failed cases, with an example for each engine and kind of failure."""
    rows = [row for row in run.results if not has_ended(row) and row["status"] != "skip"]
    parts = []
    for (name, status), group in group_by(rows, "engine", "status").items():
        row = group[0]
        sentence = " ".join(row["message"].split()).rstrip(".").replace("`", "") or "no message"
        example = f'{row["mechanism"]} {row["scenario"]} ("{sentence}")'
        parts.append(f"`{name}` {status} in {count(len(group), 'case')}, such as {example}")
    if rows:
        text = f"{count(len(rows), 'case')} of {len(run.results)} ended without a trajectory: {'; '.join(parts)}."
        short = f"{count(len(rows), 'case')} of {len(run.results)} ended without a trajectory."
        yield Finding("Failed cases", text, "bad", short, (lay_out("behind_failed", rows),))
