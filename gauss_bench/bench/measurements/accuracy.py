"""Run the accuracy cases and compare their motions with reference motions. References have rows of their own."""

from collections.abc import Collection, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gauss_bench.bench.cases import Case, adapt_cases, cases
from gauss_bench.bench.measure import at_checkpoints, measure, mechanism_of, reference_of
from gauss_bench.bench.poses import choose_played, keep, true_poses
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, group_by, place_of
from gauss_bench.mechanism.coordinates import value
from gauss_bench.metrics import observed_order
from gauss_bench.runs.offers import is_isolated
from gauss_bench.suites.schema import Suite
from gauss_bench.tables import KEY
from gauss_bench.terms import Array

JUDGING = 20.0  # [s] for the reference and the metrics of a case, besides the limit of the run


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return the tasks of all references and cases of a suite."""
    chosen = adapt_cases(cases(suite), context.until, context.steps)
    return tasks(chosen, context, choose_played(chosen))


def tasks(chosen: Sequence[Case], context: Context, posed: Collection[Case] = ()) -> list[Task]:
    """Return the tasks that compute references, then those that run cases; only cases in `posed` store poses."""
    listed = []
    motions = {(case.linkage, case.scenario, case.t_end) for case in chosen}  # each has one reference, which several cases may use
    for linkage, scenario, t_end in sorted(motions):
        arguments: tuple[Any, ...] = (linkage, scenario, t_end, context.store)
        listed.append(context.task("references", reference, arguments, linkage, scenario, t_end=t_end))
    for case in chosen:
        names = {k: x for k, x in asdict(case).items() if k not in ("linkage", "scenario")}
        arguments = (case, context.store, context.alter, context.limit, case in posed)
        task = context.task("results", measure, arguments, case.linkage, case.scenario, **names)
        listed.append(task._replace(limit=task.limit + JUDGING) if is_isolated(case.engine) else task)
    return listed


def reference(linkage: str, scenario: str, t_end: float, store: str) -> Tables:
    """Return the row of a reference until `t_end` [s] and the rows of its poses; the reference is kept in the folder `store`."""
    mechanism = mechanism_of(linkage, scenario)
    truth = reference_of(linkage, scenario, t_end, store)
    place = place_of(mechanism) | {"t_end": t_end}
    row: dict[str, Any] = place | {
        "method": truth.method,
        "error_bar_q": float(truth.error_q.max()),
        "error_bar_v": float(truth.error_v.max()),
        "measured": mechanism.measured.name,
        "measured_unit": mechanism.measured.unit,
        "floor_q": float(np.nanmax(truth.floor_q)) if np.isfinite(truth.floor_q).any() else None,
    }
    row |= at_checkpoints("measured", truth.t, value(mechanism.measured.coordinate, truth.q))
    return {"references": [row], "motions": [place | x for x in true_poses(mechanism, truth)]}


def complete(suite: Suite, tables: Tables) -> None:
    """Sort the rows of results, fill in the observed orders of convergence, and keep only those poses that the report plays."""
    tables["results"] = with_orders(sorted(tables.get("results", []), key=in_order))
    tables["poses"] = keep(tables["results"], tables.get("poses", []))


def in_order(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return the sort key of a row: the values of its key columns, with larger steps first."""
    return (*(row[k] for k in KEY[:6]), -row["step"], row["t_end"])


def with_orders(rows: Rows) -> Rows:
    """Fill in `observed_order` of rows sorted by `in_order`, and return the rows.

    The order of rows that differ only in the step follows from the error of the measured coordinate at the last checkpoint that any
    of these rows reached.
    """
    for group in group_by(rows, *(k for k in KEY if k != "step")).values():
        steps, floors = _numbers(group, "step"), np.nan_to_num(_numbers(group, "position_error_bar"))
        errors = [_numbers(group, f"measured_error_{checkpoint}") for checkpoint in ("t2", "t1", "t05")]  # the last one first
        reached = [x for x in errors if not np.isnan(x).all()]
        if reached and len(group) > 1:
            for row, order in zip(group, observed_order(steps, reached[0], floors).tolist(), strict=True):
                row["observed_order"] = order
    return rows


def _numbers(rows: Rows, column: str) -> Array:
    """Return a column of k rows as numbers (k,); NaN for a missing number."""
    return np.array([np.nan if row.get(column) is None else row[column] for row in rows], dtype=float)
