"""The references: the motions against which errors are measured, with their error bars and floors."""

from collections.abc import Iterator

from gauss_bench.report.content import Bullets, Finding, Section, Text, blocks_of, count
from gauss_bench.report.rows import Row, Run, is_known, measure, number

PLACE = 50
TABLES = ("references", "certificates", "published")


def section(run: Run) -> Section:
    certificates = run.table("certificates")
    exact = [row for row in certificates if is_known(row.get("taylor_off_closed_form"))]
    early = tuple(_early(row) for row in certificates if row["status"] != "ok" or row["complete"] is False)
    blocks = (
        *blocks_of("references", [{**row, "what": measure([row])} for row in run.table("references")]),
        *blocks_of("certificates", [row for row in certificates if row not in exact]),
        *([Bullets(early)] if early else []),
        *blocks_of("closed_forms", exact),
        *blocks_of("published", run.table("published")),
    )
    return Section("The truth", "references", blocks or (Text("The run recorded no references."),))


def _early(row: Row) -> str:
    until = f"until {number(row, 'until'):g} s" if is_known(row.get("until")) else "not at all"
    return f"`{row['mechanism']}` {row['scenario']} is certified {until}: {row['message']}."


def findings(run: Run) -> Iterator[Finding]:
    """Yield how many published reference values are wrong beyond their printed digits."""
    rows = run.table("published")
    off = [row for row in rows if number(row, "difference") > 10 * max(number(row, "floor"), number(row, "error_bar"))]
    if off:
        worst = min(off, key=lambda row: number(row, "true_digits"))
        text = (
            f"The IVP test set prints {count(len(rows), 'value')} for Andrews' squeezing mechanism, copied ever since; {len(off)} "
            f"are off by more than ten times what the certified motion leaves open: {worst['quantity']} is printed with "
            f"{number(worst, 'printed_digits'):g} digits, of which {number(worst, 'true_digits'):g} are true."
        )
        yield Finding("Published values", text, "warn")
