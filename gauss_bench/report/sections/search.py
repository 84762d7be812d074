"""The cheapest setting of every engine that meets a requirement over the whole run."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from gauss_bench.reach import BY_AUTHORS, ERRORS, Kind, Reach, Requirement
from gauss_bench.report.cases import setting_words
from gauss_bench.report.content import Block, Finding, Section, Text, blocks_of, lay_out, layouts
from gauss_bench.report.rows import Row, Run, first_number, group_by, is_known, number, search_span, spread, with_number
from gauss_bench.report.site.settings import race_multiples, reach_of_search
from gauss_bench.report.words import count, itemise, itemise_code, limit_text, range_text, ratio_text

PLACE = 15
TRIED = (Kind.TIMED, Kind.UNTIMED, Kind.NOT_REACHED)  # kinds of `gauss_bench.reach.Reach` of an engine that ran
KINDS = ("position", "end", "angle", "force")  # kinds of error in the order of the findings
OK = "ok"  # status of a row with a raced setting


def section(run: Run) -> Section | None:
    """Return the section with the cheapest settings, the searched variants and their options; None if the run has no search."""
    rows = [r for r in run.table("search_winners") if r["required"]]
    if not rows:
        return None
    layout = layouts()["search"]
    blocks: list[Block] = [Text(layout["words"]), Text(layout["scope"].format(effort=describe_effort(rows)))]
    for kind, group in group_by(rows, "required").items():
        winners = list_winners(run, group)
        # only tables of position errors are unfolded; "end" is the position at the end of the run
        blocks.append(lay_out("search", winners, kind=ERRORS.get(kind, kind), folded=kind not in ("position", "end")))
    blocks += blocks_of("search_owned", list_owned(run.table("search_owned")))
    space = run.table("search_space")
    blocks += blocks_of("search_space", space, variants=count(len(space), "variant"))
    blocks += blocks_of("search_knobs", run.table("search_knobs"))
    return Section("The searched best of every engine", "search", blocks)


def list_winners(run: Run, rows: Sequence[Row]) -> list[Row]:
    """Return rows of `search_winners`, sorted by linkage and accuracy, with further columns for the layout `search`.

    Marks in the column `name`: "own" if the authors of this suite wrote the engine, "base" if times are divided by its time, and
    BY_AUTHORS if the authors of the engine own the settings.
    """
    multiples = race_multiples(run)
    winners = []
    for row in rows:
        marks = ["own"] if row["engine"] in run.own_engines else []
        marks += ["base"] if row.get("own") else []  # the column `own` marks the cheapest of the suite's engines
        marks += [BY_AUTHORS] if row.get("owner") else []
        more: dict[str, Any] = {
            "within": f"{limit_text(row['accuracy'])} {row['unit']}",
            "name": f"{row['engine']} ({', '.join(marks)})" if marks else row["engine"],
            "size": first_number(number(row, "step"), number(row, "tolerance")),  # [s] or tolerance
            "over": multiples.get((row["mechanism"], row["required"], row["accuracy"], row["engine"]), math.nan),
        }
        if row["status"] == OK:
            more["remark"] = f"in Python: {row['in_python']}" if row.get("in_python") else ""
        else:
            reach = reach_of_row(run, row)
            more |= {"remark": reach.words, "remark_tone": "warn", "missing": str(reach.kind)}
        winners.append({**row, **more})
    # untimed engines come last
    return sorted(winners, key=lambda row: (row["mechanism"], -row["accuracy"], first_number(number(row, "seconds"), math.inf)))


def list_owned(rows: Sequence[Row]) -> list[Row]:
    """Return two rows of the layout `search_owned` for each row of the table: one for each owner of settings.

    The table has the settings by the engine's authors and, in the columns `our_*`, those of this suite.
    """
    lines: list[Row] = []
    for row in rows:
        place = {k: row[k] for k in ("mechanism", "required")} | {"within": f"{limit_text(row['accuracy'])} {row['unit']}"}
        ours = {k.removeprefix("our_"): x for k, x in row.items() if k.startswith("our_")}
        their_name = {"name": f"{row['engine']}, {BY_AUTHORS}", "owner": row["owner"]}
        for setting, names in ((row, their_name), (ours, {"name": row["engine"], "owner": ""})):
            size = first_number(number(setting, "step"), number(setting, "tolerance"))  # step [s], or tolerance
            words = setting_words(setting) if is_known(number(setting, "seconds")) else ""
            lines.append({**place, **setting, **names, "size": size, "words": words, "remark": setting.get("message", "")})
    return lines


def describe_effort(rows: Sequence[Row]) -> str:
    """Return in words the largest allowed numbers of evaluations of a variant and of steps of a run; ranges if linkages differ."""
    limits = ([r[column] for r in with_number(rows, column)] for column in ("budget", "most_steps"))
    evaluations, steps = (range_text(numbers, "{:.0f}".format) for numbers in limits)
    return f"at most {evaluations} evaluations and {steps} steps per run"


def reach_of_row(run: Run, row: Row) -> Reach:
    """Return whether the engine of a row of `search_winners` meets the requirement of the row and, if not, how close it comes."""
    return reach_of_search(run, row["mechanism"], row["engine"], [Requirement(row["required"], row["accuracy"])])


def findings(run: Run) -> Iterator[Finding]:
    """Yield findings on races that failed, on settings by engines' authors, and on all engines' times at each requirement."""
    unsearched = [r for r in run.table("search_winners") if not r["required"]]
    if unsearched:
        reasons = "; ".join(f"{r['mechanism']}: {r['message']}" for r in unsearched)
        text = f"The races on {count(len(unsearched), 'linkage')} failed: {reasons}."
        yield Finding("Not searched", text, "bad", behind=(lay_out("behind_lost", unsearched),))
    yield from compare_owned(run)
    groups = group_by((r for r in run.table("search_winners") if r["required"]), "required", "accuracy")
    # kinds in the order of KINDS, other kinds after them; larger errors first
    for kind, accuracy in sorted(groups, key=lambda x: ([*KINDS, x[0]].index(x[0]), -x[1])):
        group = divide_by_ours(groups[kind, accuracy])
        lost = [*name_defeats(run, group)]
        rivals = [r for r in group if r["engine"] not in run.own_engines and reach_of_row(run, r).kind in TRIED]
        ratios = []
        for engine, rows in group_by(rivals, "engine").items():
            ratios.append(f"`{engine}` {itemise(_print_ratio(run, r) for r in rows)}")
        if ratios:
            ours = itemise_code(r["engine"] for r in group if r.get("ours"))
            text = (
                f"{''.join(lost)}The cheaper of {ours} is this many times as fast as the searched best of {'; '.join(ratios)}, "
                f"with the spread of the race in brackets; each variant had {describe_effort(group)}."
                f"{''.join(name_left_out(run, group))}"
            )
            title = f"Within {limit_text(accuracy)} {group[0]['unit']} of {ERRORS.get(kind, kind)} {search_span(run)}"
            behind = lay_out("behind_search", list_winners(run, group))
            yield Finding(title, text, "warn" if lost else "", compare_best(run, group), (behind,))


def compare_owned(run: Run) -> Iterator[Finding]:
    """Yield a finding for each engine with settings by its authors."""
    for engine, rows in group_by(run.table("search_owned"), "engine").items():
        ratios = [f"{_place(r)} {spread(r, 'ratio').print_with(ratio_text)}" for r in with_number(rows, "ratio")]
        missed = [f"{_place(r)} ({r['message']})" for r in rows if r["status"] != OK]
        parts = [f"take this multiple of the time of our cheapest: {itemise(ratios)}"] if ratios else []
        parts += [f"do not hold {itemise(missed)}"] if missed else []
        if parts:
            text = f"The settings of `{engine}` {BY_AUTHORS} {'; they '.join(parts)}."
            yield Finding(f"{engine}, {BY_AUTHORS}", text, behind=(lay_out("search_owned", list_owned(rows)),))


def _place(row: Row) -> str:
    """Return the requirement and the linkage of a row in words, such as "1e-06 m of position on four_bar"."""
    return f"{limit_text(row['accuracy'])} {row['unit']} of {ERRORS.get(row['required'], row['required'])} on {row['mechanism']}"


def compare_best(run: Run, group: Sequence[Row]) -> str:
    """Return a sentence that compares all engines' times at one requirement with our compiled ones; empty without times."""
    raced = count(len({r["mechanism"] for r in with_number(group, "ratio")}), "linkage")
    faster = group_by(list_faster(group), "engine").items()
    wins = itemise(f"{_mark_engine(run, engine)} is faster on {len(rows)}" for engine, rows in faster)
    ratios = [r["ratio"] for r in with_number(group, "ratio") if r["engine"] not in run.own_engines]
    others = f"engines by others take {range_text(ratios)} times as long" if ratios else ""
    outcome = "; ".join(filter(None, (wins, others)))
    return f"Against the cheaper of our compiled formulations on {raced}, {outcome}." if outcome else ""


