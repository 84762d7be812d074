"""The summary of a run as a page of Markdown, for reviewers of changed rows; it is kept in git beside the rows.

Findings in which the suite's own engines lose come first. Accuracy and times have tables of their own, so that a repeated run
changes few lines.
"""

import math
from collections.abc import Iterable, Sequence

from gauss_bench.reach import ERRORS
from gauss_bench.report.cases import end_bar, end_error, has_ended, may_rank, measured_head, setting_words
from gauss_bench.report.content import Block, Bullets, Cell, Finding, Section, Table, Text, lay_out, layouts, status_cell, text_cell
from gauss_bench.report.first_table import first_table, mark_own
from gauss_bench.report.pages import SENTENCE
from gauss_bench.report.rows import Row, Run, group_by, is_known, search_span, with_number
from gauss_bench.report.sections.search import TRIED, reach_of_row
from gauss_bench.report.site.settings import race_multiples
from gauss_bench.report.words import NOTHING, count, itemise, ratio_text

BOLD = "**"  # mark around bold text: findings print in bold the sentences in which the suite's own engines lose
DEFEAT = "slower"  # word that marks other sentences in which the suite's own engines lose
SHORT, LONGEST = 40, 800  # [characters] shortest first sentence that says enough alone; longest summary of a finding


def summary(run: Run, findings: Iterable[Finding]) -> list[Section]:
    """Return the sections of the summary; sections for which the run has no rows are left out."""
    # findings in bold come first, then those with the word DEFEAT
    ordered = sorted(findings, key=lambda f: (BOLD not in f.text, DEFEAT not in f.text))
    lost = [shorten(f) for f in ordered if f.tone in ("bad", "warn")]
    others = [shorten(f) for f in ordered if f.tone not in ("bad", "warn")]
    table, multiples, texts = first_table(run), multiple_tables(run), layouts()["texts"]
    linkages = []
    for name in run.linkages:
        rows = run.cases_of(name)
        least = [find_least_error(cases) for cases in group_by(rows, "engine", "settings").values()]
        title = ", ".join(sorted({r["scenario"] for r in rows}))
        linkages.append(Section(name, name, (lay_out("least", least, title, unit=measured_head(rows)),)))
    sections = [
        Section("What this is", "about", describe_run(run)),
        Section("What holding an accuracy costs", "first", (Text(texts["first"]), table)) if table else None,
        Section("Where it loses, and what failed", "lost", (Bullets(lost),)) if lost else None,
        Section("What else was found", "found", (Bullets(others),)) if others else None,
        Section("The cheapest setting of each engine", "cheapest", (Text(texts["cheapest"]), *multiples)) if multiples else None,
        Section("Accuracy", "accuracy", (Text(texts["accuracy"]),), linkages) if linkages else None,
    ]
    return [section for section in sections if section is not None]


def describe_run(run: Run) -> list[Block]:
    """Return the paragraphs on the suite's authors, the cases that were run, and the files of the rows."""
    ended = sum(has_ended(row) for row in run.results)
    linkages = itemise(f"`{name}`" for name in run.linkages)
    cases = f"{count(len(run.results), 'case')} on {linkages}; {ended} ended with a motion."
    texts = layouts()["texts"]
    return [Text(texts["authors"]), *([Text(cases)] if run.results else []), Text(texts["where"])]


def shorten(finding: Finding) -> str:
    """Return a finding's title with its bold sentences.

    A finding without bold sentences is shortened to its first sentence (its first two if the first is short) and all sentences with
    the word DEFEAT: sentences in which the suite's own engines lose must not be left out. A text that is still longer than LONGEST
    characters is truncated at a semicolon.
    """
    sentences = SENTENCE.split(finding.text)
    chosen = [x for x in sentences if BOLD in x]
    if not chosen:
        first = 2 if len(sentences[0]) < SHORT else 1
        chosen = sentences[:first] + [x for x in sentences[first:] if DEFEAT in x]
    text = " ".join(chosen)
    if len(text) > LONGEST:
        text = f"{text[:LONGEST].rpartition('; ')[0] or text[:LONGEST]}; ..."
    return f"**{finding.title}.** {text.replace(BOLD, '')}"


def find_least_error(rows: Sequence[Row]) -> Row:
    """Return the case with the least error among the usable cases of one engine and setting, as a row of the layout `least`.

    Its column `by` has integrator and stabilisation; if no usable case has an error, `by` has the statuses of all cases.
    """
    usable = [r for r in rows if may_rank(r)]
    errors = [r["acceleration_error_median"] for r in with_number(rows, "acceleration_error_median")]
    shared = {"acceleration_error_median": min(errors, default=math.nan), "usable": f"{len(usable)} of {len(rows)}"}
    compared = [r for r in usable if is_known(end_error(r))]
    if not compared:
        endings = itemise(dict.fromkeys(status_cell(r).text for r in rows))
        return {k: rows[0][k] for k in ("engine", "settings", "status")} | shared | {"by": endings}
    best = min(compared, key=end_error)
    method = setting_words(best, "integrator", "stabilization")
    return {**best, **shared, "by": method, "end_error": end_error(best), "end_bar": end_bar(best)}


def multiple_tables(run: Run) -> list[Table]:
    """Return a table of multiples (time over that of the fastest engine) for each requirement."""
    rows = run.table("search_winners")
    names = sorted({r["mechanism"] for r in rows})
    multiples = race_multiples(run)
    tables = []
    for (required, accuracy, unit), races in sorted(group_by(rows, "required", "accuracy", "unit").items()):
        race_of = {(r["mechanism"], r["engine"]): r for r in races}
        lines = []
        for engine in sorted({r["engine"] for r in races if r["status"] != "skip"}):
            cells = [text_cell(mark_own(run, engine))]
            for name in names:
                row, multiple = race_of.get((name, engine)), multiples.get((name, required, accuracy, engine))
                if row is None:
                    cells.append(Cell(NOTHING))
                elif multiple is not None:
                    cells.append(Cell(ratio_text(multiple), multiple))
                else:  # the result of the search in words if the engine ran, else only why it did not run
                    reach = reach_of_row(run, row)
                    cells.append(Cell(reach.words if reach.kind in TRIED else str(reach.kind)))
            lines.append(cells)
        title = f"Within {accuracy:.0e} {unit} of {ERRORS.get(required, required)} {search_span(run)}"
        tables.append(Table(title, ("engine", *names), lines, range(1, 1 + len(names))))
    return tables
