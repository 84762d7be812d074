"""The section on possible biases: how the suite may favour its authors' engines, and the effort that went into each engine."""

from collections import Counter
from collections.abc import Mapping

from gauss_bench.report.cases import has_ended
from gauss_bench.report.content import Bullets, Section, blocks_of, layouts
from gauss_bench.report.rows import Row, Run
from gauss_bench.report.words import count

PLACE = 91
TITLE, ANCHOR = "Where this suite may be biased", "bias"


def section(run: Run) -> Section:
    """Return the section on possible biases, with a table of the effort that went into each engine."""
    lines = list(count_effort(run).values())
    return Section(TITLE, ANCHOR, (Bullets((describe_authorship(run), *layouts()["bias"]["items"])), *blocks_of("bias", lines)))


def describe_authorship(run: Run) -> str:
    """Return a sentence on the share of engines that the suite's authors wrote, and on what they chose."""
    engines = count_effort(run).values()
    own = sum(row["own"] == "yes" for row in engines)
    return (
        f"The authors of the suite wrote {own} of its {count(len(engines), 'engine')}, chose the linkages, and listed the settings "
        "that were searched for all engines."
    )


def count_effort(run: Run) -> Mapping[str, Row]:
    """Return engine -> a row with its numbers of searched variants, runs of searches, cases and valid cases; own engines first."""
    tables = {"variants": run.table("search_space"), "evaluations": run.table("search_ladder"), "cases": run.results}
    counts = {column: Counter(row["engine"] for row in rows) for column, rows in tables.items()}
    counts["valid"] = Counter(r["engine"] for r in run.results if has_ended(r) and r["valid"])
    effort: dict[str, Row] = {}
    for name in sorted(set().union(*counts.values()), key=lambda x: (x not in run.own_engines, x)):
        own = "yes" if name in run.own_engines else "no"
        effort[name] = {"engine": name, "own": own} | {column: engines[name] for column, engines in counts.items()}
    return effort
