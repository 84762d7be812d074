"""The first screen: the setting of each engine that meets a requirement, the main findings, and questions with answers."""

import math
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from statistics import median
from typing import Any

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.report.cases import end_error, has_ended, is_unstabilised, may_rank
from gauss_bench.report.content import Chart, Finding, layouts
from gauss_bench.report.drawings.pose import pose_in
from gauss_bench.report.first_table import first_table
from gauss_bench.report.palette import assign_hues
from gauss_bench.report.rows import Row, Run, group_by, is_known, with_number
from gauss_bench.report.sections import bias
from gauss_bench.report.sections.trajectories import name_most_accurate
from gauss_bench.report.site.charts import FLOOR, specify_bars
from gauss_bench.report.site.engine import explain_time
from gauss_bench.report.site.page import Page, file_name, render, sentence_of
from gauss_bench.report.site.settings import (
    FORCES,
    POSITIONS,
    USUAL,
    Setting,
    all_settings,
    cheapest_stored,
    collect_choices,
    describe_setting,
    describe_size,
    fastest_first,
    scenarios,
)
from gauss_bench.report.words import count, error_text, ratio_text

HOLDS = 1e-4  # [m, rad] a loop that opens by no more than this, a tenth of a millimetre, counts as closed
CARD = tomllib.loads((Path(__file__).parent / "assets" / "cards.toml").read_text(encoding="utf-8"))  # name of a card -> its texts
STEP = 1e-3  # [s] step at which engines are compared as shipped
CLAIM = "The paper's claim"  # title of the finding on Gauss against Lagrange
Card = dict[str, Any]  # contents of a card: its texts of CARD with `sentence`, `number` and `chart` (None without a figure)
Question = dict[str, str]  # a question, its answer in one sentence, and the address of the page with the rows behind it
Programs = Callable[[list[tuple[Any, ...]]], Mapping[tuple[Any, ...], str]]  # list of `Setting.choice` -> program of each


def make_card(name: str, sentence: str, number: str, rows: list[dict[str, Any]], unit: str = "", **chart_options: Any) -> Card:
    """Return a card, which is a framed box of the first page: a question, its answer, and a small bar chart.

    Each of `rows` is a bar, with `name`, `y` and optionally `low` and `high`.
    """
    words, chart = CARD[name], None
    if rows:
        heads = {"name": words["rows"], "y": words["column"], "low": "least", "high": "largest"}
        head = {key: text for key, text in heads.items() if key in rows[0]}  # rows without a range have neither `low` nor `high`
        spec = specify_bars(rows, words["axis"], **chart_options)
        chart = Chart(f"card-{name}", words["title"], words["description"], spec, rows, head, small=True)
    return {**words, "sentence": sentence, "number": number, "unit": unit or words["unit"], "chart": chart}


