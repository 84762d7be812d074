"""Describe the changes between releases of an engine's library in sentences, from rows of the tables NAMES.

The sentences are printed on a terminal, written to the file `what_changed.md`, and shown in the report.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

from gauss_bench.report.rows import Row, group_by, is_known, spread
from gauss_bench.report.words import count

MOST_NAMES, LONGEST = 3, 80  # limits: names in a sentence, and characters of a reason
DEFAULT, WORKS, THERE, ABSENT = "default", "works", "there", "not there"  # values of the columns `quantity`, `was` and `now`
EXCEPTION = re.compile(r"^\w+(Error|Failure|Warning): ")
PLACE_IN_CODE = re.compile(r" (\(\w+\.py:\d+\)|\[file '[^']*', line \d+\]:?)")
NAMES = ("releases", "release_changes", "release_costs", "release_cost_changes")  # tables on releases
TITLE = "# What changed between releases"
RULE = (
    "Each release computes accelerations at the same states, and a run of 1 s at steps of 1 ms. Both are repeated from starts "
    "changed by 1e-14, which shows the effect of rounding. A difference between two neighbouring releases is real if it "
    "exceeds 50 times that effect; otherwise it is rounding. It is also real if a changed start changes the answers of one release "
    "by more than a thousandth, and those of the other by less than a millionth. A cost changed if the range of its ratio lies "
    "more than 5 % from 1, and beyond the ratio of two timings of the newest release."
)


def describe_changes(tables: Mapping[str, Sequence[Row]]) -> list[tuple[str, list[str]]]:
    """Return (heading, sentences) for each pair of consecutive releases; releases that gave no results are left out."""
    parts = []
    usable = [row for row in tables["releases"] if row["status"] == "ok"]
    for before, after in pairwise(usable):
        if before["engine"] != after["engine"]:
            continue
        pair = {"engine": after["engine"], "before": before["version"], "after": after["version"]}
        changes = [*tables["release_changes"], *tables["release_cost_changes"]]
        changed = [row for row in changes if pair.items() <= row.items()]  # rows that agree with all values of `pair`
        sentences = [*describe_quantities(changed), describe_rounding(after)]
        for x in (before, after):
            if x["left_out"]:
                sentences.append(f"{int(x['left_out'])} cases of {x['version']} were left out for lack of time")
        parts.append((f"{pair['engine']} {pair['before']} -> {pair['after']}", sentences))
    return parts


def describe_unusable(rows: Iterable[Row]) -> list[str]:
    """Return a sentence for each release that gave no results, with the reason."""
    return [f"{row['engine']} {row['version']}: {row['message']}" for row in rows if row["status"] != "ok"]


def describe_quantities(changes: Iterable[Row]) -> list[str]:
    """Return sentences on changed numbers, changed answers, and changed, new and gone defaults."""
    numeric = group_by(changes, lambda r: is_known(r.get("difference")) or is_known(r.get("ratio")))
    figures, others = numeric.get(True, []), numeric.get(False, [])
    defaults = [row for row in others if row["quantity"] == DEFAULT]
    answers = [row for row in others if row["quantity"] != DEFAULT]
    kinds = group_by(defaults, lambda r: "new" if r["was"] == ABSENT else "gone" if r["now"] == ABSENT else "changed")
    reasons = group_by(answers, lambda r: (shorten(r["was"]), shorten(r["now"])))
    sentences = [describe_figures(quantity, rows) for quantity, rows in group_by(figures, "quantity").items()]
    sentences += [describe_answers(was, now, rows) for (was, now), rows in reasons.items()]
    return sentences + [describe_defaults(kind, rows) for kind, rows in kinds.items()]


def describe_figures(quantity: str, rows: Sequence[Row]) -> str:
    """Return a sentence on a number that differs: a cost by its ratios, any other number by its largest difference."""
    if is_known(rows[0].get("ratio")):
        ratios = (spread(row, "ratio").print_with("{:.2f}".format).replace("..", " to ") for row in rows)
        return f"{quantity}: " + "; ".join(f"{place_of(row)} times {ratio}" for row, ratio in zip(rows, ratios, strict=True))
    worst = max(rows, key=lambda row: float(row["difference"]))
    errors = f"error against the truth {worst['error_before']:.1e} -> {worst['error_after']:.1e}"
    size = f"by up to {worst['difference']:.2g} of their size, where rounding makes {worst['rounding']:.0e}"
    return f"{quantity}: {len(rows)} differ, {size} ({place_of(worst)}: {errors})"


def describe_answers(was: str, now: str, rows: Sequence[Row]) -> str:
    """Return a sentence on the questions to which only one of two releases gives a result."""
    cases = name_some(sorted({place_of(row) for row in rows}), "; ")
    change = f"answered now, but not before: {was}" if now == WORKS else f"no longer answered: {now}"
    return f"{count(len(rows), 'question')} {change} ({cases})"


def describe_defaults(kind: str, rows: Sequence[Row]) -> str:
    """Return a sentence on names and default values of the library that differ; `kind` is "new", "gone" or "changed"."""
    places = [place_of(row) for row in rows]
    if kind == "new":
        places = [x if row["now"] == THERE else f"{x} ({row['now']})" for x, row in zip(places, rows, strict=True)]
    if kind == "changed":
        places = [f"{x} from {row['was']} to {row['now']}" for x, row in zip(places, rows, strict=True)]
    return f"names and defaults that are {kind}: {name_some(places, ', ')}"


def name_some(names: Sequence[str], between: str) -> str:
    """Return the first MOST_NAMES names, joined by `between`, and the number of further names."""
    more = f"{between}and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return between.join(names[:MOST_NAMES]) + more


def shorten(answer: str) -> str:
    """Return a reason without the class of its exception and the line of code that raised it, cut to LONGEST characters."""
    bare = PLACE_IN_CODE.sub("", EXCEPTION.sub("", answer))
    return bare if len(bare) <= LONGEST else bare[: bare.rindex(" ", 0, LONGEST)] + " ..."


def describe_rounding(after: Row) -> str:
    """Return a sentence on the numbers of a release that equal those of the previous release, exactly or within rounding."""
    figures = f"{int(after['rounding'])} of {int(after['compared'])} figures"
    if after["largest_rounding"] == 0:
        return f"equal to the last bit: {figures}"
    return f"equal but for rounding: {figures}, which differ by at most {after['largest_rounding']:.1e}"


def place_of(row: Row) -> str:
    """Return the case and the setting of a row, separated by a comma."""
    return ", ".join(filter(None, (row["case"], row["setting"])))


def write_page(tables: Mapping[str, Sequence[Row]]) -> str:
    """Return the text of `what_changed.md`."""
    lines = [TITLE, "", RULE, ""]
    for heading, sentences in describe_changes(tables):
        lines += [f"## {heading}", "", *(f"- {x}" for x in sentences), ""]
    if unusable := describe_unusable(tables["releases"]):
        lines += ["## Without results", "", *(f"- {x}" for x in unusable), ""]
    return "\n".join(lines)


def newest_first(releases: Iterable[Row]) -> list[Row]:
    """Return the rows of one engine's releases, the newest first."""
    return sorted(releases, key=lambda row: [int(x) for x in re.findall(r"\d+", row["version"])], reverse=True)
