"""An engine's page: its cases, its best settings, its races, its failures, and how to object to the results."""

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from statistics import geometric_mean
from typing import Any

from gauss_bench.reach import ERRORS
from gauss_bench.report.cases import SAME_ACCELERATION, has_ended, setting_words
from gauss_bench.report.content import Table, lay_out
from gauss_bench.report.faults import faults_of
from gauss_bench.report.first_table import FIRST
from gauss_bench.report.pages import facts
from gauss_bench.report.reaches import engines_of
from gauss_bench.report.rows import Row, Run, group_by, is_known, number, with_number
from gauss_bench.report.sections import field
from gauss_bench.report.sections.search import list_owned
from gauss_bench.report.sections.settings import list_options
from gauss_bench.report.site.page import Page, file_name, plain_page, render
from gauss_bench.report.site.settings import (
    POSITIONS,
    USUAL,
    Setting,
    all_settings,
    answer_of,
    cheapest_stored,
    describe_setting,
    describe_size,
    fastest_first,
    make_setting,
    race_multiples,
    scenarios,
)
from gauss_bench.report.words import count, error_text, itemise, limit_text, ratio_text

TABLED = sorted({*POSITIONS[1::2], USUAL, FIRST}, reverse=True)  # [m] accuracies in the table of an engine's best settings


def engine_names(run: Run) -> list[str]:
    """Return the names of the engines that were run or searched, sorted."""
    rows = (*run.results, *run.table("search_winners"), *run.table("search_ladder"), *run.table("field"))
    return sorted({r["engine"] for r in rows} - {""})


def runs_of_engines(run: Run) -> dict[str, Run]:
    """Return engine -> the run with its rows, sorted by name: the run of the suite `field` for engines that only this one has."""
    runs = dict.fromkeys(engine_names(run.field_run), run.field_run) | dict.fromkeys(engine_names(run), run)
    return dict(sorted(runs.items()))


def engine_page(run: Run, name: str) -> Page:
    """Return the page of an engine; its tables appear as far as its run has their rows."""
    whole, run = run, runs_of_engines(run).get(name, run)
    rows = [r for r in run.results if r["engine"] == name]
    installed = run.environment.get("engines", {}).get(name, {})
    version = installed.get("version") if isinstance(installed, dict) else ""
    asked = field.answers(whole, name)
    body = render(
        "engine.html",
        name=name,
        asked=lay_out("field", asked, title="Its answers"),
        costs=lay_out("field_costs", field.costs(whole, name), title="Its costs"),
        apart=field.describe_run(whole) if asked and run is not whole.field_run else "",
        home=describe_home(name, installed),
        settings=lay_out("settings", list_options(run, name), title="Its settings in full", folded=True)
        if run is not whole
        else None,
        commands=list_commands(run, name),
        cases=lay_out("engine_cases", list_cases(rows)),
        bests=bests(run, name),
        races=list_races(run, name),
        why=explain_time(run, name),
        broken=list_failures(run, name),
        faults=faults_of(whole.faults, name),
        atlas=atlas_table([r for r in whole.table("atlas") if r["engine"] == name]),
        owned=lay_out("search_owned", list_owned([r for r in run.table("search_owned") if r["engine"] == name])),
        releases=sum(r["engine"] == name for r in whole.table("releases")),
        history=lay_out("engine_history", list_changes([r for r in whole.accepted if r["engine"] == name])),
        knobs=lay_out("engine_knobs", [r for r in run.table("search_knobs") if r["engine"] == name]),
    )
    wrong = "A negative control, wrong on purpose: it must never pass."
    lead = (
        wrong
        if any(r["control"] for r in rows)
        else f"{version or name}: as shipped, as set here, and with the best settings found."
    )
    return Page(f"engine-{file_name(name)}", name, lead, body, facts=tuple(facts(run)))


def describe_home(name: str, installed: Mapping[str, Any]) -> str:
    """Return in words in which environment an engine lives; empty for one that shares the environment of the suite."""
    if not installed.get("environment"):
        return ""
    return (
        f"It lives in an environment of its own: {installed['environment']}. `gauss-bench engines install {name}` installs it; "
        "`gauss-bench engines` shows its licence and size."
    )


def list_commands(run: Run, name: str) -> list[tuple[str, str]]:
    """Return the engine's cheapest setting within TABLED accuracies, as commands to paste, each with a sentence.

    An engine of which no setting was found has that of a case as shipped.
    """
    commands = []
    for linkage, scenario in scenarios(run).items():
        for position in TABLED:
            one = cheapest_stored(run, linkage, position).get(name)
            if one is not None:
                commands.append((f"{linkage} within {limit_text(position)} m", command_of(one, scenario)))
    if not commands:
        shipped = [r for r in run.results if r["engine"] == name and r["settings"] == "default"]
        for row in shipped[-1:]:
            one = make_setting(row, until=row["t_end"])
            commands.append((f"{row['mechanism']} as shipped", command_of(one, row["scenario"])))
    return list({command: (words, command) for words, command in reversed(commands)}.values())[::-1]


