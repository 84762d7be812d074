"""Where the suite may favour its authors' engines: who wrote, tuned and chose what, counted from the rows."""

from collections.abc import Mapping

from gauss_bench.report.cases import has_ended
from gauss_bench.report.content import Bullets, Section, blocks_of
from gauss_bench.report.rows import Row, Run
from gauss_bench.report.words import count

PLACE = 91
TITLE, ANCHOR = "Where this suite may be biased", "bias"
REASONS = (
    "**The authors wrote the adapters to all other engines.** A slow or loose setting may be the adapter's fault; the page of each "
    "engine says how to object.",
    "**Own engines are code that is generated for one linkage.** Other engines are general programs, and the time of generation "
    "and compilation is not counted.",
    "**The linkages are those of the authors' papers and their kind.** All are planar and small, and none has contact or three "
    "dimensions, for which MuJoCo is made.",
    "**All times are of one machine.** Another processor may order engines that are close in another way.",
    "**References come from the authors' own programs.** Two pipelines without common equations agree on them, and they are "
    "compared with published values and closed forms.",
)


def section(run: Run) -> Section:
    """Return the possible biases, and the effort that each engine was given."""
    lines = list(count_effort(run).values())
    return Section(TITLE, ANCHOR, (Bullets((shorten(run), *REASONS)), *blocks_of("bias", lines)))


def shorten(run: Run) -> str:
    """Return in one sentence what share of the engines the authors of the suite wrote, and who chose settings."""
    engines = count_effort(run).values()
    own = sum(row["own"] == "yes" for row in engines)
    return (
        f"The authors of the suite wrote {own} of its {count(len(engines), 'engine')}, chose the linkages, and listed the settings "
        "that were searched for all engines."
    )


def count_effort(run: Run) -> Mapping[str, Row]:
    """Return engine -> the variants and evaluations that the search spent on it, and its cases; own engines first."""
    tables = {"variants": run.table("search_space"), "evaluations": run.table("search_ladder"), "cases": run.results}
    names = sorted({r["engine"] for rows in tables.values() for r in rows}, key=lambda x: (x not in run.own_engines, x))
    effort: dict[str, Row] = {}
    for name in names:
        counts = {what: sum(r["engine"] == name for r in rows) for what, rows in tables.items()}
        valid = sum(has_ended(r) and bool(r["valid"]) for r in run.results if r["engine"] == name)
        effort[name] = {"engine": name, "own": "yes" if name in run.own_engines else "no", **counts, "valid": valid}
    return effort
