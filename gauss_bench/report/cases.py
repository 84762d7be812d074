"""Queries on result rows of cases: which cases count in rankings, their errors and times, and their names in words.

The rows are those of the table `results`, or rows of searches, which have the same columns.
"""

import math
from collections.abc import Iterable, Sequence
from operator import itemgetter

from gauss_bench.report.rows import METHOD, Row, first_number, group_by, is_known, number, with_number

MEASURED_ERRORS = ("measured_error_t05", "measured_error_t1", "measured_error_t2")  # errors after 0.5, 1 and 2 s
SAME_ACCELERATION = 1e-6  # relative, median: 100 times the error of numerical differentiation, far below a soft loop's (1e-2)
OWN_STEPS = 0.02  # the integrator chose its steps if their number differs from duration / step by over this share, and by over 1


def has_ended(row: Row) -> bool:
    """Tell whether a case ended with a trajectory, valid or not."""
    return row["status"] in ("ok", "invalid")


def may_rank(row: Row) -> bool:
    """Tell whether a case counts in rankings: it ended, is valid, and is no negative control."""
    return has_ended(row) and bool(row["valid"]) and not row["control"]


def is_unstabilised(row: Row) -> bool:
    """Tell whether a case has no stabilisation."""
    return row["stabilization"] in ("none", "")


def measured_name(rows: Iterable[Row]) -> str:
    """Return the linkage's coordinate in which the errors of rows are measured."""
    return next((row["measured"] for row in rows if row.get("measured")), "measured coordinate")


def measured_unit(rows: Iterable[Row]) -> str:
    """Return the unit of the measured coordinate, "rad" or "m"; "rad or m" if rows have different units, or no unit."""
    units = {row["measured_unit"] for row in rows if row.get("measured_unit")}
    return units.pop() if len(units) == 1 else "rad or m"


def measured_head(rows: Sequence[Row]) -> str:
    """Return the measured coordinate with its unit, such as "crank [rad]"."""
    return f"{measured_name(rows)} [{measured_unit(rows)}]"


def end_column(row: Row) -> str:
    """Return the column with the latest measured error that the row has, at 0.5, 1 or 2 s; the first if it has none."""
    return next((column for column in reversed(MEASURED_ERRORS) if is_known(row.get(column))), MEASURED_ERRORS[0])


def end_error(row: Row) -> float:
    """Return the error of the measured coordinate at the last of 0.5, 1 and 2 s with a known error; NaN if there is none."""
    return number(row, end_column(row))


def error_bar(row: Row, column: str) -> float:
    """Return the reference's error bar of the error in `column`; if unknown, that of positions; else 0."""
    return first_number(number(row, column.replace("error", "error_bar")), number(row, "position_error_bar"), 0.0)


def end_bar(row: Row) -> float:
    """Return the reference's error bar of `end_error`."""
    return error_bar(row, end_column(row))


def is_below_reference(row: Row) -> bool:
    """Tell whether the error at the end is smaller than the reference's own error bar."""
    return end_error(row) < end_bar(row)


def chose_steps(row: Row) -> bool:
    """Tell whether the integrator chose its own steps; the row's step is then only the spacing of samples."""
    step = number(row, "step")
    equal_steps = number(row, "t_end") / step if step > 0 else math.nan  # number of steps of this length
    return not is_known(equal_steps) or abs(number(row, "steps") - equal_steps) > max(OWN_STEPS * equal_steps, 1.0)


def run_time(row: Row) -> float:
    """Return the time [s] of a run: its number of steps times the time of a step, in the engine's own loop if that was timed."""
    return first_number(number(row, "native_step_time"), number(row, "step_time")) * number(row, "steps")


def setting_words(row: Row, *columns: str) -> str:
    """Return the texts of a row in some columns, separated by spaces, without "default" and "none".

    Args:
        columns: names of the columns to print; by default settings, integrator and stabilization.
    """
    return " ".join(row[column] for column in columns or METHOD[1:] if row[column] not in ("", "default", "none"))


def describe_case(row: Row) -> str:
    """Return a case in words, such as "`gauss` rk4 at step 0.001 s"."""
    step = "" if chose_steps(row) else f"at step {row['step']:g} s"
    return " ".join(filter(None, (f"`{row['engine']}`", setting_words(row), step)))


def acceleration_rows(rows: Iterable[Row]) -> list[Row]:
    """Return one row for each linkage, engine and setting whose acceleration error is known."""
    groups = group_by(with_number(rows, "acceleration_error_median"), "mechanism", "engine", "settings")
    return [_merge(group) for group in groups.values()]


def cost_rows(rows: Iterable[Row]) -> list[Row]:
    """Return one row for each linkage and variant with a timed step, or with a timed acceleration if no step was timed."""
    place = itemgetter("mechanism", "engine", "settings")
    stepped = [r for r in rows if is_known(r.get("step_time")) or is_known(r.get("native_step_time"))]
    with_steps = {place(r) for r in stepped}
    accelerated = [r for r in with_number(rows, "acceleration_time") if place(r) not in with_steps]
    return [_merge(group) for group in group_by(stepped + accelerated, "mechanism", *METHOD).values()]


def _merge(group: Sequence[Row]) -> Row:
    """Return the first row of the group; each missing number is taken from the first row that has it."""
    merged = dict(group[0])
    for column in merged:
        numbers = [row[column] for row in group if is_known(row.get(column))]
        merged[column] = numbers[0] if numbers else merged[column]
    return merged
