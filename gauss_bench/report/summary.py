"""The summary of a run as a page of Markdown, for reviewers of changed rows: findings, and a small table per linkage.

The page is kept in git beside the rows; the site has everything else. Defeats come first. Accuracy and times are in separate
tables, as are the rows, so that a repeated run changes few lines.
"""

import math
from collections.abc import Iterable, Sequence

from gauss_bench.reach import ERRORS
from gauss_bench.report.content import (
    AUTHORS,
    NOTHING,
    Block,
    Bullets,
    Cell,
    Finding,
    Section,
    Table,
    Text,
    count,
    itemise,
    lay_out,
    status_cell,
    text_cell,
    times,
)
from gauss_bench.report.first_table import SAID, first_table, mark
from gauss_bench.report.pages import SENTENCE
from gauss_bench.report.rows import (
    Row,
    Run,
    end_bar,
    end_error,
    group_rows,
    is_known,
    may_rank,
    measure,
    number,
    ok,
    over_time,
)
from gauss_bench.report.sections.search import TRIED, answer_of
from gauss_bench.report.site.settings import multiples
from gauss_bench.report.site.write import SITE

LOST = "**"  # findings print defeats in bold
SHORT, LONGEST = 40, 800  # characters of a finding


def summary(run: Run, findings: Iterable[Finding]) -> tuple[Section, ...]:
    """Return the sections of the page."""
    ordered = sorted(findings, key=lambda f: (LOST not in f.text, "slower" not in f.text))
    lost = [f for f in ordered if f.tone in ("bad", "warn")]
    won = [f for f in ordered if f.tone not in ("bad", "warn")]
    parts = [_linkage(run, name) for name in run.linkages]
    sections = [
        Section("Where it loses, and what failed", "lost", (Bullets(tuple(map(_said, lost))),)) if lost else None,
        Section("What else was found", "found", (Bullets(tuple(map(_said, won))),)) if won else None,
        _cheapest(run),
        Section("Accuracy", "accuracy", (Text(EXPLAINED),), tuple(parts)) if parts else None,
    ]
    about = Section("What this is", "about", _about(run))
    table = first_table(run)
    first = Section("What holding an accuracy costs", "first", (Text(SAID), table)) if table else None
    return (about, *([first] if first else []), *(x for x in sections if x is not None))


EXPLAINED = (
    "For each engine and setting: the error of its accelerations at the same states, how many of its cases may be used, and of "
    "those the one with the least error at the end of the run, with its drift and its error of energy. All cases stand in "
    "`results.csv`."
)


def _about(run: Run) -> tuple[Block, ...]:
    fine = sum(ok(row) for row in run.results)
    scope = f"{count(len(run.results), 'case')} on {itemise(f'`{x}`' for x in run.linkages)}; {fine} ended with a motion."
    where = (
        f"Beside this page lie the rows: a table a file, what a clock decides in `times`, columns with units and meanings in "
        f"`tables.json`, where and when in `environment.json`. The site, `{SITE}/index.html`, is built from them by "
        "`gauss-bench report` and is not kept in git."
    )
    return (Text(AUTHORS), *((Text(scope),) if run.results else ()), Text(where))


def _said(finding: Finding) -> str:
    """Return a finding's title with its bold sentences, or else with its first sentence that is not very short."""
    sentences = SENTENCE.split(finding.text)
    chosen = [x for x in sentences if LOST in x] or sentences[: 2 if len(sentences[0]) < SHORT else 1]
    chosen += [x for x in sentences if "slower" in x and x not in chosen and LOST not in finding.text]
    said = " ".join(chosen)
    if len(said) > LONGEST:
        said = f"{said[:LONGEST].rpartition('; ')[0] or said[:LONGEST]}; ..."
    return f"**{finding.title}.** {said.replace(LOST, '')}"


def _linkage(run: Run, name: str) -> Section:
    """Return the table of a linkage with one row per engine and setting."""
    rows = run.of(name)
    least = [_best(some) for some in group_rows(rows, lambda r: (r["engine"], r["settings"])).values()]
    title = ", ".join(sorted({str(r["scenario"]) for r in rows}))
    return Section(name, name, (lay_out("least", least, title, unit=measure(rows)),))


def _best(rows: Sequence[Row]) -> Row:
    """Return the valid case with the least error, with its setting; without a valid case, how the cases ended."""
    usable = [r for r in rows if may_rank(r)]
    known = [r for r in usable if is_known(end_error(r))]
    same = min((x for r in rows if is_known(x := number(r, "acceleration_error_median"))), default=math.nan)
    shared = {"acceleration_error_median": same, "usable": f"{len(usable)} of {len(rows)}"}
    if not known:
        ended = dict.fromkeys(status_cell(r).text for r in rows)
        return {k: rows[0][k] for k in ("engine", "settings", "status")} | shared | {"by": itemise(ended)}
    best = min(known, key=end_error)
    choice = " ".join(str(best[k]) for k in ("integrator", "stabilization") if best[k] not in ("", "none"))
    return {**best, **shared, "by": choice, "end_error": end_error(best), "end_bar": end_bar(best)}


def _cheapest(run: Run) -> Section | None:
    """Return tables of engines against linkages: the time of each engine's best setting as a multiple of the fastest."""
    rows = run.table("search_winners")
    if not rows:
        return None
    names = sorted({str(r["mechanism"]) for r in rows})
    blocks: list[Block] = [Text(SEARCHED)]
    for (required, accuracy, unit), some in sorted(group_rows(rows, lambda r: (r["required"], r["accuracy"], r["unit"])).items()):
        by = {(r["engine"], r["mechanism"]): r for r in some}
        lines = []
        over = {
            name: multiples({e: number(r, "seconds") for (e, x), r in by.items() if x == name and r["status"] == "ok"})
            for name in names
        }
        for engine in sorted({r["engine"] for r in some if r["status"] != "skip"}):
            cells = [_multiple(run, by.get((engine, name)), over[name].get(engine)) for name in names]
            lines.append((text_cell(mark(run, engine)), *cells))
        title = f"Within {accuracy:.0e} {unit} of {ERRORS.get(required, required)} {over_time(run)}"
        blocks.append(Table(title, ("engine", *names), tuple(lines), frozenset(range(1, 1 + len(names)))))
    return Section("The cheapest way of each engine", "cheapest", tuple(blocks))


SEARCHED = (
    "Time of the cheapest variant and step that were found exact enough, over that of the fastest of all on the linkage, whoever "
    "made it; engines marked (own) are written by the authors of this suite. "
    "Spreads, steps and settings stand in `times/search_winners.csv`."
)


def _multiple(run: Run, row: Row | None, x: float | None) -> Cell:
    if row is None:
        return Cell(NOTHING)
    if x is None:
        found = answer_of(run, row)
        return Cell(found.words if found.kind in TRIED else str(found.kind))
    return Cell(times(x), x)
