"""The cheapest setting of every engine that holds a requirement over the whole run.

Every figure is for the best setting that the search found; the section lists the searched variants, the budget, and the source of
each option.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from gauss_bench.reach import BY_AUTHORS, ERRORS, Kind, Reach, Requirement
from gauss_bench.report.cases import setting_words
from gauss_bench.report.content import Block, Finding, Section, Table, Text, blocks_of, lay_out, layouts
from gauss_bench.report.reaches import answer
from gauss_bench.report.rows import Row, Run, first_number, group_by, is_known, number, search_span, spread, with_number
from gauss_bench.report.site.settings import race_multiples
from gauss_bench.report.words import count, itemise, limit_text, range_text, ratio_text

PLACE = 15
TRIED = (Kind.TIMED, Kind.UNTIMED, Kind.NOT_REACHED)
KINDS = ("position", "end", "angle", "force")  # in the order of the findings
OK = "ok"


def section(run: Run) -> Section | None:
    """Return the section with the winners, then the searched variants and their options."""
    rows = [r for r in run.table("search_winners") if r["required"]]
    if not rows:
        return None
    scope = (
        f"Each variant had {describe_effort(rows)}; a requirement that was **not reached** was not "
        "reached within these limits, by these variants and adapters."
    )
    blocks: list[Block] = [Text(layouts()["search"]["words"]), Text(scope)]
    for kind, group in group_by(rows, "required").items():
        winners = list_winners(run, group)
        blocks.append(lay_out("search", winners, kind=ERRORS.get(kind, kind), folded=kind not in ("position", "end")))
    blocks += blocks_of("search_owned", list_owned(run.table("search_owned")))
    space = run.table("search_space")
    blocks += blocks_of("search_space", space, variants=count(len(space), "variant"))
    blocks += blocks_of("search_knobs", run.table("search_knobs"))
    return Section("The searched best of every engine", "search", blocks)


def list_winners(run: Run, rows: Sequence[Row]) -> list[Row]:
    """Return the rows of winners with their multiples of the fastest, marks of own engines, and remarks."""
    over = race_multiples(run)
    winners = []
    for row in rows:
        marks = [mark for mark, is_so in (("own", row["engine"] in run.own_engines), ("base", row.get("own"))) if is_so]
        marks += [BY_AUTHORS] if row.get("owner") else []
        more: dict[str, Any] = {
            "within": f"{limit_text(row['accuracy'])} {row['unit']}",
            "name": f"{row['engine']} ({', '.join(marks)})" if marks else row["engine"],
            "size": first_number(number(row, "step"), number(row, "tolerance")),
            "over": over.get((row["mechanism"], row["required"], row["accuracy"], row["engine"]), math.nan),
        }
        if row["status"] == OK:
            more["remark"] = f"in Python: {row['in_python']}" if row.get("in_python") else ""
        else:
            reach = answer_of(run, row)
            more |= {"remark": reach.words, "remark_tone": "warn", "missing": str(reach.kind)}
        winners.append({**row, **more})

    def order(row: Row) -> tuple[str, float, float]:
        seconds = number(row, "seconds")
        return row["mechanism"], -row["accuracy"], seconds if is_known(seconds) else math.inf

    return sorted(winners, key=order)


def list_owned(rows: Sequence[Row]) -> list[Row]:
    """Return a row for the settings by an engine's authors and one for ours below it, for each requirement that both tried."""
    lines: list[Row] = []
    for row in rows:
        place = {k: row[k] for k in ("mechanism", "required")} | {"within": f"{limit_text(row['accuracy'])} {row['unit']}"}
        ours = {k.removeprefix("our_"): x for k, x in row.items() if k.startswith("our_")}
        their_name = {"name": f"{row['engine']}, {BY_AUTHORS}", "owner": row["owner"]}
        for side, names in ((row, their_name), (ours, {"name": row["engine"], "owner": ""})):
            size = first_number(number(side, "step"), number(side, "tolerance"))
            words = setting_words(side) if is_known(number(side, "seconds")) else ""
            lines.append({**place, **side, **names, "size": size, "words": words, "remark": side.get("message", "")})
    return lines


