"""The section on the crank-slider example of Yuan & Ge (2016), computed again; each number in its sentences is computed."""

import math
from collections.abc import Iterator, Mapping, Sequence

from gauss_bench.report.content import Block, Bullets, Chart, Finding, Section, Text, blocks_of, lay_out, layouts
from gauss_bench.report.rows import Row, Run, group_by, is_known, number
from gauss_bench.report.site.charts import place_names, specify_lines
from gauss_bench.report.words import NOTHING, error_text, itemise

PLACE = 60
TITLE, ANCHOR = "The first paper's example, run again", "reproduction"
DIGITS = 6  # largest number of printed digits
# caption of the curves
CAPTION = "The motion that the paper draws in its figures 2 to 9, from the reference: from the printed start with the printed data."
GROUPS = ("running", "static", "equilibria", "settling", "formulas")  # groups of rows that have a value
QUOTED = ("mean", "settles_above", "settles_below", "torque")  # keys of the rows that the finding quotes
CURVES = (  # column of `paper_motion`, title of the figure, axis
    ("theta1_rate", "The crank's speed", "speed of the crank [rad/s]"),
    ("x3", "The slider", "position of the slider [m]"),
)


def section(run: Run) -> Section:
    """Return the section on the paper's example: the verdict with its reasons, the curves that the paper draws, all quantities."""
    table = run.table("reproduction")
    rows = {row["key"]: row for row in table}
    if "stops" not in rows:
        return Section(TITLE, ANCHOR, (Text("The run did not repeat the example."),))
    quantities = list_quantities([row for row in table if row["group"] in GROUPS])
    groups = group_by(table, "group")
    blocks: list[Block] = [*describe_example(rows), Text(layouts()["reproduction"]["why"])]
    blocks += paper_figures(run.table("paper_motion"))
    blocks += blocks_of("reproduction_claims", groups.get("claims", ()))
    blocks += blocks_of("reproduction_left_out", groups.get("left out", ()))
    blocks += blocks_of("reproduction", quantities)
    return Section(TITLE, ANCHOR, blocks)


def list_quantities(rows: Sequence[Row]) -> list[Row]:
    """Return rows of the table `reproduction` with value and uncertainty as texts, in the columns `figure` and `uncertainty`."""
    bars = [error_text(row["bracket"]) if is_known(row["bracket"]) else "rounding" for row in rows]
    return [{**row, "figure": print_value(row), "uncertainty": bar} for row, bar in zip(rows, bars, strict=True)]


def describe_example(rows: Mapping[str, Row]) -> list[Block]:
    """Return the verdict on the paper's statement that its linkage stops, and sentences with values of the run.

    Args:
        rows: key of a quantity -> its row of the table `reproduction`.
    """
    values = {key: f"{print_value(row)} {row['unit']}" for key, row in rows.items()}  # for the {names} in the layout's texts
    at_rest = [row for key, row in rows.items() if key.startswith("rest_at_")]
    values["rests"] = itemise(f"{print_value(row)} rad ({row['quantity'].removeprefix('comes to rest ')})" for row in at_rest)
    values |= {"stops": rows["stops"]["quantity"], "assumed": list_assumed(rows)}
    verdict = f"The paper says that {values['stops']}: with the data of this run it does."
    if rows["stops"]["verdict"] == "refuted":
        verdict = layouts()["reproduction"]["verdict"].format(**values)
    return [Text(verdict), Bullets([x.format(**values) for x in layouts()["reproduction"]["holding"]])]


def print_value(row: Row) -> str:
    """Format a value with the digits that its uncertainty `bracket` leaves, from 1 to DIGITS; "0" for at most `bracket`."""
    x, bracket = number(row, "value"), number(row, "bracket")
    if not is_known(x):
        return NOTHING
    if abs(x) <= bracket:
        return "0"
    certain = math.floor(math.log10(abs(x) / bracket)) if bracket > 0 else DIGITS  # number of digits
    return f"{x:.{max(1, min(DIGITS, certain))}g}"


def paper_figures(rows: Sequence[Row]) -> list[Chart]:
    """Return the charts of the curves that the paper draws of its example, from rows of `paper_motion`; none without rows."""
    charts = []
    for column, title, axis in CURVES if rows else ():
        line = [{"engine": "reference", "line": "reference", "name": "", "x": r["t"], "y": r[column]} for r in rows]
        drawn = place_names([line], logarithmic=False)
        spec = specify_lines(drawn, axis, logarithmic=False, height=220)
        charts.append(Chart(f"paper-{column}", title, CAPTION, spec, drawn, {"x": "time [s]", "y": axis}))
    return charts


def findings(run: Run) -> Iterator[Finding]:
    """Yield a finding if the motion of the run shows that the mechanism does not stop, although the paper says that it does."""
    rows = {row["key"]: row for row in run.table("reproduction")}
    if "stops" not in rows or rows["stops"]["verdict"] != "refuted":
        return
    value = {key: number(row, "value") for key, row in rows.items()}
    yield Finding(
        "The paper's mechanism never stops",
        f'"{rows["stops"]["quantity"].capitalize()}", says the first paper of its example. With the printed data it settles '
        f"into turning at {value['mean']:.4g} rad/s on average; from the printed start it comes to rest only for torques between "
        f"{value['settles_above']:.4f} and {value['settles_below']:.4f} N m, and {value['torque']:g} N m is printed. "
        f"{list_assumed(rows)}",
        "warn",
        "With the printed data the first paper's mechanism does not stop: it settles into turning at "
        f"{print_value(rows['mean'])} rad/s on average.",
        (lay_out("reproduction", list_quantities([r for r in rows.values() if r["key"] in QUOTED]), folded=False),),
    )


def list_assumed(rows: Mapping[str, Row]) -> str:
    """Return a sentence on the numbers that the paper does not give, with the numbers assumed here."""
    left_out = [rows[key] for key in ("inertias", "gravity") if key in rows]
    assumed = itemise(f"the {row['quantity']} ({row['statement'].partition(';')[0]})" for row in left_out)
    return f"The paper does not give {assumed}."
