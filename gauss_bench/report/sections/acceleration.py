"""Accelerations at given states, which compare the equations of motion of engines without any integrator."""

from collections.abc import Iterator, Sequence

from gauss_bench.report.cases import (
    SAME_ACCELERATION,
    acceleration_rows,
    chose_steps,
    end_error,
    has_ended,
    measured_name,
    measured_unit,
    setting_words,
)
from gauss_bench.report.content import Finding, Table, lay_out
from gauss_bench.report.rows import METHOD, Row, Run, group_by, is_known, with_number
from gauss_bench.report.sections.trajectories import list_cases
from gauss_bench.report.words import count, error_text, itemise, range_text

PLACE = 11
SHRINKS = 2.0  # while the step falls 4-fold, an error that falls by a smaller factor than this is not caused by the step
ERROR = "acceleration_error_median"  # column of the median relative error


def findings(run: Run) -> Iterator[Finding]:
    """Yield findings on engines whose accelerations agree with the reference, on those that differ, and on negative controls."""
    rows = [row for row in acceleration_rows(run.results) if not row["control"]]
    yield from find_same_model(rows)
    yield from find_other_models(run, rows)
    yield from find_controls(run)


def find_same_model(rows: Sequence[Row]) -> Iterator[Finding]:
    """Yield a finding on the engines whose accelerations agree with the reference."""
    engines = group_by(rows, lambda r: f"`{r['engine']}` {setting_words(r, 'settings')}".strip())
    worst = {name: max(r[ERROR] for r in group) for name, group in engines.items()}
    same = sorted((error, name) for name, error in worst.items() if error <= SAME_ACCELERATION)
    if same:
        exact = itemise(f"{name} ({error_text(error)})" for error, name in same)
        yield Finding(
            "Same state, same acceleration",
            f"Given the same states, {exact} return the reference's acceleration. Brackets have the largest median relative error "
            f"on {count(len({r['mechanism'] for r in rows}), 'linkage')}.",
            "good",
            f"Given the same states, {len(same)} of {count(len(worst), 'engine setting')} return the reference's acceleration "
            f"with a median relative error of at most {error_text(same[-1][0])}.",
            (list_errors(rows),),
        )


def list_errors(rows: Sequence[Row]) -> Table:
    """Return the table of acceleration errors, the largest first."""
    return lay_out("behind_acceleration", sorted(rows, key=lambda r: -r[ERROR]))


def find_other_models(run: Run, rows: Sequence[Row]) -> Iterator[Finding]:
    """Yield a finding for each setting with other accelerations than the reference, and cases where a smaller step did not help."""
    for (name, settings), group in group_by(rows, "engine", "settings").items():
        off = [row for row in group if row[ERROR] > SAME_ACCELERATION]
        if off:
            span = range_text([row[ERROR] for row in off], error_text)
            text = (
                f"`{name}` (settings {settings}) has a different acceleration at the same state: median relative error {span} on "
                f"{itemise(row['mechanism'] for row in off)}. A smaller step cannot change that"
            )
            ending, behind = _show_flat_error(run, off)
            yield Finding("Soft, or another model", f"{text}{ending}", "warn", behind=(list_errors(off), *behind))


def _show_flat_error(run: Run, off: Sequence[Row]) -> tuple[str, list[Table]]:
    """Return the end of the sentence "A smaller step cannot change that", and a list with the table of the cases that show it.

    Among series of cases whose step falls at least 4-fold, the end of the sentence names the series whose trajectory error falls by
    the smallest factor, if this factor is below SHRINKS. Otherwise the end is "." and the list is empty.
    """
    models = {(row["mechanism"], row["engine"], row["settings"]) for row in off}
    rows = [r for r in run.results if has_ended(r) and not chose_steps(r) and is_known(end_error(r))]
    flattest, least = [], SHRINKS  # cases from the largest step to the smallest, and the factor by which their error falls
    for (mechanism, _, engine, settings, *_), group in group_by(rows, "mechanism", "scenario", *METHOD).items():
        stepped = sorted(group, key=lambda r: -r["step"])
        is_wide = stepped[0]["step"] >= 4 * stepped[-1]["step"]
        if (mechanism, engine, settings) in models and is_wide and end_error(stepped[-1]) > 0:
            factor = end_error(stepped[0]) / end_error(stepped[-1])
            if factor < least:
                flattest, least = stepped, factor
    if not flattest:
        return ".", []
    ends = (flattest[0], flattest[-1])
    before, after = (f"{error_text(end_error(row))} {measured_unit([row])} at step {row['step']:g} s" for row in ends)
    place = f"{flattest[0]['mechanism']} {flattest[0]['scenario']}"
    return f", and does not: on {place} the error of {measured_name(flattest)} is {before} and {after}.", [list_cases(flattest)]


def find_controls(run: Run) -> Iterator[Finding]:
    """Yield a finding for each negative control, which is a formulation that is wrong on purpose."""
    rows = [row for row in run.results if row["control"] and has_ended(row)]
    for name, group in group_by(rows, "engine").items():
        residuals = [row["acceleration_residual"] for row in with_number(group, "acceleration_residual")]
        errors = [row[ERROR] for row in with_number(group, ERROR)]
        if not errors:
            continue
        holds = f"satisfies the acceleration constraints to {error_text(max(residuals))} and is" if residuals else "is"
        passed = sum(bool(row["valid"]) for row in group)
        caught = "None of its rows passes the gate."
        if passed:
            caught = f"**{passed} of its {len(group)} rows pass the gate: it is too wide.**"
        yield Finding(
            "The negative control",
            f"`{name}` {holds} still wrong: the median relative error of its acceleration is {range_text(errors, error_text)}. "
            f"{caught} Residuals alone do not show this error.",
            "bad" if passed else "good",
            behind=(lay_out("behind_control", group),),
        )
