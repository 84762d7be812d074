"""An engine's page: as shipped, as this suite would set it, the best that was found, what breaks it, and how to object."""

import math
from collections.abc import Sequence
from statistics import geometric_mean

from markupsafe import Markup

from gauss_bench.reach import ERRORS
from gauss_bench.report.content import (
    BELOW_LEGEND,
    Cell,
    Table,
    columns,
    count,
    error,
    error_cell,
    itemise,
    small,
    span,
    text_cell,
    time_of,
    times,
)
from gauss_bench.report.first_table import FIRST
from gauss_bench.report.reaches import engines_of
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number, ok
from gauss_bench.report.site.page import Page, file_name, heading, join_blocks, link, paragraph, rich, table
from gauss_bench.report.site.settings import (
    POSITIONS,
    Setting,
    answer_of,
    cheapest_stored,
    in_words,
    linkages,
    multiples,
    row_in_words,
)

OBJECT = (
    "Its authors may object that a setting they would use is missing, or that the adapter asks it in a way they would not. Every "
    "knob that was searched stands below with where it is documented. A better variant is one line of `variants.toml` in the "
    "engine's room; the search then tries it beside the others, and a changed result is published like any other."
)
REACH = ("passes_to", "breaks_at")
COST = "Times of a step called from Python include the adapter's translation; in the engine's own loop they do not."


def engine_names(run: Run) -> tuple[str, ...]:
    return tuple(
        sorted({str(r["engine"]) for r in (*run.results, *run.table("search_winners"), *run.table("search_ladder"))} - {""})
    )


def engine_page(run: Run, name: str, settings: Sequence[Setting]) -> Page:
    rows = [r for r in run.results if r["engine"] == name]
    installed = run.environment.get("engines", {}).get(name, {})
    version = str(installed.get("version", "")) if isinstance(installed, dict) else ""
    body: list[Markup] = []
    if rows:
        body += [
            heading("As shipped and as set here", "default"),
            paragraph("One line for each linkage, setting and integrator: its most accurate case."),
            table(cases(rows)),
        ]
    if best := [x for x in settings if x.engine == name]:
        body += [
            heading("Best found", "best"),
            paragraph("The cheapest setting within each tolerance, of all that were tried on a linkage."),
            table(bests(run, name, settings)),
        ]
    if winners := [r for r in run.table("search_winners") if r["engine"] == name and r["required"] and is_known(r.get("seconds"))]:
        body.append(table(list_races(run, winners)))
    if reasons := why(run, name, settings):
        body += [heading("Why it takes this long", "why"), paragraph(reasons[0]), table(reasons[1])]
    body += [heading("What breaks it", "breaks"), *map(paragraph, broken(run, name))]
    if reached := [r for r in run.table("atlas") if r["engine"] == name]:
        body.append(table(atlas(reached)))
    body += [
        heading("What its authors may object to", "object"),
        paragraph(OBJECT if best else OBJECT.partition(" Every")[0] + "."),
        *knobs(run, name),
    ]
    control = any(r["control"] for r in rows)
    lead = (
        "A negative control, wrong on purpose: it must never pass."
        if control
        else f"{version or name}: as shipped, as set here, and the best that was found."
    )
    return Page(f"engine-{file_name(name)}", name, lead, join_blocks(body))


def cases(rows: Sequence[Row]) -> Table:
    def least(some: Sequence[Row]) -> Row:
        return min(some, key=lambda r: (not ok(r), number(r, "position_error") if is_known(r.get("position_error")) else 1e99))

    lines = []
    for group in group_rows(rows, lambda r: (r["mechanism"], r["settings"], r["integrator"])).values():
        row = least(group)
        tone = "good" if row["valid"] else "bad"
        names = (
            text_cell(row["mechanism"]),
            text_cell(row["settings"]),
            text_cell(row["integrator"]),
            text_cell(row["stabilization"]),
        )
        step = Cell(f"{number(row, 'step'):g}", number(row, "step")) if is_known(row.get("step")) else Cell("own")
        numbers = (
            error_cell(row, "position_error", number(row, "position_error_bar")),
            error_cell(row, "position_drift"),
            error_cell(row, "energy_error"),
        )
        status = "valid" if row["valid"] else str(row.get("flag") or row["message"] or row["status"])
        lines.append((*names, step, *numbers, text_cell(status, tone)))
    head, numeric = columns(
        ("linkage", "settings", "integrator", "stabilization", "step [s]", "position error", "drift", "energy [J]", "outcome"),
        4,
        last_text=1,
    )
    return Table("Cases", head, tuple(lines), numeric, note=BELOW_LEGEND)


