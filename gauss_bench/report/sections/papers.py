"""The audit of three papers, line by line: the printed form, the right form, the computed error of both, and the cause."""

from collections.abc import Iterable, Iterator, Sequence

from gauss_bench.report.content import TONES, Block, Finding, Section, Text, blocks_of, count, error, itemise, lay_out, layouts
from gauss_bench.report.rows import Row, Run, group_rows, number

PLACE = 70
TABLES = ("audit",)
SAID = {"ok": "right as printed", "misprint": "misprinted", "not given": "left out", "unreadable": "unreadable in our text"}


def section(run: Run) -> Section:
    audit = run.table("audit")
    if not audit:
        return Section("The papers, audited", "papers", (Text("The run audited no paper."),))
    blocks: list[Block] = [Text(layouts()["audit"]["words"]), Text(summary(audit))]
    for paper, rows in group_rows(audit, lambda row: str(row["paper"])).items():
        off = [row for row in rows if row["verdict"] != "ok" or not row["stands"]]
        told = [str(rows[0][key]) for key in ("cited", "assumed") if rows[0].get(key)]
        blocks.append(Text(f"**{paper}.** {' '.join(told)}"))
        blocks += [
            *blocks_of("audit_causes", reasons(off), paper=paper),
            *([lay_out("audit", map(judge_row, off), paper=paper)] if off else []),
            *blocks_of("audit_right", [row for row in rows if row not in off], paper=paper),
        ]
    blocks += blocks_of("audit_numbers", [row for row in audit if row["example"]])
    return Section("The papers, audited", "papers", tuple(blocks))


def summary(rows: Sequence[Row]) -> str:
    """Count the verdicts of each paper's lines, with their causes; name each verdict that its measurement contradicts."""
    papers = group_rows(rows, lambda row: str(row["paper"]))
    parts = [f"{paper}: {count(len(group), 'line')}; {verdicts(group)}." for paper, group in papers.items()]
    fallen = [f"{row['paper']} {row['equation']} ({row['name']}: {row['faults']})" for row in rows if not row["stands"]]
    return " ".join(parts) + (f" **Verdicts that the measurement contradicts: {itemise(fallen)}.**" if fallen else "")


def judge_row(row: Row) -> Row:
    """Return a row whose verdict, if its measurement contradicts it, says so."""
    return row if row["stands"] else {**row, "verdict": f"{row['verdict']}, contradicted: {row['faults']}", "verdict_tone": "bad"}


def reasons(rows: Sequence[Row]) -> list[Row]:
    """Each cause once, with the lines that fail for it."""
    found: list[Row] = []
    for group in causes(rows).values():
        verdict, where = str(group[0]["verdict"]), ", ".join(dict.fromkeys(str(row["equation"]) for row in group))
        said = {"verdict": SAID.get(verdict, verdict), "verdict_tone": TONES.get(verdict, "")}
        found.append({**group[0], **said, "lines": len(group), "where": where})
    return found


def findings(run: Run) -> Iterator[Finding]:
    """Yield how many lines hold, and the printed formula whose residuals hide its error."""
    yield from statements(run)
    yield from unseen(run)


def causes(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """(paper, cause) -> its lines; lines without a cause are left out."""
    return group_rows((row for row in rows if row.get("cause")), lambda row: (str(row["paper"]), str(row["cause"])))


def verdicts(rows: Iterable[Row]) -> str:
    """Count lines by verdict, with their causes: "3 right as printed, 4 misprinted (2 causes)"."""
    parts = []
    for verdict, group in group_rows(rows, lambda row: str(row["verdict"])).items():
        reasons = len(causes(group))
        parts.append(f"{len(group)} {SAID.get(verdict, verdict)}" + (f" ({count(reasons, 'cause')})" if reasons else ""))
    return itemise(parts)


def statements(run: Run) -> Iterator[Finding]:
    """Yield how many printed lines hold, the number of causes for which others fail, and the wrong statements."""
    if not run.table("audit"):
        return
    papers = {row["paper"] for row in run.table("audit")}
    off = [row for row in run.table("audit") if row["verdict"] != "ok"]
    wrong = group_rows((row for row in off if row["verdict"] == "wrong"), lambda row: f"{row['equation']} of {row['paper']}")
    fallen = [str(row["name"]) for row in run.table("audit") if not row["stands"]]
    lines = run.table("audit")
    text = f"Of {count(len(lines), 'line')} of {count(len(papers), 'paper')} that were computed: {verdicts(lines)}."
    text += f" Wrong as statements: {itemise(wrong)}." if wrong else ""
    text += f" **The measurement contradicts the verdict on {itemise(fallen)}.**" if fallen else ""
    yield Finding("What the papers print", text, "bad" if fallen else "warn" if off else "good")


def unseen(run: Run) -> Iterator[Finding]:
    """Yield the printed formula that satisfies all constraints and is still wrong."""
    rows = {str(row["name"]): row for row in run.table("audit")}
    meets, off = rows.get("meets the constraints"), rows.get("with Moore-Penrose inverses")
    if meets is None or off is None or not (meets["stands"] and off["stands"]):
        return
    printed, true = (number(off, f"example_{key}") for key in ("printed", "true"))
    yield Finding(
        "A printed formula that no residual gives away",
        f"Eq. {off['equation']} of {off['paper']}, read with Moore-Penrose inverses, meets every constraint to "
        f"{error(number(meets, 'printed_off'))} and gives {printed:.4g} for the {off['example']}, where the truth is {true:.4g}.",
        "warn",
    )
