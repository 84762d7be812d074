"""A linkage's page: its motion, error against cost, drift and energy over time, and the best setting of each engine."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.reach import Kind
from gauss_bench.report.content import Chart, Table, count, lay_out, times
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.linkages import pose_in
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import Row, Run, group_rows, is_known, may_rank, number, ok
from gauss_bench.report.sections.trajectories import best, whole
from gauss_bench.report.site.charts import FLOOR, MOST_LINES, label, over_time, points
from gauss_bench.report.site.motion import turning
from gauss_bench.report.site.page import Page, file_name, plain_page, render
from gauss_bench.report.site.playback import side_by_side
from gauss_bench.report.site.settings import (
    POSITIONS,
    Setting,
    cheapest_stored,
    in_words,
    method_of,
    multiples,
    not_held,
    size_in_words,
)

STEP = 1e-3  # [s] of the runs whose drift is drawn
HELD = 1e-4  # [m] accuracy at which the cheapest engines are named
PLAYED = 50  # points of a line in a figure
BETTER = 0.98  # a costlier setting is on the front if its error is below this share of the last one's
TITLES = {"accuracy": "What accuracy costs", "drift": "Do its loops stay shut?", "energy": "Energy", "forces": "Joint forces"}
FIRST = ("gauss-native", "lagrange-native", "mujoco", "pinocchio", "exudyn", "casadi")


def linkage_page(run: Run, name: str, scenario: str, settings: Sequence[Setting]) -> Page:
    own = [x for x in settings if x.mechanism == name]
    turn, pair = turning(run, name), side_by_side(run, name, scenario)
    charts = [x for x in (accuracy(own), drift(run, name), energy(run, name), forces(run, name)) if x]
    rows = [r for r in run.of(name) if r["scenario"] == scenario]
    title = name.replace("_", " ")
    body = render(
        "linkage.html",
        name=name,
        title=title,
        turn=turn and turn[0],
        still=None if turn else drawing(run, name),
        leaders=leaders(run, name, own),
        holding=holding(run, name, own),
        charts=charts,
        titles=TITLES,
        cases=best(name, scenario, rows) if rows else None,
        count=len(rows),
        rows_file=rows_file(name),
        pair=pair and pair[0],
    )
    data = {"charts": {x.name: x.data() for x in charts}, "turn": turn and turn[1], "pair": pair and pair[1]}
    data = {k: x for k, x in data.items() if x}
    scripts = ("player.js",) if turn or pair else ()
    return Page(f"linkage-{file_name(name)}", title, describe(run, name, scenario), body, data, "Linkages", scripts)


def rows_file(name: str) -> str:
    return f"linkage-{file_name(name)}-rows.html"


def rows_page(run: Run, name: str) -> Page | None:
    """Return the page with every case of a linkage."""
    scenarios = group_rows(run.of(name), lambda r: str(r["scenario"]))
    if not scenarios:
        return None
    tables = [whole(name, scenario, rows) for scenario, rows in scenarios.items()]
    back = f"linkage-{file_name(name)}.html", f"Back to {name}"
    title, lead = f"{name.replace('_', ' ')}: all cases", "Every case that was run, as it ended."
    return plain_page(rows_file(name).removesuffix(".html"), title, lead, back=back, tables=tables)


def describe(run: Run, name: str, scenario: str) -> str:
    """Describe the linkage in a sentence."""
    try:
        mechanism, _, _ = pose_in(run, name)
    except LinkageError:
        return f"Scenario {scenario}."
    loops = max(len(mechanism.joints) - len(mechanism.links), 0)
    parts = {"moving link": len(mechanism.links), "joint": len(mechanism.joints), "loop": loops, "degree": mechanism.dof}
    return f"{mechanism.title}: {', '.join(count(n, word) for word, n in parts.items())} of freedom. Scenario {scenario}."


def drawing(run: Run, name: str) -> Markup | None:
    """Return a still drawing, for linkages whose crank cannot turn fully; None if the linkage does not load."""
    try:
        return Markup(inline(draw(*pose_in(run, name)), "still"))
    except LinkageError:
        return None


def leaders(run: Run, name: str, settings: Sequence[Setting]) -> str:
    """Return a sentence on the cheapest engines within HELD, and on the engines that do not hold it."""
    if not settings:
        return ""
    held = cheapest_stored(run, name, settings, HELD, math.inf).values()
    cheapest = sorted((x for x in held if is_known(x.seconds)), key=lambda x: x.seconds)
    missed = {x.engine: str(Kind.UNTIMED) for x in held if x not in cheapest}
    missed |= {e: x.words for e, x in not_held(run, name, settings, HELD).items()}
    others = "".join(f" `{e}`: {words}." for e, words in missed.items())
    if not cheapest:
        return f"No setting that was timed stays within {1e3 * HELD:g} mm.{others}"
    over = multiples({x.engine: x.seconds for x in cheapest})
    names = [f"`{x.engine}`{' (own)' if x.engine in run.own_engines else ''}" for x in cheapest]
    next_ones = ", ".join(f"{y} {times(over[x.engine])} x" for x, y in zip(cheapest[1:5], names[1:5], strict=True))
    first = f"{names[0]} ({in_words(run, cheapest[0])}){f'; then {next_ones}' if next_ones else ''}"
    return f"Cheapest within {1e3 * HELD:g} mm over {cheapest[0].until:g} s: {first}.{others}"


def holding(run: Run, name: str, settings: Sequence[Setting]) -> Table | None:
    """Return the table of each engine's cheapest setting at four accuracies, fastest first."""
    lines = []
    for position in POSITIONS[::2][:4]:
        held = [x for x in cheapest_stored(run, name, settings, position, math.inf).values() if is_known(x.seconds)]
        over = multiples({x.engine: x.seconds for x in held})
        for x in sorted(held, key=lambda x: x.seconds):
            words = {"words": in_words(run, x), "size": size_in_words(x)}
            lines.append(vars(x) | words | {"within": position, "multiple": over[x.engine]})
    return lay_out("holding", lines) if lines else None