def _mark_engine(run: Run, engine: str) -> str:
    """Return the name of an engine as code, marked if the authors of the suite wrote the engine."""
    return f"`{engine}`{' (own)' if engine in run.own_engines else ''}"


def _print_ratio(run: Run, row: Row) -> str:
    """Return in words the linkage of a row, and the engine's time divided by this suite's, or why this ratio is missing."""
    if row["status"] != OK:
        return f"{row['mechanism']} {reach_of_row(run, row).words}"
    ratio = spread(row, "ratio")  # unknown if our own engines do not meet the requirement
    words = ratio.print_with(ratio_text) if is_known(ratio.value) else f"(ours {Kind.NOT_REACHED})"
    return f"{row['mechanism']} {words}"


def divide_by_ours(group: Sequence[Row]) -> list[Row]:
    """Return rows of `search_winners` with times divided by that of the fastest of this suite's compiled engines on the linkage.

    Rows of these engines have the entry `ours`. The stored ratios may be relative to another of them, equally fast within the
    spread; division by their smallest ratio gives the fastest the ratio 1. If none of them has a ratio, all ratios are NaN.
    """
    compiled = group_by((r for r in with_number(group, "ratio") if r.get("ours")), "mechanism")
    least = {linkage: min(r["ratio"] for r in rows) for linkage, rows in compiled.items()}
    divided: list[Row] = []
    for row in group:
        ours, ratio = least.get(row["mechanism"], math.nan), spread(row, "ratio")
        divided.append({**row, "ratio": ratio.value / ours, "ratio_low": ratio.low / ours, "ratio_high": ratio.high / ours})
    return divided


