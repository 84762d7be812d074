"""The audit of three papers, line by line: the printed form, the right form, the computed error of both, and the cause."""

from collections.abc import Iterable, Iterator, Sequence

from gauss_bench.report.content import TONES, Block, Finding, Section, Text, blocks_of, lay_out, layouts
from gauss_bench.report.rows import Row, Run, group_by
from gauss_bench.report.words import count, error_text, itemise

PLACE = 70
VERDICTS = {
    "ok": "right as printed",
    "misprint": "misprinted",
    "not given": "left out",
    "unreadable": "unreadable in the extracted text",
}


def section(run: Run) -> Section:
    """Return the section with three tables for each paper: causes of errors, lines that are not right as printed, and right lines.

    A line of the audit is a formula or a statement of a paper. The last table has the lines with numbers to check by hand.
    """
    audit = run.table("audit")
    if not audit:
        return Section("The papers, audited", "papers", (Text("The run audited no paper."),))
    blocks: list[Block] = [Text(summarise(audit)), Text(layouts()["audit"]["introduction"])]
    for paper, rows in group_by(audit, "paper").items():
        # `stands`: the measurement agrees with the verdict
        right = [row for row in rows if row["verdict"] == "ok" and row["stands"]]
        others = [row for row in rows if row not in right]
        source = [rows[0][key] for key in ("cited", "assumed") if rows[0].get(key)]  # sentences on the whole paper
        blocks.append(Text(f"**{paper}.** {' '.join(source)}"))
        blocks += blocks_of("audit_causes", list_causes(others), paper=paper)
        blocks += blocks_of("audit", [mark_contradiction(row) for row in others], paper=paper)
        blocks += blocks_of("audit_right", right, paper=paper)
    blocks += blocks_of("audit_numbers", [row for row in audit if row["example"]])
    return Section("The papers, audited", "papers", blocks)


def summarise(rows: Sequence[Row]) -> str:
    """Return sentences on the number of audited lines with each verdict, paper by paper, and on contradicted verdicts."""
    papers = group_by(rows, "paper")
    parts = [f"{paper}: {count(len(group), 'line')}; {count_verdicts(group)}." for paper, group in papers.items()]
    contradicted = [f"{row['paper']} {row['equation']} ({row['name']}: {row['faults']})" for row in rows if not row["stands"]]
    if contradicted:
        parts.append(f"**Verdicts that the measurement contradicts: {itemise(contradicted)}.**")
    return " ".join(parts)


def mark_contradiction(row: Row) -> Row:
    """Return a row; if the measurement contradicts the verdict, the text of the verdict says so."""
    return row if row["stands"] else {**row, "verdict": f"{row['verdict']}, contradicted: {row['faults']}", "verdict_tone": "bad"}


def list_causes(rows: Sequence[Row]) -> list[Row]:
    """Return a row for each cause of errors, with the number and the equation numbers of the lines that it makes wrong."""
    causes: list[Row] = []
    for group in group_causes(rows).values():
        verdict = group[0]["verdict"]
        words = {"verdict": VERDICTS.get(verdict, verdict), "verdict_tone": TONES.get(verdict, "")}
        equations = ", ".join(dict.fromkeys(row["equation"] for row in group))
        causes.append({**group[0], **words, "lines": len(group), "where": equations})
    return causes


def group_causes(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """Return (paper, cause of errors) -> the audited lines that are wrong for this cause; lines without a cause are left out."""
    return group_by((row for row in rows if row.get("cause")), "paper", "cause")


def count_verdicts(rows: Iterable[Row]) -> str:
    """Return in words the numbers of lines with each verdict, and of causes: "3 right as printed and 4 misprinted (2 causes)"."""
    parts = []
    for verdict, group in group_by(rows, "verdict").items():
        causes = len(group_causes(group))
        parts.append(f"{len(group)} {VERDICTS.get(verdict, verdict)}" + (f" ({count(causes, 'cause')})" if causes else ""))
    return itemise(parts)


def findings(run: Run) -> Iterator[Finding]:
    """Yield a finding on the verdicts, and one on a printed formula that is wrong although its constraint residuals are zero."""
    yield from find_verdicts(run.table("audit"))
    yield from find_hidden_error(run.table("audit"))


def find_verdicts(lines: Sequence[Row]) -> Iterator[Finding]:
    """Yield a finding on the number of lines by verdict, the wrong statements, and verdicts that a measurement contradicts."""
    if not lines:
        return
    right = sum(row["verdict"] == "ok" for row in lines)
    wrong = [f"{row['equation']} of {row['paper']}" for row in lines if row["verdict"] == "wrong"]
    contradicted = [row["name"] for row in lines if not row["stands"]]
    computed = f"Of {count(len(lines), 'line')} of {count(len({row['paper'] for row in lines}), 'paper')} that were computed"
    text = f"{computed}: {count_verdicts(lines)}."
    text += f" Wrong as statements: {itemise(dict.fromkeys(wrong))}." if wrong else ""
    short = f"{computed}, {right} are right as printed and {len(wrong)} wrong as statements."
    tone = "good" if right == len(lines) else "warn"
    if contradicted:
        text += f" **The measurement contradicts the verdict on {itemise(contradicted)}.**"
        short, tone = "", "bad"
    yield Finding("What the papers print", text, tone, short, (lay_out("behind_audit", lines),))


def find_hidden_error(lines: Sequence[Row]) -> Iterator[Finding]:
    """Yield a finding on a printed formula whose accelerations satisfy all constraints and are still wrong."""
    # `stands`: the measurement agrees with the verdict of the line; `printed_off`: error of the formula as printed
    rows = {row["name"]: row for row in lines}
    meets, off = rows.get("meets the constraints"), rows.get("with Moore-Penrose inverses")
    if meets is None or off is None or not (meets["stands"] and off["stands"]):
        return
    yield Finding(
        "A printed formula whose error no residual shows",
        f"Eq. {off['equation']} of {off['paper']}, read with Moore-Penrose inverses, meets every constraint to "
        f"{error_text(meets['printed_off'])} and gives {off['example_printed']:.4g} for the {off['example']}, where the truth is "
        f"{off['example_true']:.4g}.",
        "warn",
        behind=(lay_out("behind_hidden", (meets, off)),),
    )