def accuracy(settings: Sequence[Setting]) -> Chart | None:
    """Return the chart of error against time, with the Pareto front of each engine's settings."""
    kept = [
        one
        for some in group_rows(map(vars, settings), lambda x: x["engine"]).values()
        for one in front(some, "seconds", "position")
    ]
    rows = [drawn(x, f"{x['engine']} {Setting(**x).words}", x["seconds"], 1e3 * x["position"], 1e3 * FLOOR) for x in kept]
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


def drawn(row: Row, name: str, x: float, y: float, least: float = FLOOR) -> dict[str, Any]:
    return {"engine": str(row["engine"]), "line": str(row["engine"]), "name": name, "x": x, "y": max(y, least)}


def toggle(rows: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    engines = tuple(dict.fromkeys(str(r["engine"]) for r in rows))
    return (engines, engines) if len(engines) > 1 else ((), ())


def front(rows: Sequence[Row], cost: str, error: str) -> list[Row]:
    """Return the Pareto front: rows that no other row beats in both cost and error, cheapest first."""
    kept: list[Row] = []
    for one in sorted((x for x in rows if is_known(x[cost])), key=lambda x: (x[cost], x[error])):
        if not kept or one[error] < BETTER * kept[-1][error]:
            kept.append(one)
    return kept


def forces(run: Run, name: str) -> Chart | None:
    """Return the chart of joint-force errors against the number of steps, with the Pareto front of each engine."""
    ladder = (r for r in run.table("search_ladder") if r["mechanism"] == name and r["status"] == "ok" and number(r, "steps") > 0)
    known = group_rows((r for r in ladder if is_known(r.get("force_error"))), lambda r: str(r["engine"]))
    kept = [one for some in known.values() for one in front(some, "steps", "force_error")]
    rows = [drawn(r, f"{r['engine']} {r['settings']}", number(r, "steps"), number(r, "force_error")) for r in kept]
    if not rows:
        return None
    words = (
        "Of each engine the variants that no other of it beats with as few steps; forces are those that its motion needs, computed "
        "by one code for all."
    )
    head = {"name": "variant", "x": "steps", "y": "error [N]"}
    spec = points(rows, "steps of the run", "largest error of a joint force [N]")
    return Chart("forces", "Joint forces", words, spec, tuple(rows), head, *toggle(rows))


def histories(run: Run, name: str, column: str) -> list[list[dict[str, Any]]]:
    """Return one line per engine over time: its plainest case with a step nearest to STEP. Engines in FIRST come first."""
    cases = {_case(r): r for r in run.of(name) if may_rank(r) or (ok(r) and not r["control"])}
    series = group_rows((r for r in run.table("series") if r["mechanism"] == name), _case)
    chosen: dict[str, tuple[Any, list[Row]]] = {}
    for key, rows in series.items():
        row = cases.get(key)
        if row is None or not any(is_known(r.get(column)) for r in rows):
            continue
        # prefer the step nearest to STEP, then no stabilisation, default settings and rk4
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
    places = [*FIRST, *sorted(chosen.keys() - set(FIRST))]
    for engine, (_, rows) in sorted(chosen.items(), key=lambda x: places.index(x[0])):
        some = sorted((r for r in rows if is_known(r.get(column))), key=lambda r: number(r, "t"))
        kept = [some[i] for i in sorted({round(float(x)) for x in np.linspace(0, len(some) - 1, PLAYED)})]
        first = cases[_case(rows[0])]
        said = " ".join(
            str(first[k]) for k in ("settings", "integrator", "stabilization") if first[k] not in ("", "default", "none")
        )
        lines.append([drawn(first, engine, number(r, "t"), abs(number(r, column))) | {"said": said} for r in kept])
    return lines


def _case(row: Row) -> tuple[Any, ...]:
    return *method_of(row), row["step"]


def history(run: Run, name: str, column: str, kind: str, title: str, words: str, axis: str) -> Chart | None:
    lines = histories(run, name, column)
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
    words = "Energy, work and losses against what they should sum to."
    return history(run, name, "energy_error", "energy", "Error of the energy balance", words, "energy error [J]")
