"""The references and how far they can be trusted."""

from gauss_bench.report.rows import Run, number
from gauss_bench.report.tables import Cell, Section, Table, Text, columns, error_cell, text_cell


def section(run: Run) -> Section:
    if not run.references:
        return Section("References", "references", (Text("The run recorded no references."),))
    head, numeric = columns(
        ("linkage", "scenario", "until s", "bar q", "bar v", "crank 0.5 s", "1 s", "2 s", "method"), 2, last_text=1
    )
    lines = []
    for row in run.references:
        until = Cell(f"{number(row, 't_end'):g}", number(row, "t_end"))
        bars = (error_cell(row, "error_bar_q"), error_cell(row, "error_bar_v"))
        angles = tuple(_angle(number(row, f"crank_t{t}")) for t in ("05", "1", "2"))
        lines.append((text_cell(row["mechanism"]), text_cell(row["scenario"]), until, *bars, *angles, text_cell(row["method"])))
    words = "An error bar is the largest disagreement of two integrations, made as the last column says; no digit below it is used."
    table = Table("References", head, tuple(lines), numeric, note="Bars in m, rad and m/s, rad/s; crank angles in rad.")
    return Section("References", "references", (Text(words), table))


def _angle(x: float) -> Cell:
    return Cell(f"{x:.12f}", x) if x == x else Cell("-")
