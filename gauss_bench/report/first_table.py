"""The first table of README, the summary and the site: the time in which each engine holds a requirement, and its multiple.

Every multiple in a report comes from `multiples`: a time divided by the smallest time of all engines. Engines of the suite's
authors are marked. README has the table between two marker lines; `make publish` writes it there by `pictures.py`.
"""

import math
from collections.abc import Sequence
from statistics import median

from gauss_bench.reach import Requirement, reach, trial_of
from gauss_bench.report.content import NOTHING, Cell, Table, duration, error, small, text_cell, times
from gauss_bench.report.pages import markdown_cell
from gauss_bench.report.rows import Row, Run, group_rows, over_time
from gauss_bench.report.site.settings import Setting, all_settings, cheapest, cheapest_stored, multiples

FIRST = 1e-6  # [m]
SHOWN = ("four_bar", "six_bar")  # in full: one loop, and two
BEGIN, END = "<!-- first table, written by make publish -->", "<!-- end of the first table -->"
SAID = (
    "For each engine its cheapest setting that holds this: error, processor time, and how many times the time of the fastest of "
    "all on that linkage, whoever made it. Engines marked (own) are written by the authors of this suite."
)


def way_of(engine: str, settings: str) -> str:
    """Return the engine's name; Pinocchio's also says whether its loop is compiled or called from Python."""
    if engine != "pinocchio":
        return engine
    return f"{engine}, {'compiled' if settings.startswith('compiled') else 'called from Python'}"


def cheapest_ways(run: Run, mechanism: str, settings: Sequence[Setting], position: float) -> dict[str, Setting]:
    """Return engine (with its kind of loop) -> its cheapest setting that holds; winners of races at this accuracy come first."""
    leaders = cheapest_stored(run, mechanism, settings, position, float("inf"))
    found = {way_of(x.engine, x.settings): x for x in leaders.values()}
    for way in dict.fromkeys(way_of(x.engine, x.settings) for x in settings):
        some = [x for x in settings if way_of(x.engine, x.settings) == way]
        if way not in found and (one := next(iter(cheapest(some, position).values()), None)):
            found[way] = one
    return found


def mark(run: Run, way: str) -> str:
    return f"{way} (own)" if way.partition(",")[0] in run.own_engines else way


def first_table(run: Run, position: float = FIRST) -> Table | None:
    """Return a row per engine: error, time and multiple on the linkages SHOWN, and the range of its multiples on all linkages."""
    settings = all_settings(run)
    ran = {r["engine"] for r in run.table("search_ladder") if r["status"] != "skip"}
    ladder = group_rows((r for r in run.table("search_ladder") if r["engine"] in ran), lambda r: str(r["mechanism"]))
    held = {x: cheapest_ways(run, x, [s for s in settings if s.mechanism == x], position) for x in ladder}
    if not any(held.values()):
        return None
    over = {x: multiples({way: one.seconds for way, one in found.items()}) for x, found in held.items()}
    tried = {x: group_rows(rows, lambda r: way_of(str(r["engine"]), str(r["settings"]))) for x, rows in ladder.items()}
    shown = [x for x in SHOWN if x in held] or list(held)[:2]
    names = {way for some in tried.values() for way in some} | {way for some in held.values() for way in some}
    ways = {way: [x[way] for x in over.values() if way in x] for way in names}
    lines = []
    for way in sorted(ways, key=lambda w: (median(ways[w] or [math.inf]), w)):
        cells = [text_cell(mark(run, way))]
        for name in shown:
            one = held[name].get(way)
            if one is None:
                cells += [text_cell(why_not(tried[name].get(way, []), position)), Cell(NOTHING), Cell(NOTHING)]
            else:
                multiple = over[name].get(way, math.nan)
                cells += [Cell(error(one.position), one.position), Cell(duration(one.seconds), one.seconds)]
                cells.append(Cell(times(multiple), multiple))
        ends = dict.fromkeys(times(x) for x in (min(ways[way]), max(ways[way]))) if ways[way] else (NOTHING,)
        lines.append((*cells, Cell(f"{sum(way in x for x in held.values())} of {len(held)}"), Cell(" to ".join(ends))))
    figures = (f"{x}: {y}" for x in shown for y in ("error [m]", "time", "multiple"))
    head = ("engine", *figures, "holds on", "multiples")
    return Table(title(run, position), head, tuple(lines), frozenset(range(1, len(head))))


def why_not(rows: Sequence[Row], position: float) -> str:
    """Return in a few words why an engine has no time, from its rows of `search_ladder` on a linkage."""
    variants = group_rows(rows, lambda r: (r["settings"], r["integrator"], r["stabilization"])).values()
    answer = reach([[trial_of(r) for r in some] for some in variants], [Requirement("position", position)], "no race took it in")
    return answer.words.partition(":")[0]


def title(run: Run, position: float = FIRST) -> str:
    return f"Within {small(position)} m of position {over_time(run)}"


def markdown(table: Table) -> str:
    """Return the table in Markdown."""
    rule = ["---:" if i in table.numeric else "---" for i in range(len(table.head))]
    rows = [table.head, rule, *(map(markdown_cell, row) for row in table.rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def renew(page: str, run: Run) -> str:
    """Return README's text with the table of a run between the marker lines."""
    before, found, rest = page.partition(BEGIN)
    _, ended, after = rest.partition(END)
    if not found or not ended:
        raise ValueError(f"README has no lines {BEGIN} and {END}")
    table = first_table(run)
    assert table is not None, "the run searched nothing"
    return f"{before}{BEGIN}\n{markdown(table)}\n{END}{after}"