def list_faster(group: Sequence[Row]) -> list[Row]:
    """Return the rows of engines that are faster than the suite's compiled ones: the whole range of the ratio is below 1."""
    return [r for r in group if not r.get("ours") and number(r, "ratio_high") < 1]


def name_defeats(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield a sentence in bold for each way in which this suite's compiled engines lose.

    These engines are slower than others, do not meet the requirement on a linkage, or lead by less than the target.

    Args:
        group: rows that `divide_by_ours` returns, at one requirement.
    """
    if faster := [f"{_mark_engine(run, r['engine'])} on {_print_ratio(run, r)}" for r in list_faster(group)]:
        yield f"**Slower than {itemise(faster)}.** "
    for linkage, rows in sorted(group_by(group, "mechanism").items()):
        ours = [r for r in rows if r.get("ours")]
        if any(r["status"] == OK for r in ours):
            continue
        # engines that were skipped or not tried do not count as defeated
        if any(reach_of_row(run, r).kind is Kind.NOT_REACHED for r in ours):
            others = itemise(f"`{r['engine']}`" for r in rows if r["status"] == OK)
            yield f"**Our own engines do not meet the requirement on {linkage}**{f', unlike {others}' if others else ''}. "
    missed = [r for r in with_number(group, "target") if not r["met"]]
    if short := [f"`{r['engine']}` on {_print_ratio(run, r)} instead of {ratio_text(r['target'])}" for r in missed]:
        yield f"**Our lead misses its target** over {itemise(short)}. "


def name_left_out(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield sentences on the engines that did not run on a linkage, one for each reason, and on linkages without a search."""
    missing = [r for r in group if r["status"] != OK and reach_of_row(run, r).kind not in TRIED]
    for words, rows in group_by(missing, lambda r: reach_of_row(run, r).words).items():
        engines = itemise_code(r["engine"] for r in rows)
        yield f" Left out: {engines} on {itemise(sorted({r['mechanism'] for r in rows}))} ({words})."
    if rest := sorted(set(run.linkages) - {r["mechanism"] for r in group}):
        yield f" Not searched: {itemise(rest)}."
