"""The accuracy gate: compare the figures (measured numbers and statuses) of the gate suite with a committed baseline.

Times are not compared. A figure fails if it is worse than its value in the baseline by more than the factor of its metric, and is
reported as better if it is better by more than this factor. A figure that is much better fails too, because a faulty metric may be
the cause; a real improvement is accepted like any other change. A new baseline needs a reason, which is stored with the date.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.atomic import write_text
from gauss_bench.bench.cases import Case
from gauss_bench.judge import OFF_ACCELERATION, OFF_DRIFT
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import offer
from gauss_bench.tables import BASELINE_FORMAT, KEY, TABLES, Row, case_of, csv_text, read_file, row_of

FIGURE = [*KEY, "metric"]  # columns that identify a figure
Key = tuple[Any, ...]  # values of the columns FIGURE


@dataclass(frozen=True)
class Rule:
    """The limits of one metric, an error column of the result rows.

    A figure fails if it is larger than `factor` times its value in the baseline and larger than `floor`. It is reported as better
    if it is smaller than the baseline / `factor` and the baseline is larger than `floor`.
    """

    factor: float
    floor: float


# Figures differ by a factor below 2 between machines, but much more if they are as small as rounding errors: hence the floors.
RULES = {
    "acceleration_error_median": Rule(2.0, 1e-12),  # rounding at a condition number of 1e4
    "measured_error_t1": Rule(2.0, 1e-10),  # rounding errors that have grown over a second of fast rotation
    "position_error": Rule(2.0, 1e-10),
    "length_error": Rule(2.0, 1e-10),
    "angle_error": Rule(2.0, 1e-10),
    "velocity_error": Rule(2.0, 1e-8),  # velocities in rad/s are about 50 times the angles
    "position_drift": Rule(2.0, 1e-12),
    "velocity_drift": Rule(2.0, 1e-10),
    "energy_error": Rule(2.0, 1e-8),  # [J] error of the integral of power over samples 1 ms apart
}
SCATTERING = {"idas": 10.0, "idas_ggl": 10.0}  # a start moved by 1e-15 changes figures of IDAS by this factor
FLATTERING = 10.0  # a figure better than the baseline by this factor fails, if the baseline is above its floor by this factor
ORDER_FLATTERING = 1.0  # an observed order fails if it is higher than the baseline by more than this
ORDER_MARGIN = 0.2  # allowed decrease of an observed order, which scatters by 0.1 between neighbouring steps
TRUTH_MARGIN = 1e-9  # allowed change of a reference, relative to 1 + |value|; its error bar is 1e-11
TRUTHS = ("measured_t05", "measured_t1")  # gated columns of the references
LOST = 1.0  # [m, rad] figures of runs with a larger position error differ between machines
ENDED = ("ok", "invalid")  # statuses of runs that have figures
BROKEN = ("crashed", "timeout", "error", "incomplete", "warning")  # statuses of a failed process or an unfinished run


@dataclass(frozen=True)
class Verdict:
    """The verdict on one figure.

    Attributes:
        outcome: "fail", "better" or "ok".
        case: linkage, scenario, engine and setting.
        metric: column of the results, or of the references.
        value, limit, baseline: the figure, its limit and its value in the baseline, as texts in the metric's unit.
        cause: the message of the engine's run, which may tell why a figure failed.
    """

    outcome: str
    case: str
    metric: str
    value: str
    limit: str
    baseline: str
    cause: str = ""

    def __str__(self) -> str:
        cause = f"{self.cause}: " if self.cause else ""
        return f"{self.outcome}: {self.case}: {cause}{self.metric} = {self.value}, limit {self.limit} (baseline {self.baseline})"


def figures_of(rows: Iterable[Row], references: Iterable[Row]) -> list[Row]:
    """Return the figures that the gate compares: one row for each case and metric, from the rows of results and of references.

    Of a run with large errors, only the status, the validity and the acceleration error are taken, because its other figures differ
    between machines.
    """
    figures: list[Row] = []
    limits = {"acceleration_error_median": OFF_ACCELERATION, "position_drift": OFF_DRIFT, "position_error": LOST}
    for row in rows:
        key = {k: row[k] for k in KEY}
        figures.append(key | {"metric": "status", "value": row["status"], "message": row["message"]})
        ended = row["status"] in ENDED
        if ended:
            figures.append(key | {"metric": "valid", "value": str(row["valid"])})
        repeatable = ended and all(row[metric] <= limit for metric, limit in limits.items())
        used = [*RULES, "observed_order"] if repeatable else ["acceleration_error_median"]
        figures += [key | {"metric": m, "value": f"{row[m]:.6g}"} for m in used if np.isfinite(row[m])]
    for reference in references:
        place = {k: reference[k] for k in ("mechanism", "scenario", "t_end")}
        key = {**dict.fromkeys(KEY, ""), **place, "engine": "reference", "step": 0.0}
        figures += [key | {"metric": m, "value": f"{reference[m]:.15g}"} for m in TRUTHS if np.isfinite(reference[m])]
    return figures


def key_of(figure: Row) -> Key:
    """Return the values of the columns FIGURE, which identify a figure."""
    return tuple(figure[k] for k in FIGURE)


def compare(figures: Iterable[Row], baseline: Iterable[Row]) -> list[Verdict]:
    """Return a verdict for every figure of a run and of the baseline; a figure that is missing in one of the two fails.

    If the status of a case differs, its missing figures get no verdict, because the verdict on the status explains them.
    """
    here, there = {key_of(row): row for row in figures}, {key_of(row): row for row in baseline}
    verdicts = []
    for key in sorted(here.keys() | there.keys(), key=str):
        status = (*key[:-1], "status")  # the key of the case's status
        statuses = {str(rows[status]["value"]) for rows in (here, there) if status in rows}
        if len(statuses) > 1 and key != status and not (key in here and key in there):
            continue
        value, base = (str(rows[key]["value"]) if key in rows else None for rows in (here, there))
        verdict = judge_figure(key, value, base)
        if verdict.outcome == "fail" and key in here:
            verdict = replace(verdict, cause=str(here[key].get("message", "")))
        verdicts.append(verdict)
    return verdicts


def judge_figure(key: Key, value: str | None, base: str | None) -> Verdict:
    """Return the verdict on a figure: "fail", "better" or "ok".

    There are four kinds of figures, each with its own limits: statuses, which must be equal; observed orders of convergence; values
    of references; and errors, whose limits follow from RULES.

    Args:
        key: values of the columns FIGURE, the last of which is the metric.
        value, base: figures of the run and of the baseline, as texts; None if missing.
    """
    metric, missing = str(key[-1]), "none"
    case = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in key[:-1] if x != "")

    def verdict(outcome: str, value: str, limit: str, baseline: str) -> Verdict:
        return Verdict(outcome, case, metric, value, limit, baseline)

    if base is None or value is None:
        # an order exists only while errors are above their floor: a missing order is reported (as "better"), and does not fail
        outcome = "better" if metric == "observed_order" else "fail"
        return verdict(outcome, value or missing, "present in run and baseline", base or missing)
    if metric in ("status", "valid"):
        return verdict("ok" if value == base else "fail", value, base, base)
    x, b = float(value), float(base)  # of this run, and of the baseline
    if metric == "observed_order":
        low, high = b - ORDER_MARGIN, b + ORDER_FLATTERING
        if x > high:
            return verdict("fail", f"{x:.2f}", f"at most {high:.2f} without a reason", f"{b:.2f}")
        outcome = "fail" if x < low else "better" if x > b + ORDER_MARGIN else "ok"
        return verdict(outcome, f"{x:.2f}", f"at least {low:.2f}", f"{b:.2f}")
    if metric in TRUTHS:
        margin = TRUTH_MARGIN * (1 + abs(b))
        return verdict("fail" if abs(x - b) > margin else "ok", value, f"{b:.12g} +- {margin:.1g}", base)
    # the figure is an error: smaller is better. `scatter` widens the limits for integrators whose figures vary more
    rule, scatter = RULES[metric], SCATTERING.get(str(key[KEY.index("integrator")]), 1.0)
    factor, flattering = max(rule.factor, scatter), FLATTERING * scatter
    if x < b / flattering and b > flattering * rule.floor:  # a faulty metric may be the cause
        return verdict("fail", f"{x:.3g}", f"at least {b / flattering:.3g} without a reason", f"{b:.3g}")
    limit = max(factor * b, rule.floor)  # below the floor, figures differ between machines
    outcome = "fail" if not x <= limit else "better" if x < b / factor and b > rule.floor else "ok"
    return verdict(outcome, f"{x:.3g}", f"{limit:.3g}", f"{b:.3g}")


def read_baseline(path: Path) -> list[Row]:
    """Return the figures of a baseline, as `accept` wrote them: one row for each case and metric.

    Raises:
        TableError: the file is damaged, or has a newer format than this version can read.
    """
    return [*read_file("baseline", path)]


def accept(figures: Iterable[Row], path: Path, reason: str) -> tuple[int, list[str]]:
    """Write a new baseline, in which every figure that changed beyond its limits has today's date and the reason.

    The new baseline keeps the old figures of pairs of mechanism and engine that were not measured, and of cases that are refused:
    those with a status in BROKEN and, if there is an old baseline, those that failed with another status than there.

    Returns:
        The number of figures that changed, and a sentence for every case whose new figures were not accepted.
    """
    stamp = f"{datetime.now(UTC):%Y-%m-%d} {reason}"
    old_rows = {key_of(row): row for row in read_baseline(path)} if path.exists() else {}
    rows_by_key = {key_of(row): row for row in sorted(figures, key=key_of)}
    refused: dict[Key, str] = {}  # key of a case (all columns of FIGURE but the last, the metric) -> sentence
    for key, row in rows_by_key.items():
        acceptable = [*ENDED, "skip", old_rows[key]["value"] if key in old_rows else ""]
        if key[-1] == "status" and (row["value"] in BROKEN or (old_rows and row["value"] not in acceptable)):
            refused[key[:-1]] = f"{' '.join(map(str, key[:-1]))}: {row['value']}: {row.get('message', '')}"
    measured = {(key[0], key[2]) for key in rows_by_key}  # mechanism and engine
    rows = [row for key, row in old_rows.items() if key[:-1] in refused or (key[0], key[2]) not in measured]
    changed = 0
    for key, row in rows_by_key.items():
        if key[:-1] in refused:
            continue
        keeps = key in old_rows and judge_figure(key, str(row["value"]), str(old_rows[key]["value"])).outcome == "ok"
        rows.append(old_rows[key] if keeps else {**row, "accepted": stamp})
        changed += not keeps
    table, columns = TABLES["baseline"], (*FIGURE, "value", "accepted")
    typed = [row_of(table, {k: row[k] for k in columns} | {"format": BASELINE_FORMAT}) for row in sorted(rows, key=key_of)]
    write_text(path, csv_text(table.columns, typed))
    return changed, list(refused.values())


def known_cases(cases: Sequence[Case], baseline: Iterable[Row]) -> list[Case]:
    """Return the cases that have figures in a baseline.

    An engine that cannot be used here has one case without integrator, which no baseline has. This case is kept if the baseline has
    any case of the same linkage and engine: the gate must then fail, because the run lacks figures that the baseline has.
    """
    known = {case_of(row) for row in baseline}
    pairs = {(key[0], key[2]) for key in known}  # linkage and engine
    chosen = []
    for case in cases:
        mechanism = load(case.linkage, case.scenario or None)
        # in the order of the columns KEY: mechanism, scenario, and the fields of a case after linkage and scenario
        key = (mechanism.name, mechanism.scenario, *astuple(case)[2:])
        if key in known or ((mechanism.name, case.engine) in pairs and not offer(case.engine).usable):
            chosen.append(case)
    return chosen


def restrict(baseline: Iterable[Row], mechanisms: set[str], engines: set[str]) -> list[Row]:
    """Return the figures of a baseline for the given mechanisms and engines, and for the references of these mechanisms."""
    return [row for row in baseline if row["mechanism"] in mechanisms and row["engine"] in (*engines, "reference")]


def failures(verdicts: list[Verdict]) -> Iterator[Verdict]:
    """Yield the verdicts that fail."""
    return (v for v in verdicts if v.outcome == "fail")


def scale_inertia(factor: float, mechanism: Mechanism) -> Mechanism:
    """Plant a fault: multiply the inertia of the crank by a factor, or that of every link if there is no crank."""
    links = [
        replace(link, inertia=link.inertia * factor) if mechanism.crank in (None, k) else link
        for k, link in enumerate(mechanism.links)
    ]
    return replace(mechanism, links=tuple(links))
