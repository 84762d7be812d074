"""The costs of a step and of an acceleration, as ratios to one engine of the same run."""

from collections.abc import Iterator

from gauss_bench.report.content import (
    NOTE,
    Cell,
    Finding,
    Section,
    Table,
    Text,
    columns,
    engine_cell,
    itemise,
    ratio_cells,
    text_cell,
    time_cell,
    times,
)
from gauss_bench.report.rows import Row, Run, costs, group_rows, is_known, number, plain

PLACE = 50
TABLES = ("results",)
OWN, RIVAL = "gauss", "lagrange"
HEAD = (
    *("engine", "settings", "integrator", "stabilization"),
    *("step µs", "ratio", "spread"),
    *("own loop µs", "ratio", "spread"),
    *("acceleration µs", "ratio", "spread"),
    *("warm build ms", "cold build ms"),
)


def section(run: Run, name: str) -> Section | None:
    rows = costs(run.of(name))
    if not rows:
        return None
    baseline = run.environment.get("baseline_engine", "")
    words = (
        f"Lower quartiles of interleaved samples, and their ratio to `{baseline}` with its spread. **Step** is a step called from "
        "Python, **own loop** a step inside the engine's compiled loop. A ratio above 1 is slower. **Warm build** is a model and "
        "its first step where what is generated is stored, **cold build** the first one in a new process with nothing stored, "
        "once; engines without one generate no code."
    )
    head, numeric = columns(HEAD, 4)
    lines = []
    for row in rows:
        names = tuple(text_cell(row[key]) for key in ("settings", "integrator", "stabilization"))
        step = (time_cell(row, "step_time"), *ratio_cells(row, "step_ratio"))
        own = (time_cell(row, "native_step_time"), *ratio_cells(row, "native_step_ratio"))
        one = (time_cell(row, "acceleration_time"), *ratio_cells(row, "acceleration_ratio"))
        built = (milliseconds(row, x) for x in ("build_time", "cold_build_time"))
        lines.append((engine_cell(row), *names, *step, *own, *one, *built))
    table = Table(f"{name}: cost", head, tuple(lines), numeric, note=NOTE)
    inside = group_rows((r for r in rows if r.get("in_python")), lambda r: str(r["in_python"]))
    said = [f"{itemise(dict.fromkeys(str(r['engine']) for r in some))}: {what}" for what, some in inside.items()]
    told = [Text(f"The suite's own in Python, inside these times: {'; '.join(said)}.")] if said else []
    return Section("Cost", f"{name}-cost", (Text(words), table, *told))


def milliseconds(row: Row, column: str) -> Cell:
    x = number(row, column)
    return Cell(f"{1e3 * x:.2f}", x) if is_known(x) else Cell("-")


def findings(run: Run) -> Iterator[Finding]:
    """The suite's own formulation against Lagrange multipliers: the cost of a step and of an acceleration."""
    rows = [row for row in costs(run.results) if plain(row)]
    for quantity, what in (("step", "A step"), ("acceleration", "One acceleration")):
        spreads: dict[str, list[float]] = {}
        for row in (r for r in rows if r["engine"] == OWN):
            rival = next((r for r in rows if r["engine"] == RIVAL and _alike(r, row)), None)
            ratio = _ratio(run, row, rival, quantity) if rival is not None else []
            if ratio:  # an acceleration has no integrator: one per linkage
                spreads.setdefault(f"{row['mechanism']}{' ' + row['integrator'] if quantity == 'step' else ''}", ratio)
        if spreads:
            longer, slower = (sum(x[:2][end] > 1 for x in spreads.values()) for end in (0, -1))
            level = sum(x[1] <= 1 <= x[2] for x in spreads.values() if len(x) > 1)
            told = itemise(f"{name} {_with_spread(x)}" for name, x in spreads.items())
            yield Finding(
                f"Cost of {OWN} against {RIVAL}",
                f"{what} of `{OWN}` takes this multiple of the time of `{RIVAL}`: {told}; slower in {slower} of {len(spreads)}"
                f"{f', not told apart in {level}' if level else ''}.",
                "warn" if longer > len(spreads) / 2 else "good",
            )


def _with_spread(x: list[float]) -> str:
    return f"{times(x[0])} ({times(x[1])}..{times(x[2])})" if len(x) > 1 else times(x[0])


def _alike(a: Row, b: Row) -> bool:
    return all(a[key] == b[key] for key in ("mechanism", "settings", "integrator"))


def _ratio(run: Run, own: Row, rival: Row, quantity: str) -> list[float]:
    """Ratio with low and high where the rival, or the row itself, is what ratios are taken to; else the quotient of two ratios."""
    x, low, high = (number(own, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    y, below, above = (number(rival, f"{quantity}_ratio{end}") for end in ("", "_low", "_high"))
    baseline = run.environment.get("baseline_engine")
    if baseline == RIVAL and y == 1 and is_known(low) and is_known(high):
        return [x, low, high]
    if baseline == OWN and x == 1 and below > 0 and above > 0:
        return [1 / y, 1 / above, 1 / below]
    return [x / y] if is_known(x) and y > 0 else []