def describe_effort(rows: Sequence[Row]) -> str:
    """Return the budget and the largest number of steps, as ranges if linkages differ in them."""
    ranges = []
    for column in ("budget", "most_steps"):
        values = sorted({int(r[column]) for r in with_number(rows, column)})
        ranges.append(" to ".join(str(x) for x in dict.fromkeys((values[0], values[-1]))))
    return f"{ranges[0]} evaluations and {ranges[1]} steps of a run at most"


def answer_of(run: Run, row: Row) -> Reach:
    """Return the reach of the engine of a row of winners."""
    return answer(run, row["mechanism"], row["engine"], [Requirement(row["required"], row["accuracy"])])


def findings(run: Run) -> Iterator[Finding]:
    """Yield at each requirement the speed of our compiled engines relative to each rival's best, defeats first."""
    rows = run.table("search_winners")
    lost_races = [f"{r['mechanism']}: {r['message']}" for r in rows if not r["required"]]
    if lost_races:
        text = f"The race of {count(len(lost_races), 'linkage')} was lost: {'; '.join(lost_races)}."
        unsearched = [r for r in rows if not r["required"]]
        yield Finding("Not searched", text, "bad", behind=(lay_out("behind_lost", unsearched),))
    yield from compare_owned(run)
    groups = group_by((r for r in rows if r["required"]), "required", "accuracy")
    for kind, accuracy in sorted(groups, key=lambda x: ([*KINDS, x[0]].index(x[0]), -x[1])):
        group = over_the_cheaper(groups[kind, accuracy])
        lost = [*name_faster(run, group), *name_unreached(run, group), *name_missed_targets(run, group)]
        rivals = [r for r in group if r["engine"] not in run.own_engines and answer_of(run, r).kind in TRIED]
        races = [f"`{engine}` {itemise(_multiple(run, r) for r in some)}" for engine, some in group_by(rivals, "engine").items()]
        if races:
            ours = itemise(dict.fromkeys(f"`{r['engine']}`" for r in group if r.get("ours")))
            text = (
                f"{''.join(lost)}The cheaper of {ours} is this many times as fast as the searched best of {'; '.join(races)}, "
                f"where each variant had {describe_effort(group)}, and in brackets "
                f"the spread of the race.{''.join(name_left_out(run, group))}"
            )
            title = f"Within {limit_text(accuracy)} {group[0]['unit']} of {ERRORS.get(kind, kind)} {search_span(run)}"
            yield Finding(title, text, "warn" if lost else "", compare_best(run, group), (list_ratios(run, group),))


def compare_owned(run: Run) -> Iterator[Finding]:
    """Yield for each engine how long the settings that its authors own take, in times of our cheapest one."""
    for engine, rows in group_by(run.table("search_owned"), "engine").items():
        races = [f"{_place(r)} {spread(r, 'ratio').print_with(ratio_text)}" for r in with_number(rows, "ratio")]
        missed = [f"{_place(r)} ({r['message']})" for r in rows if r["status"] != OK]
        parts = [f"hold {itemise(races)} times as long as our cheapest"] if races else []
        parts += [f"do not hold {itemise(missed)}"] if missed else []
        if parts:
            text = f"The settings of `{engine}` {BY_AUTHORS} {'; they '.join(parts)}."
            yield Finding(f"{engine}, {BY_AUTHORS}", text, behind=(lay_out("search_owned", list_owned(rows)),))


def _place(row: Row) -> str:
    """Return the linkage and the requirement of a row in words."""
    return f"{limit_text(row['accuracy'])} {row['unit']} of {ERRORS.get(row['required'], row['required'])} on {row['mechanism']}"


