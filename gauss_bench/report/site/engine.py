"""The page of an engine: its cases, its best settings, its races, its failures, and how to object to the results."""

import math
import shlex
from collections.abc import Iterator, Sequence
from statistics import geometric_mean

from gauss_bench.reach import ERRORS
from gauss_bench.report.cases import SAME_ACCELERATION, has_ended, setting_words
from gauss_bench.report.content import Table, lay_out, layouts
from gauss_bench.report.first_table import FIRST
from gauss_bench.report.pages import fault_sections, list_facts
from gauss_bench.report.rows import Row, Run, group_by, is_known, number, of_engine, with_number
from gauss_bench.report.sections import field
from gauss_bench.report.sections.search import list_owned
from gauss_bench.report.sections.settings import list_options
from gauss_bench.report.site.page import Page, file_name, plain_page, render
from gauss_bench.report.site.settings import (
    POSITIONS,
    USUAL,
    Setting,
    all_settings,
    cheapest_stored,
    describe_setting,
    describe_size,
    engines_of,
    fastest_first,
    make_setting,
    race_multiples,
    reach_of_engine,
    scenarios,
)
from gauss_bench.report.words import count, error_text, itemise, limit_text, ratio_text

TABLED = sorted({*POSITIONS[1::2], USUAL, FIRST}, reverse=True)  # [m] accuracies for which tables have an engine's best settings


def engine_names(run: Run) -> list[str]:
    """Return the sorted names of all engines in the rows of a run."""
    rows = (*run.results, *run.table("search_winners"), *run.table("search_ladder"), *run.table("field"))
    return sorted({r["engine"] for r in rows} - {""})


def runs_of_engines(run: Run) -> dict[str, Run]:
    """Return engine -> the run whose rows the engine's page shows, sorted by name: this run if it has the engine."""
    runs = dict.fromkeys(engine_names(run.field_run), run.field_run) | dict.fromkeys(engine_names(run), run)
    return dict(sorted(runs.items()))


def engine_page(run: Run, name: str) -> Page:
    """Return the page of an engine; tables without rows are left out."""
    its_run = runs_of_engines(run).get(name, run)
    rows = of_engine(its_run.results, name)
    installed = its_run.environment.get("engines", {}).get(name, {})
    field_results = field.list_results(run, name)  # results of the same tests for all engines, from the suite `field`
    options = None  # the method page has the options of the engines in this run
    if its_run is not run:
        options = lay_out("settings", list_options(its_run, name), title="Its settings in full", folded=True)
    environment = ""
    if installed.get("environment"):
        environment = layouts()["texts"]["environment"].format(where=installed["environment"], name=name)
    body = render(
        "engine.html",
        name=name,
        results=lay_out("field", field_results, title="Its results"),
        costs=lay_out("field_costs", field.list_costs(run, name), title="Its costs"),
        field_run=field.describe_run(run) if field_results and its_run is not run.field_run else "",
        environment=environment,
        settings=options,
        commands=list_commands(its_run, name),
        cases=lay_out("engine_cases", list_cases(rows)),
        cheapest=cheapest_table(its_run, name),
        races=list_races(its_run, name),
        why=explain_time(its_run, name),
        failures=list_failures(its_run, name),
        faults=fault_sections(run.faults, name),
        atlas=atlas_table(of_engine(run.table("atlas"), name)),
        owned=lay_out("search_owned", list_owned(of_engine(its_run.table("search_owned"), name))),
        releases=len(of_engine(run.table("releases"), name)),
        history=lay_out("engine_history", list_changes(of_engine(run.accepted, name))),
        knobs=lay_out("engine_knobs", of_engine(its_run.table("search_knobs"), name)),
    )
    lead = f"{installed.get('version') or name}: as shipped, as set here, and with the best settings found."
    if any(r["control"] for r in rows):
        lead = "A negative control, wrong on purpose: it must never pass."
    return Page(f"engine-{file_name(name)}", name, lead, body, facts=tuple(list_facts(its_run)))


def list_commands(run: Run, name: str) -> list[tuple[str, str]]:
    """Return (purpose, command) for the engine's cheapest setting on each linkage at each of the accuracies TABLED.

    If no setting of the engine meets any of the accuracies, the list has the command of the last case with default settings. A
    command that serves several purposes is listed once, with the first of these purposes.
    """
    purposes: dict[str, str] = {}  # command -> its purpose
    for linkage, scenario in scenarios(run).items():
        for position in TABLED:
            setting = cheapest_stored(run, linkage, position).get(name)
            if setting is not None:
                purposes.setdefault(command_of(setting, scenario), f"{linkage} within {limit_text(position)} m")
    shipped = [r for r in of_engine(run.results, name) if r["settings"] == "default"]
    if not purposes and shipped:
        row = shipped[-1]
        command = command_of(make_setting(row, until=row["t_end"]), row["scenario"])
        purposes[command] = f"{row['mechanism']} as shipped"
    return [(purpose, command) for command, purpose in purposes.items()]


