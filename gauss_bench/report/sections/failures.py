"""Cases without a trajectory, each kind with its sentence."""

import re
from collections.abc import Iterator, Sequence

from gauss_bench.report.content import Block, Cell, Finding, Section, Table, Text, columns, count, itemise, text_cell
from gauss_bench.report.rows import Row, Run, group_rows, is_known, ok

PLACE = 80
TABLES = ("results", "untimed")
NUMBER = re.compile(r"\d[\d.e+-]*")


def section(run: Run) -> Section:
    failed = [row for row in run.results if not ok(row)]
    invalid = [row | {"message": row.get("flag", "")} for row in map(dict, run.results) if ok(row) and not row["valid"]]
    lost = [row for row in run.table("untimed") if row["status"] != "skip"]
    if not failed and not invalid and not lost:
        return Section("Skipped and failed cases", "failures", (Text("None: every case of the run ended and is valid."),))
    blocks: list[Block] = [Text("Cases that ended for the same reason share a line; none of them is in a figure or a ranking.")]
    for skipped, title in ((False, "Failed"), (True, "Skipped: not modelled, with the adapter's reason")):
        rows = [row for row in failed if (row["status"] == "skip") == skipped]
        if rows:
            blocks.append(reasons(title, rows))
    if invalid:
        blocks.append(reasons("Ended, but not valid: the judge's reason", invalid, "not valid"))
    if lost:
        blocks.append(costs(lost))
    return Section("Skipped and failed cases", "failures", tuple(blocks))


def costs(lost: list[Row]) -> Table:
    """Cost samples that could not be taken, with the engine's sentence."""
    head, numeric = columns(("engine", "linkage", "settings", "integrator", "quantity", "sentence"), 5, last_text=1)
    keys = ("mechanism", "settings", "integrator", "quantity", "message")
    lines = [(text_cell(x.get("engine", ""), "engine"), *(text_cell(x.get(key, "")) for key in keys)) for x in lost]
    return Table("Costs that could not be measured", head, tuple(lines), numeric)


def reasons(title: str, rows: Sequence[Row], word: str = "") -> Table:
    """One line per engine, status and sentence, whatever its numbers."""
    head, numeric = columns(("engine", "status", "where", "cases", "sentence"), 3, last_text=1)
    lines = []
    for (engine, status, _), group in group_rows(rows, lambda r: (r["engine"], r["status"], NUMBER.sub("#", r["message"]))).items():
        message = group[0]["message"] + (" (numbers of the first)" if len({r["message"] for r in group}) > 1 else "")
        tone = "warn" if status == "skip" else "bad"
        cases = Cell(str(len(group)), float(len(group)))
        lines.append(
            (text_cell(engine, "engine"), text_cell(word or status, tone), text_cell(where(group)), cases, text_cell(message))
        )
    return Table(f"{title} ({count(len(rows), 'case')})", head, tuple(lines), numeric)


def where(rows: Sequence[Row]) -> str:
    """Linkages and choices in which a group of cases differ."""
    parts = [itemise(sorted({f"{r['mechanism']} {r['scenario']}" for r in rows}))]
    for key in ("settings", "integrator", "stabilization"):
        parts.append("/".join(sorted({r[key] for r in rows} - {""})))
    steps = sorted({row["step"] for row in rows if is_known(row["step"])})
    parts.append(f"step {', '.join(f'{x:g}' for x in steps)}" if steps else "")
    return "; ".join(part for part in parts if part)


def findings(run: Run) -> Iterator[Finding]:
    rows = [row for row in run.results if row["status"] not in ("ok", "invalid", "skip")]
    if rows:
        groups = group_rows(rows, lambda r: (r["engine"], r["status"])).items()
        why = "; ".join(f"`{name}` {status} in {count(len(group), 'case')}, {_first(group)}" for (name, status), group in groups)
        text = f"{count(len(rows), 'case')} of {len(run.results)} ended without a trajectory: {why}."
        yield Finding("Failed cases", text, "bad")


def _first(group: list[Row]) -> str:
    row = group[0]
    sentence = " ".join(str(row["message"]).split()).rstrip(".").replace("`", "") or "no message"
    return f'such as {row["mechanism"]} {row["scenario"]} ("{sentence}")'
