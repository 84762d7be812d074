"""The summary of a run as a page of Markdown, for reviewers of changed rows: findings, and a small table per linkage.

The page is kept in git beside the rows; the site has everything else. Defeats come first. Accuracy and times are in separate
tables, as are the rows, so that a repeated run changes few lines.
"""

import math
from collections.abc import Iterable, Sequence

from gauss_bench.reach import ERRORS
from gauss_bench.report.cases import end_bar, end_error, has_ended, may_rank, measured_head, setting_words
from gauss_bench.report.content import AUTHORS, Block, Bullets, Cell, Finding, Section, Table, Text, lay_out, status_cell, text_cell
from gauss_bench.report.first_table import EXPLAINED, first_table, mark_own
from gauss_bench.report.pages import SENTENCE
from gauss_bench.report.rows import Row, Run, group_by, is_known, search_span, with_number
from gauss_bench.report.sections.search import TRIED, answer_of
from gauss_bench.report.site.settings import race_multiples
from gauss_bench.report.site.write import SITE
from gauss_bench.report.words import NOTHING, count, itemise, ratio_text

LOST = "**"  # findings print defeats in bold
SHORT, LONGEST = 40, 800  # characters of a finding
ACCURACY = (
    "For each engine and setting the table has the error of its accelerations at the same states, and the number of usable cases. "
    "Of those it has the case with the least error at the end of the run, with drift and error of energy. `results.csv` has all "
    "cases."
)
SEARCHED = (
    "A multiple is the time of the engine's cheapest setting that is exact enough, divided by that of the fastest engine on the "
    "linkage. Engines marked (own) are written by the authors of this suite. `times/search_winners.csv` has spreads, steps and "
    "settings."
)


def summary(run: Run, findings: Iterable[Finding]) -> list[Section]:
    """Return the sections of the page."""
    # findings in bold come first, then those on what is slower
    ordered = sorted(findings, key=lambda f: (LOST not in f.text, "slower" not in f.text))
    lost = [shorten(f) for f in ordered if f.tone in ("bad", "warn")]
    won = [shorten(f) for f in ordered if f.tone not in ("bad", "warn")]
    table, cheapest = first_table(run), multiple_tables(run)
    sections = [Section("What this is", "about", describe_run(run))]
    if table:
        sections.append(Section("What holding an accuracy costs", "first", (Text(EXPLAINED), table)))
    if lost:
        sections.append(Section("Where it loses, and what failed", "lost", (Bullets(lost),)))
    if won:
        sections.append(Section("What else was found", "found", (Bullets(won),)))
    if cheapest:
        sections.append(Section("The cheapest setting of each engine", "cheapest", (Text(SEARCHED), *cheapest)))
    if run.linkages:
        linkages = [summarise_linkage(run, name) for name in run.linkages]
        sections.append(Section("Accuracy", "accuracy", (Text(ACCURACY),), linkages))
    return sections


def describe_run(run: Run) -> list[Block]:
    """Return the paragraphs on who wrote the report, what was run, and where the rows are."""
    ended = sum(has_ended(row) for row in run.results)
    cases = f"{count(len(run.results), 'case')} on {itemise(f'`{x}`' for x in run.linkages)}; {ended} ended with a motion."
    where = (
        "The rows are beside this page, each table in its own file. `times` has the measured times, `tables.json` the unit and "
        "meaning of each column, and `environment.json` date and machine. `gauss-bench report` builds the site, "
        f"`{SITE}/index.html`, from the rows; it is not kept in git."
    )
    return [Text(AUTHORS), *([Text(cases)] if run.results else []), Text(where)]


def shorten(finding: Finding) -> str:
    """Return a finding's title with its bold sentences, or else with its first sentence that is not very short."""
    sentences = SENTENCE.split(finding.text)
    chosen = [x for x in sentences if LOST in x] or sentences[: 2 if len(sentences[0]) < SHORT else 1]
    chosen += [x for x in sentences if "slower" in x and x not in chosen and LOST not in finding.text]
    text = " ".join(chosen)
    if len(text) > LONGEST:
        text = f"{text[:LONGEST].rpartition('; ')[0] or text[:LONGEST]}; ..."
    return f"**{finding.title}.** {text.replace(LOST, '')}"


def summarise_linkage(run: Run, name: str) -> Section:
    """Return the table of a linkage with one row per engine and setting."""
    rows = run.of(name)
    least = [least_error(some) for some in group_by(rows, "engine", "settings").values()]
    title = ", ".join(sorted({r["scenario"] for r in rows}))
    return Section(name, name, (lay_out("least", least, title, unit=measured_head(rows)),))


def least_error(rows: Sequence[Row]) -> Row:
    """Return the valid case with the least error, with its setting; without a valid case, how the cases ended."""
    usable = [r for r in rows if may_rank(r)]
    errors = [r["acceleration_error_median"] for r in with_number(rows, "acceleration_error_median")]
    shared = {"acceleration_error_median": min(errors, default=math.nan), "usable": f"{len(usable)} of {len(rows)}"}
    known = [r for r in usable if is_known(end_error(r))]
    if not known:
        ended = itemise(dict.fromkeys(status_cell(r).text for r in rows))
        return {k: rows[0][k] for k in ("engine", "settings", "status")} | shared | {"by": ended}
    best = min(known, key=end_error)
    choice = setting_words(best, "integrator", "stabilization")
    return {**best, **shared, "by": choice, "end_error": end_error(best), "end_bar": end_bar(best)}


def multiple_tables(run: Run) -> list[Table]:
    """Return tables of engines against linkages: the time of each engine's best setting as a multiple of the fastest."""
    rows = run.table("search_winners")
    names = sorted({r["mechanism"] for r in rows})
    over = race_multiples(run)
    tables = []
    for (required, accuracy, unit), some in sorted(group_by(rows, "required", "accuracy", "unit").items()):
        races = {(r["mechanism"], r["engine"]): r for r in some}
        lines = []
        for engine in sorted({r["engine"] for r in some if r["status"] != "skip"}):
            multiples = [over.get((name, required, accuracy, engine)) for name in names]
            cells = [multiple_cell(run, races.get((name, engine)), x) for name, x in zip(names, multiples, strict=True)]
            lines.append((text_cell(mark_own(run, engine)), *cells))
        title = f"Within {accuracy:.0e} {unit} of {ERRORS.get(required, required)} {search_span(run)}"
        tables.append(Table(title, ("engine", *names), lines, range(1, 1 + len(names))))
    return tables


def multiple_cell(run: Run, row: Row | None, multiple: float | None) -> Cell:
    """Return the cell of an engine on a linkage: its multiple, or why it has none."""
    if row is None:
        return Cell(NOTHING)
    if multiple is None:
        reach = answer_of(run, row)
        return Cell(reach.words if reach.kind in TRIED else str(reach.kind))
    return Cell(ratio_text(multiple), multiple)
