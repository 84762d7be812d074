"""The page of a linkage: its motion, error against cost, drift and energy over time, and the best setting of each engine."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from operator import itemgetter
from typing import Any

import numpy as np
from markupsafe import Markup

from gauss_bench.linkage.errors import LinkageError
from gauss_bench.reach import Kind
from gauss_bench.report.cases import end_error, has_ended, is_unstabilised, may_rank, setting_words
from gauss_bench.report.content import Chart, Table, lay_out
from gauss_bench.report.drawings.drawing import draw
from gauss_bench.report.drawings.pose import pose_in
from gauss_bench.report.palette import inline
from gauss_bench.report.rows import Item, Row, Run, group_by, is_known, number, with_number
from gauss_bench.report.sections.trajectories import all_cases, best_cases, name_most_accurate
from gauss_bench.report.site.charts import FLOOR, MOST_LINES, place_names, specify_lines, specify_points
from gauss_bench.report.site.page import Page, file_name, plain_page, render
from gauss_bench.report.site.playback import draw_turn, play_pair
from gauss_bench.report.site.settings import (
    POSITIONS,
    VARIANT,
    Setting,
    all_settings,
    cheapest_stored,
    describe_setting,
    describe_size,
    engines_short_of,
    fastest_first,
)
from gauss_bench.report.words import count, ratio_text

STEP = 1e-3  # [s] step of the runs whose drift is drawn
NAMED = 1e-4  # [m] accuracy at which the cheapest engines are named
SAMPLES = 50  # drawn points of a line in a figure
LISTED = 7  # every 7th drawn point is in the table of numbers below a figure, counted from the last point of a line
BETTER = 0.98  # a costlier setting is on a Pareto front if its error is below this share of the front's last error
TITLES = {"accuracy": "What accuracy costs", "drift": "Do the loops stay closed?", "energy": "Energy", "forces": "Joint forces"}
FIRST = ("gauss-native", "lagrange-native", "mujoco", "pinocchio", "exudyn", "casadi")  # engines whose lines come first
DRIFT = "Largest residual of the constraints over time, without stabilisation in engines that allow this."
ENERGY = "Energy gained beyond the work done, over time."
case_of = itemgetter(*VARIANT, "step")  # values that identify a case in the tables `results` and `series`


def linkage_page(run: Run, name: str, scenario: str) -> Page:
    """Return the page of a linkage; parts without rows are left out."""
    # (SVG, data) and (contents for the template, data); each is None without such a picture
    turn, pair = draw_turn(run, name), play_pair(run, name, scenario)
    lead, still = f"Scenario {scenario}.", None
    with suppress(LinkageError):
        pose = pose_in(run, name)
        mechanism = pose[0]
        still = None if turn else Markup(inline(draw(*pose), "still"))
        # "degree" is last, because "of freedom" follows the list: 1 degree of freedom, 2 degrees of freedom
        numbers = {
            "moving link": len(mechanism.links),
            "joint": len(mechanism.joints),
            "loop": mechanism.loops,
            "degree": mechanism.dof,
        }
        lead = f"{mechanism.title}: {', '.join(count(n, word) for word, n in numbers.items())} of freedom. Scenario {scenario}."
    candidates = (
        accuracy_chart(all_settings(run).get(name, [])),
        history_chart(run, name, "position_drift", "drift", "Drift of the loops", DRIFT, "residual [m, rad]"),
        history_chart(run, name, "energy_error", "energy", "Error of the energy balance", ENERGY, "energy error [J]"),
        force_chart(run, name),
    )
    charts = [chart for chart in candidates if chart is not None]
    rows = [r for r in run.cases_of(name) if r["scenario"] == scenario]
    usable = [r for r in rows if may_rank(r) and is_known(end_error(r))]
    title = name.replace("_", " ")
    body = render(
        "linkage.html",
        name=name,
        title=title,
        turn=turn and turn[0],
        still=still,
        leaders=name_leaders(run, name),
        holding=list_leaders(run, name),
        charts=charts,
        titles=TITLES,
        cases=best_cases(name, scenario, rows) if rows else None,
        exact=name_most_accurate(usable) if usable else "",
        count=len(rows),
        rows_file=f"{rows_name(name)}.html",
        pair=pair and pair[0],
    )
    data = {"charts": {x.name: x.data() for x in charts}, "turn": turn and turn[1], "pair": pair and pair[1]}
    scripts = ("player.js",) if turn or pair else ()
    data = {k: x for k, x in data.items() if x}
    return Page(f"linkage-{file_name(name)}", title, lead, body, data, "Linkages", scripts)


def rows_name(name: str) -> str:
    """Return the name of the page with every case of a linkage."""
    return f"linkage-{file_name(name)}-rows"


def rows_page(run: Run, name: str) -> Page | None:
    """Return the page with every case of a linkage, or None for a linkage without cases."""
    scenarios = group_by(run.cases_of(name), "scenario")
    if not scenarios:
        return None
    tables = [all_cases(name, scenario, rows) for scenario, rows in scenarios.items()]
    back = f"linkage-{file_name(name)}.html", f"Back to {name}"
    title, lead = f"{name.replace('_', ' ')}: all cases", "All cases that were run, with their status."
    return plain_page(rows_name(name), title, lead, back=back, tables=tables)


def name_leaders(run: Run, name: str) -> str:
    """Return sentences on the fastest engines within NAMED [m], and on why other engines have no time; empty without settings."""
    if name not in all_settings(run):
        return ""
    timed = fastest_first(run, name, NAMED)
    reasons = {x.engine: str(Kind.UNTIMED) for x in cheapest_stored(run, name, NAMED).values() if not is_known(x.seconds)}
    reasons |= {engine: reach.words for engine, reach in engines_short_of(run, name, NAMED).items()}
    others = "".join(f" `{engine}`: {words}." for engine, words in reasons.items())
    if not timed:
        return f"No setting that was timed stays within {1e3 * NAMED:g} mm.{others}"
    first, *rest = timed
    names = {x.engine: f"`{x.engine}`{' (own)' if x.engine in run.own_engines else ''}" for x in timed}
    followers = ", ".join(f"{names[x.engine]} {ratio_text(x.seconds / first.seconds)} x" for x in rest[:4])
    text = f"{names[first.engine]} ({describe_setting(run, first)}){f'; then {followers}' if followers else ''}"
    return f"Cheapest within {1e3 * NAMED:g} mm over {first.until:g} s: {text}.{others}"


def list_leaders(run: Run, name: str) -> Table | None:
    """Return the table of each engine's cheapest setting at four accuracies; None if no timed setting reaches any."""
    lines = []
    for position in POSITIONS[::2][:4]:  # 1e-2, 1e-4, 1e-6 and 1e-8 m
        timed = fastest_first(run, name, position)
        for x in timed:
            words = {"words": describe_setting(run, x), "size": describe_size(x)}
            lines.append(vars(x) | words | {"within": position, "multiple": x.seconds / timed[0].seconds})
    return lay_out("holding", lines) if lines else None


