"""Accelerations at given states: compares the equations of motion of engines, apart from any integrator."""

from collections.abc import Iterator

from gauss_bench.report.content import Finding, count, error, itemise, run_of_numbers
from gauss_bench.report.rows import (
    SAME_ACCELERATION,
    Row,
    Run,
    accelerations,
    end_error,
    group_rows,
    is_known,
    label,
    method,
    number,
    ok,
    own_steps,
    quantity,
    unit,
)

PLACE = 11
TABLES = ("results",)
SHRINKS = 2.0  # an error that falls by a smaller factor while the step falls 4-fold is not caused by the step


def findings(run: Run) -> Iterator[Finding]:
    """Yield which engines return the reference's acceleration, which do not, and how the negative control ends."""
    yield from same_model(run)
    yield from other_model(run)
    yield from controls(run)


def same_model(run: Run) -> Iterator[Finding]:
    """Yield the engines that return the reference's acceleration at the same state, with their errors."""
    rows = [row for row in accelerations(run.results) if not row["control"]]
    worst = {
        name: max(number(r, "acceleration_error_median") for r in group)
        for name, group in group_rows(rows, lambda r: label(r, "settings")).items()
    }
    same = sorted((x, name) for name, x in worst.items() if x <= SAME_ACCELERATION)
    if same:
        exact = itemise(f"{name} ({error(x)})" for x, name in same)
        yield Finding(
            "Same state, same acceleration",
            f"Given the same states, {exact} return the reference's acceleration; in brackets the largest median relative error of "
            f"{count(len({r['mechanism'] for r in rows}), 'linkage')}.",
            "good",
        )


def other_model(run: Run) -> Iterator[Finding]:
    """Yield the engines that compute another acceleration, and whether a smaller step helps."""
    rows = [row for row in accelerations(run.results) if not row["control"]]
    for (name, settings), group in group_rows(rows, lambda r: (r["engine"], r["settings"])).items():
        off = [row for row in group if not row["acceleration_error_median"] <= SAME_ACCELERATION]
        if not off:
            continue
        span = run_of_numbers([number(r, "acceleration_error_median") for r in off], error)
        text = (
            f"`{name}` (settings {settings}) computes another acceleration at the same state: median relative error {span} on "
            f"{itemise(row['mechanism'] for row in off)}. A smaller step cannot change that"
        )
        yield Finding("Soft, or another model", f"{text}{_step_does_not_help(run, off)}", "warn")


def _step_does_not_help(run: Run, off: list[Row]) -> str:
    """Return the end of a sentence: the trajectory error that falls least over a 4-fold range of steps."""
    wanted = {(row["mechanism"], row["engine"], row["settings"]) for row in off}
    rows = [r for r in run.results if ok(r) and (r["mechanism"], r["engine"], r["settings"]) in wanted and is_known(end_error(r))]
    falls = []
    for group in group_rows(rows, lambda r: (r["mechanism"], r["scenario"], *method(r))).values():
        stepped = sorted((r for r in group if not own_steps(r)), key=lambda r: -number(r, "step"))
        if len(stepped) > 1 and stepped[0]["step"] >= 4 * stepped[-1]["step"] and end_error(stepped[-1]) > 0:
            falls.append((end_error(stepped[0]) / end_error(stepped[-1]), stepped))
    flat = [(ratio, steps) for ratio, steps in falls if ratio < SHRINKS]
    if not flat:
        return "."
    _, steps = min(flat, key=lambda x: x[0])
    first, last = steps[0], steps[-1]
    before, after = (f"{error(end_error(row))} {unit([row])} at step {row['step']:g} s" for row in (first, last))
    return f", and does not: on {first['mechanism']} {first['scenario']} the error of {quantity(steps)} is {before} and {after}."


def controls(run: Run) -> Iterator[Finding]:
    """Yield for each negative control that it satisfies its constraints, and whether the gate still rejects it."""
    rows = [row for row in run.results if row["control"] and ok(row)]
    for name, group in group_rows(rows, lambda r: r["engine"]).items():
        residuals = [number(r, "acceleration_residual") for r in group if is_known(r.get("acceleration_residual"))]
        errors = [number(r, "acceleration_error_median") for r in group if is_known(r.get("acceleration_error_median"))]
        if not errors:
            continue
        holds = f"satisfies the constraints of acceleration to {error(max(residuals))} and is" if residuals else "is"
        passed = sum(bool(row["valid"]) for row in group)
        caught = (
            "**" + f"{passed} of its {len(group)} rows pass the gate: it is too wide.**"
            if passed
            else "No row of it passes the gate."
        )
        yield Finding(
            "The negative control",
            f"`{name}` {holds} still wrong: the median relative error of its acceleration is {run_of_numbers(errors, error)}. "
            f"{caught} Residuals alone would not have shown it.",
            "bad" if passed else "good",
        )
