"""The cheapest way of every engine that is exact enough over the whole run: what answers which engine to take.

Every figure is the searched best of its engine; what was searched, with which budget, and where each knob comes from stands below.
"""

from collections.abc import Iterator, Sequence

from gauss_bench.report.content import (
    Block,
    Cell,
    Finding,
    Section,
    Text,
    count,
    counts,
    error_cell,
    listed,
    ratio_cells,
    remark,
    small,
    text_cell,
    texts,
    time_of,
    times,
    titled_table,
)
from gauss_bench.report.rows import Row, Run, grouped, known, number

PLACE = 15
TABLES = ("search_winners", "search_space", "search_knobs")
SEARCH = (
    "For every linkage, requirement and engine: of all variants of the engine (integrator, stabilisation, solver, iterations, "
    "flags) the cheapest whose error stays within the requirement at every beat of the whole run. Errors depend on no clock; of "
    "the variants that pass, those near the cheapest race in one process, and of those that tie the first of the engine's file "
    "wins. Generation and compilation are not timed. A ratio is an engine's time over that of the suite's own cheapest way, marked "
    "**own**: above 1 the engine is slower."
)
HEAD = (
    *("linkage", "within", "engine", "variant", "integrator", "stabilization"),
    *("step [s] or tolerance", "error", "time", "ratio", "spread", "tried", "passing", "remark"),
)
SPACE = ("engine", "variant", "integrator", "stabilization", "chosen by the search", "other knobs")
KNOBS = ("engine", "knob", "meaning", "source")


def section(run: Run) -> Section | None:
    """Winners, then the space and its knobs."""
    rows = run.table("search_winners")
    if not rows:
        return None
    blocks: list[Block] = [Text(SEARCH), Text(scope(rows))]
    for kind, group in grouped(rows, lambda r: str(r["required"])).items():
        blocks.append(
            titled_table(f"Searched best, by error of {kind}", HEAD, 6, in_order(group), winner, folded=kind != "position")
        )
    if space := run.table("search_space"):
        blocks.append(titled_table(f"The space: {count(len(space), 'variant')}", SPACE, len(SPACE), space, variant, folded=True))
    if knobs := run.table("search_knobs"):
        blocks.append(titled_table("Knobs, and where each is documented", KNOBS, len(KNOBS), knobs, knob, folded=True))
    return Section("The searched best of every engine", "search", tuple(blocks))


def in_order(rows: Sequence[Row]) -> list[Row]:
    return sorted(
        rows, key=lambda r: (str(r["mechanism"]), -number(r, "accuracy"), number(r, "seconds") if known(r.get("seconds")) else 1e9)
    )


def scope(rows: Sequence[Row]) -> str:
    """What was spent, and what is left out."""
    budget, most = (number(rows[0], x) for x in ("budget", "most_steps"))
    return (
        f"Each variant had {count(int(budget), 'evaluation')} and runs of at most {most:.0f} steps: **cannot reach** means within "
        "these, by these variants, and with this suite's adapters."
    )


def winner(row: Row) -> tuple[Cell, ...]:
    size = next((number(row, x) for x in ("step", "tolerance") if known(row.get(x))), None)
    return (
        text_cell(row["mechanism"]),
        Cell(f"{small(number(row, 'accuracy'))} {row['unit']}", number(row, "accuracy")),
        text_cell(f"{row['engine']}{' (own)' if row.get('own') else ''}", "engine"),
        *texts(row, "settings", "integrator", "stabilization"),
        Cell("-") if size is None else Cell(f"{size:.3g}", size),
        error_cell(row, "error"),
        time_of(row),
        *ratio_cells(row, "ratio"),
        *counts(row, "evaluations", "passing"),
        remark(row),
    )


def variant(row: Row) -> tuple[Cell, ...]:
    return (text_cell(row["engine"], "engine"), *texts(row, "settings", "integrator", "stabilization", "size", "options"))


def knob(row: Row) -> tuple[Cell, ...]:
    return (text_cell(row["engine"], "engine"), *texts(row, "knob", "meaning", "source"))


def findings(run: Run) -> Iterator[Finding]:
    """At each accuracy of positions: how the other engines' best compares with the suite's own best, where they win or cannot."""
    rows = [r for r in run.table("search_winners") if r["required"] == "position"]
    for accuracy, group in sorted(grouped(rows, lambda r: number(r, "accuracy")).items(), reverse=True):
        owned = {str(r["mechanism"]): str(r["engine"]) for r in group if r.get("own")}
        if not owned:
            continue
        everywhere = {str(r["mechanism"]) for r in group}
        rivals = [r for r in group if str(r["engine"]) not in set(owned.values())]
        parts = [told(name, lines) for name, lines in grouped(rivals, lambda r: str(r["engine"])).items()]
        faster = sorted({f"{r['engine']} on {r['mechanism']}" for r in rivals if number(r, "ratio_high") < 1})
        lost = sorted(everywhere - owned.keys())
        first = f"Faster than our own best: {listed(faster)}. " if faster else ""
        missing = f" Our own ways cannot reach it on {listed(lost)}." if lost else ""
        text = f"{first}Each engine's searched best against the suite's own: {'; '.join(parts)}.{missing} {scope(group)}"
        title = f"Within {small(accuracy)} m over the whole run"
        yield Finding(title, text, "warn" if faster or lost else "")


def told(engine: str, rows: Sequence[Row]) -> str:
    """An engine's least and largest ratio, and where it has none."""
    reached = sorted((r for r in rows if known(r.get("ratio"))), key=lambda r: number(r, "ratio"))
    cannot = sorted(str(r["mechanism"]) for r in rows if r["status"] == "cannot reach")
    skipped = sorted(str(r["mechanism"]) for r in rows if r["status"] not in ("ok", "cannot reach"))
    parts = []
    if reached:
        ends = dict.fromkeys(f"{times(number(r, 'ratio'))} ({r['mechanism']})" for r in (reached[0], reached[-1]))
        parts.append(f"takes {' to '.join(ends)} times as long on {count(len(reached), 'linkage')}")
    if cannot:
        parts.append(f"cannot reach it on {listed(cannot)}")
    if skipped:
        parts.append(f"does not run on {listed(skipped)}")
    return f"`{engine}` {', '.join(parts)}"
