"""The result rows of a run, and functions that select and group rows of any table.

A row maps a column to its value; a missing number is NaN.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any, TypeVar

from gauss_bench.tables import ENDS

Row = Mapping[str, Any]
Item = TypeVar("Item")
Key = TypeVar("Key", bound=Hashable)

KEYS = ("mechanism", "scenario", "engine", "settings", "integrator", "stabilization", "step", "t_end")  # identify a case
METHOD = ("engine", "settings", "integrator", "stabilization")  # identify a variant of an engine
VALID_ACCELERATION = 1e-2  # limit of a valid case's median acceleration error, for runs that did not record the limit
OWN_ENGINES = (  # for runs that did not record them; later own engines are not in this list
    *("gauss", "gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16"),
    *("gauss-native", "lagrange-native", "minimal", "by_hand"),
)


@dataclass(frozen=True, eq=False)
class Run:
    """A run of a suite: its environment, and its rows by table, typed and sorted.

    Attributes:
        environment: content of `environment.json`.
        tables: name of a table -> its rows.
        checksum: SHA-256 of the checksums of all stored tables; empty for a run without checksums.
        accepted: rows of the accuracy gate's baseline, each with the date and the reason of its last change.
        faults: name of a report on a fault in an engine's library -> its text in Markdown.
        beside: the run of the suite `field` in the subfolder `field` of this run's folder; None if there is none.
    """

    environment: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, tuple[Row, ...]] = field(default_factory=dict)
    checksum: str = ""
    accepted: tuple[Row, ...] = ()
    faults: Mapping[str, str] = field(default_factory=dict)
    beside: "Run | None" = None

    @property
    def field_run(self) -> "Run":
        """The run of the suite `field`, which runs the same tests on every engine: `beside` if there is one, else this run."""
        return self.beside or self

    def table(self, name: str) -> tuple[Row, ...]:
        """Return the rows of a table; the result is empty if the run did not fill it."""
        return self.tables.get(name, ())

    @property
    def results(self) -> tuple[Row, ...]:
        """The rows of all cases."""
        return self.table("results")

    @property
    def own_engines(self) -> tuple[str, ...]:
        """The names of the engines that the authors of the suite wrote."""
        return tuple(self.environment.get("own_engines", OWN_ENGINES))

    @property
    def linkages(self) -> tuple[str, ...]:
        """The names of the linkages with cases, sorted."""
        return tuple(sorted({row["mechanism"] for row in self.results}))

    @property
    def acceleration_gate(self) -> float:
        """The largest median relative error of accelerations that a valid run may have."""
        return float(self.environment.get("gates", {}).get("acceleration", VALID_ACCELERATION))

    def cases_of(self, mechanism: str) -> tuple[Row, ...]:
        """Return the rows of all cases of a linkage."""
        return tuple(row for row in self.results if row["mechanism"] == mechanism)


@dataclass(frozen=True)
class Spread:
    """A measured number and the range in which a second measurement would lie; NaN where it is unknown."""

    value: float
    low: float
    high: float

    def print_with(self, form: Callable[[float], str]) -> str:
        """Return the text "value (low..high)", or the value alone if its range is unknown, with numbers formatted by `form`."""
        return f"{form(self.value)} ({form(self.low)}..{form(self.high)})" if is_known(self.low) else form(self.value)


def is_known(x: Any) -> bool:
    """Tell whether a value is a finite number."""
    return isinstance(x, (int, float)) and math.isfinite(x)


def number(row: Row, column: str) -> float:
    """Return the number in a column; NaN if it is missing or not finite."""
    x = row.get(column, math.nan)
    return float(x) if is_known(x) else math.nan


def spread(row: Row, column: str) -> Spread:
    """Return the number in a column, with its range in `column`_low and `column`_high."""
    return Spread(*(number(row, column + end) for end in ENDS))


def with_number(rows: Iterable[Row], column: str) -> list[Row]:
    """Return the rows that have a finite number in a column."""
    return [row for row in rows if is_known(row.get(column))]


def of_engine(rows: Iterable[Row], engine: str) -> list[Row]:
    """Return the rows of one engine."""
    return [row for row in rows if row["engine"] == engine]


def first_number(*values: float) -> float:
    """Return the first finite number; NaN if none is finite."""
    return next(filter(is_known, values), math.nan)


def group_by(items: Iterable[Item], *keys: str | Callable[[Item], Any]) -> dict[Any, list[Item]]:
    """Return key -> the items with this key; groups and items keep the order of `items`.

    Args:
        keys: a function of an item, or names of columns. With one column the keys are the values of this column, with several
            columns they are tuples of values.
    """
    key: Callable[[Any], Any] = keys[0] if callable(keys[0]) else itemgetter(*keys)
    groups: dict[Any, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def search_span(run: Run) -> str:
    """Return the duration of the longest run in the searches in words, such as "over 1 s"; "over the whole run" if unknown."""
    durations = [row["until"] for row in with_number(run.table("search_ladder"), "until")]
    return f"over {max(durations):g} s" if durations else "over the whole run"


def sort_key(row: Row) -> tuple[Any, ...]:
    """Return the sort key of a row: the texts that identify its case, then larger steps first, then time or round."""
    texts = [str(row.get(column, "")) for column in KEYS if column not in ("step", "t_end")]
    numbers = (-float(row.get("step", 0.0)), float(row.get("t", row.get("round", 0.0))))
    # NaN cannot be ordered, so it counts as 0
    return (*texts, *(0.0 if math.isnan(x) else x for x in numbers))
