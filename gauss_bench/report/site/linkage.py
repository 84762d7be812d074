"""A linkage's page: how it moves, what accuracy costs on it, how runs drift, and the best of each engine."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.reach import Kind
from gauss_bench.report.content import Cell, Chart, Table, count, duration, text_cell, times
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.linkages import pose_in
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import Row, Run, group_rows, is_known, may_rank, number, ok
from gauss_bench.report.sections.linkage.trajectories import best, whole
from gauss_bench.report.site.charts import FLOOR, MOST_LINES, label, over_time, points
from gauss_bench.report.site.first import millimetres
from gauss_bench.report.site.motion import turning
from gauss_bench.report.site.page import Page, chart, file_name, heading, join_blocks, link, paragraph, table
from gauss_bench.report.site.playback import side_by_side
from gauss_bench.report.site.settings import POSITIONS, Setting, cheapest_stored, in_words, method_of, multiples, not_held

STEP = 1e-3  # [s] of the runs whose drift is drawn
PLAYED = 50  # points of a line in a figure
TOP = 10
SIDE_BY_SIDE = (
    "Every link is drawn where the run had it, as stored; at `1 times` that is all. A larger factor magnifies what the run differs "
    "from the true motion by: being early or late along the motion of the linkage, and links that stand off closed loops straight "
    "apart. So joints are drawn open only where the run opened them. Of each engine its default and its most accurate setting."
)


def linkage_page(run: Run, name: str, scenario: str, settings: Sequence[Setting]) -> Page:
    own = [x for x in settings if x.mechanism == name]
    moved = turning(run, name, name.replace("_", " "))
    data: dict[str, Any] = {}
    body: list[Markup] = []
    if moved:
        body.append(moved[0])
        data["turn"] = moved[1]
    elif still := drawing(run, name):
        body.append(still)
    charts = [x for x in (accuracy(own), drift(run, name), energy(run, name), forces(run, name)) if x]
    body += [leaders(run, name, own)]
    if held := holding(run, name, own):
        body += [heading("Settings that hold an accuracy", "settings"), table(held, caption=False)]
    titles = {"accuracy": "What accuracy costs", "drift": "Do its loops stay shut?", "energy": "Energy", "forces": "Joint forces"}
    for one in charts:
        body += [heading(titles[one.name], one.name), chart(one)]
        data.setdefault("charts", {})[one.name] = one.data()
    rows = [r for r in run.of(name) if r["scenario"] == scenario]
    if rows:
        first = best(f"Most accurate case of each engine and setting, {scenario}", rows)
        body += [heading("Cases", "cases"), table(Table(first.title, first.head, first.rows, first.numeric, note=first.note))]
        body.append(Markup("<p>{}</p>").format(link(rows_file(name), f"All {len(rows)} cases of {name}")))
    if pair := side_by_side(run, name, scenario):
        body += [heading("Two engines side by side", "side-by-side"), paragraph(SIDE_BY_SIDE), pair[0]]
        data["pair"] = pair[1]
    scripts = ("player.js",) if moved or pair else ()
    return Page(
        f"linkage-{file_name(name)}",
        name.replace("_", " "),
        describe(run, name, scenario),
        join_blocks(body),
        data,
        "Linkages",
        scripts,
    )


def rows_file(name: str) -> str:
    return f"linkage-{file_name(name)}-rows.html"


def rows_page(run: Run, name: str) -> Page | None:
    """Every case of a linkage."""
    scenarios = group_rows(run.of(name), lambda r: str(r["scenario"]))
    if not scenarios:
        return None
    tables = [table(whole(f"{name}, {scenario}", list(rows)), most=10_000) for scenario, rows in scenarios.items()]
    back = Markup("<p>{}</p>").format(link(f"linkage-{file_name(name)}.html", f"Back to {name}"))
    return Page(
        rows_file(name).removesuffix(".html"),
        f"{name.replace('_', ' ')}: all cases",
        "Every case that was run, as it ended.",
        join_blocks([back, *tables]),
    )


def describe(run: Run, name: str, scenario: str) -> str:
    """Describe the linkage in a sentence."""
    try:
        mechanism, _, _ = pose_in(run, name)
    except LinkageError:
        return f"Scenario {scenario}."
    loops = max(len(mechanism.joints) - len(mechanism.links), 0)
    return (
        f"{mechanism.title}: {count(len(mechanism.links), 'moving link')}, "
        f"{count(len(mechanism.joints), 'joint')}, {count(loops, 'loop')}, "
        f"{count(mechanism.dof, 'degree')} of freedom. Scenario {scenario}."
    )


def drawing(run: Run, name: str) -> Markup | None:
    """A still one, where the crank does not come round."""
    try:
        text = draw(*pose_in(run, name))
    except LinkageError:
        return None
    return Markup('<div class="player"><div class="stage">{}</div></div>').format(Markup(inline(text, "still")))


def leaders(run: Run, name: str, settings: Sequence[Setting]) -> Markup:
    """Name who is cheapest within a tenth of a millimetre, in a sentence."""
    if not settings:
        return Markup("")
    held = cheapest_stored(run, name, settings, 1e-4, math.inf).values()
    cheapest = sorted((x for x in held if is_known(x.seconds)), key=lambda x: x.seconds)
    missed = {x.engine: str(Kind.UNTIMED) for x in held if x not in cheapest}
    missed |= {e: x.words for e, x in not_held(run, name, settings, 1e-4).items()}
    others = "".join(f" `{e}`: {words}." for e, words in missed.items())
    if not cheapest:
        return paragraph(f"No setting that was timed stays within {millimetres(1e-4)}.{others}")
    over = multiples({x.engine: x.seconds for x in cheapest})
    name_of = {x.engine: f"`{x.engine}`{' (own)' if x.engine in run.own_engines else ''}" for x in cheapest}
    said = ", ".join(f"{name_of[x.engine]} {times(over[x.engine])} x" for x in cheapest[1:5])
    rest = f"; then {said}" if said else ""
    return Markup("<p>{} {}</p>").format(
        paragraph(
            f"Cheapest within {millimetres(1e-4)} over {cheapest[0].until:g} s: {name_of[cheapest[0].engine]} "
            f"({in_words(run, cheapest[0])}){rest}.{others}"
        ).striptags(),
        link(f"index.html#linkage={name}", "Choose another tolerance"),
    )


def holding(run: Run, name: str, settings: Sequence[Setting]) -> Table | None:
    """The cheapest setting of each engine within some accuracies, fastest first."""
    lines = []
    for position in POSITIONS[::2][:4]:
        held = [x for x in cheapest_stored(run, name, settings, position, math.inf).values() if is_known(x.seconds)]
        over = multiples({x.engine: x.seconds for x in held})
        for x in sorted(held, key=lambda x: x.seconds):
            size = (
                f"{1e3 * x.step:.4g} ms" if is_known(x.step) else f"tolerance {x.tolerance:.0e}" if is_known(x.tolerance) else "own"
            )
            words = text_cell(in_words(run, x))
            cells = (Cell(f"{1e3 * position:g}", position), text_cell(x.engine), words, text_cell(size))
            lines.append((*cells, Cell(duration(x.seconds), x.seconds), Cell(times(over[x.engine]), over[x.engine])))
    head = ("within [mm]", "engine", "setting", "step", "time", "multiple")
    return Table("Settings that hold an accuracy", head, tuple(lines), frozenset({0, 4, 5}), note=UNNAMED) if lines else None


UNNAMED = "Options that a setting does not name are as the engine is shipped. Multiple: over the fastest of all, whoever made it."


def accuracy(settings: Sequence[Setting]) -> Chart | None:
    """Error against time: what no other setting of the same engine beats in both."""
    rows = []
    for engine in dict.fromkeys(x.engine for x in settings):
        for one in front([x for x in settings if x.engine == engine]):
            rows.append(
                {
                    "engine": engine,
                    "line": engine,
                    "name": f"{engine} {one.words}",
                    "x": one.seconds,
                    "y": 1e3 * max(one.position, FLOOR),
                }
            )
    if not rows:
        return None
    longest = max(x.until for x in settings)
    spec = points(rows, f"processor time of {longest:g} s of motion [s]", "largest position error [mm]")
    words = (
        f"Largest error of any link's centre of mass over {longest:g} s, against the time of that run; of each engine the settings "
        "that none of its others beats in both, projection and other stabilisation included."
    )
    head = {"name": "setting", "x": "time [s]", "y": "error [mm]"}
    return Chart("accuracy", "Error against cost", words, spec, tuple(rows), head, *toggle(rows))


def toggle(rows: Sequence[Mapping[str, Any]], most: int = 99) -> tuple[tuple[str, ...], tuple[str, ...]]:
    engines = tuple(dict.fromkeys(str(r["engine"]) for r in rows))
    return (engines, engines[:most]) if len(engines) > 1 else ((), ())


def front(settings: Sequence[Setting]) -> list[Setting]:
    """Settings that none is both as cheap and as exact as, cheapest first."""
    kept: list[Setting] = []
    for one in sorted((x for x in settings if is_known(x.seconds)), key=lambda x: (x.seconds, x.position)):
        if not kept or one.position < 0.98 * kept[-1].position:
            kept.append(one)
    return kept


def histories(run: Run, name: str, column: str) -> list[list[dict[str, Any]]]:
    """One line for each engine: its case at STEP with the fewest additions, the first engines of MOST_LINES first."""
    cases = {_case(r): r for r in run.of(name) if may_rank(r) or (ok(r) and not r["control"])}
    series = group_rows((r for r in run.table("series") if r["mechanism"] == name), _case)
    chosen: dict[str, tuple[Any, list[Row]]] = {}
    for key, rows in series.items():
        row = cases.get(key)
        if row is None or not any(is_known(r.get(column)) for r in rows):
            continue
        order = (
            abs(math.log10(number(row, "step") / STEP)),
            row["stabilization"] not in ("none", ""),
            row["settings"] != "default",
            str(row["integrator"]) != "rk4",
        )
        engine = str(row["engine"])
        if engine not in chosen or order < chosen[engine][0]:
            chosen[engine] = (order, rows)
    lines = []
    for engine, (_, rows) in sorted(
        chosen.items(), key=lambda x: (x[0] not in FIRST, FIRST.index(x[0]) if x[0] in FIRST else 0, x[0])
    ):
        some = sorted((r for r in rows if is_known(r.get(column))), key=lambda r: number(r, "t"))
        kept = [some[i] for i in sorted({round(float(x)) for x in np.linspace(0, len(some) - 1, PLAYED)})]
        first = cases[_case(rows[0])]
        said = " ".join(
            str(first[k]) for k in ("settings", "integrator", "stabilization") if first[k] not in ("", "default", "none")
        )
        lines.append(
            [
                {"engine": engine, "line": engine, "name": engine, "said": said, "x": number(r, "t"), "y": number(r, column)}
                for r in kept
            ]
        )
    return lines


FIRST = ("gauss-native", "lagrange-native", "mujoco", "pinocchio", "exudyn", "casadi")


def _case(row: Row) -> tuple[Any, ...]:
    return *method_of(row), row["step"]


def history(run: Run, name: str, column: str, kind: str, title: str, words: str, axis: str) -> Chart | None:
    lines = histories(run, name, column)
    lines = [[r | {"y": max(abs(r["y"]), FLOOR)} for r in line] for line in lines if line]
    if not lines:
        return None
    rows = label(lines)
    spec = over_time(rows, axis)
    toggles, _ = toggle(rows)
    shown = tuple(line[0]["engine"] for line in lines)[:MOST_LINES]
    said = "; ".join(f"{line[0]['engine']} {line[0]['said']}".strip() for line in lines)
    head = {"engine": "engine", "said": "settings", "x": "time [s]", "y": axis}
    return Chart(kind, title, f"{words} Cases at a step of {STEP:g} s where there are: {said}.", spec, rows, head, toggles, shown)


def drift(run: Run, name: str) -> Chart | None:
    words = "Largest residual of the constraints over time, nothing added to hold the loops where an engine can do without."
    return history(run, name, "position_drift", "drift", "Drift of the loops", words, "residual [m, rad]")


def energy(run: Run, name: str) -> Chart | None:
    return history(
        run,
        name,
        "energy_error",
        "energy",
        "Error of the energy balance",
        "Energy, work and losses against what they should sum to.",
        "energy error [J]",
    )


def forces(run: Run, name: str) -> Chart | None:
    """Error of joint forces against the step, of each engine's best variant there."""
    rows = []
    ladder = [
        r
        for r in run.table("search_ladder")
        if r["mechanism"] == name and r["status"] == "ok" and is_known(r.get("force_error")) and number(r, "steps") > 0
    ]
    for engine, some in group_rows(ladder, lambda r: str(r["engine"])).items():
        least: list[tuple[float, float, Row]] = []
        for row in sorted(some, key=lambda r: (number(r, "steps"), number(r, "force_error"))):
            if not least or number(row, "force_error") < 0.98 * least[-1][1]:
                least.append((number(row, "steps"), number(row, "force_error"), row))
        for steps, error, row in least:
            rows.append(
                {"engine": engine, "line": engine, "name": f"{engine} {row['settings']}", "x": steps, "y": max(error, FLOOR)}
            )
    if not rows:
        return None
    spec = points(rows, "steps of the run", "largest error of a joint force [N]")
    words = (
        "Of each engine the variants that no other of it beats with as few steps; forces are those that its "
        "motion needs, computed by one code for all."
    )
    return Chart(
        "forces", "Joint forces", words, spec, tuple(rows), {"name": "variant", "x": "steps", "y": "error [N]"}, *toggle(rows)
    )
