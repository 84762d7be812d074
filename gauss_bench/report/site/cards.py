"""The four questions on the first screen, each answered by a sentence, a number and a small figure from stored rows."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from gauss_bench.report.content import Chart, count, error, times
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number, ok, plain
from gauss_bench.report.site.charts import FLOOR, bars

HOLDS = 1e-4  # [m, rad] a loop that opens by less counts as held: a tenth of a millimetre
CARD = tomllib.loads((Path(__file__).parent / "assets" / "cards.toml").read_text(encoding="utf-8"))  # words of each
STEP = 1e-3  # [s] that engines are compared at as shipped


@dataclass(frozen=True)
class Card:
    """A question with its answer, and a link to the page with details."""

    question: str
    sentence: str
    number: str
    unit: str
    chart: Chart | None
    page: str
    more: str


def make_card(name: str, sentence: str, number: str, rows: list[dict[str, Any]], unit: str = "", **look: Any) -> Card:
    """Make a card with the texts of CARD and a figure of rows; without rows it has no figure."""
    words = CARD[name]
    spec = bars(rows, words["axis"], **look)
    head = {"name": words["rows"], "y": words["column"], **({"low": "least", "high": "largest"} if "low" in str(rows[:1]) else {})}
    drawn = Chart(f"card-{name}", words["title"], words["description"], spec, tuple(rows), head, small=True) if rows else None
    return Card(words["question"], sentence, number, unit or words["unit"], drawn, words["page"], words["more"])


def as_shipped(run: Run) -> dict[str, Row]:
    """Return engine -> its case with the largest drift, among cases with default settings, no stabilisation and a step of STEP.

    If an engine has several integrators, the one with the smallest largest drift stands for it.
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
    """Return the card "Do loops hold by default?", or None without cases."""
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
    return make_card("loops", sentence, f"{len(held)} of {len(drift)}", rows, logarithmic=True, rule=HOLDS)


def gauss_or_lagrange(run: Run) -> Card | None:
    """Return the card on the cost of a step by Gauss against Lagrange, both compiled, or None without races."""
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
    return make_card("gauss", sentence, times(middle), shown, logarithmic=True, rule=1.0, written="~g")


def paper(run: Run) -> Card | None:
    """Return the card "Is the paper right?", or None without an audit."""
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
    ordered = sorted(kinds.items(), key=lambda x: -len(x[1]))
    shown = [{"name": "right as printed" if kind == "ok" else kind, "y": len(some)} for kind, some in ordered]
    return make_card("paper", sentence, f"{len(fine)} of {len(rows)}", shown)


def trust(run: Run) -> Card | None:
    """Return the card "Why trust this?": digits of certificates, or the largest error bar of a run without certificates."""
    rows = [r for r in run.table("certificates") if r["status"] == "ok" and is_known(r.get("digits"))]
    bars_of = [r for r in run.table("references") if is_known(r.get("error_bar_q"))]
    if rows:
        least = min(rows, key=lambda r: number(r, "digits"))
        sentence = (
            "Errors are measured against motions that two independent pipelines agree on: "
            f"{count(len(rows), 'scenario')} to at least {number(least, 'digits'):g} digits, the fewest on {least['mechanism']}."
        )
        kinds = group_rows(sorted(rows, key=lambda r: -number(r, "digits")), lambda r: f"{number(r, 'digits'):g} digits")
        return make_card("trust", sentence, f"{number(least, 'digits'):g}", [{"name": k, "y": len(v)} for k, v in kinds.items()])
    if bars_of:
        worst = max(bars_of, key=lambda r: number(r, "error_bar_q"))
        figure = error(number(worst, "error_bar_q"))
        sentence = f"Errors are measured against references whose own bars are at most {figure} (m, rad), on {worst['mechanism']}."
        return make_card("trust", sentence, figure, [], "the widest bar")
    return None


CARDS: tuple[Callable[[Run], Card | None], ...] = (loops, gauss_or_lagrange, paper, trust)
