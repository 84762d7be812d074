"""The example of Yuan & Ge (2016) run again: what becomes of the crank-slider, in sentences whose numbers are the run's."""

import math
from collections.abc import Iterator, Mapping, Sequence

from gauss_bench.report.content import (
    Block,
    Bullets,
    Cell,
    Chart,
    Finding,
    Section,
    Table,
    Text,
    columns,
    error,
    itemise,
    text_cell,
)
from gauss_bench.report.rows import (
    Row,
    Run,
    is_known,
    number,
)
from gauss_bench.report.site.charts import label, over_time

PLACE = 60
TABLES = ("reproduction", "paper_motion")
TITLE, ANCHOR = "The first paper's example, run again", "reproduction"
DIGITS = 6
CAPTION = "The motion that the paper draws in its figures 2 to 9, from the reference: from the printed start with the printed data."
WHY = (
    "The equation of motion has no time in it, so two motions cannot cross in the plane of crank angle and speed: a crank that "
    "has come round once from rest is ahead of its first turn in every later one. A crank that turns back before that is caught "
    "between two angles, and the damper brings it to rest. The first turn therefore decides, and the bounds follow by bisection."
)
GROUPS = ("running", "static", "equilibria", "settling", "formulas")
VERDICTS = {"refuted": "bad", "holds": "good", "not shown": "warn"}


def section(run: Run) -> Section:
    rows = {str(row["key"]): row for row in run.table("reproduction")}
    if "stops" not in rows:
        return Section(TITLE, ANCHOR, (Text("The run did not repeat the example."),))
    blocks: list[Block] = [Text(verdict(rows)), Bullets(tuple(holding(rows))), Text(WHY)]
    blocks += paper_figures(run.table("paper_motion"))
    claims = [row for row in run.table("reproduction") if row["group"] == "claims"]
    omitted = [row for row in run.table("reproduction") if row["group"] == "left out"]
    blocks += [said("What the paper says of its example", claims), list_left_out(omitted), quantities(run.table("reproduction"))]
    return Section(TITLE, ANCHOR, tuple(blocks))


def value(rows: Mapping[str, Row], key: str) -> str:
    """A quantity with its unit."""
    return f"{figure(rows[key])} {rows[key]['unit']}"


def figure(row: Row) -> str:
    """As many digits as the uncertainty leaves, but no more than DIGITS."""
    x, bracket = number(row, "value"), number(row, "bracket")
    if not is_known(x):
        return "-"
    if is_known(bracket) and abs(x) <= bracket:
        return "0"
    left = math.floor(math.log10(abs(x) / bracket)) if is_known(bracket) and bracket > 0 and x else DIGITS
    return f"{x:.{max(1, min(DIGITS, left))}g}"


def verdict(rows: Mapping[str, Row]) -> str:
    """State whether it stops, and what it does instead."""
    if rows["stops"]["verdict"] != "refuted":
        return f"The paper says that {rows['stops']['quantity']}: with the data of this run it does."
    return (
        f'**The paper says that "{rows["stops"]["quantity"]}". For the printed data this is refuted.** {assume_values(rows)} Under '
        f"{value(rows, 'torque')} the crank, at rest at first, comes round after {value(rows, 'first_time')} with "
        f"{value(rows, 'first_speed')} and goes on. From {value(rows, 'steady_after')} on its turns are alike within 1 %: "
        f"{value(rows, 'mean')} on average, between {value(rows, 'slowest')} and {value(rows, 'fastest')}. Each turn takes "
        f"{value(rows, 'taken')} from the torque and loses {value(rows, 'lost')} in the damper; at constant speed the balance "
        f"would be struck at {value(rows, 'balance')}."
    )


