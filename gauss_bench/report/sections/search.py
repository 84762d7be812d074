"""The cheapest setting of every engine that holds a requirement over the whole run.

Every figure is for the best setting that the search found; the section lists the searched variants, the budget, and the source of
each option.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from gauss_bench.reach import ERRORS, Kind, Reach, Requirement
from gauss_bench.report.content import Block, Finding, Section, Text, blocks_of, count, itemise, lay_out, layouts, small, times
from gauss_bench.report.reaches import answer
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number, over_time
from gauss_bench.report.site.settings import multiples

PLACE = 15
TRIED = (Kind.TIMED, Kind.UNTIMED, Kind.NOT_REACHED)
TABLES = ("search_winners", "search_space", "search_knobs")
KINDS = ("position", "end", "angle", "force")
OK = "ok"


def section(run: Run) -> Section | None:
    """Return the section with the winners, then the searched variants and their options."""
    rows = [r for r in run.table("search_winners") if r["required"]]
    if not rows:
        return None
    blocks: list[Block] = [Text(layouts()["search"]["words"]), Text(scope(rows))]
    for kind, group in group_rows(rows, lambda r: str(r["required"])).items():
        shown = list_winners(run, group)
        blocks.append(lay_out("search", shown, kind=ERRORS.get(kind, kind), folded=kind not in ("position", "end")))
    space = run.table("search_space")
    blocks += blocks_of("search_space", space, variants=count(len(space), "variant"))
    blocks += blocks_of("search_knobs", run.table("search_knobs"))
    return Section("The searched best of every engine", "search", tuple(blocks))


def list_winners(run: Run, rows: Sequence[Row]) -> list[Row]:
    """Return the rows of winners with their multiples of the fastest, marks of own engines, and remarks."""
    over: dict[tuple[Any, ...], float] = {}
    for place, some in group_rows(rows, lambda r: (r["mechanism"], number(r, "accuracy"))).items():
        over |= multiples({(*place, r["engine"]): number(r, "seconds") for r in some if r["status"] == OK})
    found = []
    for row in rows:
        marks = [mark for mark, is_so in (("own", row["engine"] in run.own_engines), ("base", row.get("own"))) if is_so]
        is_ok = row["status"] == OK
        said = {
            "within": f"{small(number(row, 'accuracy'))} {row['unit']}",
            "name": f"{row['engine']} ({', '.join(marks)})" if marks else row["engine"],
            "size": next((number(row, x) for x in ("step", "tolerance") if is_known(row.get(x))), math.nan),
            "over": over.get((row["mechanism"], number(row, "accuracy"), row["engine"]), math.nan),
            "said": in_python(row) if is_ok else answer_of(run, row).words,
            "said_tone": "" if is_ok else "warn",
        }
        found.append({**row, **said})

    def order(row: Row) -> tuple[str, float, float]:
        return str(row["mechanism"]), -number(row, "accuracy"), number(row, "seconds") if is_known(row.get("seconds")) else 1e9

    return sorted(found, key=order)


def scope(rows: Sequence[Row]) -> str:
    """Return a sentence on the effort of the search and its limits."""
    return (
        f"Each variant had {effort(rows)}; what was **not reached** was not within these, by these variants, with these adapters."
    )


def effort(rows: Sequence[Row]) -> str:
    """Return the budget and the largest number of steps, as ranges if linkages differ in them."""
    budgets, steps = (sorted({int(number(r, x)) for r in rows if is_known(r.get(x))}) for x in ("budget", "most_steps"))
    ranges = [" to ".join(str(x) for x in dict.fromkeys((some[0], some[-1]))) for some in (budgets, steps)]
    return f"{ranges[0]} evaluations and {ranges[1]} steps of a run at most"


def answer_of(run: Run, row: Row) -> Reach:
    """Return the reach of the engine of a row of winners."""
    return answer(run, str(row["mechanism"]), str(row["engine"]), [Requirement(str(row["required"]), number(row, "accuracy"))])


def in_python(row: Row) -> str:
    """Return the suite's own Python code that runs inside the measured time, in words; empty without any."""
    return f"in Python: {row['in_python']}" if row.get("in_python") else ""