def drift_as_shipped(run: Run) -> dict[str, Row]:
    """Return engine -> its case with the largest drift, among cases with default settings, no stabilisation and a step of STEP.

    Of several integrators, that with the smallest such drift counts.
    """
    ended = [r for r in with_number(run.results, "position_drift") if has_ended(r) and not r["control"]]
    shipped = [r for r in ended if r["settings"] == "default" and is_unstabilised(r) and abs(r["step"] - STEP) < 1e-9]
    drift = itemgetter("position_drift")
    worst = [max(cases, key=drift) for cases in group_by(shipped, "engine", "integrator").values()]
    return {engine: min(cases, key=drift) for engine, cases in group_by(worst, "engine").items()}


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
    """Return the card that compares a compiled step by Gauss with one by Lagrange multipliers; None without rows."""
    rows = sorted(with_number(run.table("kernel_claim"), "ratio"), key=lambda r: -r["ratio"])
    if not rows:
        return None
    verdicts = Counter(r["verdict"] for r in rows)
    middle = ratio_text(median(r["ratio"] for r in rows))
    sentence = (
        f"Compiled by the same generator, a step by Gauss (n - m unknowns) is faster than one by Lagrange multipliers (n + m) on "
        f"{verdicts['holds']} of {count(len(rows), 'linkage')}, slower on {verdicts['reversed']}, and neither on "
        f"{verdicts['open']}; the median ratio of times is {middle}."
    )
    columns = {"name": "mechanism", "y": "ratio", "low": "ratio_low", "high": "ratio_high"}
    ratios = [{key: r.get(column, math.nan) for key, column in columns.items()} for r in rows]
    return make_card("gauss", sentence, middle, ratios, logarithmic=True, rule=1.0, number_format="~g")


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
    numbers = [{"name": "right as printed" if verdict == "ok" else verdict, "y": n} for verdict, n in verdicts.most_common()]
    return make_card("paper", sentence, f"{verdicts['ok']} of {len(rows)}", numbers)


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
        numbers = [{"name": f"{x:g} digits", "y": n} for x, n in digits.items()]
        return make_card("trust", sentence, f"{loosest['digits']:g}", numbers)
    references = with_number(run.table("references"), "error_bar_q")
    if references:
        worst = max(references, key=itemgetter("error_bar_q"))
        figure = error_text(worst["error_bar_q"])
        sentence = f"Errors are measured against references whose own bars are at most {figure} (m, rad), on {worst['mechanism']}."
        return make_card("trust", sentence, figure, [], "the widest bar")
    return None


CARDS: tuple[Callable[[Run], Card | None], ...] = (loops_card, claim_card, paper_card, trust_card)


def list_questions(run: Run, findings: Sequence[Finding], preferred: str) -> Iterator[Question]:
    """Yield questions that readers ask, answered from the rows; the question on MuJoCo is about the linkage `preferred`."""
    setting = cheapest_stored(run, preferred, USUAL).get("mujoco")
    if setting is not None:
        size = f"step {describe_size(setting)}" if is_known(setting.step) else describe_size(setting)
        answer = f"On {preferred} the cheapest is {describe_setting(run, setting)}, {size}; its page lists all linkages."
        yield Question(question=f"Which settings hold {1e3 * USUAL:g} mm in MuJoCo?", answer=answer, page="engine-mujoco.html#best")
    for name in scenarios(run):
        try:
            redundant = pose_in(run, name)[0].redundant
        except LinkageError:
            continue
        rows = [r for r in run.cases_of(name) if may_rank(r) and is_known(end_error(r))]
        if redundant > 0 and rows:
            answer = f"{name_most_accurate(rows).rstrip('.')}, on {name}, which has {count(redundant, 'redundant row')}."
            question = "Which engine is most accurate on redundant loops?"
            yield Question(question=question, answer=answer, page=f"linkage-{file_name(name)}.html#cases")
            break
    if why := explain_time(run, "exudyn"):
        yield Question(question="Why is Exudyn slow here?", answer=why[0], page="engine-exudyn.html#why")
    if claim := next((finding for finding in findings if finding.title == CLAIM), None):
        yield Question(question="Is Gauss faster than Lagrange?", answer=sentence_of(claim), page="papers.html#claim")
    biased = "Where may this suite be biased?"
    yield Question(question=biased, answer=bias.describe_authorship(run), page=f"method.html#{bias.ANCHOR}")


