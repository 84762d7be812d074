"""Four questions that a reader has first, each with one sentence, one number and one small figure out of stored rows."""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

from gauss_bench.report.content import Chart, count, error, times
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number, ok, plain
from gauss_bench.report.site.charts import FLOOR, bars

HOLDS = 1e-4  # [m, rad] a loop that opens by less is called held: a tenth of a millimetre
STEP = 1e-3  # [s] that engines are compared at as shipped


@dataclass(frozen=True)
class Card:
    """A question with its answer, and the page that says more."""

    question: str
    sentence: str
    number: str
    unit: str
    chart: Chart | None
    page: str
    more: str


def small(
    name: str, title: str, description: str, spec: dict[str, object], rows: list[dict[str, object]], head: dict[str, str]
) -> Chart:
    return Chart(f"card-{name}", title, description, spec, tuple(rows), head, small=True)


def as_shipped(run: Run) -> dict[str, Row]:
    """Engine -> where its loops open most, of its cases with default settings, no stabilisation added and a step of STEP.

    Of several integrators the one that opens them least stands for the engine.
    """
    rows = [
        r
        for r in run.results
        if ok(r) and not r["control"] and r["settings"] == "default" and plain(r) and abs(number(r, "step") - STEP) < 1e-9
    ]
    worst: dict[str, Row] = {}
    for (engine, _), some in group_rows(
        (r for r in rows if is_known(r.get("position_drift"))), lambda r: (str(r["engine"]), str(r["integrator"]))
    ).items():
        row = max(some, key=lambda r: number(r, "position_drift"))
        if engine not in worst or number(row, "position_drift") < number(worst[engine], "position_drift"):
            worst[engine] = row
    return worst


def loops(run: Run) -> Card | None:
    """Do loops hold by default?"""
    worst = as_shipped(run)
    if not worst:
        return None
    drift = {name: number(row, "position_drift") for name, row in worst.items()}
    held = sorted(name for name, x in drift.items() if x <= HOLDS)
    loosest = max(drift, key=lambda x: drift[x])
    where = worst[loosest]
    sentence = (
        f"With default settings, its best integrator and a step of {STEP:g} s, {len(held)} of "
        f"{count(len(drift), 'engine')} hold every loop within "
        f"{1e3 * HOLDS:g} mm (or {HOLDS:g} rad); the loosest, `{loosest}`, opens one by {error(drift[loosest])} on "
        f"{where['mechanism']} ({where['integrator']})."
    )
    rows = [{"name": name, "y": max(x, FLOOR)} for name, x in sorted(drift.items(), key=lambda x: x[1])]
    spec = bars(rows, "largest opening of any loop [m, rad]", logarithmic=True, rule=HOLDS)
    drawn = small(
        "loops",
        "Loops as shipped",
        "Largest residual of the constraints; the dashed line is 0.1 mm.",
        spec,
        rows,
        {"name": "engine", "y": "largest opening [m, rad]"},
    )
    return Card(
        "Do loops hold by default?",
        sentence,
        f"{len(held)} of {len(drift)}",
        "engines keep them shut",
        drawn,
        "engines.html",
        "Engines, and what holds their loops",
    )


def gauss_or_lagrange(run: Run) -> Card | None:
    """Gauss or Lagrange, with nothing else that differs?"""
    rows = sorted((r for r in run.table("kernel_claim") if is_known(r.get("ratio"))), key=lambda r: -number(r, "ratio"))
    if not rows:
        return None
    on = {x: [r for r in rows if r["verdict"] == x] for x in ("holds", "open", "reversed")}
    middle = median(number(r, "ratio") for r in rows)
    sentence = (
        f"Compiled by the same generator, a step by Gauss (n - m unknowns) is faster than one by Lagrange multipliers (n + m) on "
        f"{len(on['holds'])} of {count(len(rows), 'linkage')}, slower on {len(on['reversed'])}, and not to be told apart on "
        f"{len(on['open'])}; the middle ratio of times is {times(middle)}."
    )
    shown = [
        {"name": str(r["mechanism"]), "y": number(r, "ratio"), "low": number(r, "ratio_low"), "high": number(r, "ratio_high")}
        for r in rows
    ]
    drawn = small(
        "gauss",
        "Lagrange's time over Gauss's",
        "Median of several processes, and where a second race falls; right of the dashed line Gauss is faster.",
        bars(shown, "time of a step, Lagrange / Gauss (logarithmic)", logarithmic=True, rule=1.0, written="~g"),
        shown,
        {"name": "linkage", "y": "ratio", "low": "least", "high": "largest"},
    )
    return Card(
        "Gauss or Lagrange?",
        sentence,
        times(middle),
        "times as fast, in the middle",
        drawn,
        "papers.html#claim",
        "The claim, linkage by linkage",
    )


def paper(run: Run) -> Card | None:
    """Is the paper right?"""
    rows = run.table("audit")
    if not rows:
        return None
    fine = [r for r in rows if r["verdict"] == "ok"]
    wrong = [r for r in rows if r["verdict"] == "wrong"]
    sentence = (
        f"Of {count(len(rows), 'statement')} of {count(len({r['paper'] for r in rows}), 'paper')} that can be "
        f"computed, {len(fine)} are right as printed "
        f"and {len(wrong)} wrong as statements; the others are slips, left out, loose or unreadable in our text."
    )
    kinds = group_rows(rows, lambda r: str(r["verdict"]))
    shown = [
        {"name": "right as printed" if k == "ok" else k, "y": len(v)} for k, v in sorted(kinds.items(), key=lambda x: -len(x[1]))
    ]
    drawn = small(
        "paper",
        "Statements by verdict",
        "Each was computed as printed and held against the truth.",
        bars(shown, "statements"),
        shown,
        {"name": "verdict", "y": "statements"},
    )
    return Card(
        "Is the paper right?",
        sentence,
        f"{len(fine)} of {len(rows)}",
        "statements hold as printed",
        drawn,
        "papers.html",
        "Every line, as printed and as it should read",
    )


def trust(run: Run) -> Card | None:
    """The card "Why trust this?"."""
    rows = [r for r in run.table("certificates") if r["status"] == "ok" and is_known(r.get("digits"))]
    bars_of = [r for r in run.table("references") if is_known(r.get("error_bar_q"))]
    drawn = None
    if rows:
        least = min(rows, key=lambda r: number(r, "digits"))
        figure, unit = f"{number(least, 'digits'):g}", "digits at least"
        sentence = (
            "Errors are measured against motions that two independent pipelines agree on: "
            f"{count(len(rows), 'scenario')} to at least {figure} digits, the fewest on {least['mechanism']}."
        )
        kinds = group_rows(sorted(rows, key=lambda r: -number(r, "digits")), lambda r: f"{number(r, 'digits'):g} digits")
        shown = [{"name": k, "y": len(v)} for k, v in kinds.items()]
        drawn = small(
            "trust",
            "Certified digits",
            "Of positions and velocities: how many scenarios have how many.",
            bars(shown, "scenarios"),
            shown,
            {"name": "digits", "y": "scenarios"},
        )
    elif bars_of:
        worst = max(bars_of, key=lambda r: number(r, "error_bar_q"))
        figure, unit = error(number(worst, "error_bar_q")), "the widest bar"
        sentence = f"Errors are measured against references whose own bars are at most {figure} (m, rad), on {worst['mechanism']}."
    else:
        return None
    return Card("Why trust this?", sentence, figure, unit, drawn, "method.html", "Method, limits first")


CARDS: tuple[Callable[[Run], Card | None], ...] = (loops, gauss_or_lagrange, paper, trust)
