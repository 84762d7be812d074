"""Accuracy: run cases and judge them against references, whose rows are kept too."""

from collections.abc import Collection, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gauss_bench.bench.cases import Case, as_asked, cases
from gauss_bench.bench.measure import at_checkpoints, measure, mechanism_of, reference_of
from gauss_bench.bench.poses import keep, play, true_poses
from gauss_bench.bench.tasks import Context, Rows, Tables, Task, place_of
from gauss_bench.mechanism.coordinates import value
from gauss_bench.metrics import observed_order
from gauss_bench.runs.apart import Alteration
from gauss_bench.runs.offers import is_isolated
from gauss_bench.suites.schema import Suite
from gauss_bench.tables import KEY
from gauss_bench.terms import Array

JUDGING = 20.0  # [s] beside the run, which has its own limit: for the reference and the metrics


def exact_tasks(suite: Suite, context: Context) -> list[Task]:
    """Return the tasks of the references, which the cases share, then those of the cases."""
    chosen = as_asked(cases(suite), context.until, context.steps)
    return tasks(chosen, context, play(chosen))


def tasks(chosen: Sequence[Case], context: Context, posed: Collection[Case] = ()) -> list[Task]:
    """Return the tasks of cases and of their references; poses are kept for the cases in `posed`."""
    wanted = dict.fromkeys((c.linkage, c.scenario, c.t_end) for c in chosen)
    planned = [context.task("references", reference, (*x, context.store), *x[:2], t_end=x[2]) for x in sorted(wanted)]
    for case in chosen:
        names = {k: x for k, x in asdict(case).items() if k not in ("linkage", "scenario")}
        arguments = (case, context.store, context.alter, context.limit, case in posed)
        task = context.task("results", accuracy, arguments, case.linkage, case.scenario, **names)
        planned.append(task._replace(limit=task.limit + JUDGING) if is_isolated(case.engine) else task)
    return planned


def reference(linkage: str, scenario: str, t_end: float, store: str) -> Tables:
    """Return the row of a reference and its poses; the reference itself is kept in the folder `store`."""
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


def accuracy(case: Case, store: str, alter: Alteration, limit: float, posed: bool = False) -> Tables:
    """Return the row of a case, and its curves and poses for the report."""
    mechanism = mechanism_of(case.linkage, case.scenario)
    key = {k: x for k, x in asdict(case).items() if k in KEY} | place_of(mechanism)
    measured = measure(case, store, alter, limit, posed)
    curves = {table: [key | point for point in measured[table]] for table in ("series", "poses")}
    return {"results": [key | measured["row"]], **curves}


def complete(suite: Suite, tables: Tables) -> None:
    """Sort the rows by their key, fill in the observed orders, and keep the poses that are played."""
    tables["results"] = with_orders(sorted(tables.get("results", []), key=in_order))
    tables["poses"] = keep(tables["results"], tables.get("poses", []))


def in_order(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return the sort key of a row: its key columns, with larger steps first."""
    return (*(row[k] for k in KEY[:6]), -row["step"], row["t_end"])


def with_orders(rows: Rows) -> Rows:
    """Fill in `observed_order`, from the error of the measured coordinate at the last checkpoint that a run reached."""
    groups: dict[tuple[Any, ...], Rows] = {}
    for row in rows:
        groups.setdefault(tuple(row[k] for k in KEY if k != "step"), []).append(row)
    for group in groups.values():
        steps, floors = _numbers(group, "step"), np.nan_to_num(_numbers(group, "position_error_bar"))
        errors = [_numbers(group, f"measured_error_{at}") for at in ("t2", "t1", "t05")]
        known = [x for x in errors if not np.isnan(x).all()]
        if known and len(group) > 1:
            for row, order in zip(group, observed_order(steps, known[0], floors).tolist(), strict=True):
                row["observed_order"] = order
    return rows


def _numbers(rows: Rows, column: str) -> Array:
    """Return a column (k,) as numbers, NaN where a row has none."""
    return np.array([np.nan if row.get(column) is None else row[column] for row in rows], dtype=float)