def accuracy_chart(settings: Sequence[Setting]) -> Chart | None:
    """Return the chart of error against time, with the Pareto front of each engine's settings; None without settings."""
    groups = group_by(settings, lambda x: x.engine).values()
    front = [x for group in groups for x in pareto_front(group, lambda x: x.seconds, lambda x: x.position)]
    rows = [chart_row(x.engine, f"{x.engine} {x.words}", x.seconds, 1e3 * x.position, 1e3 * FLOOR) for x in front]
    if not rows:
        return None
    longest = max(x.until for x in settings)
    spec = specify_points(rows, f"processor time of {longest:g} s of motion [s]", "largest position error [mm]")
    words = (
        f"Largest error of any link's centre of mass over {longest:g} s, against the time of the run. The figure has the settings "
        "of each engine that no other of its settings beats in both, with and without stabilisation."
    )
    head = {"name": "setting", "x": "time [s]", "y": "error [mm]"}
    return Chart("accuracy", "Error against cost", words, spec, rows, head, toggles_of(rows))


def chart_row(engine: str, name: str, x: float, y: float, least: float = FLOOR) -> dict[str, Any]:
    """Return a point of a figure as a row of its data; `least` replaces a smaller y."""
    return {"engine": engine, "line": engine, "name": name, "x": x, "y": max(y, least)}


