"""Trajectories: every engine, setting, integrator, stabilisation and step against the reference."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from gauss_bench.report.content import (
    Finding,
    Table,
    count,
    error,
    itemise,
    lay_out,
    layouts,
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
    plain,
    quantity,
    run_time,
    unit,
)

PLACE = 12
TABLES = ("results", "series")
TARGETS = (1e-3, 1e-6)  # errors of the measured coordinate [rad or m] at which costs are compared
OWN = "gauss"
NUMBERS = r"( by)? \d\S*( rad| m| J)?( \(m or rad\))?( where \S+ J move)?(?= |,|;|$)"  # in the judge's words
SHUT = 1e-4  # [m, rad] loops with a smaller gap look closed
LOST = 1.0  # [rad or m] error beyond which the motion is another one


def whole(name: str, scenario: str, rows: Sequence[Row]) -> Table:
    """Return the table of every case of a linkage in a scenario, with errors of its measured coordinate."""
    bars = {column: f"bar_{column.rpartition('_')[2]}" for column in MEASURED_ERRORS}
    shown = [{**row, **{bar: measure_bar(row, column) for column, bar in bars.items()}} for row in rows]
    return lay_out("trajectories", shown, name=name, scenario=scenario, quantity=quantity(rows), unit=unit(rows))


def best(name: str, scenario: str, rows: Sequence[Row]) -> Table:
    """Return the most accurate case per engine and settings; of cases below the reference's bar, the one with the largest step."""

    def rank(row: Row) -> tuple[bool, float, float]:
        below = below_reference(row)
        return not below, 0.0 if below else end_error(row), -row["step"] if is_known(row["step"]) else 0.0

    usable = [row for row in rows if may_rank(row) and is_known(end_error(row))]
    least = [min(group, key=rank) for group in group_rows(usable, lambda r: method(r)[:2]).values()]
    title = f"Most accurate case of each engine and setting, {scenario}"
    return replace(whole(name, scenario, least), title=title, folded=False, note=layouts()["notes"]["below"])


def findings(run: Run) -> Iterator[Finding]:
    """Yield the best of each linkage, wrong motions with closed loops, invalid cases, and the largest drift."""
    for name in run.linkages:
        yield from best_of(run, name)
    yield from wrong_though_closed(run)
    yield from not_valid(run)
    yield from drifted(run)


def best_of(run: Run, name: str) -> Iterator[Finding]:
    """Yield the most accurate engine of each scenario of a linkage, and the cheapest at each of TARGETS."""
    for scenario, rows in group_rows((r for r in run.of(name) if may_rank(r)), lambda r: r["scenario"]).items():
        with_error = [row for row in rows if is_known(end_error(row))]
        if not with_error:
            continue
        sentences = [_most_accurate(with_error)]
        for target in TARGETS:
            reached = [r for r in with_error if max(end_error(r), end_bar(r)) <= target and is_known(run_time(r))]
            # compiled and interpreted loops are not compared with each other
            for where, some in sorted(group_rows(reached, _where).items()):
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
    """Return how `gauss` compares with the cheapest case of the same accuracy."""
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
    """Yield the case with the largest error although its model is right and its loops stay closed: residuals do not show it."""
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
    """Return the judge's reasons for these rows without numbers, the most frequent first."""
    flags = (re.sub(r" \S+ m from", " away from", str(row.get("flag") or "no reason given")) for row in group)
    words = [re.sub(NUMBERS, "", flag) for flag in flags]
    return itemise(sorted(set(words), key=lambda x: (-words.count(x), x)))


def drifted(run: Run) -> Iterator[Finding]:
    """Yield the valid case without stabilisation that has the largest drift."""
    free = [row for row in run.results if may_rank(row) and is_known(row.get("position_drift")) and plain(row)]
    if free:
        row = max(free, key=lambda r: number(r, "position_drift"))
        place, speed = (error(number(row, f"{x}_drift")) for x in ("position", "velocity"))
        yield Finding(
            "Where drift is worst",
            "Of the valid rows without stabilisation, constraints are left farthest by "
            f"{tie(free, row, lambda r: number(r, 'position_drift'))} on {row['mechanism']} {row['scenario']}: {place} in position "
            f"and {speed} in velocity.",
        )