def bests(run: Run, name: str, settings: Sequence[Setting]) -> Table:
    lines = []
    for linkage in linkages(run):
        own = [x for x in settings if (x.mechanism, x.engine) == (linkage, name)]
        for position in POSITIONS[1::2] if own or name in engines_of(run, linkage) else ():
            one = cheapest_stored(run, linkage, own, position, float("inf")).get(name)
            if one is None:
                words = text_cell(answer_of(run, linkage, name, own, position).words, "warn")
                lines.append((text_cell(linkage), Cell(f"{1e3 * position:g}", position), words, *[Cell("-")] * 3))
                continue
            size = (
                f"{one.step:.3g} s"
                if is_known(one.step)
                else f"tolerance {one.tolerance:.0e}"
                if is_known(one.tolerance)
                else "own"
            )
            lines.append(
                (
                    text_cell(linkage),
                    Cell(f"{1e3 * position:g}", position),
                    text_cell(in_words(run, one)),
                    text_cell(size),
                    Cell(f"{1e6 * one.seconds:.4g}", one.seconds) if is_known(one.seconds) else text_cell("not timed"),
                    Cell(f"{1e3 * one.position:.1e}", one.position),
                )
            )
    return Table(
        "Best found",
        ("linkage", "within [mm]", "setting", "step or tolerance", "time [µs]", "error [mm]"),
        tuple(lines),
        frozenset({1, 4, 5}),
    )


def why(run: Run, name: str, settings: Sequence[Setting]) -> tuple[str, Table] | None:
    """Return the engine's multiple within FIRST as steps times time of a step, in a sentence and linkage by linkage."""
    lines, shares = [], []
    for linkage in linkages(run):
        held = cheapest_stored(run, linkage, [x for x in settings if x.mechanism == linkage], FIRST, math.inf)
        timed = [x for x in held.values() if is_known(x.seconds) and x.steps > 0]
        one = next((x for x in timed if x.engine == name), None)
        if one is None:
            continue
        best = min(timed, key=lambda x: x.seconds)
        whole, steps = one.seconds / best.seconds, one.steps / best.steps
        shares.append((whole, steps, whole / steps))
        ratios = (Cell(times(x), x) for x in shares[-1])
        lines.append((text_cell(linkage), text_cell(best.engine), *ratios, text_cell(in_words(run, one))))
    if not lines:
        return None
    whole, steps, each = (geometric_mean(x) for x in zip(*shares, strict=True))  # whose product holds, as medians' does not
    said = (
        f"To hold {small(FIRST)} m, on {count(len(lines), 'linkage')} it takes, as geometric means, {times(whole)} times as long "
        f"as the fastest engine there: {times(steps)} times as many steps, each of {times(each)} times the time."
    )
    cause = "the number of its steps" if steps > each else "what one of its steps costs"
    said += f" {cause[0].upper()}{cause[1:]} decides." if whole > 1.05 else " It is the fastest."
    head, numeric = columns(("linkage", "fastest", "time", "steps", "time of a step", "its setting"), 2, last_text=1)
    return said, Table("Multiples of the fastest", head, tuple(lines), numeric)


