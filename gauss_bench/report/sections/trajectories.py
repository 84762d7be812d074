"""Trajectories of every engine, setting, integrator, stabilisation and step, compared with the reference."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from gauss_bench.report.cases import (
    MEASURED_ERRORS,
    describe_case,
    end_bar,
    end_error,
    error_bar,
    has_ended,
    is_below_reference,
    is_unstabilised,
    may_rank,
    measured_name,
    measured_unit,
    run_time,
)
from gauss_bench.report.content import Finding, Table, lay_out, layouts
from gauss_bench.report.rows import KEYS, Row, Run, group_by, is_known, number, with_number
from gauss_bench.report.words import count, error_text, itemise, ratio_text

PLACE = 12
TARGETS = (1e-3, 1e-6)  # errors of the measured coordinate [rad or m] at which costs are compared
OWN = "gauss"
NUMBERS = r"( by)? \d\S*( rad| m| J)?( \(m or rad\))?( where \S+ J move)?(?= |,|;|$)"  # numbers in the judge's sentences
SHUT = 1e-4  # [m, rad] loops with a smaller gap count as closed
LOST = 1.0  # [rad or m] a motion with a larger error is another motion
MOST_DRIFT = 20  # number of cases in the table of the largest drift
TIED = 0.05  # relative difference within which engines are equally good


def all_cases(name: str, scenario: str, rows: Sequence[Row]) -> Table:
    """Return the table of every case of a linkage in a scenario, with errors of its measured coordinate."""
    # the layout has the error bars at 0.5, 1 and 2 s in columns bar_t05, bar_t1 and bar_t2
    bars = {column: f"bar_{column.rpartition('_')[2]}" for column in MEASURED_ERRORS}
    shown = [{**row, **{bar: error_bar(row, column) for column, bar in bars.items()}} for row in rows]
    return lay_out("trajectories", shown, name=name, scenario=scenario, quantity=measured_name(rows), unit=measured_unit(rows))


def best_cases(name: str, scenario: str, rows: Sequence[Row]) -> Table:
    """Return the table of the most accurate valid case of each engine and setting, the most accurate first.

    Cases with errors below the reference's error bar count as equally accurate; of these the case with the largest step is taken.
    """

    def rank(row: Row) -> tuple[bool, float, float]:
        """Return the sort key of a case: errors below the reference's error bar come first, as equals, then larger steps first."""
        step = -row["step"] if is_known(row["step"]) else 0.0
        return (False, 0.0, step) if is_below_reference(row) else (True, end_error(row), step)

    usable = [row for row in rows if may_rank(row) and is_known(end_error(row))]
    most_accurate = sorted((min(group, key=rank) for group in group_by(usable, "engine", "settings").values()), key=rank)
    title = f"Most accurate case of each engine and setting, {scenario}"
    return replace(all_cases(name, scenario, most_accurate), title=title, folded=False, note=layouts()["notes"]["below"])


def findings(run: Run) -> Iterator[Finding]:
    """Yield findings on the best cases of each linkage, wrong motions with closed loops, invalid cases, and the largest drift."""
    for name in run.linkages:
        yield from find_best(run, name)
    yield from find_wrong_motion(run)
    yield from find_invalid(run)
    yield from find_drift(run)


def find_best(run: Run, name: str) -> Iterator[Finding]:
    """Yield, for each scenario of a linkage, a finding on the most accurate case, and on the cheapest within each of TARGETS."""
    usable = [row for row in run.cases_of(name) if may_rank(row) and is_known(end_error(row))]
    for scenario, rows in group_by(usable, "scenario").items():
        sentences = [name_most_accurate(rows)]
        for target in TARGETS:
            # a target is reached if neither the error nor the reference's error bar is larger
            reached = [r for r in rows if max(end_error(r), end_bar(r)) <= target and is_known(run_time(r))]
            # compiled and interpreted loops are not compared with each other
            for loop, group in sorted(group_by(reached, _name_loop).items()):
                sentences.append(f"Cheapest within {target:.0e} {measured_unit(group)}: {_name_cheapest(group, loop)}.")
        yield Finding(f"{name}, {scenario}", " ".join(sentences), short=sentences[0], behind=(list_cases(rows),))


def list_cases(rows: Sequence[Row]) -> Table:
    """Return the table of cases with error, drift, time and the judge's reason for an invalid case, the most accurate first."""
    lines = [
        {**r, "end_error": end_error(r), "end_bar": end_bar(r), "seconds": run_time(r), "flag": r.get("flag") or "none"}
        for r in sorted(rows, key=lambda r: (not is_known(end_error(r)), end_error(r)))
    ]
    return lay_out("behind_cases", lines, unit=measured_unit(rows))


def _name_loop(row: Row) -> str:
    """Return in words whether the steps of a case run in the engine's own loop or are called from Python."""
    return "in its own loop" if is_known(row.get("native_step_time")) else "stepped from Python"


