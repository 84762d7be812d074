"""The first screen: which setting of each engine holds what is required, what was found, and four questions with their answers."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from markupsafe import Markup

from gauss_bench.report.content import AUTHORS, Finding, times
from gauss_bench.report.first_table import SAID, first_table
from gauss_bench.report.palette import slots
from gauss_bench.report.rows import Run, is_known, number
from gauss_bench.report.site.cards import CARDS, Card
from gauss_bench.report.site.page import Page, chart, file_name, finding, heading, join_blocks, link, paragraph, rich, table
from gauss_bench.report.site.settings import (
    FORCES,
    POSITIONS,
    USUAL,
    Setting,
    all_settings,
    answers,
    cheapest_stored,
    in_words,
    linkages,
    multiples,
    scenario_of,
)

LEAD = (
    "Which engine, with which settings, simulates a closed-loop linkage well enough, and at what cost. Every answer below was "
    "measured against a motion known to far more digits."
)
Programs = Callable[[list[tuple[Any, ...]]], Mapping[tuple[Any, ...], str]]


def option(value: object, text: str, chosen: bool = False) -> Markup:
    return Markup('<option value="{}"{}>{}</option>').format(value, Markup(" selected") if chosen else "", text)


def selector(name: str, label: str, options: Markup) -> Markup:
    return Markup('<label>{}<select id="{}">{}</select></label>').format(label, name, options)


def millimetres(x: float) -> str:
    return f"{1e3 * x:g} mm"


def chooser(run: Run, names: tuple[str, ...], settings: Sequence[Setting]) -> Markup:
    """The form, and its first answers; a script gives the others."""
    preferred = "four_bar" if "four_bar" in names else names[0]
    fields = (
        selector("linkage", "Linkage", join_blocks(option(x, x.replace("_", " "), x == preferred) for x in names)),
        selector(
            "position", "Position within", join_blocks(option(i, millimetres(x), x == USUAL) for i, x in enumerate(POSITIONS))
        ),
        selector(
            "force",
            "Joint forces within",
            join_blocks(option(j, "any" if math.isinf(x) else f"{x:g} N") for j, x in enumerate(FORCES)),
        ),
        selector("horizon", "Over the first", Markup("")),
    )
    return Markup(
        '<section class="chooser" aria-label="Find a setting"><div class="fields">{}</div>'
        '<ol class="answers" id="answers" aria-live="polite">{}</ol><p class="note" id="said">{}</p></section>'
    ).format(join_blocks(fields), first_answers(run, preferred, settings), UNSCRIPTED)


UNSCRIPTED = "Without scripts these answers stand for the first choice; every linkage's page has a table of its settings."


def first_answers(run: Run, name: str, settings: Sequence[Setting]) -> Markup:
    """What the form answers before anything is chosen: the cheapest setting of each engine, fastest first."""
    own = [x for x in settings if x.mechanism == name]
    held = [x for x in cheapest_stored(run, name, own, USUAL, math.inf).values() if is_known(x.seconds)]
    over = multiples({x.engine: x.seconds for x in held})
    return join_blocks(
        Markup('<li><span class="ratio">{} &times;</span>{}<div class="what">{}, {} steps</div></li>').format(
            times(over[x.engine]), link(f"engine-{file_name(x.engine)}.html", x.engine, "engine"), in_words(run, x), f"{x.steps:g}"
        )
        for x in sorted(held, key=lambda x: x.seconds)
    )


def card(one: Card) -> Markup:
    drawn = chart(one.chart) if one.chart else Markup("")
    return Markup('<article class="card"><h2>{}</h2><p class="number">{} <small>{}</small></p><p>{}</p>{}{}</article>').format(
        one.question, one.number, one.unit, rich(one.sentence), drawn, link(one.page, one.more)
    )


def headlines(findings: list[Finding]) -> list[Finding]:
    """The bold part of findings: where this suite's own is slower, short of its aim, or cannot."""
    lost = [x for x in findings if x.text.startswith("**") and x.tone in ("bad", "warn")]
    return [Finding(x.title, x.text.partition(" The compiled kernel's")[0].replace("**", "")) for x in lost]


