"""The rows of a run, and the queries that many sections need.

A row is a mapping from column to value; a missing number is NaN. `may_rank` decides which cases count in rankings: those that
ended, passed the validity gate and are no negative control.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

Row = Mapping[str, Any]
Key = TypeVar("Key", bound=Hashable)

KEYS = ("mechanism", "scenario", "engine", "settings", "integrator", "stabilization", "step", "t_end")
MEASURED_ERRORS = {"measured_error_t05": 0.5, "measured_error_t1": 1.0, "measured_error_t2": 2.0}
SAME_ACCELERATION = 1e-6  # median: 100 times what numerical differentiation loses (1e-8), far below a soft loop (1e-2)
VALID_ACCELERATION = 1e-2  # median: the validity gate, where a run does not record its own
OWN_ENGINES = (  # default, for runs that do not record them
    *("gauss", "gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16"),
    *("gauss-native", "lagrange-native", "minimal", "by_hand"),
)
OWN_STEPS = 0.02  # relative: if the number of steps differs more from duration / step, the integrator chose its steps


@dataclass(frozen=True, eq=False)
class Run:
    """A run of a suite: its environment, and its rows by table, typed and sorted."""

    environment: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, tuple[Row, ...]] = field(default_factory=dict)

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
        return tuple(sorted({row["mechanism"] for row in self.results}))

    @property
    def acceleration_gate(self) -> float:
        """Largest median relative error of the acceleration at the same state with which a run may be valid."""
        return float(self.environment.get("gates", {}).get("acceleration", VALID_ACCELERATION))

    def of(self, mechanism: str | None) -> tuple[Row, ...]:
        """Return the cases of one linkage, or of all."""
        return tuple(row for row in self.results if mechanism in (None, row["mechanism"]))


def is_known(x: Any) -> bool:
    """Tell whether a value is a finite number."""
    return isinstance(x, (int, float)) and math.isfinite(x)


def number(row: Row, column: str) -> float:
    """Return the value of a column, NaN if it is missing."""
    x = row.get(column, math.nan)
    return float(x) if is_known(x) else math.nan


def group_rows(rows: Iterable[Row], key: Callable[[Row], Key]) -> dict[Key, list[Row]]:
    """Group rows by key, in the order of each key's first row."""
    groups: dict[Key, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def ok(row: Row) -> bool:
    """Tell whether a case ended with a trajectory, valid or not."""
    return row["status"] in ("ok", "invalid")


def may_rank(row: Row) -> bool:
    """Tell whether a case counts in rankings: it ended, is valid, and is no negative control."""
    return ok(row) and bool(row["valid"]) and not row["control"]


def quantity(rows: Iterable[Row]) -> str:
    """Return the name of the coordinate in which errors of a linkage are measured."""
    return next((x for row in rows if (x := str(row.get("measured") or ""))), "measured coordinate")


def unit(rows: Iterable[Row]) -> str:
    """Return the unit of the measured coordinate: rad or m, or both if rows differ or do not say."""
    units = {str(row["measured_unit"]) for row in rows if row.get("measured_unit")}
    return units.pop() if len(units) == 1 else "rad or m"


def measure(rows: Sequence[Row]) -> str:
    """Return the measured coordinate with its unit, for the head of a table."""
    return f"{quantity(rows)} [{unit(rows)}]"


def end_column(row: Row) -> str:
    """Return the column of the measured error at the latest of 0.5, 1 and 2 s that the row has."""
    return next((c for c in reversed(MEASURED_ERRORS) if is_known(row.get(c))), "measured_error_t05")


def end_error(row: Row) -> float:
    """Return the measured error, in its unit, at the latest of 0.5, 1 and 2 s that the row has."""
    return number(row, end_column(row))


def measure_bar(row: Row, column: str) -> float:
    """Return the reference's error bar of a measured error, else its largest bar of any position, else 0."""
    bars = number(row, column.replace("error", "error_bar")), number(row, "position_error_bar")
    return next((x for x in bars if is_known(x)), 0.0)


def end_bar(row: Row) -> float:
    return measure_bar(row, end_column(row))


def below_reference(row: Row) -> bool:
    return is_known(end_error(row)) and end_error(row) < end_bar(row)


def plain(row: Row) -> bool:
    """Tell whether the run has no stabilisation."""
    return row["stabilization"] in ("none", "")


def searched_until(run: Run, mechanism: str = "") -> float:
    """Return the end [s] of the longest searched run on one linkage or on all, NaN without a search."""
    rows = (r for r in run.table("search_ladder") if mechanism in ("", r["mechanism"]))
    return max((x for r in rows if is_known(x := number(r, "until"))), default=math.nan)


def over_time(run: Run) -> str:
    """Return the length of the searched runs in words."""
    until = searched_until(run)
    return f"over {until:g} s" if is_known(until) else "over the whole run"


def own_steps(row: Row) -> bool:
    """Tell whether the integrator chose its steps, so that the row's step is only the spacing of samples."""
    step = number(row, "step")
    given = number(row, "t_end") / step if step > 0 else math.nan
    return not is_known(given) or abs(number(row, "steps") - given) > max(OWN_STEPS * given, 1.0)


def run_time(row: Row) -> float:
    """Return the cost [s] of a run: number of steps times the time of a step, in the engine's own loop if it has one."""
    own = number(row, "native_step_time")
    return (own if is_known(own) else number(row, "step_time")) * number(row, "steps")


def method(row: Row) -> tuple[str, str, str, str]:
    """Return engine and setting of a row without the step."""
    return row["engine"], row["settings"], row["integrator"], row["stabilization"]


def label(row: Row, *columns: str) -> str:
    """Return a case in words, such as "`gauss` rk4 at step 0.001 s"."""
    words = [f"`{row['engine']}`"]
    words += [str(row[c]) for c in columns if c != "step" and row[c] not in ("", "default", "none")]
    if "step" in columns and not own_steps(row):
        words.append(f"at step {row['step']:g} s")
    return " ".join(words)


def accelerations(rows: Sequence[Row]) -> list[Row]:
    """Return one row per linkage, engine and settings with an acceleration error, which all their cases share."""
    measured = [row for row in rows if is_known(row.get("acceleration_error_median"))]
    return [_merge(group) for group in group_rows(measured, lambda r: (r["mechanism"], r["engine"], r["settings"])).values()]


def costs(rows: Sequence[Row]) -> list[Row]:
    """Return one row per linkage and method with a timed step, or with a timed acceleration if no step was timed."""
    keys = ("mechanism", "engine", "settings", "integrator", "stabilization")
    stepped = [r for r in rows if is_known(r.get("step_time")) or is_known(r.get("native_step_time"))]
    have = {tuple(r[k] for k in keys[:3]) for r in stepped}
    timed = stepped + [r for r in rows if is_known(r.get("acceleration_time")) and tuple(r[k] for k in keys[:3]) not in have]
    return [_merge(group) for group in group_rows(timed, lambda r: tuple(r[k] for k in keys)).values()]


def _merge(group: Sequence[Row]) -> Row:
    """Return the first row, with each missing number taken from the next row that has it."""
    return {k: next((r[k] for r in group if is_known(r.get(k))), x) if not is_known(x) else x for k, x in group[0].items()}


def order(row: Row) -> tuple[Any, ...]:
    """Return the sort key of a row in its table; larger steps come first."""
    words = tuple(str(row.get(k, "")) for k in KEYS if k not in ("step", "t_end"))
    numbers = (-float(row.get("step", 0.0)), float(row.get("t", row.get("round", 0.0))))
    return (*words, *(0.0 if math.isnan(x) else x for x in numbers))
