"""Trajectories: every engine, setting, integrator, stabilisation and step against the reference."""

import re
from collections.abc import Iterator, Sequence

from gauss_bench.report.content import (
    BELOW_LEGEND,
    Block,
    Cell,
    Finding,
    Section,
    Table,
    columns,
    count,
    engine_cell,
    error,
    error_cell,
    itemise,
    status_cell,
    step_cell,
    text_cell,
    tie,
    times,
)
from gauss_bench.report.rows import (
    MEASURED_ERRORS,
    Row,
    Run,
    below_reference,
    end_bar,
    end_error,
    group_rows,
    is_known,
    label,
    may_rank,
    measure_bar,
    method,
    number,
    ok,
    quantity,
    run_time,
    unit,
)

PLACE = 30
TABLES = ("results",)
TARGETS = (1e-3, 1e-6)  # errors of the measured coordinate [rad or m] at which costs are compared
OWN = "gauss"
NUMBERS = r"( by)? \d\S*( rad| m| J)?( \(m or rad\))?( where \S+ J move)?(?= |,|;|$)"  # in the judge's words
SHUT = 1e-4  # [m, rad] a gap that nobody would see
LOST = 1.0  # [rad or m] a linkage that is somewhere else
BEFORE = ("engine", "settings", "integrator", "stabilization", "step [s]")
AFTER = (
    "length [m]",
    "angle [rad]",
    "velocity",
    "pos. drift",
    "vel. drift",
    "acc. residual",
    "energy [J]",
    "order",
    "status",
)
NOTE = (
    "Errors against the reference: of the measured coordinate at three times, and the worst over the run of any link's centre of "
    "mass [m], of any link's angle [rad] and of any velocity [m/s, rad/s]. Drift: worst constraint residual [m, rad] and its rate. "
    "Order: observed from this and the next larger step. "
)


def section(run: Run, name: str) -> Section | None:
    blocks: list[Block] = []
    for scenario, rows in group_rows(run.of(name), lambda r: str(r["scenario"])).items():
        if any(is_known(end_error(row)) for row in rows):
            blocks.append(best(f"{name}, {scenario}: the most accurate valid row of each engine and its settings", rows))
        blocks.append(whole(f"{name}, {scenario}: all trajectories", rows))
    return Section("Trajectories", f"{name}-trajectories", tuple(blocks)) if blocks else None


def line(row: Row) -> tuple[Cell, ...]:
    order = row.get("observed_order")
    return (
        engine_cell(row),
        *(text_cell(row[key]) for key in ("settings", "integrator", "stabilization")),
        step_cell(row),
        *(error_cell(row, column, measure_bar(row, column)) for column in MEASURED_ERRORS),
        *(error_cell(row, column, number(row, "position_error_bar")) for column in ("length_error", "angle_error")),
        error_cell(row, "velocity_error", number(row, "velocity_error_bar")),
        *(error_cell(row, column) for column in ("position_drift", "velocity_drift", "acceleration_residual")),
        error_cell(row, "energy_error", number(row, "energy_error_bar")),
        Cell(f"{order:.1f}", order) if is_known(order) and order is not None else Cell("-"),
        status_cell(row),
    )


def heading(rows: Sequence[Row]) -> tuple[str, ...]:
    """The head of a table of one linkage's rows, which names the coordinate that errors are measured by."""
    return (*BEFORE, *(f"error of {quantity(rows)} after {t:g} s [{unit(rows)}]" for t in MEASURED_ERRORS.values()), *AFTER)


def whole(title: str, rows: list[Row]) -> Table:
    head, numeric = columns(heading(rows), 4, last_text=1)
    return Table(title, head, tuple(line(row) for row in rows), numeric, folded=True, note=NOTE + BELOW_LEGEND)


def best(title: str, rows: list[Row]) -> Table:
    """One line for each engine and its settings; below the reference the largest step stands for all."""

    def rank(row: Row) -> tuple[bool, float, float]:
        below = below_reference(row)
        return not below, 0.0 if below else end_error(row), -row["step"] if is_known(row["step"]) else 0.0

    usable = [row for row in rows if may_rank(row) and is_known(end_error(row))]
    lines = [line(min(group, key=rank)) for group in group_rows(usable, lambda r: method(r)[:2]).values()]
    head, numeric = columns(heading(rows), 4, last_text=1)
    return Table(title, head, tuple(lines), numeric, note=BELOW_LEGEND)


