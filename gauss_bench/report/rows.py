"""The rows of a run, and the queries that many sections need.

A row is a mapping from column to value; a missing number is NaN. `may_rank` decides which cases count in rankings: those that
ended, passed the validity gate and are no negative control.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any, TypeVar

from gauss_bench.tables import ENDS

Row = Mapping[str, Any]
Item = TypeVar("Item")
Key = TypeVar("Key", bound=Hashable)

KEYS = ("mechanism", "scenario", "engine", "settings", "integrator", "stabilization", "step", "t_end")
METHOD = ("engine", "settings", "integrator", "stabilization")
MEASURED_ERRORS = ("measured_error_t05", "measured_error_t1", "measured_error_t2")  # after 0.5, 1 and 2 s
SAME_ACCELERATION = 1e-6  # median: 100 times the error of numerical differentiation (1e-8), far below that of a soft loop (1e-2)
VALID_ACCELERATION = 1e-2  # median: the validity gate of runs that do not record it
OWN_ENGINES = (  # of runs that do not record them
    *("gauss", "gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16"),
    *("gauss-native", "lagrange-native", "minimal", "by_hand"),
)
OWN_STEPS = 0.02  # relative difference of the number of steps from duration / step, beyond which the integrator chose its steps


@dataclass(frozen=True, eq=False)
class Run:
    """A run of a suite: its environment, and its rows by table, typed and sorted.

    Attributes:
        checksum: of all its tables as they are stored; empty for a run without checksums.
        accepted: the figures of the accuracy gate that lie beside the run, each with the date and the reason of its last change.
        faults: name of a report on a fault in an engine's library, ENGINE_WORDS -> its text in Markdown.
        beside: the run of the suite `field` that is published beside this one.
    """

    environment: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, tuple[Row, ...]] = field(default_factory=dict)
    checksum: str = ""
    accepted: tuple[Row, ...] = ()
    faults: Mapping[str, str] = field(default_factory=dict)
    beside: "Run | None" = None

    @property
    def field_run(self) -> "Run":
        """The run that asked every engine the same questions: the one beside this one, or else this one."""
        return self.beside or self

    def table(self, name: str) -> tuple[Row, ...]:
        """Return the rows of a table; none if the run did not fill it."""
        return self.tables.get(name, ())

    @property
    def results(self) -> tuple[Row, ...]:
        """The rows of cases."""
        return self.table("results")

    @property
    def own_engines(self) -> tuple[str, ...]:
        """The engines written by the authors of the suite."""
        return tuple(self.environment.get("own_engines", OWN_ENGINES))

    @property
    def linkages(self) -> tuple[str, ...]:
        """The names of the linkages with cases, sorted."""
        return tuple(sorted({row["mechanism"] for row in self.results}))

    @property
    def acceleration_gate(self) -> float:
        """Largest median relative error of the acceleration at the same state with which a run may be valid."""
        return float(self.environment.get("gates", {}).get("acceleration", VALID_ACCELERATION))

    def of(self, mechanism: str) -> tuple[Row, ...]:
        """Return the cases of one linkage."""
        return tuple(row for row in self.results if row["mechanism"] == mechanism)


@dataclass(frozen=True)
class Spread:
    """A measured number with the range in which a second measurement would lie; NaN where it is unknown."""

    value: float
    low: float
    high: float

    def print_with(self, form: Callable[[float], str]) -> str:
        """Return the text "value (low..high)"."""
        return f"{form(self.value)} ({form(self.low)}..{form(self.high)})"


def is_known(x: Any) -> bool:
    """Tell whether a value is a finite number."""
    return isinstance(x, (int, float)) and math.isfinite(x)


def number(row: Row, column: str) -> float:
    """Return the value of a column, NaN if it is missing."""
    x = row.get(column, math.nan)
    return float(x) if is_known(x) else math.nan


def spread(row: Row, column: str) -> Spread:
    """Return a column's value with the ends of its range."""
    return Spread(*(number(row, column + end) for end in ENDS))


def with_number(rows: Iterable[Row], column: str) -> list[Row]:
    """Return the rows that have a finite number in a column."""
    return [row for row in rows if is_known(row.get(column))]


def first_number(*values: float) -> float:
    """Return the first finite number, NaN without one."""
    return next(filter(is_known, values), math.nan)


