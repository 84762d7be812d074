"""The cheapest way of every engine that is exact enough over the whole run: what answers which engine to take.

Every figure is the searched best of its engine; what was searched, with which budget, and where each knob comes from stands below.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from gauss_bench.reach import ERRORS, Kind, Reach, Requirement
from gauss_bench.report.content import (
    RANGE,
    Block,
    Cell,
    Finding,
    Section,
    Text,
    count,
    counts,
    error_cell,
    goal,
    itemise,
    ratio_cells,
    small,
    table_with_title,
    text_cell,
    texts,
    time_of,
    times,
)
from gauss_bench.report.reaches import answer
from gauss_bench.report.rows import Row, Run, group_rows, is_known, number, over_time
from gauss_bench.report.site.settings import multiples

PLACE = 15
TRIED = (Kind.TIMED, Kind.UNTIMED, Kind.NOT_REACHED)
TABLES = ("search_winners", "search_space", "search_knobs")
SEARCH = (
    "For every linkage, requirement and engine: of all variants of the engine (integrator, stabilisation, solver, iterations, "
    "flags) the cheapest whose error stays within the requirement at every beat of the run. Errors depend on no clock; of "
    "the variants that pass, those near the cheapest race in one process, which is repeated in several: where code and data happen "
    "to lie moves a time by several per cent for the life of a process. Whoever is as fast as the fastest in a quarter of the "
    "processes ties with it, and of those that tie the first of the engine's file wins. "
    "Generation and compilation are not timed. A time is the median over the processes of lower quartiles of their rounds; **times "
    "the fastest** is over the least of all engines' times, whoever made it; **ratio** is to the suite's own compiled way that is "
    "marked **base**: above 1 the engine is slower. "
    "Remarks say what of the suite's own runs in Python inside that time. Engines marked **own** are by the suite's "
    "authors. A range is where a second race of as many processes falls in 99 of 100 cases, whichever of those that tie is named "
    "then."
)
HEAD = (
    *("linkage", "within", "engine", "variant", "integrator", "stabilization"),
    *(
        "step [s] or tolerance",
        "steps",
        "error",
        "time",
        "times the fastest",
        "ratio",
        RANGE,
        "target",
        "met",
        "tried",
        "passing",
        "remark",
    ),
)
KINDS = ("position", "end", "angle", "force")
OK = "ok"
SPACE = ("engine", "variant", "integrator", "stabilization", "chosen by the search", "other knobs")
KNOBS = ("engine", "knob", "meaning", "source")


def section(run: Run) -> Section | None:
    """Winners, then the space and its knobs."""
    rows = [r for r in run.table("search_winners") if r["required"]]
    if not rows:
        return None
    blocks: list[Block] = [Text(SEARCH), Text(scope(rows))]
    for kind, group in group_rows(rows, lambda r: str(r["required"])).items():
        title, line = f"Searched best, by error of {ERRORS.get(kind, kind)}", with_base(run, group)
        blocks.append(table_with_title(title, HEAD, 6, in_order(group), line, 1, folded=kind not in ("position", "end")))
    if space := run.table("search_space"):
        blocks.append(
            table_with_title(f"The space: {count(len(space), 'variant')}", SPACE, len(SPACE), space, variant, folded=True)
        )
    if knobs := run.table("search_knobs"):
        blocks.append(table_with_title("Knobs, and where each is documented", KNOBS, len(KNOBS), knobs, knob, folded=True))
    return Section("The searched best of every engine", "search", tuple(blocks))


def in_order(rows: Sequence[Row]) -> list[Row]:
    return sorted(
        rows,
        key=lambda r: (str(r["mechanism"]), -number(r, "accuracy"), number(r, "seconds") if is_known(r.get("seconds")) else 1e9),
    )


def scope(rows: Sequence[Row]) -> str:
    """State what was spent, and what is left out."""
    return (
        f"Each variant had {effort(rows)}; what was **not reached** was not within these, by these variants, with these adapters."
    )


def effort(rows: Sequence[Row]) -> str:
    """Budget and most steps; from the least to the largest where linkages differ in them."""
    budgets, steps = (sorted({int(number(r, x)) for r in rows if is_known(r.get(x))}) for x in ("budget", "most_steps"))
    told = [" to ".join(str(x) for x in dict.fromkeys((some[0], some[-1]))) for some in (budgets, steps)]
    return f"{told[0]} evaluations and {told[1]} steps of a run at most"


def answer_of(run: Run, row: Row) -> Reach:
    """Return the answer of a row of winners."""
    return answer(run, str(row["mechanism"]), str(row["engine"]), [Requirement(str(row["required"]), number(row, "accuracy"))])


def with_base(run: Run, rows: Sequence[Row]) -> Callable[[Row], tuple[Cell, ...]]:
    """The line of a winner, which knows who is the fastest at each requirement and who is the authors' own."""
    over: dict[tuple[Any, ...], float] = {}
    for place, some in group_rows(rows, lambda r: (r["mechanism"], r["required"], number(r, "accuracy"))).items():
        over |= multiples({(*place, r["engine"]): number(r, "seconds") for r in some if r["status"] == OK})

    def line(row: Row) -> tuple[Cell, ...]:
        x = over.get((row["mechanism"], row["required"], number(row, "accuracy"), row["engine"]), math.nan)
        marks = [mark for mark, is_so in (("own", row["engine"] in run.own_engines), ("base", row.get("own"))) if is_so]
        return _winner(run, row, f" ({', '.join(marks)})" if marks else "", x)

    return line