def command_of(x: Setting, scenario: str) -> str:
    """Return the command that runs a setting once."""
    words = ["gauss-bench", "simulate", x.mechanism, "--scenario", scenario, "--engine", x.engine, "--settings", x.settings]
    words += ["--integrator", x.integrator, "--stabilization", x.stabilization or "none"]
    words += ["--step", f"{x.step:.10g}"] if is_known(x.step) else []
    words += ["--tolerance", f"{x.tolerance:.10g}"] if is_known(x.tolerance) else []
    return shlex.join([*words, "--at", f"{x.until:g}"])


def list_cases(rows: Sequence[Row]) -> Iterator[Row]:
    """Yield the most accurate case of each linkage, setting and integrator, as a row of the layout `engine_cases`."""
    for group in group_by(rows, "mechanism", "settings", "integrator").values():
        # cases that ended come first, and known errors before unknown ones
        row = min(group, key=lambda r: (not has_ended(r), math.isnan(number(r, "position_error")), number(r, "position_error")))
        outcome = "valid" if row["valid"] else row.get("flag") or row["message"] or row["status"]
        yield {**row, "outcome": outcome, "outcome_tone": "good" if row["valid"] else "bad"}


def cheapest_table(run: Run, name: str) -> Table:
    """Return the table of the engine's cheapest setting for each linkage at each of the accuracies TABLED, or why it has none."""
    lines: list[Row] = []
    # linkages on which the engine was searched, and those for which a setting of it is stored; without `stored` the table is empty
    searched = [linkage for linkage in scenarios(run) if name in engines_of(run, linkage)]
    stored = [linkage for linkage, settings in all_settings(run).items() if any(x.engine == name for x in settings)]
    for linkage in sorted({*searched, *stored}) if stored else ():
        for position in TABLED:
            place = {"mechanism": linkage, "within": position}
            setting = cheapest_stored(run, linkage, position).get(name)
            if setting is None:
                reach = reach_of_engine(run, linkage, name, position)
                lines.append(place | {"words": reach.words, "words_tone": "warn", "missing": str(reach.kind)})
            else:
                lines.append(vars(setting) | place | {"words": describe_setting(run, setting), "size": describe_size(setting)})
    return lay_out("engine_bests", lines)


def explain_time(run: Run, name: str) -> tuple[str, Table] | None:
    """Return sentences on why the engine is slower than the fastest engine, and a table with the numbers for each linkage.

    The ratio of run times is the product of the ratio of numbers of steps and the ratio of times of a step. The cheapest settings
    with position errors of at most FIRST [m] are compared or, if the engine meets FIRST on no linkage, those with errors of at most
    the larger USUAL [m]. The result is None if the engine does not meet USUAL either.
    """
    lines: list[Row] = []
    for position in (FIRST, USUAL):
        for linkage in scenarios(run):
            timed = [x for x in fastest_first(run, linkage, position) if x.steps > 0]  # one setting of each engine
            for setting in (x for x in timed if x.engine == name):
                best = timed[0]
                time, steps = setting.seconds / best.seconds, setting.steps / best.steps
                ratios = {"time": time, "steps": steps, "each": time / steps}
                lines.append(ratios | {"mechanism": linkage, "fastest": best.engine, "words": describe_setting(run, setting)})
        if lines:
            break
    else:
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
    """Return the table of the engine's races, each with its time divided by that of the fastest engine at the same accuracy."""
    multiples = race_multiples(run)
    lines = []
    for r in of_engine(run.table("search_winners"), name):
        race = (r["mechanism"], r["required"], r["accuracy"], name)
        if r["required"] and race in multiples:
            what = f"{ERRORS.get(r['required'], r['required'])} within {limit_text(r['accuracy'])} {r['unit']}"
            lines.append({**r, "what": what, "words": describe_setting(run, make_setting(r)), "multiple": multiples[race]})
    code = itemise(dict.fromkeys(r["in_python"] for r in lines if r.get("in_python")))
    python = f" These times contain Python code of the suite: {code}." if code else ""
    note = f"The multiple is the engine's time divided by that of the fastest engine at the same accuracy.{python}"
    return lay_out("engine_races", lines, note=note)


def list_changes(figures: Sequence[Row]) -> list[Row]:
    """Return a row for each accepted change of the engine's numbers in the accuracy gate's baseline, the latest first.

    Args:
        figures: rows of the baseline, one for each number, in which `accepted` is "DATE REASON".
    """
    lines: list[Row] = []
    for accepted, rows in group_by(figures, "accepted").items():
        date, _, reason = accepted.partition(" ")
        if reason:
            lines.append({"date": date, "reason": reason, "figures": len(rows)})
    return sorted(lines, key=lambda line: (line["date"], line["reason"]), reverse=True)