def _name_cheapest(rows: Sequence[Row], loop: str) -> str:
    """Return in words the cheapest of the given cases with its run time, and the run time of the cheapest case of `gauss`."""
    cheapest = min(rows, key=run_time)
    text = f"{describe_case(cheapest)}, {run_time(cheapest) * 1e3:.3g} ms {loop}"
    own = [row for row in rows if row["engine"] == OWN]
    if not own or cheapest["engine"] == OWN:
        return text
    row = min(own, key=run_time)
    return f"{text}; `{OWN}` needs {run_time(row) * 1e3:.3g} ms ({ratio_text(run_time(row) / run_time(cheapest))} times as long)"


def name_most_accurate(rows: Sequence[Row]) -> str:
    """Return a sentence on the case with the least error, or on the engines whose errors are below the reference's error bar."""
    below = sorted({row["engine"] for row in rows if is_below_reference(row)})
    if below:
        bar = f"{max(end_bar(row) for row in rows):.0e} {measured_unit(rows)}"
        return f"Error of {measured_name(rows)} below the reference's bar ({bar}): {itemise(f'`{x}`' for x in below)}."
    best = min(rows, key=end_error)
    error = f"error of {measured_name([best])} {error_text(end_error(best))} {measured_unit([best])}"
    return f"Most accurate: {name_tied(rows, best, end_error)}, {error}."


def name_tied(rows: Sequence[Row], best: Row, value: Callable[[Row], float]) -> str:
    """Return in words a case together with the engines that tie with it under the same settings.

    Args:
        value: function that returns the number of a row by which cases are compared, such as an error. Other engines tie with the
            case if their number differs from that of the case by at most the share TIED.
    """
    same = [r for r in rows if all(str(r[k]) == str(best[k]) for k in KEYS if k != "engine")]
    engines = sorted({r["engine"] for r in same if abs(value(r) - value(best)) <= TIED * abs(value(best))})
    setting = describe_case(best).removeprefix(f"`{best['engine']}`")
    return f"{itemise(f'`{name}`' for name in engines)}{setting}"


def find_wrong_motion(run: Run) -> Iterator[Finding]:
    """Yield a finding on the largest error of a case with closed loops and right accelerations, if it is above LOST."""
    closed = [row for row in run.results if has_ended(row) and not row["control"] and number(row, "position_drift") < SHUT]
    rows = [r for r in closed if number(r, "acceleration_error_median") <= run.acceleration_gate and end_error(r) > LOST]
    if rows:
        row = max(rows, key=end_error)
        loops = f"on {row['mechanism']} keeps its loops within {error_text(row['position_drift'])}"
        truth = f"{measured_unit([row])} from the true {measured_name([row])}"
        yield Finding(
            "Closed loops, wrong motion",
            f"In the scenario {row['scenario']}, {describe_case(row)} {loops}, has the right model, raises no warning, and ends "
            f"{end_error(row):.3g} {truth}. "
            f"{count(len(rows), 'row')} of this kind ended more than {LOST:g} {measured_unit(rows)} off.",
            "warn",
            f"{describe_case(row)} {loops}, raises no warning, and ends {error_text(end_error(row))} {truth}.",
            (list_cases(rows),),
        )


def find_invalid(run: Run) -> Iterator[Finding]:
    """Yield a finding on the number of cases of each engine that the judge found invalid, with the judge's reasons."""
    rows = [row for row in run.results if has_ended(row) and not row["valid"] and not row["control"]]
    if rows:
        engines = group_by(rows, "engine").items()
        reasons = itemise(f"`{name}` {len(group)} ({_list_flags(group)})" for name, group in engines)
        yield Finding(
            "Ran, but not valid",
            f"{count(len(rows), 'case')} ended and may not be used: {reasons}. They stay in the tables, marked, "
            "and are in no figure of error against cost and in no ranking.",
            "warn",
            f"{count(len(rows), 'case')} of {len(run.results)} ended with a motion that the judge refuses.",
            (list_cases(rows),),
        )


def _list_flags(group: Sequence[Row]) -> str:
    """Return a list in words of the reasons why the given cases were judged invalid, the most frequent first."""
    # without numbers, so that sentences that differ only in numbers count as one reason
    flags = (re.sub(r" \S+ m from", " away from", row.get("flag") or "no reason given") for row in group)
    frequency = Counter(re.sub(NUMBERS, "", flag) for flag in flags)
    return itemise(sorted(frequency, key=lambda flag: (-frequency[flag], flag)))


def find_drift(run: Run) -> Iterator[Finding]:
    """Yield a finding on the valid case without stabilisation that has the largest drift."""
    free = [row for row in with_number(run.results, "position_drift") if may_rank(row) and is_unstabilised(row)]
    if free:
        row = max(free, key=lambda r: r["position_drift"])
        position, velocity = (error_text(number(row, f"{x}_drift")) for x in ("position", "velocity"))
        worst = name_tied(free, row, lambda r: r["position_drift"])
        yield Finding(
            "The largest drift",
            f"Among valid rows without stabilisation, {worst} has the largest drift, on {row['mechanism']} {row['scenario']}: "
            f"{position} in position and {velocity} in velocity.",
            behind=(list_cases(sorted(free, key=lambda r: -r["position_drift"])[:MOST_DRIFT]),),
        )
