"""The first screen: which setting of each engine holds a requirement, the main findings, and four questions with answers."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gauss_bench.report.content import AUTHORS, Finding, times
from gauss_bench.report.first_table import SAID, first_table
from gauss_bench.report.palette import slots
from gauss_bench.report.rows import Run, is_known
from gauss_bench.report.site.cards import CARDS
from gauss_bench.report.site.page import Page, file_name, render
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


def first_page(run: Run, findings: list[Finding], programs: Programs | None) -> Page:
    settings = all_settings(run)
    names = tuple(x for x in linkages(run) if any(s.mechanism == x for s in settings))
    preferred = "four_bar" if "four_bar" in names else next(iter(names), "")
    cards = [made for make in CARDS if (made := make(run)) is not None]
    body = render(
        "index.html",
        names=names,
        preferred=preferred,
        positions=[(i, f"{1e3 * x:g} mm") for i, x in enumerate(POSITIONS)],
        usual=POSITIONS.index(USUAL),
        forces=[(j, "any" if math.isinf(x) else f"{x:g} N") for j, x in enumerate(FORCES)],
        first=first_answers(run, preferred, settings),
        table=first_table(run),
        said=SAID,
        cards=cards,
        lost=headlines(findings),
        found=len(findings),
        authors=AUTHORS,
    )
    data: dict[str, Any] = {"charts": {c.chart.name: c.chart.data() for c in cards if c.chart}}
    looked_up, later = chooser_data(run, names, settings, programs) if names else ({}, {})
    scripts = ("chooser.js",) if names else ()
    return Page("index", "Choose an engine for your linkage", LEAD, body, data | looked_up, scripts=scripts, later=later)


def first_answers(run: Run, name: str, settings: Sequence[Setting]) -> list[dict[str, str]]:
    """Return the answers for the default choice: the cheapest setting of each engine, fastest first."""
    own = [x for x in settings if x.mechanism == name]
    held = [x for x in cheapest_stored(run, name, own, USUAL, math.inf).values() if is_known(x.seconds)]
    over = multiples({x.engine: x.seconds for x in held})
    found = []
    for x in sorted(held, key=lambda x: x.seconds):
        words = {"over": times(over[x.engine]), "words": in_words(run, x), "steps": f"{x.steps:g}"}
        found.append(words | {"engine": x.engine, "page": f"engine-{file_name(x.engine)}.html"})
    return found


def headlines(findings: list[Finding]) -> list[Finding]:
    """Return the findings that begin in bold: where the suite's own engines are slower, miss a target, or fail."""
    lost = [x for x in findings if x.text.startswith("**") and x.tone in ("bad", "warn")]
    return [Finding(x.title, x.text.partition(" The compiled kernel's")[0].replace("**", "")) for x in lost]


def chooser_data(
    run: Run, names: tuple[str, ...], settings: tuple[Any, ...], programs: Programs | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the data of the form, and the programs of each linkage, which a page loads only on demand."""
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
    """Store texts as indices into their distinct lines, since programs of one engine share most lines."""
    lines = {x: i for i, x in enumerate(dict.fromkeys(line for text in texts for line in text.split("\n")))}
    return {"lines": list(lines), "texts": [[lines[x] for x in text.split("\n")] for text in texts]}


def call_of(name: str, x: Setting) -> str:
    """Return a Python call of this package that runs a setting, for settings without a program in the engine's own language."""
    named = {k: getattr(x, k) for k in ("engine", "scenario", "settings", "integrator", "stabilization")}
    given = "".join(f"    {k}={v!a},\n" for k, v in named.items() if v)
    step = f"{x.step:.10g}" if is_known(x.step) else "0.001"
    until = f"{x.until:g}" if is_known(x.until) and x.until > 0 else "1"
    start = f"import gauss_bench\n\nrun = gauss_bench.simulate(\n    {name!a},\n{given}"
    return f"{start}    step={step},\n    at=[0.0, {until}],\n)\nprint(run.to_json())\n"