def compare_best(run: Run, group: Sequence[Row]) -> str:
    """Return in one sentence which engines beat our compiled formulations at a requirement, and how long other engines take."""
    ahead = list_faster(group)
    beaten = group_by(ahead, "engine")
    raced = count(len({r["mechanism"] for r in with_number(group, "ratio")}), "linkage")
    wins = [f"`{x}`{' (own)' if x in run.own_engines else ''} is faster on {len(some)}" for x, some in beaten.items()]
    ratios = [r["ratio"] for r in with_number(group, "ratio") if r["engine"] not in run.own_engines]
    slower = f"the engines of others take {range_text(ratios)} times as long" if ratios else ""
    told = "; ".join(filter(None, (itemise(wins) if wins else "", slower)))
    return f"Against the cheaper of our compiled formulations on {raced}, {told}." if told else ""


def list_ratios(run: Run, group: Sequence[Row]) -> Table:
    """Return the table of a requirement's races, each time over that of the cheaper of our compiled formulations."""
    return lay_out("behind_search", list_winners(run, group))


def _multiple(run: Run, row: Row) -> str:
    """Return a rival's time divided by our own on a linkage, with its spread."""
    if row["status"] != OK:
        return f"{row['mechanism']} {answer_of(run, row).words}"
    over = spread(row, "ratio")  # unknown if our own engines do not hold the requirement
    words = over.print_with(ratio_text) if is_known(over.value) else f"(ours {Kind.NOT_REACHED})"
    return f"{row['mechanism']} {words}"


def over_the_cheaper(group: Sequence[Row]) -> list[Row]:
    """Return rows with ratios relative to the cheaper of our compiled engines; stored ratios may refer to one that ties with it."""
    least: dict[str, float] = {}
    for row in with_number(group, "ratio"):
        if row.get("ours"):
            least[row["mechanism"]] = min(row["ratio"], least.get(row["mechanism"], math.inf))
    rows: list[Row] = []
    for row in group:
        ours = least.get(row["mechanism"], math.nan)
        over = spread(row, "ratio")
        rows.append({**row, "ratio": over.value / ours, "ratio_low": over.low / ours, "ratio_high": over.high / ours})
    return rows


def list_faster(group: Sequence[Row]) -> list[Row]:
    """Return the rows of engines that are faster than our compiled formulations beyond the spread."""
    return [r for r in group if not r.get("ours") and number(r, "ratio_high") < 1]


def name_faster(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield the engines that are faster than our compiled formulations, including other own engines."""
    ahead = list_faster(group)
    faster = [f"`{r['engine']}`{' (own)' if r['engine'] in run.own_engines else ''} on {_multiple(run, r)}" for r in ahead]
    if faster:
        yield f"**Slower than {itemise(faster)}.** "


def name_unreached(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield the linkages on which none of our compiled engines holds the requirement, and the engines that do."""
    for place, rows in sorted(group_by(group, "mechanism").items()):
        ours = [r for r in rows if r.get("ours")]
        if any(r["status"] == OK for r in ours) or all(answer_of(run, r).kind is not Kind.NOT_REACHED for r in ours):
            continue
        others = itemise(f"`{r['engine']}`" for r in rows if r["status"] == OK)
        yield f"**Our own engines do not reach it on {place}**{f', {others} does' if others else ''}. "


def name_missed_targets(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield the rivals over which our lead misses its target."""
    missed = [r for r in with_number(group, "target") if not r["met"]]
    near = [f"`{r['engine']}` on {_multiple(run, r)} of {ratio_text(r['target'])}" for r in missed]
    if near:
        yield f"**Short of the aim**: {itemise(near)}. "


def name_left_out(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield what the figures leave out: engines that do not run a linkage, and linkages that were not searched."""
    missing = [r for r in group if r["status"] != OK and answer_of(run, r).kind not in TRIED]
    for words, rows in group_by(missing, lambda r: answer_of(run, r).words).items():
        engines = itemise(dict.fromkeys(f"`{r['engine']}`" for r in rows))
        yield f" Left out: {engines} on {itemise(sorted({r['mechanism'] for r in rows}))} ({words})."
    if rest := sorted(set(run.linkages) - {r["mechanism"] for r in group}):
        yield f" Not searched: {itemise(rest)}."
