"""The first table of README, the summary and the site: the time in which each engine holds a requirement, and its multiple.

Every multiple in a report comes from `multiples`: a time divided by the smallest time of all engines. Engines of the suite's
authors are marked. README has the table between two marker lines; `make publish` writes it there by `pictures.py`.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median

from gauss_bench.reach import Requirement, reach, trial_of
from gauss_bench.report.content import Cell, Table, text_cell
from gauss_bench.report.pages import markdown_cell
from gauss_bench.report.rows import Row, Run, group_by, search_span
from gauss_bench.report.site.settings import Setting, all_settings, cheapest, cheapest_stored, multiples
from gauss_bench.report.words import NOTHING, error_text, limit_text, range_text, ratio_text, time_text

FIRST = 1e-6  # [m] accuracy of the first table
SHOWN = ("four_bar", "six_bar")  # linkages with all figures, of one loop and of two
BEGIN, END = "<!-- first table, written by make publish -->", "<!-- end of the first table -->"
EXPLAINED = (
    "For each engine the table has the cheapest setting that holds this accuracy, with its error and processor time. The multiple "
    "is this time divided by that of the fastest engine on the linkage. Engines marked (own) are written by the authors of this "
    "suite."
)


def loop_of(engine: str, settings: str) -> str:
    """Return the engine's name; Pinocchio's also says whether its loop is compiled or called from Python."""
    if engine != "pinocchio":
        return engine
    return f"{engine}, {'compiled' if settings.startswith('compiled') else 'called from Python'}"


def group_by_loop(settings: Iterable[Setting]) -> dict[str, list[Setting]]:
    """Return engine (with its kind of loop) -> its settings."""
    return group_by(settings, lambda x: loop_of(x.engine, x.settings))


def cheapest_loops(run: Run, mechanism: str, position: float) -> dict[str, Setting]:
    """Return engine (with its kind of loop) -> its cheapest setting that holds; winners of races at this accuracy come first."""
    settings = all_settings(run).get(mechanism, [])
    leaders = {loop: cheapest(some, position) for loop, some in group_by_loop(settings).items()}
    found = {loop: one for loop, some in leaders.items() for one in some.values()}
    return found | {loop_of(x.engine, x.settings): x for x in cheapest_stored(run, mechanism, position).values()}


def mark_own(run: Run, loop: str) -> str:
    """Return an engine's name, marked if the authors of the suite wrote it."""
    return f"{loop} (own)" if loop.partition(",")[0] in run.own_engines else loop


@dataclass(frozen=True)
class Answers:
    """What holding an accuracy costs on one linkage; keys are engines with their kind of loop.

    Attributes:
        leaders: cheapest settings that hold.
        multiples: their times over that of the fastest engine.
        ladders: rows of `search_ladder`.
    """

    leaders: dict[str, Setting]
    multiples: dict[str, float]
    ladders: dict[str, list[Row]]

    def cells(self, loop: str, position: float) -> list[Cell]:
        """Return error, time and multiple of an engine, or why it has none."""
        one = self.leaders.get(loop)
        if one is None:
            why = explain_missing(self.ladders.get(loop, []), position)
            return [text_cell(why), Cell(NOTHING, why=why), Cell(NOTHING, why=why)]
        multiple = self.multiples.get(loop, math.nan)
        error, time = Cell(error_text(one.position), one.position), Cell(time_text(one.seconds), one.seconds)
        return [error, time, Cell(ratio_text(multiple), multiple)]


def answers_of(run: Run, mechanism: str, ladder: Iterable[Row], position: float) -> Answers:
    """Return the answers of all engines on a linkage from its rows of `search_ladder`."""
    leaders = cheapest_loops(run, mechanism, position)
    over = multiples({loop: one.seconds for loop, one in leaders.items()})
    return Answers(leaders, over, group_by(ladder, lambda r: loop_of(r["engine"], r["settings"])))


def first_table(run: Run, position: float = FIRST) -> Table | None:
    """Return a row per engine: error, time and multiple on the linkages SHOWN, and the range of its multiples on all linkages."""
    modelled = {r["engine"] for r in run.table("search_ladder") if r["status"] != "skip"}
    ladders = group_by((r for r in run.table("search_ladder") if r["engine"] in modelled), "mechanism")
    answers = {name: answers_of(run, name, rows, position) for name, rows in ladders.items()}
    if not any(x.leaders for x in answers.values()):
        return None
    shown = [x for x in SHOWN if x in answers] or list(answers)[:2]
    loops = {loop for x in answers.values() for loop in (*x.ladders, *x.leaders)}
    ranges = {loop: [x.multiples[loop] for x in answers.values() if loop in x.multiples] for loop in loops}
    lines = []
    for loop in sorted(ranges, key=lambda x: (median(ranges[x] or [math.inf]), x)):
        cells = [cell for name in shown for cell in answers[name].cells(loop, position)]
        holds = f"{sum(loop in x.leaders for x in answers.values())} of {len(answers)}"
        over = Cell(range_text(ranges[loop])) if ranges[loop] else Cell(NOTHING, why="holds on none")
        lines.append([text_cell(mark_own(run, loop)), *cells, Cell(holds), over])
    figures = (f"{x}: {y}" for x in shown for y in ("error [m]", "time", "multiple"))
    head = ("engine", *figures, "holds on", "multiples")
    title = f"Within {limit_text(position)} m of position {search_span(run)}"
    return Table(title, head, lines, range(1, len(head)))


def explain_missing(rows: Iterable[Row], position: float) -> str:
    """Return in a few words why an engine has no time, from its rows of `search_ladder` on a linkage."""
    variants = group_by(rows, "settings", "integrator", "stabilization").values()
    answer = reach([[trial_of(r) for r in some] for some in variants], [Requirement("position", position)], "no race took it in")
    return answer.words.partition(":")[0]


def print_markdown(table: Table) -> str:
    """Return the table in Markdown."""
    rule = ["---:" if i in table.numeric else "---" for i in range(len(table.head))]
    rows = [table.head, rule, *(map(markdown_cell, row) for row in table.rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def renew(page: str, run: Run) -> str:
    """Return README's text with the table of a run between the marker lines."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"README has no lines {BEGIN} and {END}")
    table = first_table(run)
    assert table is not None, "the run searched nothing"
    return f"{before}{BEGIN}\n{print_markdown(table)}\n{END}{after}"