def findings(run: Run) -> Iterator[Finding]:
    """Yield at each requirement the speed of our compiled engines relative to each rival's best, defeats first."""
    lines = run.table("search_winners")
    if lost_races := [r for r in lines if not r["required"]]:
        said = "; ".join(f"{r['mechanism']}: {r['message']}" for r in lost_races)
        yield Finding("Not searched", f"The race of {count(len(lost_races), 'linkage')} was lost: {said}.", "bad")
    for (kind, accuracy), group in sorted(group_rows((r for r in lines if r["required"]), _requirement).items(), key=_by_kind):
        group = over_the_cheaper(group)
        lost = [*slower(run, group), *out_of_reach(run, group), *short(run, group)]
        others = [r for r in group if r["engine"] not in run.own_engines and answer_of(run, r).kind in TRIED]
        rivals = group_rows(others, lambda r: str(r["engine"]))
        said = "; ".join(f"`{engine}` {itemise(_multiple(run, r) for r in rows)}" for engine, rows in rivals.items())
        if not said:
            continue
        ours = [f"`{x}`" for x in dict.fromkeys(str(r["engine"]) for r in group if r.get("ours"))]
        text = (
            f"{''.join(lost)}The cheaper of {itemise(ours)} is this many times as fast as the searched best of {said}, "
            f"where each variant had {effort(group)}, and in brackets "
            f"the spread of the race.{''.join(not_told(run, group))}"
        )
        title = f"Within {small(accuracy)} {group[0]['unit']} of {ERRORS.get(kind, kind)} {over_time(run)}"
        yield Finding(title, text, "warn" if lost else "")


def _by_kind(item: tuple[tuple[str, float], list[Row]]) -> tuple[int, float]:
    kind, accuracy = item[0]
    return [*KINDS, kind].index(kind), -accuracy


def _requirement(row: Row) -> tuple[str, float]:
    return str(row["required"]), number(row, "accuracy")


def _multiple(run: Run, row: Row) -> str:
    """Return a rival's time divided by our own on a linkage, with its spread."""
    if row["status"] != OK:
        return f"{row['mechanism']} {answer_of(run, row).words}"
    x, low, high = (times(number(row, f"ratio{end}")) for end in ("", "_low", "_high"))
    return (
        f"{row['mechanism']} {x} ({low}..{high})" if is_known(row.get("ratio")) else f"{row['mechanism']} (ours {Kind.NOT_REACHED})"
    )


def over_the_cheaper(group: Sequence[Row]) -> list[Row]:
    """Return rows with ratios relative to the cheaper of our compiled engines; stored ratios may refer to one that ties with it."""
    least = {
        place: min((number(r, "ratio") for r in some if r.get("ours") and is_known(r.get("ratio"))), default=math.nan)
        for place, some in group_rows(group, lambda r: str(r["mechanism"])).items()
    }
    columns = [f"ratio{end}" for end in ("", "_low", "_high")]
    return [{**r, **{x: number(r, x) / least[str(r["mechanism"])] for x in columns}} for r in group]


def slower(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield the engines that are faster than our compiled formulations, including other own engines."""
    ahead = [r for r in group if not r.get("ours") and number(r, "ratio_high") < 1]
    faster = [f"`{r['engine']}`{' (own)' if r['engine'] in run.own_engines else ''} on {_multiple(run, r)}" for r in ahead]
    if faster:
        yield f"**Slower than {itemise(faster)}.** "


def out_of_reach(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield the linkages on which none of our compiled engines holds the requirement, and the engines that do."""
    reached = {str(r["mechanism"]) for r in group if r.get("ours") and r["status"] == OK}
    for place in sorted(
        {str(r["mechanism"]) for r in group if r.get("ours") and answer_of(run, r).kind is Kind.NOT_REACHED} - reached
    ):
        others = itemise(f"`{r['engine']}`" for r in group if r["mechanism"] == place and r["status"] == OK)
        yield f"**Our own ways do not reach it on {place}**{f', {others} does' if others else ''}. "


def short(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield the rivals over which our lead misses its target."""
    missed = [r for r in group if is_known(r.get("target")) and not r["met"]]
    near = [f"`{r['engine']}` on {_multiple(run, r)} of {times(number(r, 'target'))}" for r in missed]
    if near:
        yield f"**Short of the aim**: {itemise(near)}. "


def not_told(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Yield what the figures leave out: engines that do not run a linkage, and linkages that were not searched."""
    untried = [r for r in group if r["status"] != OK and answer_of(run, r).kind not in TRIED]
    for message, rows in group_rows(untried, lambda r: answer_of(run, r).words).items():
        engines = itemise(dict.fromkeys(f"`{r['engine']}`" for r in rows))
        yield f" Left out: {engines} on {itemise(sorted({str(r['mechanism']) for r in rows}))} ({message})."
    if rest := sorted(set(run.linkages) - {str(r["mechanism"]) for r in group}):
        yield f" Not searched: {itemise(rest)}."
