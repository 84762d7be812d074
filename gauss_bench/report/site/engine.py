"""An engine's page: its cases, its best settings, its races, its failures, and how to object to the results."""

import math
from collections.abc import Iterator, Sequence
from statistics import geometric_mean

from gauss_bench.reach import ERRORS
from gauss_bench.report.content import Table, count, error, itemise, lay_out, small, times
from gauss_bench.report.first_table import FIRST
from gauss_bench.report.reaches import engines_of
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number, ok
from gauss_bench.report.site.page import Page, file_name, plain_page, render
from gauss_bench.report.site.settings import (
    POSITIONS,
    Setting,
    answer_of,
    cheapest_stored,
    in_words,
    linkages,
    multiples,
    row_in_words,
    size_in_words,
)


def engine_names(run: Run) -> tuple[str, ...]:
    return tuple(
        sorted({str(r["engine"]) for r in (*run.results, *run.table("search_winners"), *run.table("search_ladder"))} - {""})
    )


def engine_page(run: Run, name: str, settings: Sequence[Setting]) -> Page:
    rows = [r for r in run.results if r["engine"] == name]
    installed = run.environment.get("engines", {}).get(name, {})
    version = str(installed.get("version", "")) if isinstance(installed, dict) else ""
    winners = [r for r in run.table("search_winners") if r["engine"] == name and r["required"] and is_known(r.get("seconds"))]
    reached = [r for r in run.table("atlas") if r["engine"] == name]
    knobs = [r for r in run.table("search_knobs") if r["engine"] == name]
    body = render(
        "engine.html",
        cases=lay_out("engine_cases", cases(rows)) if rows else None,
        bests=bests(run, name, settings) if any(x.engine == name for x in settings) else None,
        races=races(run, winners) if winners else None,
        why=why(run, name, settings),
        broken=broken(run, name),
        atlas=atlas(reached) if reached else None,
        knobs=lay_out("engine_knobs", knobs) if knobs else None,
    )
    wrong = "A negative control, wrong on purpose: it must never pass."
    lead = wrong if any(r["control"] for r in rows) else f"{version or name}: as shipped, as set here, and the best that was found."
    return Page(f"engine-{file_name(name)}", name, lead, body)


def cases(rows: Sequence[Row]) -> Iterator[Row]:
    """Yield the most accurate case of each linkage, setting and integrator, with its outcome."""
    for group in group_rows(rows, lambda r: (r["mechanism"], r["settings"], r["integrator"])).values():
        row = min(group, key=lambda r: (not ok(r), number(r, "position_error") if is_known(r.get("position_error")) else math.inf))
        outcome = "valid" if row["valid"] else str(row.get("flag") or row["message"] or row["status"])
        yield {**row, "outcome": outcome, "outcome_tone": "good" if row["valid"] else "bad"}


def bests(run: Run, name: str, settings: Sequence[Setting]) -> Table:
    """Return the engine's cheapest setting per linkage and accuracy, or why none holds it."""
    lines: list[Row] = []
    for linkage in linkages(run):
        own = [x for x in settings if (x.mechanism, x.engine) == (linkage, name)]
        for position in POSITIONS[1::2] if own or name in engines_of(run, linkage) else ():
            place = {"mechanism": linkage, "within": position}
            one = cheapest_stored(run, linkage, own, position, math.inf).get(name)
            if one is None:
                lines.append(place | {"words": answer_of(run, linkage, name, own, position).words, "words_tone": "warn"})
            else:
                lines.append(vars(one) | place | {"words": in_words(run, one), "size": size_in_words(one)})
    return lay_out("engine_bests", lines)


def why(run: Run, name: str, settings: Sequence[Setting]) -> tuple[str, Table] | None:
    """Return the engine's multiple within FIRST as steps times time of a step, in a sentence and linkage by linkage."""
    lines = []
    for linkage in linkages(run):
        held = cheapest_stored(run, linkage, [x for x in settings if x.mechanism == linkage], FIRST, math.inf)
        timed = {e: x for e, x in held.items() if is_known(x.seconds) and x.steps > 0}
        if name in timed:
            one, best = timed[name], min(timed.values(), key=lambda x: x.seconds)
            whole, steps = one.seconds / best.seconds, one.steps / best.steps
            ratios = {"time": whole, "steps": steps, "each": whole / steps}
            lines.append(ratios | {"mechanism": linkage, "fastest": best.engine, "words": in_words(run, one)})
    if not lines:
        return None
    # geometric means, unlike medians, keep the identity time = steps * time per step
    whole, steps, each = (geometric_mean(number(x, k) for x in lines) for k in ("time", "steps", "each"))
    sentence = (
        f"To hold {small(FIRST)} m, on {count(len(lines), 'linkage')} it takes, as geometric means, {times(whole)} times as long "
        f"as the fastest engine there: {times(steps)} times as many steps, each of {times(each)} times the time."
    )
    cause = "The number of its steps" if steps > each else "What one of its steps costs"
    return sentence + (f" {cause} decides." if whole > 1.05 else " It is the fastest."), lay_out("engine_why", lines)