def list_failures(run: Run, name: str) -> list[str]:
    """Return sentences on what the engine failed at: cases, runs of the search, models, and accelerations."""
    rows = of_engine(run.results, name)
    failed = [r for r in rows if not has_ended(r) and r["status"] != "skip"]
    # negative controls are left out: they are invalid on purpose
    invalid = [r for r in rows if has_ended(r) and not r["valid"] and not r["control"]]
    ladder = of_engine(run.table("search_ladder"), name)  # its trials in the search
    early = [r for r in ladder if r["status"] not in ("ok", "skip")]
    sentences = []
    if failed:
        statuses, places = (itemise(sorted({r[k] for r in failed})) for k in ("status", "mechanism"))
        sentences.append(f"{count(len(failed), 'case')} of {len(rows)} ended without a motion: {statuses}, on {places}.")
    if invalid:
        # if no drift is known, the first case is named
        worst = max(with_number(invalid, "position_drift") or invalid[:1], key=lambda r: number(r, "position_drift"))
        sentences.append(
            f"{count(len(invalid), 'case')} of {len(rows)} ended and may not be used; the loosest opened a loop "
            f"by {error_text(number(worst, 'position_drift'))} ({worst['mechanism']}, {worst['settings']} "
            f"{worst['integrator']} at step {worst['step']:g} s)."
        )
    if early:
        steps = [r["step"] for r in with_number(early, "step")]
        # runs with a tolerance have no step
        smallest = f"; the smallest step among them was {min(steps):.2g} s" if steps else ""
        sentences.append(f"In the search {len(early)} of {count(len(ladder), 'evaluation')} ended early{smallest}.")
    tried = (*rows, *of_engine(run.table("search_winners"), name))
    skipped = sorted({r["message"] for r in tried if r["status"] == "skip"} - {""})
    sentences += [f"Cannot be modelled: {x.removeprefix('cannot be modelled: ')}." for x in skipped[:4]]
    sentences = [*(sentences or ["No case of this run failed."]), *list_inexact(run, name)]
    if not of_engine(run.table("atlas"), name):
        sentences.append(f"`gauss-bench atlas --engine {name}` maps where it fails, along stiffness, speed, mass and other axes.")
    return sentences


def list_inexact(run: Run, name: str) -> list[str]:
    """Return a sentence for each setting with wrong accelerations, with the cause if it is known."""
    causes = run.environment.get("engines", {}).get(name, {}).get("soft", {})
    rows = with_number(of_engine(run.results, name), "acceleration_error_median")
    sentences = []
    for settings, cases in group_by(rows, "settings").items():
        off = max(r["acceleration_error_median"] for r in cases)
        if off > SAME_ACCELERATION:
            cause = f": {causes[settings]}" if settings in causes else ""
            sentences.append(
                f"Under `{settings}` the relative error of accelerations at given states is {error_text(off)} in the median, where "
                f"{SAME_ACCELERATION:.0e} counts as none{cause}."
            )
    return sentences


def atlas_table(rows: Sequence[Row]) -> Table:
    """Return the table of the engine's limits: the values up to which it works as linkages get harder in one respect.

    Args:
        rows: the engine's rows of the table `atlas`, one for each axis: a respect in which linkages get harder, such as stiffness.
    """
    lines = []
    for r in rows:
        ends = {k: f"{r[k]:g} {r['unit']}".strip() if is_known(r.get(k)) else "" for k in ("passes_to", "breaks_at")}
        setting = setting_words(r, "settings", "stabilization") or "default"
        missing = "fails at the easiest" if not ends["passes_to"] else "passes to the end"  # reason of a dash in either column
        if r["last"] == "cannot":  # the engine cannot model the next linkage of the axis
            missing = "not run further"
        lines.append({**r, "setting": setting, "passes": ends["passes_to"], "breaks": ends["breaks_at"], "missing": missing})
    commits = itemise(sorted({r["commit"] for r in rows} - {""}))
    note = f"Each axis is run from easy to hard, one thing changed at a time{f'; at commit {commits}' if commits else ''}."
    return lay_out("engine_atlas", lines, note=note)


def engines_page(run: Run) -> Page:
    """Return the page that lists all engines, with their results in the tests of the suite `field`."""
    entries = []
    for name, its_run in runs_of_engines(run).items():
        rows = of_engine(its_run.results, name)
        if rows:
            valid = sum(bool(r["valid"]) for r in rows)
            words = f"{valid} of {count(len(rows), 'case')} valid" + ("" if its_run is run else " (suite `field`)")
        else:
            reasons = [r["message"] for r in of_engine(its_run.table("field"), name) if r["message"]]
            words = reasons[0] if reasons else "in the search alone, in no accuracy case"
        entries.append({"page": f"engine-{file_name(name)}.html", "name": name, "words": words})
    lead = "Each engine as shipped, as set here, and with the best settings found."
    tests = field.section(run)
    return plain_page("engines", "Engines", lead, "Engines", engines=entries, sections=[tests] if tests else [])
