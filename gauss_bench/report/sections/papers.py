"""The three papers, line by line: what is printed, what is right, how far off each is when computed, and why it fails."""

from collections.abc import Iterable, Iterator, Sequence

from gauss_bench.report.content import Block, Cell, Finding, Section, Table, Text, columns, count, error, itemise, text_cell
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number

PLACE = 70
TABLES = ("audit",)
SAID = {"ok": "right as printed", "misprint": "misprinted", "not given": "left out", "unreadable": "unreadable in our text"}
WORDS = (
    "The suite stands on three papers. Every statement of theirs that can be computed is computed here: as printed and, where that "
    "fails, as it should read, both against a truth that knows neither. Whether a line holds follows from the two discrepancies. "
    "Lines that fail for one and the same reason have one **cause** and are one mistake. **Wrong** is what fails as a statement, "
    "**misprint** a slip whose meaning is clear, **loose** what holds under a condition that is not stated, **not given** what is "
    "left out and assumed here. The papers were read as texts extracted from their pages: **unreadable** is what fails in our text "
    "by a mark that the extraction is likely to have lost or added, and is not held against the paper."
)
NOTE = "Off: discrepancy of the form when computed; what it is and why the tolerance is what it is stands in `audit.csv`."
BY_HAND = "Single numbers that follow from the forms, for a reader who wants to check one."
TONES = {"ok": "good", "wrong": "bad", "misprint": "warn", "loose": "warn"}


def section(run: Run) -> Section:
    if not run.table("audit"):
        return Section("The papers, audited", "papers", (Text("The run audited no paper."),))
    blocks: list[Block] = [Text(WORDS), Text(summary(run.table("audit")))]
    for paper, rows in group_rows(run.table("audit"), lambda row: str(row["paper"])).items():
        off = [row for row in rows if row["verdict"] != "ok" or not row["stands"]]
        sound = [row for row in rows if row not in off]
        told = [str(rows[0][key]) for key in ("cited", "assumed") if rows[0].get(key)]
        blocks.append(Text(f"**{paper}.** {' '.join(told)}"))
        if any(row.get("cause") for row in off):
            blocks.append(reasons(f"{paper}: causes", off))
        if off:
            blocks.append(faulty(f"{paper}: what is not right as printed", off))
        if sound:
            blocks.append(right(f"{paper}: what is right as printed", sound))
    numbers = [row for row in run.table("audit") if row["example"]]
    if numbers:
        blocks += [Text(BY_HAND), by_hand(numbers)]
    return Section("The papers, audited", "papers", tuple(blocks))


def summary(rows: Sequence[Row]) -> str:
    """Count how many lines and causes of each paper came out how; name each verdict that disagrees with its measurement."""
    parts = [
        f"{paper}: {count(len(group), 'line')}; {verdicts(group)}."
        for paper, group in group_rows(rows, lambda row: str(row["paper"])).items()
    ]
    fallen = [f"{row['paper']} {row['equation']} ({row['name']}: {row['faults']})" for row in rows if not row["stands"]]
    return " ".join(parts) + (f" **Verdicts that the measurement contradicts: {itemise(fallen)}.**" if fallen else "")


def verdict_cell(row: Row) -> Cell:
    if not row["stands"]:
        return text_cell(f"{row['verdict']}, contradicted: {row['faults']}", "bad")
    return text_cell(row["verdict"], TONES.get(str(row["verdict"]), ""))


def off_cell(row: Row, column: str) -> Cell:
    x = number(row, column)
    return Cell("0" if x == 0 else error(x), x if is_known(x) else "")


def reasons(title: str, rows: Sequence[Row]) -> Table:
    """Each cause once, with the lines that fail for it."""
    head, numeric = columns(("cause", "verdict", "lines", "where", "why it fails", "may the extract be at fault?"), 2, last_text=3)
    cells = tuple(
        (
            text_cell(cause),
            text_cell(SAID.get(str(group[0]["verdict"]), group[0]["verdict"]), TONES.get(str(group[0]["verdict"]), "")),
            Cell(str(len(group)), len(group)),
            text_cell(", ".join(dict.fromkeys(str(row["equation"]) for row in group))),
            text_cell(group[0]["cause_text"]),
            text_cell(group[0]["doubt"]),
        )
        for (_, cause), group in causes(rows).items()
    )
    return Table(title, head, cells, numeric)


def faulty(title: str, rows: Sequence[Row]) -> Table:
    names = ("equation", "what", "cause", "printed", "right", "verdict", "printed off", "right off", "tolerance", "remark")
    head, numeric = columns(names, 6, last_text=1)
    lines = tuple(
        (
            *(text_cell(row[key]) for key in ("equation", "name", "cause")),
            *(text_cell(row[key], "formula") for key in ("printed", "intended")),
            verdict_cell(row),
            *(off_cell(row, key) for key in ("printed_off", "intended_off", "tolerance")),
            text_cell(row["sentence"]),
        )
        for row in rows
    )
    return Table(title, head, lines, numeric, note=NOTE)


def right(title: str, rows: Sequence[Row]) -> Table:
    head, numeric = columns(("equation", "what", "printed", "off", "tolerance", "remark"), 3, last_text=1)
    lines = tuple(
        (
            *(text_cell(row[key]) for key in ("equation", "name")),
            text_cell(row["printed"], "formula"),
            *(off_cell(row, key) for key in ("printed_off", "tolerance")),
            text_cell(row["sentence"]),
        )
        for row in rows
    )
    return Table(title, head, lines, numeric, folded=True, note=NOTE)


def by_hand(rows: Sequence[Row]) -> Table:
    head, numeric = columns(("paper", "equation", "what", "number", "as printed", "as it should read", "truth"), 4)
    lines = tuple(
        (
            *(text_cell(row[key]) for key in ("paper", "equation", "name", "example")),
            *(value_cell(number(row, key)) for key in ("example_printed", "example_intended", "example_true")),
        )
        for row in rows
    )
    return Table("Numbers to check by hand", head, lines, numeric)


def value_cell(x: float) -> Cell:
    return Cell(f"{x:.7g}", x) if is_known(x) else Cell("-")


def findings(run: Run) -> Iterator[Finding]:
    """State how many lines hold, and the fault that no residual gives away."""
    yield from statements(run)
    yield from unseen(run)


def causes(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """(paper, cause) -> its lines; lines without a cause are left out."""
    return group_rows((row for row in rows if row.get("cause")), lambda row: (str(row["paper"]), str(row["cause"])))


def verdicts(rows: Iterable[Row]) -> str:
    """Count the lines by how they came out, with their causes: "3 right as printed, 4 misprinted (2 causes)"."""
    parts = []
    for verdict, group in group_rows(rows, lambda row: str(row["verdict"])).items():
        reasons = len(causes(group))
        parts.append(f"{len(group)} {SAID.get(verdict, verdict)}" + (f" ({count(reasons, 'cause')})" if reasons else ""))
    return itemise(parts)


def statements(run: Run) -> Iterator[Finding]:
    """State how many printed lines hold, for how many causes the others do not, and which are wrong."""
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
    """The printed formula that meets the constraints and is wrong."""
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