def races(run: Run, rows: Sequence[Row]) -> Table:
    """Return the engine's races, each with its time as a multiple of the fastest at the same accuracy."""
    lines = []
    for r in rows:
        same = (x for x in run.table("search_winners") if all(x[k] == r[k] for k in ("mechanism", "required", "accuracy")))
        over = multiples({str(x["engine"]): number(x, "seconds") for x in same if x["status"] == "ok"})
        choices = " ".join(str(r[k]) for k in ("settings", "integrator", "stabilization") if r[k] not in ("", "none"))
        what = f"{ERRORS.get(str(r['required']), r['required'])} within {small(number(r, 'accuracy'))} {r['unit']}"
        lines.append({**r, "what": what, "words": row_in_words(run, r) or choices, "multiple": over[str(r["engine"])]})
    inside = itemise(dict.fromkeys(str(r["in_python"]) for r in rows if r.get("in_python")))
    python = f" In Python inside these times, and the suite's own: {inside}." if inside else ""
    note = f"Multiple: its time over that of the fastest of all at the same accuracy, whoever made it.{python}"
    return lay_out("engine_races", lines, note=note)


def broken(run: Run, name: str) -> list[str]:
    """Return sentences on where the engine failed, was invalid, or does not model a linkage."""
    rows = [r for r in run.results if r["engine"] == name]
    failed = [r for r in rows if not ok(r) and r["status"] != "skip"]
    invalid = [r for r in rows if ok(r) and not r["valid"] and not r["control"]]
    ladder = [r for r in run.table("search_ladder") if r["engine"] == name]
    lost = [r for r in ladder if r["status"] not in ("ok", "skip")]
    said = []
    if failed:
        said.append(
            f"{count(len(failed), 'case')} of {len(rows)} ended without a motion: "
            f"{itemise(sorted({str(r['status']) for r in failed}))}, on {itemise(sorted({str(r['mechanism']) for r in failed}))}."
        )
    if invalid:
        worst = max(invalid, key=lambda r: number(r, "position_drift") if is_known(r.get("position_drift")) else 0.0)
        said.append(
            f"{count(len(invalid), 'case')} of {len(rows)} ended and may not be used; the loosest opened a loop "
            f"by {error(number(worst, 'position_drift'))} ({worst['mechanism']}, {worst['settings']} "
            f"{worst['integrator']} at step {worst['step']:g} s)."
        )
    if lost:
        said.append(
            f"In the search {len(lost)} of {count(len(ladder), 'evaluation')} ended early, most of them at steps "
            "that are too large; the smallest such step was "
            f"{min((number(r, 'step') for r in lost if is_known(r.get('step'))), default=0):.2g} s."
        )
    skips = (r for r in (*rows, *run.table("search_winners")) if r["engine"] == name and r["status"] == "skip")
    skipped = sorted({str(r["message"]) for r in skips if r["message"]})
    said += [f"Not modelled: {x}." for x in skipped[:4]]
    said = said or ["Nothing of this run did."]
    if not any(r["engine"] == name for r in run.table("atlas")):
        said.append(f"`gauss-bench atlas --engine {name}` maps where it fails, along stiffness, speed, mass and other axes.")
    return said


def atlas(rows: Sequence[Row]) -> Table:
    """Return the table of the engine's reach along each axis of the atlas."""
    lines = []
    for r in rows:
        setting = " ".join(str(r[k]) for k in ("settings", "stabilization") if r[k] not in ("", "none", "default"))
        ends = {k: f"{number(r, k):g} {r['unit']}".strip() if is_known(r.get(k)) else "" for k in ("passes_to", "breaks_at")}
        lines.append({**r, "way": setting or "default", "passes": ends["passes_to"], "breaks": ends["breaks_at"]})
    commits = itemise(sorted({str(r["commit"]) for r in rows if r["commit"]}))
    note = f"Each axis is run from easy to hard, one thing changed at a time{f'; by the code of {commits}' if commits else ''}."
    return lay_out("engine_atlas", lines, note=note)


def engines_page(run: Run) -> Page:
    """Return the page that lists all engines."""
    lines = []
    for name in engine_names(run):
        rows = [r for r in run.results if r["engine"] == name]
        valid = sum(bool(r["valid"]) for r in rows)
        said = f"{valid} of {count(len(rows), 'case')} valid" if rows else "searched alone"
        lines.append({"page": f"engine-{file_name(name)}.html", "name": name, "said": said})
    lead = "Each as shipped, as set here, and at the best that was found."
    return plain_page("engines", "Engines", lead, "Engines", engines=lines)