def holding(rows: Mapping[str, Row]) -> list[str]:
    """State what does hold, and how far the printed data are from it."""
    at_rest = [row for key, row in rows.items() if key.startswith("rest_at_")]
    rests = itemise(f"{figure(row)} rad ({str(row['quantity']).removeprefix('comes to rest ')})" for row in at_rest)
    return [
        f"There are equilibria at the printed torque, a stable one at {value(rows, 'stable_printed')} and an unstable one at "
        f"{value(rows, 'unstable_printed')}: weight and spring put between {value(rows, 'force_least')} and "
        f"{value(rows, 'force_most')} on the crank. The printed start does not lead to one.",
        f"From that start it does come to rest for torques between {value(rows, 'settles_above')} and "
        f"{value(rows, 'settles_below')}. Then the crank stands at {rests}.",
        f"With the printed torque it comes to rest where the damper is stronger than {value(rows, 'damping')}; the printed one has "
        f"{value(rows, 'damper')}.",
        f"The inertias of crank and rod are not given. Between all their mass in the middle and all of it at the ends, the bound "
        f"of the torque lies between {value(rows, 'settles_above_lowest')} and {value(rows, 'settles_above_highest')}: they do not "
        "change the verdict.",
        f"The wrong formulas do not explain the statement either. After {value(rows, 'watched')} the true crank has "
        f"{value(rows, 'speed_true')}; eq. (16) with Moore-Penrose inverses gives {value(rows, 'speed_eq16')}, the printed "
        f"exponents of (10) and (11) {value(rows, 'speed_eqs10_11')}.",
        "A guess that the texts cannot decide: the same torque the other way round comes to rest.",
    ]


def said(title: str, rows: Sequence[Row]) -> Table:
    head, numeric = columns(("statement", "verdict", "why"), 3)
    lines = tuple(
        (text_cell(r["quantity"]), text_cell(r["verdict"], VERDICTS.get(str(r["verdict"]), "")), text_cell(r["statement"]))
        for r in rows
    )
    return Table(title, head, lines, numeric)


def list_left_out(rows: Sequence[Row]) -> Table:
    head, numeric = columns(("left out", "here"), 2)
    return Table(
        "What the paper leaves out",
        head,
        tuple((text_cell(row["quantity"]), text_cell(row["statement"])) for row in rows),
        numeric,
    )


def quantities(rows: Sequence[Row]) -> Table:
    head, numeric = columns(("group", "quantity", "value", "unit", "uncertainty"), 2)
    lines = tuple(
        (
            text_cell(row["group"]),
            text_cell(row["quantity"]),
            Cell(figure(row), number(row, "value")),
            text_cell(row["unit"]),
            Cell(error(number(row, "bracket"))) if is_known(row["bracket"]) else Cell("rounding"),
        )
        for row in rows
        if row["group"] in GROUPS
    )
    note = "Uncertainty: half the bracket of a bisection plus what a finer or coarser integration moves the value by."
    return Table("All quantities of the example", head, lines, numeric - {3}, folded=True, note=note)


CURVES = (
    ("theta1_rate", "The crank's speed", "speed of the crank [rad/s]"),
    ("x3", "The slider", "place of the slider [m]"),
)


def paper_figures(rows: Sequence[Row]) -> list[Chart]:
    """Figures that the paper draws and gives of its example, out of the reference; nothing without rows."""
    charts = []
    for column, title, axis in CURVES if rows else ():
        line = [{"engine": "reference", "line": "reference", "name": "", "x": number(r, "t"), "y": number(r, column)} for r in rows]
        drawn = label([line], logarithmic=False)
        spec = over_time(drawn, axis, logarithmic=False, height=220)
        charts.append(Chart(f"paper-{column}", title, CAPTION, spec, drawn, {"x": "time [s]", "y": axis}))
    return charts


def findings(run: Run) -> Iterator[Finding]:
    """State what becomes of the mechanism that is said to stop."""
    rows = {str(row["key"]): row for row in run.table("reproduction")}
    if "stops" not in rows or rows["stops"]["verdict"] != "refuted":
        return
    low, high = (number(rows[key], "value") for key in ("settles_above", "settles_below"))
    torque, mean = number(rows["torque"], "value"), number(rows["mean"], "value")
    yield Finding(
        "The paper's mechanism never stops",
        f'"{str(rows["stops"]["quantity"]).capitalize()}", says the first paper of its example. With the printed data it settles '
        f"into turning at {mean:.4g} rad/s on average; from the printed start it comes to rest only for torques between "
        f"{low:.4f} and {high:.4f} N m, and {torque:g} N m is printed. {assume_values(rows)}",
        "warn",
    )


def assume_values(rows: Mapping[str, Row]) -> str:
    """List the numbers that the example needs and the paper does not give, from the reproduction's rows by key."""
    left_out = (rows[key] for key in ("inertias", "gravity") if key in rows)
    taken = (f"the {row['quantity']} ({str(row['statement']).partition(';')[0]})" for row in left_out)
    return f"The paper does not give {itemise(taken)}."
