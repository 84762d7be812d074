"""The first screen: the setting of each engine that meets a requirement, the main findings, and questions with answers."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gauss_bench.report.content import AUTHORS, Finding
from gauss_bench.report.first_table import EXPLAINED, first_table
from gauss_bench.report.palette import slots
from gauss_bench.report.rows import Run, is_known
from gauss_bench.report.site.cards import CARDS
from gauss_bench.report.site.page import Page, file_name, render
from gauss_bench.report.site.questions import questions
from gauss_bench.report.site.settings import (
    FORCES,
    POSITIONS,
    USUAL,
    Setting,
    all_settings,
    answers,
    describe_setting,
    fastest_first,
    scenarios,
)
from gauss_bench.report.words import ratio_text

LEAD = (
    "This page finds the engine and the settings that simulate a closed-loop linkage accurately enough at the least cost. Errors "
    "are measured against a motion that is known to far more digits."
)
Programs = Callable[[list[tuple[Any, ...]]], Mapping[tuple[Any, ...], str]]  # list of `Setting.choice` -> program of each


def first_page(run: Run, findings: Sequence[Finding], programs: Programs | None) -> Page:
    """Return the site's first page: chooser of engines, first table, cards with charts, questions, main findings."""
    settings = all_settings(run)
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
        asked=questions(run, findings, preferred),
        table=first_table(run),
        said=EXPLAINED,
        cards=cards,
        lost=headlines(findings),
        found=len(findings),
        authors=AUTHORS,
    )
    data: dict[str, Any] = {"charts": {c["chart"].name: c["chart"].data() for c in cards if c["chart"]}}
    later: dict[str, Any] = {}
    if names:
        choices = {name: answers(run, name) for name in names}
        later = program_files(choices, programs)
        data |= chooser_data(run, choices)
    scripts = ("chooser.js",) if names else ()
    return Page("index", "Choose an engine for your linkage", LEAD, body, data, scripts=scripts, later=later)


def first_answers(run: Run, name: str) -> list[dict[str, str]]:
    """Return for each engine the texts on its cheapest setting with position errors of at most USUAL [m] on the linkage `name`."""
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


def headlines(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings that begin in bold: those where the suite's own engines are slower, miss a target or fail."""
    return [replace(x, tone="") for x in findings if x.text.startswith("**") and x.tone in ("bad", "warn")]


def program_files(choices: Mapping[str, dict[str, Any]], programs: Programs | None) -> dict[str, Any]:
    """Return a dictionary: name of a file -> the programs of a linkage, which a page loads only on demand."""
    chosen: dict[str, list[Setting]] = {name: data.pop("chosen") for name, data in choices.items()}
    texts = programs([x.choice for settings in chosen.values() for x in settings]) if programs else {}
    later = {}
    for name, settings in chosen.items():
        file = f"programs-{file_name(name)}"
        choices[name]["programs"] = file
        later[file] = {f"programs of {name}": pack([texts.get(x.choice) or write_call(x) for x in settings])}
    return later


def chooser_data(run: Run, choices: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the data of the web form in which a reader chooses a linkage and a requirement."""
    for name, data in choices.items():
        data |= {"page": f"linkage-{file_name(name)}.html", "scenario": scenarios(run)[name]}
    with_settings = {x.engine for settings in all_settings(run).values() for x in settings}
    engines = sorted(with_settings.union(*(data["none"] for data in choices.values())))
    return {
        "choices": choices,
        "engines": {e: f"engine-{file_name(e)}.html" for e in engines},
        "own": [x for x in engines if x in run.own_engines],
        "dots": {e: f"var(--{slot})" for e, slot in slots(engines).items()},
        "positions": POSITIONS,
        "forces": [None if math.isinf(x) else x for x in FORCES],
    }


def pack(texts: Sequence[str]) -> dict[str, Any]:
    """Return the distinct lines of texts, and each text as indices of its lines; programs of one engine share most lines."""
    lines: dict[str, int] = {}
    indices = [[lines.setdefault(line, len(lines)) for line in text.split("\n")] for text in texts]
    return {"lines": list(lines), "texts": indices}


def write_call(x: Setting) -> str:
    """Return a Python program that runs a setting by a call of this package."""
    named = {k: getattr(x, k) for k in ("engine", "scenario", "settings", "integrator", "stabilization")}
    given = "".join(f"    {k}={v!a},\n" for k, v in named.items() if v)
    step = f"{x.step:.10g}" if is_known(x.step) else "0.001"
    until = f"{x.until:g}" if is_known(x.until) and x.until > 0 else "1"
    start = f"import gauss_bench\n\nrun = gauss_bench.simulate(\n    {x.mechanism!a},\n{given}"
    return f"{start}    step={step},\n    at=[0.0, {until}],\n)\nprint(run.to_json())\n"
