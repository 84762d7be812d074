"""The example of Yuan & Ge (2016), a crank-slider, run again; all numbers in the sentences are computed."""

import math
from collections.abc import Iterator, Mapping, Sequence

from gauss_bench.report.content import Block, Bullets, Chart, Finding, Section, Text, blocks_of, error, itemise, layouts
from gauss_bench.report.rows import Row, Run, is_known, number
from gauss_bench.report.site.charts import label, over_time

PLACE = 60
TABLES = ("reproduction", "paper_motion")
TITLE, ANCHOR = "The first paper's example, run again", "reproduction"
DIGITS = 6
CAPTION = "The motion that the paper draws in its figures 2 to 9, from the reference: from the printed start with the printed data."
GROUPS = ("running", "static", "equilibria", "settling", "formulas")


def section(run: Run) -> Section:
    table = run.table("reproduction")
    rows = {str(row["key"]): row for row in table}
    if "stops" not in rows:
        return Section(TITLE, ANCHOR, (Text("The run did not repeat the example."),))
    blocks: list[Block] = [*say(rows), Text(layouts()["reproduction"]["why"]), *paper_figures(run.table("paper_motion"))]
    quantities = [
        {**row, "figure": figure(row), "uncertainty": error(row["bracket"]) if is_known(row["bracket"]) else "rounding"}
        for row in table
        if row["group"] in GROUPS
    ]
    blocks += [
        *blocks_of("reproduction_claims", [row for row in table if row["group"] == "claims"]),
        *blocks_of("reproduction_left_out", [row for row in table if row["group"] == "left out"]),
        *blocks_of("reproduction", quantities),
    ]
    return Section(TITLE, ANCHOR, tuple(blocks))


def say(rows: Mapping[str, Row]) -> list[Block]:
    """Return the sentences of `layouts.toml` on whether the linkage stops, filled in with the run's values."""
    said = {key: f"{figure(row)} {row['unit']}" for key, row in rows.items()}
    at_rest = [row for key, row in rows.items() if key.startswith("rest_at_")]
    said["rests"] = itemise(f"{figure(row)} rad ({str(row['quantity']).removeprefix('comes to rest ')})" for row in at_rest)
    said |= {"stops": str(rows["stops"]["quantity"]), "assumed": assume_values(rows)}
    verdict = f"The paper says that {said['stops']}: with the data of this run it does."
    if rows["stops"]["verdict"] == "refuted":
        verdict = layouts()["reproduction"]["verdict"].format(**said)
    return [Text(verdict), Bullets(tuple(x.format(**said) for x in layouts()["reproduction"]["holding"]))]


def figure(row: Row) -> str:
    """Format a value with as many digits as its uncertainty allows, at most DIGITS."""
    x, bracket = number(row, "value"), number(row, "bracket")
    if not is_known(x):
        return "-"
    if is_known(bracket) and abs(x) <= bracket:
        return "0"
    left = math.floor(math.log10(abs(x) / bracket)) if is_known(bracket) and bracket > 0 and x else DIGITS
    return f"{x:.{max(1, min(DIGITS, left))}g}"


CURVES = (
    ("theta1_rate", "The crank's speed", "speed of the crank [rad/s]"),
    ("x3", "The slider", "place of the slider [m]"),
)


def paper_figures(rows: Sequence[Row]) -> list[Chart]:
    """Return the curves that the paper draws of its example, from the reference; none without rows."""
    charts = []
    for column, title, axis in CURVES if rows else ():
        line = [{"engine": "reference", "line": "reference", "name": "", "x": number(r, "t"), "y": number(r, column)} for r in rows]
        drawn = label([line], logarithmic=False)
        spec = over_time(drawn, axis, logarithmic=False, height=220)
        charts.append(Chart(f"paper-{column}", title, CAPTION, spec, drawn, {"x": "time [s]", "y": axis}))
    return charts


def findings(run: Run) -> Iterator[Finding]:
    """Yield the finding on the mechanism that, according to the paper, stops."""
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