def first_page(run: Run, findings: list[Finding], programs: Programs | None) -> Page:
    names = linkages(run)
    settings = all_settings(run)
    known_names = tuple(x for x in names if any(s.mechanism == x for s in settings))
    table_of_all = first_table(run)
    cards = [made for make in CARDS if (made := make(run)) is not None]
    body = [chooser(run, known_names, settings)] if known_names else []
    if table_of_all is not None:
        body += [heading(table_of_all.title, "first-table"), paragraph(SAID), table(table_of_all, caption=False)]
    if cards:
        body.append(
            Markup('<section><h2 id="answers-short">Four questions</h2><div class="cards">{}</div></section>').format(
                join_blocks(map(card, cards))
            )
        )
    if lost := headlines(findings):
        said = Markup('<ul class="findings">{}</ul>').format(join_blocks(map(finding, lost)))
        more = link("findings.html", f"All {len(findings)} findings")
        body.append(Markup('<section><h2 id="worst">Where we lose</h2>{}<p>{}</p></section>').format(said, more))
    body.append(paragraph(AUTHORS, "note"))
    data: dict[str, Any] = {"charts": {c.chart.name: c.chart.data() for c in cards if c.chart}}
    later: dict[str, Any] = {}
    if known_names:
        looked_up, later = chooser_data(run, known_names, settings, programs)
        data |= looked_up
    scripts = ("chooser.js",) if known_names else ()
    return Page("index", "Choose an engine for your linkage", LEAD, join_blocks(body), data, scripts=scripts, later=later)


def chooser_data(
    run: Run, names: tuple[str, ...], settings: tuple[Any, ...], programs: Programs | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Everything the form looks up, and the programs of each linkage, which are looked up when they are asked for."""
    choices = {name: answers(run, name, settings) for name in names}
    wanted = [x.choice for one in choices.values() for x in one["chosen"]]
    texts = programs(wanted) if programs else {}
    later = {}
    for name, one in choices.items():
        one["programs"] = f"programs-{file_name(name)}"
        later[one["programs"]] = {f"programs of {name}": pack([texts.get(x.choice) or call_of(name, x) for x in one.pop("chosen")])}
        one["page"] = f"linkage-{file_name(name)}.html"
        one["scenario"] = scenario_of(run, name)
    engines = sorted({x.engine for x in settings} | {e for one in choices.values() for e in one["none"]})
    names_of = {e: f"engine-{file_name(e)}.html" for e in engines}
    colours = {e: f"var(--{slot})" for e, slot in slots(engines).items()}
    levels = {"positions": list(POSITIONS), "forces": [None if math.isinf(x) else x for x in FORCES]}
    own = [x for x in engines if x in run.own_engines]
    return {"choices": choices, "engines": names_of, "own": own, "dots": colours} | levels, later


def pack(texts: list[str]) -> dict[str, Any]:
    """Texts by their lines, each of which is kept once: programs of one engine differ in few."""
    lines = {x: i for i, x in enumerate(dict.fromkeys(line for text in texts for line in text.split("\n")))}
    return {"lines": list(lines), "texts": [[lines[x] for x in text.split("\n")] for text in texts]}


def call_of(name: str, setting: Any) -> str:
    """A call of this package that runs a setting, where no program in the engine's own language was written."""
    step = f"{setting.step:.10g}" if not math.isnan(setting.step) else "0.001"
    named = {
        "engine": setting.engine,
        "scenario": setting.scenario,
        "settings": setting.settings,
        "integrator": setting.integrator,
        "stabilization": setting.stabilization,
    }
    lines = [f"    {k}={v!a}," for k, v in named.items() if v]
    until = f"{setting.until:g}" if number({"x": setting.until}, "x") > 0 else "1"
    return "\n".join(
        [
            "import gauss_bench",
            "",
            "run = gauss_bench.simulate(",
            f"    {name!a},",
            *lines,
            f"    step={step},",
            f"    at=[0.0, {until}],",
            ")",
            "print(run.to_json())",
            "",
        ]
    )