def toggles_of(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the engines that a reader of a figure may hide; none for a figure of one engine."""
    engines = list(dict.fromkeys(r["engine"] for r in rows))
    return engines if len(engines) > 1 else []


def pareto_front(items: Iterable[Item], cost: Callable[[Item], float], error: Callable[[Item], float]) -> list[Item]:
    """Return the items, cheapest first, whose error is less than BETTER times that of every cheaper item that is returned.

    Without the factor BETTER, these items would be the Pareto front: no other item has a lower cost and a smaller error. The factor
    drops items that are hardly more exact than a cheaper one. Items of unknown cost are left out.
    """
    front: list[Item] = []
    for item in sorted((x for x in items if is_known(cost(x))), key=lambda x: (cost(x), error(x))):
        if not front or error(item) < BETTER * error(front[-1]):
            front.append(item)
    return front


def force_chart(run: Run, name: str) -> Chart | None:
    """Return the chart of joint-force errors against numbers of steps, with the Pareto front of each engine; None without rows."""
    ladder = [r for r in run.table("search_ladder") if r["mechanism"] == name and r["status"] == "ok" and number(r, "steps") > 0]
    groups = group_by(with_number(ladder, "force_error"), "engine").values()
    front = [r for group in groups for r in pareto_front(group, itemgetter("steps"), itemgetter("force_error"))]
    rows = [chart_row(r["engine"], f"{r['engine']} {r['settings']}", r["steps"], r["force_error"]) for r in front]
    if not rows:
        return None
    words = (
        "Largest error of a joint force, against the number of steps. The figure has the variants of each engine that no other of "
        "its variants beats in both. Joint forces follow from the motion, by the same code for all engines."
    )
    head = {"name": "variant", "x": "steps", "y": "error [N]"}
    spec = specify_points(rows, "steps of the run", "largest error of a joint force [N]")
    return Chart("forces", "Joint forces", words, spec, rows, head, toggles_of(rows))


def list_histories(run: Run, name: str, column: str) -> list[list[dict[str, Any]]]:
    """Return for each engine its line in a chart over time, as rows: the values of `column` in the table `series`.

    The values of an engine are those of its case with the step nearest to STEP; of several such cases, one without stabilisation is
    preferred, then one with default settings, then one with RK4. Negative controls, which are wrong on purpose, are left out.
    Engines in FIRST come first.
    """
    linkage_rows = [r for r in run.table("series") if r["mechanism"] == name]
    series = group_by(with_number(linkage_rows, column), case_of)
    cases = [r for r in run.cases_of(name) if has_ended(r) and not r["control"] and case_of(r) in series]
    lines = []
    order = [*FIRST, *sorted({r["engine"] for r in cases} - set(FIRST))]
    by_engine = group_by(cases, "engine")
    for engine in sorted(by_engine, key=order.index):
        row = min(by_engine[engine], key=_plainness)
        samples = sorted(series[case_of(row)], key=itemgetter("t"))
        drawn = sorted({round(float(x)) for x in np.linspace(0, len(samples) - 1, SAMPLES)})  # indices of samples
        words = {"settings": setting_words(row)}
        lines.append([chart_row(engine, engine, samples[i]["t"], abs(samples[i][column])) | words for i in drawn])
    return lines


def _plainness(row: Row) -> tuple[Any, ...]:
    """Return the sort key of a case: the step nearest to STEP comes first, then no stabilisation, default settings, RK4."""
    distance = abs(math.log10(number(row, "step") / STEP))
    return distance, not is_unstabilised(row), row["settings"] != "default", row["integrator"] != "rk4"


def history_chart(run: Run, linkage: str, column: str, name: str, title: str, words: str, axis: str) -> Chart | None:
    """Return the chart of a column of the table `series` over time; None without rows."""
    lines = list_histories(run, linkage, column)
    if not lines:
        return None
    rows = place_names(lines)
    firsts = [line[0] for line in lines]  # the first row of each line
    shown = [x["engine"] for x in firsts[:MOST_LINES]]
    cases = "; ".join(f"{x['engine']} {x['settings']}".strip() for x in firsts)
    head = {"engine": "engine", "settings": "settings", "x": "time [s]", "y": axis}
    words = f"{words} Cases, at a step of {STEP:g} s if there is one: {cases}."
    # every LISTED-th point of each line, counted from its last point, which is kept
    listed = [row for line in lines for row in line[::-LISTED][::-1]]
    note = f"Every {LISTED}th drawn point; `series.parquet` of the data page has all."
    return Chart(name, title, words, specify_lines(rows, axis), rows, head, toggles_of(firsts), shown, listed=listed, note=note)
