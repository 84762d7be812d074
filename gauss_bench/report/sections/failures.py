"""Cases without a trajectory, each kind with its sentence."""

from gauss_bench.report.rows import Row, Run, grouped, known, ok
from gauss_bench.report.tables import Block, Cell, Section, Table, Text, columns, count, listed, text_cell


def section(run: Run) -> Section:
    failed = [row for row in run.results if not ok(row)]
    if not failed:
        return Section("Skipped and failed cases", "failures", (Text("None: every case of the run ended ok."),))
    blocks: list[Block] = [Text("Cases that ended for the same reason share a line; none of them is in a figure or a ranking.")]
    for skipped, title in ((False, "Failed"), (True, "Skipped: not modelled, with the adapter's reason")):
        rows = [row for row in failed if (row["status"] == "skip") == skipped]
        if rows:
            blocks.append(reasons(title, rows))
    return Section("Skipped and failed cases", "failures", tuple(blocks))


def reasons(title: str, rows: list[Row]) -> Table:
    """One line per engine, status and sentence."""
    head, numeric = columns(("engine", "status", "where", "cases", "sentence"), 3, last_text=1)
    lines = []
    for (engine, status, message), group in grouped(rows, lambda r: (r["engine"], r["status"], r["message"])).items():
        tone = "warn" if status == "skip" else "bad"
        cases = Cell(str(len(group)), float(len(group)))
        lines.append((text_cell(engine, "engine"), text_cell(status, tone), text_cell(where(group)), cases, text_cell(message)))
    return Table(f"{title} ({count(len(rows), 'case')})", head, tuple(lines), numeric)


def where(rows: list[Row]) -> str:
    """Linkages and choices in which a group of cases differ."""
    parts = [listed(sorted({f"{r['mechanism']} {r['scenario']}" for r in rows}))]
    for key in ("settings", "integrator", "stabilization"):
        parts.append("/".join(sorted({r[key] for r in rows} - {""})))
    steps = sorted({row["step"] for row in rows if known(row["step"])})
    parts.append(f"step {', '.join(f'{x:g}' for x in steps)}" if steps else "")
    return "; ".join(part for part in parts if part)