def _winner(run: Run, row: Row, mark: str, over: float) -> tuple[Cell, ...]:
    size = next((number(row, x) for x in ("step", "tolerance") if is_known(row.get(x))), None)
    return (
        text_cell(row["mechanism"]),
        Cell(f"{small(number(row, 'accuracy'))} {row['unit']}", number(row, "accuracy")),
        text_cell(f"{row['engine']}{mark}", "engine"),
        *texts(row, "settings", "integrator", "stabilization"),
        Cell("-") if size is None else Cell(f"{size:.3g}", size),
        *counts(row, "steps"),
        error_cell(row, "error"),
        time_of(row),
        Cell(times(over), over) if is_known(over) else Cell("-"),
        *ratio_cells(row, "ratio"),
        *goal(row),
        *counts(row, "evaluations", "passing"),
        text_cell(in_python(row)) if row["status"] == OK else text_cell(answer_of(run, row).words, "warn"),
    )


def in_python(row: Row) -> str:
    """Return what of the suite's own runs in Python inside a time, in words; empty where nothing does."""
    return f"in Python: {row['in_python']}" if row.get("in_python") else ""


def variant(row: Row) -> tuple[Cell, ...]:
    return (text_cell(row["engine"], "engine"), *texts(row, "settings", "integrator", "stabilization", "size", "options"))


def knob(row: Row) -> tuple[Cell, ...]:
    return (text_cell(row["engine"], "engine"), *texts(row, "knob", "meaning", "source"))


def findings(run: Run) -> Iterator[Finding]:
    """At each requirement: how much faster than each rival's searched best our own is, where it is not, and within which limits."""
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
    """A rival's time over our own on a linkage, with its spread."""
    if row["status"] != OK:
        return f"{row['mechanism']} {answer_of(run, row).words}"
    x, low, high = (times(number(row, f"ratio{end}")) for end in ("", "_low", "_high"))
    return (
        f"{row['mechanism']} {x} ({low}..{high})" if is_known(row.get("ratio")) else f"{row['mechanism']} (ours {Kind.NOT_REACHED})"
    )


def over_the_cheaper(group: Sequence[Row]) -> list[Row]:
    """Rows whose ratios are to the cheaper of our own compiled ways on the linkage: stored ones may be to one that ties with it."""
    least = {
        place: min((number(r, "ratio") for r in some if r.get("ours") and is_known(r.get("ratio"))), default=math.nan)
        for place, some in group_rows(group, lambda r: str(r["mechanism"])).items()
    }
    columns = [f"ratio{end}" for end in ("", "_low", "_high")]
    return [{**r, **{x: number(r, x) / least[str(r["mechanism"])] for x in columns}} for r in group]


def slower(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Name who is faster than our own compiled formulations, others of our own included."""
    ahead = [r for r in group if not r.get("ours") and number(r, "ratio_high") < 1]
    faster = [f"`{r['engine']}`{' (own)' if r['engine'] in run.own_engines else ''} on {_multiple(run, r)}" for r in ahead]
    if faster:
        yield f"**Slower than {itemise(faster)}.** "


def out_of_reach(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """List where none of our own ways reaches it, and who does there."""
    reached = {str(r["mechanism"]) for r in group if r.get("ours") and r["status"] == OK}
    for place in sorted(
        {str(r["mechanism"]) for r in group if r.get("ours") and answer_of(run, r).kind is Kind.NOT_REACHED} - reached
    ):
        others = itemise(f"`{r['engine']}`" for r in group if r["mechanism"] == place and r["status"] == OK)
        yield f"**Our own ways do not reach it on {place}**{f', {others} does' if others else ''}. "


def short(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """Name who is nearer than what was aimed at."""
    missed = [r for r in group if is_known(r.get("target")) and not r["met"]]
    near = [f"`{r['engine']}` on {_multiple(run, r)} of {times(number(r, 'target'))}" for r in missed]
    if near:
        yield f"**Short of the aim**: {itemise(near)}. "


def not_told(run: Run, group: Sequence[Row]) -> Iterator[str]:
    """State what the figures leave out: engines that do not run somewhere, and linkages that were not searched."""
    untried = [r for r in group if r["status"] != OK and answer_of(run, r).kind not in TRIED]
    for message, rows in group_rows(untried, lambda r: answer_of(run, r).words).items():
        engines = itemise(dict.fromkeys(f"`{r['engine']}`" for r in rows))
        yield f" Left out: {engines} on {itemise(sorted({str(r['mechanism']) for r in rows}))} ({message})."
    if rest := sorted(set(run.linkages) - {str(r["mechanism"]) for r in group}):
        yield f" Not searched: {itemise(rest)}."
