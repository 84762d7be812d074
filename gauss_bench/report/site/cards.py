"""Four questions on the first screen; each is answered by a sentence, a number and a small figure from stored rows."""

import math
import tomllib
from collections import Counter
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from statistics import median
from typing import Any

from gauss_bench.report.cases import has_ended, is_unstabilised
from gauss_bench.report.content import Chart
from gauss_bench.report.rows import Row, Run, group_by, with_number
from gauss_bench.report.site.charts import FLOOR, bars
from gauss_bench.report.words import count, error_text, ratio_text

HOLDS = 1e-4  # [m, rad] a loop that opens by less, a tenth of a millimetre, counts as closed
CARD = tomllib.loads((Path(__file__).parent / "assets" / "cards.toml").read_text(encoding="utf-8"))  # name of a card -> its texts
STEP = 1e-3  # [s] step at which engines are compared as shipped


Card = dict[str, Any]  # contents of a card: its texts of CARD with `sentence`, `number` and `chart` (None without a figure)


def make_card(name: str, sentence: str, number: str, rows: list[dict[str, Any]], unit: str = "", **chart_options: Any) -> Card:
    """Return a card, which is a framed box of the first page: a question, its answer, and a small bar chart."""
    words, chart = CARD[name], None
    if rows:
        head = {"name": words["rows"], "y": words["column"]} | ({"low": "least", "high": "largest"} if "low" in rows[0] else {})
        spec = bars(rows, words["axis"], **chart_options)
        chart = Chart(f"card-{name}", words["title"], words["description"], spec, rows, head, small=True)
    return words | {"sentence": sentence, "number": number, "unit": unit or words["unit"], "chart": chart}


def drift_as_shipped(run: Run) -> dict[str, Row]:
    """Return engine -> its case with the largest drift, among cases with default settings, no stabilisation and a step of STEP."""
    ended = [r for r in with_number(run.results, "position_drift") if has_ended(r) and not r["control"]]
    shipped = [r for r in ended if r["settings"] == "default" and is_unstabilised(r) and abs(r["step"] - STEP) < 1e-9]
    worst: dict[str, Row] = {}  # the worst case of the best integrator
    for (engine, _), cases in group_by(shipped, "engine", "integrator").items():
        row = max(cases, key=itemgetter("position_drift"))
        if engine not in worst or row["position_drift"] < worst[engine]["position_drift"]:
            worst[engine] = row
    return worst


def loops_card(run: Run) -> Card | None:
    """Return the card "Do loops hold by default?", or None if `drift_as_shipped` finds no case with default settings."""
    worst = drift_as_shipped(run)
    if not worst:
        return None
    ordered = sorted(worst.items(), key=lambda x: x[1]["position_drift"])
    name, loosest = ordered[-1]
    closed = sum(row["position_drift"] <= HOLDS for row in worst.values())
    sentence = (
        f"With default settings, its best integrator and a step of {STEP:g} s, {closed} of "
        f"{count(len(worst), 'engine')} hold every loop within "
        f"{1e3 * HOLDS:g} mm (or {HOLDS:g} rad); the loosest, `{name}`, opens one by {error_text(loosest['position_drift'])} on "
        f"{loosest['mechanism']} ({loosest['integrator']})."
    )
    rows = [{"name": name, "y": max(row["position_drift"], FLOOR)} for name, row in ordered]
    return make_card("loops", sentence, f"{closed} of {len(worst)}", rows, logarithmic=True, rule=HOLDS)


def claim_card(run: Run) -> Card | None:
    """Return the card that compares the time of a compiled step by Gauss's principle with that by Lagrange's multipliers."""
    rows = sorted(with_number(run.table("kernel_claim"), "ratio"), key=lambda r: -r["ratio"])
    if not rows:
        return None
    verdicts = Counter(r["verdict"] for r in rows)
    middle = ratio_text(median(r["ratio"] for r in rows))
    sentence = (
        f"Compiled by the same generator, a step by Gauss (n - m unknowns) is faster than one by Lagrange multipliers (n + m) on "
        f"{verdicts['holds']} of {count(len(rows), 'linkage')}, slower on {verdicts['reversed']}, and neither on "
        f"{verdicts['open']}; the middle ratio of times is {middle}."
    )
    columns = {"name": "mechanism", "y": "ratio", "low": "ratio_low", "high": "ratio_high"}
    shown = [{k: r.get(x, math.nan) for k, x in columns.items()} for r in rows]
    return make_card("gauss", sentence, middle, shown, logarithmic=True, rule=1.0, number_format="~g")


def paper_card(run: Run) -> Card | None:
    """Return the card "Is the paper right?", or None for a run without an audit."""
    rows = run.table("audit")
    if not rows:
        return None
    verdicts = Counter(r["verdict"] for r in rows)
    sentence = (
        f"Of {count(len(rows), 'statement')} of {count(len({r['paper'] for r in rows}), 'paper')} that can be "
        f"computed, {verdicts['ok']} are right as printed "
        f"and {verdicts['wrong']} wrong as statements; the others are slips, left out, loose, or unreadable in the extracted text."
    )
    shown = [{"name": "right as printed" if kind == "ok" else kind, "y": n} for kind, n in verdicts.most_common()]
    return make_card("paper", sentence, f"{verdicts['ok']} of {len(rows)}", shown)


def trust_card(run: Run) -> Card | None:
    """Return the card "Why trust this?", or None for a run without references."""
    rows = [r for r in with_number(run.table("certificates"), "digits") if r["status"] == "ok"]
    if rows:
        loosest = min(rows, key=itemgetter("digits"))
        sentence = (
            "Errors are measured against motions that two independent pipelines agree on: "
            f"{count(len(rows), 'scenario')} to at least {loosest['digits']:g} digits, the fewest on {loosest['mechanism']}."
        )
        digits = Counter(sorted((r["digits"] for r in rows), reverse=True))
        shown = [{"name": f"{x:g} digits", "y": n} for x, n in digits.items()]
        return make_card("trust", sentence, f"{loosest['digits']:g}", shown)
    references = with_number(run.table("references"), "error_bar_q")
    if references:
        worst = max(references, key=itemgetter("error_bar_q"))
        figure = error_text(worst["error_bar_q"])
        sentence = f"Errors are measured against references whose own bars are at most {figure} (m, rad), on {worst['mechanism']}."
        return make_card("trust", sentence, figure, [], "the widest bar")
    return None


CARDS: tuple[Callable[[Run], Card | None], ...] = (loops_card, claim_card, paper_card, trust_card)