def first_page(run: Run, findings: Sequence[Finding], programs: Programs | None) -> Page:
    """Return the site's first page: chooser of engines, first table, cards with charts, questions, main findings."""
    settings, texts = all_settings(run), layouts()["texts"]
    names = [x for x in scenarios(run) if x in settings]
    preferred = "four_bar" if "four_bar" in names else next(iter(names), "")
    cards = [card for make in CARDS if (card := make(run)) is not None]
    body = render(
        "index.html",
        names=names,
        preferred=preferred,
        positions=[(i, f"{1e3 * x:g} mm") for i, x in enumerate(POSITIONS)],
        usual=POSITIONS.index(USUAL),
        forces=[(j, "any" if math.isinf(x) else f"{x:g} N") for j, x in enumerate(FORCES)],
        first=first_answers(run, preferred),
        questions=list(list_questions(run, findings, preferred)),
        table=first_table(run),
        introduction=texts["first"],
        cards=cards,
        # findings in which the suite's own engines lose begin in bold; their tone is removed, because it would colour them all
        lost=[replace(x, tone="") for x in findings if x.text.startswith("**") and x.tone in ("bad", "warn")],
        count=len(findings),
        authors=texts["authors"],
    )
    data: dict[str, Any] = {"charts": {c["chart"].name: c["chart"].data() for c in cards if c["chart"]}}
    later: dict[str, Any] = {}
    if names:
        form, later = make_chooser(run, names, programs)
        data |= form
    scripts = ("chooser.js",) if names else ()
    return Page("index", "Choose an engine for your linkage", texts["lead"], body, data, scripts=scripts, later=later)


def first_answers(run: Run, name: str) -> list[dict[str, str]]:
    """Return texts on the cheapest setting within USUAL [m] of each engine on a linkage, the fastest engine first."""
    timed = fastest_first(run, name, USUAL)
    return [
        {
            "engine": x.engine,
            "page": f"engine-{file_name(x.engine)}.html",
            "over": ratio_text(x.seconds / timed[0].seconds),
            "words": describe_setting(run, x),
            "steps": f"{x.steps:g} steps" if is_known(x.steps) else "steps not counted",
        }
        for x in timed
    ]


def make_chooser(run: Run, names: Sequence[str], programs: Programs | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the data of the web form in which a reader chooses a linkage and a requirement, and the programs that it offers.

    The second result maps the name of a file, which a page loads only on demand, to the programs of a linkage: those that
    `programs` returns, or else calls of this package.
    """
    choices = {name: collect_choices(run, name) for name in names}
    chosen: dict[str, list[Setting]] = {name: data.pop("chosen") for name, data in choices.items()}
    texts = programs([x.choice for settings in chosen.values() for x in settings]) if programs else {}  # choice -> program
    later = {}
    for name, settings in chosen.items():
        file, page = f"programs-{file_name(name)}", f"linkage-{file_name(name)}.html"
        choices[name] |= {"programs": file, "page": page, "scenario": scenarios(run)[name]}
        later[file] = {f"programs of {name}": pack_lines([texts.get(x.choice) or write_call(x) for x in settings])}
    with_settings = {x.engine for settings in all_settings(run).values() for x in settings}
    engines = sorted(with_settings.union(*(data["none"] for data in choices.values())))
    data = {
        "choices": choices,
        "engines": {engine: f"engine-{file_name(engine)}.html" for engine in engines},
        "own": [engine for engine in engines if engine in run.own_engines],
        "dots": {engine: f"var(--{hue})" for engine, hue in assign_hues(engines).items()},
        "positions": POSITIONS,
        "forces": [None if math.isinf(x) else x for x in FORCES],
    }
    return data, later


def pack_lines(texts: Sequence[str]) -> dict[str, Any]:
    """Return the distinct lines of texts, and each text as indices of its lines; most lines are shared."""
    lines: dict[str, int] = {}  # line -> its index
    indices = [[lines.setdefault(line, len(lines)) for line in text.split("\n")] for text in texts]
    return {"lines": list(lines), "texts": indices}


def write_call(x: Setting) -> str:
    """Return a Python program that runs a setting by a call of this package."""
    options = {k: getattr(x, k) for k in ("engine", "scenario", "settings", "integrator", "stabilization")}
    arguments = "".join(f"    {k}={v!a},\n" for k, v in options.items() if v)
    arguments += "".join(f"    {k}={getattr(x, k):.10g},\n" for k in ("step", "tolerance") if is_known(getattr(x, k)))
    until = f"{x.until:g}" if is_known(x.until) and x.until > 0 else "1"
    start = f"import gauss_bench\n\nrun = gauss_bench.simulate(\n    {x.mechanism!a},\n{arguments}"
    return f"{start}    at=[0.0, {until}],\n)\nprint(run.to_json())\n"