def list_races(run: Run, rows: Sequence[Row]) -> Table:
    def fastest(r: Row) -> float:
        same = (x for x in run.table("search_winners") if all(x[k] == r[k] for k in ("mechanism", "required", "accuracy")))
        return multiples({str(x["engine"]): number(x, "seconds") for x in same if x["status"] == "ok"})[str(r["engine"])]

    lines = tuple(
        (
            text_cell(r["mechanism"]),
            text_cell(f"{ERRORS.get(str(r['required']), r['required'])} within {small(number(r, 'accuracy'))} {r['unit']}"),
            text_cell(
                row_in_words(run, r)
                or " ".join(str(r[k]) for k in ("settings", "integrator", "stabilization") if r[k] not in ("", "none"))
            ),
            time_of(r),
            Cell(times(fastest(r)), fastest(r)),
            span(r),
        )
        for r in rows
    )
    head, numeric = columns(("linkage", "required", "setting", "time", "multiple", "spread of the time"), 3)
    inside = itemise(dict.fromkeys(str(r["in_python"]) for r in rows if r.get("in_python")))
    python = f" In Python inside these times, and the suite's own: {inside}." if inside else ""
    return Table(
        "Raced against the others",
        head,
        lines,
        numeric,
        note=f"Multiple: its time over that of the fastest of all at the same accuracy, whoever made it.{python}",
    )


def broken(run: Run, name: str) -> list[str]:
    """Sentences: where it failed, and what it was told off for."""
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
    skipped = sorted(
        {
            str(r["message"])
            for r in (*rows, *run.table("search_winners"))
            if r["engine"] == name and r["status"] == "skip" and r["message"]
        }
    )
    said += [f"Not modelled: {x}." for x in skipped[:4]]
    said = said or ["Nothing of this run did."]
    if any(r["engine"] == name for r in run.table("atlas")):
        return said
    return [*said, f"`gauss-bench atlas --engine {name}` maps where it fails, along stiffness, speed, mass and other axes."]


def atlas(rows: Sequence[Row]) -> Table:
    """The engine's reach along each axis of the atlas."""

    def value(row: Row, column: str) -> Cell:
        return (
            Cell(f"{number(row, column):g} {row['unit']}".strip(), number(row, column)) if is_known(row.get(column)) else Cell("-")
        )

    tones = {"pass": "good", "failed": "bad", "degraded": "warn"}
    lines = []
    for r in rows:
        way = " ".join(str(r[k]) for k in ("settings", "stabilization") if r[k] not in ("", "none", "default"))
        last = text_cell(r["last"], tones.get(str(r["last"]), ""))
        lines.append(
            (text_cell(r["axis"]), text_cell(way or "default"), *(value(r, k) for k in REACH), last, text_cell(r["reason"]))
        )
    commits = itemise(sorted({str(r["commit"]) for r in rows if r["commit"]}))
    note = f"Each axis is run from easy to hard, one thing changed at a time{f'; by the code of {commits}' if commits else ''}."
    head = ("axis", "setting", "passes to", "breaks at", "then", "reason")
    return Table("How far it goes", head, tuple(lines), frozenset({2, 3}), note=note)


def knobs(run: Run, name: str) -> list[Markup]:
    rows = [r for r in run.table("search_knobs") if r["engine"] == name]
    if not rows:
        return []
    lines = tuple((text_cell(r["knob"]), text_cell(r["meaning"]), text_cell(r["source"])) for r in rows)
    return [table(Table("Knobs that were searched", ("knob", "meaning", "documented at"), lines))]


def engines_page(run: Run, settings: Sequence[Setting]) -> Page:
    """All engines, one line each."""
    lines = []
    for name in engine_names(run):
        rows = [r for r in run.results if r["engine"] == name]
        valid = sum(bool(r["valid"]) for r in rows)
        lines.append(
            Markup("<li>{}: {}</li>").format(
                link(f"engine-{file_name(name)}.html", name),
                rich(f"{valid} of {count(len(rows), 'case')} valid" if rows else "searched alone"),
            )
        )
    return Page(
        "engines",
        "Engines",
        "Each as shipped, as set here, and at the best that was found.",
        Markup("<ul>{}</ul>").format(join_blocks(lines)),
        group="Engines",
    )
