"""The first table of README, the summary and the site: the run time that each engine needs to meet an accuracy requirement.

README has the table between two marker lines. A row belongs to an engine; Pinocchio has one row for each kind of loop over the
steps. Variables with the name of a row, such as "pinocchio, compiled", are called `loop`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from gauss_bench.reach import Requirement, reach, trial_of
from gauss_bench.report.content import Cell, Table, text_cell
from gauss_bench.report.pages import markdown_cell
from gauss_bench.report.rows import Row, Run, group_by, search_span
from gauss_bench.report.site.settings import Setting, all_settings, cheapest, cheapest_stored, multiples
from gauss_bench.report.words import NOTHING, error_text, limit_text, range_text, ratio_text, time_text

FIRST = 1e-6  # [m] accuracy of the first table
SHOWN = ("four_bar", "six_bar")  # linkages (one loop, two loops) for which the table has error, time and multiple
BEGIN, END = "<!-- first table, written by make publish -->", "<!-- end of the first table -->"


def loop_of(engine: str, settings: str) -> str:
    """Return the name of a row: the engine; for Pinocchio also its kind of loop, as in "pinocchio, compiled"."""
    if engine != "pinocchio":
        return engine
    return f"{engine}, {'compiled' if settings.startswith('compiled') else 'called from Python'}"


def group_by_loop(settings: Iterable[Setting]) -> dict[str, list[Setting]]:
    """Return name of a row (`loop_of`) -> its settings."""
    return group_by(settings, lambda x: loop_of(x.engine, x.settings))


def cheapest_loops(run: Run, mechanism: str, position: float) -> dict[str, Setting]:
    """Return name of a row (`loop_of`) -> its cheapest setting on a linkage with a position error of at most `position` [m]."""
    groups = group_by_loop(all_settings(run).get(mechanism, [])).items()
    # `cheapest` returns one setting at most, because each group has one engine
    searched = {loop: setting for loop, settings in groups for setting in cheapest(settings, position).values()}
    # settings that were raced at exactly this accuracy take precedence
    return searched | {loop_of(x.engine, x.settings): x for x in cheapest_stored(run, mechanism, position).values()}


def mark_own(run: Run, loop: str) -> str:
    """Mark the name of a row (`loop_of`) with " (own)" if the authors of the suite wrote the engine."""
    return f"{loop} (own)" if loop.partition(",")[0] in run.own_engines else loop


@dataclass(frozen=True)
class Results:
    """The results on one linkage: dictionaries whose keys are names of rows (`loop_of`).

    Attributes:
        tried: the row's trials in the table `search_ladder`.
        leaders: the cheapest setting with a position error of at most FIRST, if there is one.
        multiples: time of the leader divided by that of the fastest leader; leaders of unknown time are left out.
    """

    tried: Mapping[str, Sequence[Row]]
    leaders: Mapping[str, Setting]
    multiples: Mapping[str, float]

    def cells(self, loop: str) -> list[Cell]:
        """Return the cells error, time and multiple of a row; without a leader, the reason and two dashes."""
        leader = self.leaders.get(loop)
        if leader is None:
            why = explain_missing(self.tried.get(loop, []), FIRST)
            return [text_cell(why), Cell(NOTHING, why=why), Cell(NOTHING, why=why)]
        multiple = self.multiples.get(loop, math.nan)
        error, time = Cell(error_text(leader.position), leader.position), Cell(time_text(leader.seconds), leader.seconds)
        return [error, time, Cell(ratio_text(multiple), multiple)]


def collect_results(run: Run) -> dict[str, Results]:
    """Return linkage -> results on it, without the engines that model none of the searched linkages."""
    ladder = run.table("search_ladder")
    modelled = {r["engine"] for r in ladder if r["status"] != "skip"}
    results = {}
    for name, rows in group_by((r for r in ladder if r["engine"] in modelled), "mechanism").items():
        leaders = cheapest_loops(run, name, FIRST)
        tried = group_by(rows, lambda r: loop_of(r["engine"], r["settings"]))
        results[name] = Results(tried, leaders, multiples({loop: x.seconds for loop, x in leaders.items()}))
    return results


def first_table(run: Run) -> Table | None:
    """Return the table of the searched engines with what each needs to hold FIRST [m]; None if no engine holds FIRST."""
    results = collect_results(run)
    if not any(x.leaders for x in results.values()):
        return None
    # the linkages with error, time and multiple: those of SHOWN or, without them, the first two
    shown = [name for name in SHOWN if name in results] or list(results)[:2]
    loops = {loop for x in results.values() for loop in (*x.tried, *x.leaders)}
    multiples_of = {loop: [x.multiples[loop] for x in results.values() if loop in x.multiples] for loop in loops}
    lines = []
    # the engine with the smallest median of its multiples comes first, engines without a multiple last
    for loop in sorted(loops, key=lambda x: (median(multiples_of[x] or [math.inf]), x)):
        holds = sum(loop in x.leaders for x in results.values())  # number of linkages
        over = multiples_of[loop]
        multiple = Cell(range_text(over)) if over else Cell(NOTHING, why="holds on none")
        figures = [cell for name in shown for cell in results[name].cells(loop)]
        lines.append([text_cell(mark_own(run, loop)), *figures, Cell(f"{holds} of {len(results)}"), multiple])
    heads = [f"{name}: {figure}" for name in shown for figure in ("error [m]", "time", "multiple")]
    head = ("engine", *heads, "holds on", "multiples")
    return Table(f"Within {limit_text(FIRST)} m of position {search_span(run)}", head, lines, range(1, len(head)))


def explain_missing(rows: Iterable[Row], position: float) -> str:
    """Return in a few words why an engine has no time within `position` [m] on a linkage, from its rows of `search_ladder`.

    Either no trial met the accuracy, or no race timed such a trial, or the engine did not run on the linkage.
    """
    variants = group_by(rows, "settings", "integrator", "stabilization").values()
    trials = [[trial_of(row) for row in variant] for variant in variants]
    answer = reach(trials, [Requirement("position", position)], untimed="it took part in no race")
    return answer.words.partition(":")[0]  # without the details after the colon


def print_markdown(table: Table) -> str:
    """Return the Markdown of a table, without title and note."""
    rule = ["---:" if i in table.numeric else "---" for i in range(len(table.head))]
    rows = [table.head, rule, *(map(markdown_cell, row) for row in table.rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def renew(page: str, run: Run) -> str:
    """Return the text of README with the first table of a run between the marker lines.

    Raises:
        ValueError: the text has no marker lines.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"README has no lines {BEGIN} and {END}")
    table = first_table(run)
    assert table is not None, "the run searched nothing"
    return f"{before}{BEGIN}\n{print_markdown(table)}\n{END}{after}"