def command_of(one: Setting, scenario: str) -> str:
    """Return the command that runs a setting once."""
    words = ["gauss-bench", "simulate", one.mechanism, "--scenario", scenario, "--engine", one.engine, "--settings", one.settings]
    words += ["--integrator", one.integrator, "--stabilization", one.stabilization or "none"]
    words += ["--step", f"{one.step:.10g}"] if is_known(one.step) else []
    words += ["--tolerance", f"{one.tolerance:.10g}"] if is_known(one.tolerance) else []
    return shlex.join([*words, "--at", f"{one.until:g}"])


def list_cases(rows: Sequence[Row]) -> Iterator[Row]:
    """Yield the most accurate case of each linkage, setting and integrator, with its outcome."""
    for group in group_by(rows, "mechanism", "settings", "integrator").values():
        row = min(group, key=_inaccuracy)
        outcome = "valid" if row["valid"] else row.get("flag") or row["message"] or row["status"]
        yield {**row, "outcome": outcome, "outcome_tone": "good" if row["valid"] else "bad"}


def _inaccuracy(row: Row) -> tuple[bool, bool, float]:
    """Return the sort key of cases: ended ones first, then those with a known error, then by the error."""
    error = number(row, "position_error")
    return not has_ended(row), math.isnan(error), error


def bests(run: Run, name: str) -> Table:
    """Return the engine's cheapest setting per linkage and accuracy, or why none holds it."""
    lines: list[Row] = []
    searched = [x for x in scenarios(run) if name in engines_of(run, x)]
    known = [x for x, settings in all_settings(run).items() if any(one.engine == name for one in settings)]
    # an engine without any known setting has no table
    for linkage in sorted({*searched, *known}) if known else ():
        for position in TABLED:
            place = {"mechanism": linkage, "within": position}
            one = cheapest_stored(run, linkage, position).get(name)
            if one is None:
                reach = answer_of(run, linkage, name, position)
                lines.append(place | {"words": reach.words, "words_tone": "warn", "missing": str(reach.kind)})
            else:
                lines.append(vars(one) | place | {"words": describe_setting(run, one), "size": describe_size(one)})
    return lay_out("engine_bests", lines)


def explain_time(run: Run, name: str) -> tuple[str, Table] | None:
    """Return the engine's multiple as steps times time of a step, in a sentence and linkage by linkage.

    It is that within FIRST, or within USUAL for an engine that holds FIRST nowhere.
    """
    return next(filter(None, (explain_time_within(run, name, position) for position in (FIRST, USUAL))), None)


def explain_time_within(run: Run, name: str, position: float) -> tuple[str, Table] | None:
    """Return `explain_time` of an accuracy [m]; None if the engine has no timed setting that holds it."""
    lines: list[Row] = []
    for linkage in scenarios(run):
        timed = [x for x in fastest_first(run, linkage, position) if x.steps > 0]
        for one in timed:
            if one.engine == name:
                best = timed[0]
                time, steps = one.seconds / best.seconds, one.steps / best.steps
                ratios = {"time": time, "steps": steps, "each": time / steps}
                lines.append(ratios | {"mechanism": linkage, "fastest": best.engine, "words": describe_setting(run, one)})
    if not lines:
        return None
    # geometric means, unlike medians, keep the identity time = steps * time per step
    time, steps, each = (geometric_mean(x[k] for x in lines) for k in ("time", "steps", "each"))
    sentence = (
        f"To hold {limit_text(position)} m on {count(len(lines), 'linkage')} it takes {ratio_text(time)} times as long as the "
        f"fastest engine there: {ratio_text(steps)} times as many steps, and {ratio_text(each)} times the time of a step (means "
        "are geometric)."
    )
    cause = "number of steps" if steps > each else "time of a step"
    reason = f"Most of this comes from the {cause}." if time > 1.05 else "It is the fastest."
    return f"{sentence} {reason}", lay_out("engine_why", lines)


def list_races(run: Run, name: str) -> Table:
    """Return the engine's races, each with its time as a multiple of the fastest at the same accuracy."""
    over = race_multiples(run)
    lines = []
    for r in run.table("search_winners"):
        race = (r["mechanism"], r["required"], r["accuracy"], name)
        if r["engine"] == name and r["required"] and race in over:
            what = f"{ERRORS.get(r['required'], r['required'])} within {limit_text(r['accuracy'])} {r['unit']}"
            lines.append({**r, "what": what, "words": describe_setting(run, make_setting(r)), "multiple": over[race]})
    inside = itemise(dict.fromkeys(r["in_python"] for r in lines if r.get("in_python")))
    python = f" These times contain Python code of the suite: {inside}." if inside else ""
    note = f"The multiple is the engine's time divided by that of the fastest engine at the same accuracy.{python}"
    return lay_out("engine_races", lines, note=note)