def group_by(items: Iterable[Item], *keys: str | Callable[[Item], Any]) -> dict[Any, list[Item]]:
    """Group rows by one column or by a tuple of several, or any items by a function, in the order of each group's first item."""
    key: Callable[[Any], Any] = keys[0] if callable(keys[0]) else itemgetter(*keys)
    groups: dict[Any, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def has_ended(row: Row) -> bool:
    """Tell whether a case ended with a trajectory, valid or not."""
    return row["status"] in ("ok", "invalid")


def may_rank(row: Row) -> bool:
    """Tell whether a case counts in rankings: it ended, is valid, and is no negative control."""
    return has_ended(row) and bool(row["valid"]) and not row["control"]


def is_unstabilised(row: Row) -> bool:
    """Tell whether the run has no stabilisation."""
    return row["stabilization"] in ("none", "")


def measured_name(rows: Iterable[Row]) -> str:
    """Return the name of the coordinate in which errors of a linkage are measured."""
    return next((row["measured"] for row in rows if row.get("measured")), "measured coordinate")


def measured_unit(rows: Iterable[Row]) -> str:
    """Return the unit of the measured coordinate: rad or m, or both if rows differ or do not say."""
    units = {row["measured_unit"] for row in rows if row.get("measured_unit")}
    return units.pop() if len(units) == 1 else "rad or m"


def measured_head(rows: Sequence[Row]) -> str:
    """Return the measured coordinate with its unit, for the head of a table."""
    return f"{measured_name(rows)} [{measured_unit(rows)}]"


def end_column(row: Row) -> str:
    """Return the column of the measured error at the latest of 0.5, 1 and 2 s that the row has."""
    return next((c for c in reversed(MEASURED_ERRORS) if is_known(row.get(c))), MEASURED_ERRORS[0])


def end_error(row: Row) -> float:
    """Return the measured error, in its unit, at the latest of 0.5, 1 and 2 s that the row has."""
    return number(row, end_column(row))


def error_bar(row: Row, column: str) -> float:
    """Return the reference's error bar of a measured error, else its largest bar of any position, else 0."""
    return first_number(number(row, column.replace("error", "error_bar")), number(row, "position_error_bar"), 0.0)


def end_bar(row: Row) -> float:
    """Return the reference's error bar of `end_error`."""
    return error_bar(row, end_column(row))


def is_below_reference(row: Row) -> bool:
    """Tell whether the error at the end is smaller than the reference's own error bar."""
    return end_error(row) < end_bar(row)


def search_span(run: Run) -> str:
    """Return the length of the longest searched run in words."""
    ends = [row["until"] for row in with_number(run.table("search_ladder"), "until")]
    return f"over {max(ends):g} s" if ends else "over the whole run"


def chose_steps(row: Row) -> bool:
    """Tell whether the integrator chose its steps, so that the row's step is only the spacing of samples."""
    step = number(row, "step")
    given = number(row, "t_end") / step if step > 0 else math.nan
    return not is_known(given) or abs(number(row, "steps") - given) > max(OWN_STEPS * given, 1.0)


def run_time(row: Row) -> float:
    """Return the cost [s] of a run: number of steps times the time of a step, in the engine's own loop if it has one."""
    return first_number(number(row, "native_step_time"), number(row, "step_time")) * number(row, "steps")


def setting_words(row: Row, *columns: str) -> str:
    """Return the texts of columns, by default settings, integrator and stabilisation, without "default" and "none"."""
    return " ".join(row[c] for c in columns or METHOD[1:] if row[c] not in ("", "default", "none"))


def describe_case(row: Row, with_step: bool = True) -> str:
    """Return a case in words, such as "`gauss` rk4 at step 0.001 s"."""
    step = f"at step {row['step']:g} s" if with_step and not chose_steps(row) else ""
    return " ".join(filter(None, (f"`{row['engine']}`", setting_words(row), step)))


def acceleration_rows(rows: Iterable[Row]) -> list[Row]:
    """Return one row per linkage, engine and settings with an acceleration error, which all their cases share."""
    groups = group_by(with_number(rows, "acceleration_error_median"), "mechanism", "engine", "settings")
    return [_merge(group) for group in groups.values()]


def cost_rows(rows: Iterable[Row]) -> list[Row]:
    """Return one row per linkage and method with a timed step, or with a timed acceleration if no step was timed."""
    engine = itemgetter("mechanism", "engine", "settings")
    stepped = [r for r in rows if is_known(r.get("step_time")) or is_known(r.get("native_step_time"))]
    have = {engine(r) for r in stepped}
    timed = stepped + [r for r in with_number(rows, "acceleration_time") if engine(r) not in have]
    return [_merge(group) for group in group_by(timed, "mechanism", *METHOD).values()]


def _merge(group: Sequence[Row]) -> Row:
    """Return the first row, with each missing number taken from the next row that has it."""
    return {k: next((r[k] for r in group if is_known(r.get(k))), x) for k, x in group[0].items()}


def sort_key(row: Row) -> tuple[Any, ...]:
    """Return the place of a row in its table: by its texts, then larger steps first, then by time."""
    words = tuple(str(row.get(k, "")) for k in KEYS if k not in ("step", "t_end"))
    numbers = (-float(row.get("step", 0.0)), float(row.get("t", row.get("round", 0.0))))
    return (*words, *(0.0 if math.isnan(x) else x for x in numbers))