def findings(run: Run) -> Iterator[Finding]:
    """The best of each linkage, and what ended without being valid."""
    for name in run.linkages:
        yield from best_of(run, name)
    yield from wrong_though_closed(run)
    yield from not_valid(run)


def best_of(run: Run, name: str) -> Iterator[Finding]:
    """The most accurate engine of a linkage, and the cheapest at equal accuracy reached."""
    for scenario, rows in group_rows((r for r in run.of(name) if may_rank(r)), lambda r: r["scenario"]).items():
        with_error = [row for row in rows if is_known(end_error(row))]
        if not with_error:
            continue
        sentences = [_most_accurate(with_error)]
        for target in TARGETS:
            reached = [r for r in with_error if max(end_error(r), end_bar(r)) <= target and is_known(run_time(r))]
            for where, some in sorted(
                group_rows(reached, _where).items()
            ):  # compiled and interpreted are not held against each other
                cheapest = min(some, key=run_time)
                sentences.append(
                    f"Cheapest within {target:.0e} {unit(some)}: {_price(cheapest)} {where}{_cheapest_own(some, cheapest)}."
                )
        yield Finding(f"{name}, {scenario}", " ".join(sentences))


def _price(row: Row) -> str:
    return f"{label(row, 'settings', 'integrator', 'stabilization', 'step')}, {run_time(row) * 1e3:.3g} ms"


def _where(row: Row) -> str:
    return "in its own loop" if is_known(row.get("native_step_time")) else "stepped from Python"


def _cheapest_own(reached: list[Row], cheapest: Row) -> str:
    """Place `gauss` among the rows that reach the same accuracy."""
    own = [row for row in reached if row["engine"] == OWN]
    if not own or cheapest["engine"] == OWN:
        return ""
    row = min(own, key=run_time)
    return f"; `{OWN}` needs {run_time(row) * 1e3:.3g} ms ({times(run_time(row) / run_time(cheapest))} times as long)"


def _most_accurate(rows: list[Row]) -> str:
    below = sorted({row["engine"] for row in rows if below_reference(row)})
    if below:
        bar = max(end_bar(row) for row in rows)
        return f"Error of {quantity(rows)} below the reference's bar ({bar:.0e} {unit(rows)}): {itemise(f'`{x}`' for x in below)}."
    best = min(rows, key=end_error)
    return f"Most accurate: {tie(rows, best, end_error)}, error of {quantity([best])} {error(end_error(best))} {unit([best])}."


def wrong_though_closed(run: Run) -> Iterator[Finding]:
    """The row that is farthest off while its model is right and its loops stay shut: residuals told nothing."""
    fine = [row for row in run.results if ok(row) and not row["control"] and number(row, "position_drift") < SHUT]
    rows = [r for r in fine if number(r, "acceleration_error_median") <= run.acceleration_gate and end_error(r) > LOST]
    if rows:
        row = max(rows, key=end_error)
        yield Finding(
            "Closed loops, wrong motion",
            f"{label(row, 'settings', 'integrator', 'stabilization', 'step')} on {row['mechanism']} "
            f"{row['scenario']} keeps its loops within {error(number(row, 'position_drift'))} and its model right, raises no "
            f"warning, and ends {end_error(row):.3g} {unit([row])} from the true {quantity([row])}. {count(len(rows), 'row')} of "
            f"this kind ended more than {LOST:g} {unit(rows)} off.",
            "warn",
        )


def not_valid(run: Run) -> Iterator[Finding]:
    rows = [row for row in run.results if ok(row) and not row["valid"] and not row["control"]]
    if rows:
        engines = group_rows(rows, lambda r: str(r["engine"])).items()
        reasons = itemise(f"`{name}` {len(group)} ({_why(group)})" for name, group in engines)
        yield Finding(
            "Ran, but not valid",
            f"{count(len(rows), 'case')} ended and may not be used: {reasons}. They stay in the tables, marked, "
            "and are in no figure of error against cost and in no ranking.",
            "warn",
        )


def _why(group: list[Row]) -> str:
    """The judge's words for these rows, numbers taken out, in order of how often they were said."""
    flags = (re.sub(r" \S+ m from", " away from", str(row.get("flag") or "no reason given")) for row in group)
    words = [re.sub(NUMBERS, "", flag) for flag in flags]
    return itemise(sorted(set(words), key=lambda x: (-words.count(x), x)))