def list_changes(figures: Sequence[Row]) -> list[Row]:
    """Return a row for each accepted change of the engine's figures, the latest first: its date, its reason, its figures."""
    groups = group_by(figures, "accepted")
    dated = [(*accepted.split(" ", 1), len(some)) for accepted, some in groups.items() if " " in accepted]
    return [{"date": date, "reason": reason, "figures": number_of} for date, reason, number_of in sorted(dated, reverse=True)]


def list_failures(run: Run, name: str) -> list[str]:
    """Return sentences on where the engine failed, was invalid, or does not model a linkage."""
    rows = [r for r in run.results if r["engine"] == name]
    failed = [r for r in rows if not has_ended(r) and r["status"] != "skip"]
    invalid = [r for r in rows if has_ended(r) and not r["valid"] and not r["control"]]
    ladder = [r for r in run.table("search_ladder") if r["engine"] == name]
    early = [r for r in ladder if r["status"] not in ("ok", "skip")]
    sentences = []
    if failed:
        statuses, places = (itemise(sorted({r[k] for r in failed})) for k in ("status", "mechanism"))
        sentences.append(f"{count(len(failed), 'case')} of {len(rows)} ended without a motion: {statuses}, on {places}.")
    if invalid:
        worst = max(with_number(invalid, "position_drift") or invalid[:1], key=lambda r: number(r, "position_drift"))
        sentences.append(
            f"{count(len(invalid), 'case')} of {len(rows)} ended and may not be used; the loosest opened a loop "
            f"by {error_text(number(worst, 'position_drift'))} ({worst['mechanism']}, {worst['settings']} "
            f"{worst['integrator']} at step {worst['step']:g} s)."
        )
    if early:
        smallest = min((r["step"] for r in with_number(early, "step")), default=0)
        sentences.append(
            f"In the search {len(early)} of {count(len(ladder), 'evaluation')} ended early, most of them at steps "
            f"that are too large; the smallest such step was {smallest:.2g} s."
        )
    skips = (r for r in (*run.results, *run.table("search_winners")) if r["engine"] == name and r["status"] == "skip")
    skipped = sorted({r["message"] for r in skips} - {""})
    sentences += [f"Cannot be modelled: {x.removeprefix('cannot be modelled: ')}." for x in skipped[:4]]
    sentences = [*(sentences or ["No case of this run failed."]), *list_inexact(run, name)]
    if not any(r["engine"] == name for r in run.table("atlas")):
        sentences.append(f"`gauss-bench atlas --engine {name}` maps where it fails, along stiffness, speed, mass and other axes.")
    return sentences


def list_inexact(run: Run, name: str) -> list[str]:
    """Return a sentence for each setting under which accelerations are not those of the linkage, with the cause if it is known."""
    causes = run.environment.get("engines", {}).get(name, {}).get("soft", {})
    rows = with_number((r for r in run.results if r["engine"] == name), "acceleration_error_median")
    sentences = []
    for settings, some in group_by(rows, "settings").items():
        off = max(r["acceleration_error_median"] for r in some)
        if off > SAME_ACCELERATION:
            cause = f": {causes[settings]}" if settings in causes else ""
            sentences.append(
                f"Under `{settings}` the relative error of accelerations at given states is {error_text(off)} in the median, where "
                f"{SAME_ACCELERATION:.0e} counts as none{cause}."
            )
    return sentences


def atlas_table(rows: Sequence[Row]) -> Table:
    """Return the table of the engine's reach along each axis of the atlas."""
    lines = []
    for r in rows:
        ends = {k: f"{r[k]:g} {r['unit']}".strip() if is_known(r.get(k)) else "" for k in ("passes_to", "breaks_at")}
        setting = setting_words(r, "settings", "stabilization") or "default"
        missing = "fails at the easiest" if not ends["passes_to"] else "passes to the end"
        if r["last"] == "cannot":
            missing = "not run further"
        lines.append({**r, "way": setting, "passes": ends["passes_to"], "breaks": ends["breaks_at"], "missing": missing})
    commits = itemise(sorted({r["commit"] for r in rows} - {""}))
    note = f"Each axis is run from easy to hard, one thing changed at a time{f'; by the code of {commits}' if commits else ''}."
    return lay_out("engine_atlas", lines, note=note)


def engines_page(run: Run) -> Page:
    """Return the page that lists all engines."""
    lines = []
    for name, known in runs_of_engines(run).items():
        rows = [r for r in known.results if r["engine"] == name]
        valid = sum(bool(r["valid"]) for r in rows)
        absent = [r["message"] for r in known.table("field") if r["engine"] == name and r["message"]]
        words = (
            f"{valid} of {count(len(rows), 'case')} valid"
            if rows
            else next(iter(absent), "in the search alone, in no accuracy case")
        )
        words += " (suite `field`)" if rows and known is not run else ""
        lines.append({"page": f"engine-{file_name(name)}.html", "name": name, "said": words})
    lead = "Each engine as shipped, as set here, and with the best settings found."
    asked = field.section(run)
    return plain_page("engines", "Engines", lead, "Engines", engines=lines, sections=[asked] if asked else [])
