"""The truth: what every error is measured against, how far it can be trusted, and below what no engine can be told apart."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    Block,
    Bullets,
    Cell,
    Finding,
    Section,
    Table,
    Text,
    columns,
    count,
    error_cell,
    text_cell,
    texts,
)
from gauss_bench.report.rows import Row, Run, is_known, measure, number

PLACE = 50
TABLES = ("references", "certificates", "published")
REFERENCES = (
    "An error bar is the largest disagreement of two integrations, made as the last column says, and the rounding of what is "
    "stored; no digit below it is used."
)
CERTIFICATES = (
    "A certificate is made by two pipelines that share neither integrator nor equations: a Taylor series in 128-bit arithmetic on "
    "loop coordinates, whose rounded values are stored, and Gauss-Legendre collocation of order 20 in long double on absolute "
    "coordinates, projected. Their largest disagreement up to a time is the error bar there. Both start from the decimals of the "
    "linkage file. **Floor** is how far positions move when all parameters change by 1e-16 of themselves, which is about what "
    "rounding them to doubles does: below it engines in double precision cannot be told apart, and the tables print them so."
)
CLOSED_FORMS = (
    "Where the motion is known in closed form, to 40 digits, that is the truth, and both pipelines are judged by it: the largest "
    "error of any position until the time at which each ended."
)
PUBLISHED = (
    "Andrews' squeezing mechanism is the field's test problem of seven bodies; its reference values at t = 0.03 s are those of the "
    "IVP test set, computed by PSIDE with tolerances of 1e-14 and copied ever since. Held against the certified motion, the digits "
    "beyond the true ones are the integrator's error, not the mechanism."
)


def section(run: Run) -> Section:
    blocks: list[Block] = []
    if run.table("references"):
        blocks += [Text(REFERENCES), _references(run.table("references"))]
    if run.table("certificates"):
        plain = [row for row in run.table("certificates") if not is_known(row.get("taylor_off_closed_form"))]
        exact = [row for row in run.table("certificates") if is_known(row.get("taylor_off_closed_form"))]
        blocks += [Text(CERTIFICATES), _certificates(plain)]
        early = tuple(_early(row) for row in run.table("certificates") if row["status"] != "ok" or row["complete"] is False)
        blocks += [Bullets(early)] if early else []
        blocks += [Text(CLOSED_FORMS), _closed_forms(exact)] if exact else []
    if run.table("published"):
        blocks += [Text(PUBLISHED), _publish(run.table("published"))]
    return Section("The truth", "references", tuple(blocks) or (Text("The run recorded no references."),))


def _references(rows: tuple[Row, ...]) -> Table:
    head, numeric = columns(
        ("linkage", "scenario", "measured", "until s", "bar q", "bar v", "floor q", "after 0.5 s", "1 s", "2 s", "method"),
        3,
        last_text=1,
    )
    lines = []
    for row in rows:
        until = Cell(f"{number(row, 't_end'):g}", number(row, "t_end"))
        bars = tuple(error_cell(row, x) for x in ("error_bar_q", "error_bar_v", "floor_q"))
        angles = tuple(_angle(number(row, f"measured_t{t}")) for t in ("05", "1", "2"))
        names = (*texts(row, "mechanism", "scenario"), text_cell(measure([row])))
        lines.append((*names, until, *bars, *angles, text_cell(row["method"])))
    return Table("References", head, tuple(lines), numeric, note="Bars in m, rad and m/s, rad/s; what is measured in its unit.")


def _certificates(rows: list[Row]) -> Table:
    bars = ("error_q", "error_v", "error_a", "error_multipliers", "floor_q", "taylor_drift_q", "collocation_drift_q")
    names = ("linkage", "scenario", "digits", "until s", "bar q", "bar v", "bar a", "bar forces", "floor q", "drift A", "drift B")
    head, numeric = columns(names, 2)
    lines = []
    for row in rows:
        counts = tuple(
            Cell(f"{number(row, x):g}", number(row, x)) if is_known(row.get(x)) else Cell("-") for x in ("digits", "until")
        )
        lines.append((text_cell(row["mechanism"]), text_cell(row["scenario"]), *counts, *(error_cell(row, x) for x in bars)))
    note = "Digits of positions and velocities; bars and floor at the last time, in SI units; drift: how far the loops open."
    return Table("Certificates", head, tuple(lines), numeric, note=note)


def _closed_forms(rows: list[Row]) -> Table:
    head, numeric = columns(("linkage", "scenario", "Taylor until s", "error", "collocation until s", "error"), 2)
    lines = []
    for row in rows:
        cells = []
        for x in ("taylor", "collocation"):
            cells += [Cell(f"{number(row, f'{x}_until'):g}", number(row, f"{x}_until")), error_cell(row, f"{x}_off_closed_form")]
        lines.append((text_cell(row["mechanism"]), text_cell(row["scenario"]), *cells))
    return Table("Closed forms", head, tuple(lines), numeric)


def _publish(rows: tuple[Row, ...]) -> Table:
    names = ("linkage", "quantity", "published", "certified", "difference", "floor", "digits printed", "true")
    head, numeric = columns(names, 2)
    lines = []
    for row in rows:
        texts = tuple(text_cell(row[x]) for x in ("mechanism", "quantity", "published", "certified"))
        counts = tuple(Cell(f"{number(row, x):g}", number(row, x)) for x in ("printed_digits", "true_digits"))
        lines.append((*texts, error_cell(row, "difference"), error_cell(row, "floor"), *counts))
    return Table("Published values", head, tuple(lines), numeric)


def _early(row: Row) -> str:
    until = f"until {number(row, 'until'):g} s" if is_known(row.get("until")) else "not at all"
    return f"`{row['mechanism']}` {row['scenario']} is certified {until}: {row['message']}."


def _angle(x: float) -> Cell:
    return Cell(f"{x:.15f}", x) if x == x else Cell("-")


def findings(run: Run) -> Iterator[Finding]:
    """State how good published reference values are."""
    off = [
        row
        for row in run.table("published")
        if number(row, "difference") > 10 * max(number(row, "floor"), number(row, "error_bar"))
    ]
    if off:
        worst = min(off, key=lambda row: number(row, "true_digits"))
        digits = f"{number(worst, 'printed_digits'):g} digits, of which {number(worst, 'true_digits'):g} are true"
        printed = count(len(run.table("published")), "value")
        text = f"The IVP test set prints {printed} for Andrews' squeezing mechanism, copied ever since; "
        text += (
            f"{len(off)} are off by more than ten times what the certified motion leaves open: {worst['quantity']} is printed with "
        )
        text += f"{digits}."
        yield Finding("Published values", text, "warn")
