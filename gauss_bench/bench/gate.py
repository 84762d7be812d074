"""The accuracy gate: the gate suite against a committed baseline. It never reads a time.

A figure fails when it is worse than its limit, and is told when it is better by as much. One that is better by far fails too: a
metric that has begun to flatter looks like that, and what is truly better is accepted like any other change. Limits are computed
from the baseline by the rules below; a new baseline is accepted only with a dated reason.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gauss_bench.bench.cases import Case
from gauss_bench.judge import OFF_ACCELERATION, OFF_DRIFT
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import offer
from gauss_bench.tables import BASELINE_FORMAT, KEY, TABLES, csv_text, read_file, row_of, write_text

COLUMNS = [*KEY, "metric", "value", "accepted"]


@dataclass(frozen=True)
class Rule:
    """Limits of a metric: worse than `factor` times the baseline, but never below `floor`, fails; better by `factor` is told."""

    factor: float
    floor: float


# Figures move by less than 2 between machines as long as they stand above rounding, where they move by much more: hence the floors.
RULES = {
    "acceleration_error_median": Rule(2.0, 1e-12),  # rounding at a condition of 1e4
    "measured_error_t1": Rule(2.0, 1e-10),  # rounding grown over a second of fast turning
    "position_error": Rule(2.0, 1e-10),
    "length_error": Rule(2.0, 1e-10),
    "angle_error": Rule(2.0, 1e-10),
    "velocity_error": Rule(2.0, 1e-8),  # speeds are some 50 times angles
    "position_drift": Rule(2.0, 1e-12),
    "velocity_drift": Rule(2.0, 1e-10),
    "energy_error": Rule(2.0, 1e-8),  # [J] the quadrature of the work through samples a millisecond apart
}
SCATTERING = {"idas": 10.0, "idas_ggl": 10.0}  # times: a start that is moved by 1e-15 moves figures of IDAS by as much
FLATTERING = 10.0  # better than the baseline by this factor, where that stands as far above its floor: not by chance
ORDER_FLATTERING = 1.0  # an integrator has no order to gain
ORDER_MARGIN = 0.2  # observed orders scatter by 0.1 between neighbouring steps
TRUTH_MARGIN = 1e-9  # a reference that moves by more than its bar (1e-11) is another truth; libraries may move it below that
TRUTHS = ("measured_t05", "measured_t1")
LOST = 1.0  # [m, rad] figures of a run that is so far off differ between machines
ENDED = ("ok", "invalid")
BROKEN = ("crashed", "timeout", "error", "incomplete", "warning")  # the process failed, or did something else


@dataclass(frozen=True)
class Verdict:
    """One figure against its limit: "fail", "better" or "ok"; `cause` is what the engine said."""

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


def facts(rows: pd.DataFrame, references: pd.DataFrame) -> pd.DataFrame:
    """The gated figures in long form: one row per case and metric.

    Runs that have lost their way keep only their status, whether they are valid and their acceleration error: what else they say
    differs between machines, but they must stay what they are.
    """
    figures: list[dict[str, Any]] = []
    for row in rows.to_dict("records"):
        key = {k: row[k] for k in KEY}
        figures.append(key | {"metric": "status", "value": row["status"], "message": row["message"]})
        if row["status"] in ENDED:
            figures.append(key | {"metric": "valid", "value": str(row["valid"])})
        used = [*RULES, "observed_order"] if _repeatable(row) else ["acceleration_error_median"]
        figures += [key | {"metric": m, "value": f"{row[m]:.6g}"} for m in used if np.isfinite(row[m])]
    for reference in references.to_dict("records"):
        key = dict.fromkeys(KEY, "") | {"mechanism": reference["mechanism"], "scenario": reference["scenario"]}
        key |= {"engine": "reference", "step": 0.0, "t_end": reference["t_end"]}
        figures += [key | {"metric": m, "value": f"{reference[m]:.15g}"} for m in TRUTHS if np.isfinite(reference[m])]
    frame = (
        pd.DataFrame(figures, columns=[*COLUMNS[:-1], "message"]).astype({"step": float, "t_end": float}).fillna({"message": ""})
    )
    return frame.sort_values([*KEY, "metric"], kind="stable", ignore_index=True)


def _repeatable(row: Mapping[Any, Any]) -> bool:
    lost = (("acceleration_error_median", OFF_ACCELERATION), ("position_drift", OFF_DRIFT), ("position_error", LOST))
    return row["status"] in ENDED and all(row[metric] <= limit for metric, limit in lost)


def compare(figures: pd.DataFrame, baseline: pd.DataFrame) -> list[Verdict]:
    """A verdict for every figure; one that is missing on either side fails. A case that ends otherwise has that one verdict."""
    keys = [*KEY, "metric"]
    here = {tuple(r[k] for k in keys): str(r["value"]) for r in figures.to_dict("records")}
    there = {tuple(r[k] for k in keys): str(r["value"]) for r in baseline.to_dict("records")}
    causes = {tuple(r[k] for k in keys): str(r.get("message", "")) for r in figures.to_dict("records")}
    verdicts = []
    for key in sorted(here.keys() | there.keys(), key=str):
        status = (*key[:-1], "status")
        ended_otherwise = here.get(status) != there.get(status) and status in here and status in there
        if ended_otherwise and key != status and (key not in here or key not in there):
            continue
        case = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in key[:-1] if x != "")
        verdict = _verdict(case, str(key[-1]), here.get(key), there.get(key), _scatter(key))
        verdicts.append(replace(verdict, cause=causes.get(key, "") if verdict.outcome == "fail" else ""))
    return verdicts


def _scatter(key: Sequence[object]) -> float:
    """Return how many times a figure of this case scatters with the last bits of its start."""
    return SCATTERING.get(str(key[KEY.index("integrator")]), 1.0)


def _verdict(case: str, metric: str, value: str | None, base: str | None, scatter: float = 1.0) -> Verdict:
    if base is None or value is None:
        outcome, missing = "fail", "none"
        if metric == "observed_order":  # exists only while the errors stand above their floor: its loss is told, not judged
            outcome = "better"
        return Verdict(outcome, case, metric, value or missing, "present on both sides", base or missing)
    if metric in ("status", "valid"):
        return Verdict("ok" if value == base else "fail", case, metric, value, base, base)
    x, b = float(value), float(base)
    if metric == "observed_order":
        low = b - ORDER_MARGIN
        if x > b + ORDER_FLATTERING:
            return Verdict("fail", case, metric, f"{x:.2f}", f"at most {b + ORDER_FLATTERING:.2f} without a reason", f"{b:.2f}")
        outcome = "fail" if x < low else "better" if x > b + ORDER_MARGIN else "ok"
        return Verdict(outcome, case, metric, f"{x:.2f}", f"at least {low:.2f}", f"{b:.2f}")
    if metric in TRUTHS:
        moved = abs(x - b) > TRUTH_MARGIN * (1 + abs(b))
        return Verdict("fail" if moved else "ok", case, metric, value, f"{b:.12g} +- {TRUTH_MARGIN * (1 + abs(b)):.1g}", base)
    rule, flattering = RULES[metric], FLATTERING * scatter
    factor = max(rule.factor, scatter)
    if x < b / flattering and b > flattering * rule.floor:
        return Verdict("fail", case, metric, f"{x:.3g}", f"at least {b / flattering:.3g} without a reason", f"{b:.3g}")
    limit = max(factor * b, rule.floor)
    outcome = "fail" if not x <= limit else "better" if x < b / factor and b > rule.floor else "ok"
    return Verdict(outcome, case, metric, f"{x:.3g}", f"{limit:.3g}", f"{b:.3g}")


def read_baseline(path: Path) -> pd.DataFrame:
    """The committed figures, as `accept` wrote them, under the names of today.

    Raises:
        TableError: the file is damaged, or of a later format than is known here.
    """
    return pd.DataFrame(read_file("baseline", path), columns=COLUMNS).astype({"step": float, "t_end": float})


def accept(figures: pd.DataFrame, path: Path, reason: str) -> tuple[int, list[str]]:
    """Write a new baseline; every figure that changed beyond its limits carries today's date and the reason.

    Returns how many figures changed, and a sentence for every case that was not accepted because it failed: one whose process,
    not its mathematics, failed, and one that the baseline does not know to fail so. Only a first baseline takes failures for what
    they are. Those keep what the baseline says, as do mechanisms and engines that were not measured.
    """
    stamp = f"{datetime.now(UTC):%Y-%m-%d} {reason}"
    old = read_baseline(path) if path.exists() else pd.DataFrame(columns=COLUMNS)
    keys = [*KEY, "metric"]
    before = {tuple(r[k] for k in keys): r for r in old.to_dict("records")}
    refused: dict[tuple[Any, ...], str] = {}
    for row in figures[figures["metric"] == "status"].to_dict("records"):
        case = tuple(row[k] for k in KEY)
        known = before.get((*case, "status"))
        was = str(known["value"]) if known else ""
        if row["value"] in BROKEN or (len(old) and row["value"] not in (*ENDED, "skip", was)):
            refused[case] = f"{' '.join(str(x) for x in case)}: {row['value']}: {row.get('message', '')}"
    measured = {(r["mechanism"], r["engine"]) for r in figures.to_dict("records")}
    cases = [tuple(r[k] for k in KEY) for r in old.to_dict("records")]
    kept_cases = [c in refused or (c[0], c[2]) not in measured for c in cases]
    rows, changed = [r for r, kept in zip(old.to_dict("records"), kept_cases, strict=True) if kept], 0
    for row in figures.to_dict("records"):
        key = tuple(row[k] for k in keys)
        if key[:-1] in refused:
            continue
        kept = before.get(key)
        if kept is not None and _verdict("", str(key[-1]), str(row["value"]), str(kept["value"]), _scatter(key)).outcome == "ok":
            rows.append(kept)
        else:
            rows.append(row | {"accepted": stamp})
            changed += 1
    frame = pd.DataFrame(rows, columns=COLUMNS).astype({"step": float, "t_end": float})
    ordered = frame.sort_values([*KEY, "metric"], kind="stable").to_dict("records")
    table = TABLES["baseline"]
    typed = [row_of(table, {str(k): x for k, x in row.items()} | {"format": BASELINE_FORMAT}) for row in ordered]
    write_text(path, csv_text(table.columns, typed))
    return changed, list(refused.values())


def is_known(cases: Sequence[Case], baseline: pd.DataFrame) -> list[Case]:
    """The cases that a baseline has figures of, and those that stand for an engine of it which cannot be used here."""
    there = {tuple(row) for row in baseline[[*KEY]].itertuples(index=False)}
    pairs = {(row[0], row[2]) for row in there}

    def has(case: Case) -> bool:
        mechanism = load(case.linkage, case.scenario or None)
        key = (mechanism.name, mechanism.scenario, *astuple(case)[2:])
        return key in there or ((mechanism.name, case.engine) in pairs and not offer(case.engine).usable)

    return [case for case in cases if has(case)]


def restrict(baseline: pd.DataFrame, mechanisms: set[str], engines: set[str]) -> pd.DataFrame:
    """The part of a baseline that a partial run can be held against."""
    inside = baseline["mechanism"].isin(list(mechanisms)) & baseline["engine"].isin([*engines, "reference"])
    return baseline[inside].reset_index(drop=True)


def failures(verdicts: list[Verdict]) -> Iterator[Verdict]:
    return (v for v in verdicts if v.outcome == "fail")


def scale_inertia(factor: float, mechanism: Mechanism) -> Mechanism:
    """A planted fault: the inertia of the crank, or of every link where there is none, times a factor."""
    heavy = [mechanism.crank in (None, k) for k in range(len(mechanism.links))]
    links = [replace(x, inertia=x.inertia * factor) if y else x for x, y in zip(mechanism.links, heavy, strict=True)]
    return replace(mechanism, links=tuple(links))
