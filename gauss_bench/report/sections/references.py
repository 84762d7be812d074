"""The reference motions, against which errors are measured, with their error bars and floors.

A floor is the change of the motion if every parameter of the file changes by a relative 1e-16, as by rounding to a double.
"""

from collections.abc import Iterator

from gauss_bench.report.cases import measured_head
from gauss_bench.report.content import Bullets, Finding, Section, Text, blocks_of, lay_out
from gauss_bench.report.rows import Run, is_known, number, with_number
from gauss_bench.report.words import count

PLACE = 50


def section(run: Run) -> Section:
    """Return the section with tables of references, certificates, closed forms and published values."""
    certificates = run.table("certificates")
    exact = with_number(certificates, "taylor_off_closed_form")  # of motions that are known in closed form
    early = []  # sentences on certificates that end early
    for row in certificates:
        if row["status"] != "ok" or row["complete"] is False:
            until = f"until {row['until']:g} s" if is_known(row.get("until")) else "not at all"
            early.append(f"`{row['mechanism']}` {row['scenario']} is certified {until}: {row['message']}.")
    blocks = (
        *blocks_of("references", [{**row, "what": measured_head([row])} for row in run.table("references")]),
        *blocks_of("certificates", [row for row in certificates if row not in exact]),
        *([Bullets(early)] if early else []),
        *blocks_of("closed_forms", exact),
        *blocks_of("published", run.table("published")),
    )
    return Section("The truth", "references", blocks or (Text("The run recorded no references."),))


def findings(run: Run) -> Iterator[Finding]:
    """Yield a finding on published values that are off by more than ten times both error bar and floor."""
    rows = run.table("published")
    off = [row for row in rows if number(row, "difference") > 10 * max(number(row, "floor"), number(row, "error_bar"))]
    if off:
        worst = min(off, key=lambda row: number(row, "true_digits"))
        text = (
            f"The IVP test set prints {count(len(rows), 'value')} for Andrews' squeezing mechanism; {len(off)} are off by more "
            f"than ten times the error bar of the certified motion. The worst, {worst['quantity']}, is printed with "
            f"{worst['printed_digits']:g} digits, of which {worst['true_digits']:g} are true."
        )
        yield Finding("Published values", text, "warn", behind=(lay_out("published", rows),))
