"""Runs a suite: accuracy cases in parallel workers, then cost comparisons alone, then the tables, all of it resumable."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gauss_bench.bench.cases import Case
from gauss_bench.bench.clock import compare_costs, ratio
from gauss_bench.bench.journal import Journal, fingerprint
from gauss_bench.bench.measure import Alteration, measure, mechanism_of, reference_of, unaltered
from gauss_bench.bench.measurements.certificates import certificate_table, certificates_digest
from gauss_bench.bench.measurements.driving import LINKAGES as driving_linkages
from gauss_bench.bench.measurements.driving import driving
from gauss_bench.bench.measurements.geometry import LINKAGES as geometry_linkages
from gauss_bench.bench.measurements.geometry import geometry
from gauss_bench.bench.measurements.papers import PAPER_TASKS, example_motion
from gauss_bench.bench.offers import offers
from gauss_bench.bench.tasks import Task, finish
from gauss_bench.judge import LIMITS
from gauss_bench.mechanism.coordinates import value
from gauss_bench.metrics import CHECKPOINTS, observed_order
from gauss_bench.tables import KEY, SIDE_TABLES, environment, table, write_table, write_text
from gauss_bench.trajectory import Status

CASE_LIMIT = 120.0  # [s] the slowest case of the quick suite takes 10 s on a slow core
COST_LIMIT = 600.0  # [s] for one linkage with all engines
REFERENCE_LIMIT = 600.0
BASELINE = "gauss"  # costs are ratios to this engine: the formulation the suite is about, and the one its authors wrote
VARIANT = ["engine", "settings", "integrator"]


def run(
    cases: list[Case], folder: Path, suite: str, jobs: int = 2, costs: bool = True, driven: bool = False, limit: float = CASE_LIMIT
) -> pd.DataFrame:
    """Run what is not finished yet, write every table into `folder`, and return the rows.

    `driven` adds the kinematics of the built-in linkages and their driving torques.

    Raises:
        Busy: another run writes into the same folder.
    """
    store = str(folder / ".run" / "references")
    stamp = fingerprint()
    truth = certificates_digest()
    stamps = {case: f"{stamp}.{mechanism_of(case.linkage, case.scenario).sha256[:16]}.{truth}" for case in cases}
    with Journal(folder / ".run" / f"{suite}.jsonl") as journal:
        found = finish(reference_tasks(cases, store, stamps), jobs, REFERENCE_LIMIT, "references", journal)
        found |= finish(accuracy_tasks(cases, store, stamps), jobs, limit, "accuracy", journal)
        if driven:
            found |= finish(driven_tasks(stamp, store), jobs, CASE_LIMIT, "driven", journal)
        if costs:
            found |= finish(cost_tasks(fit(cases, found), stamps), 1, COST_LIMIT, "costs", journal)
    return _write(cases, found, folder, suite)


def measure_all(
    cases: list[Case], folder: Path, jobs: int = 2, alter: Alteration = unaltered, limit: float = CASE_LIMIT
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Accuracy rows and references of the cases, without costs and without a journal; only references are kept in `folder`.

    `alter` plants a fault in what the engines are given.
    """
    store, stamps = str(folder / ".run" / "references"), dict.fromkeys(cases, "")
    references = finish(reference_tasks(cases, store, stamps), jobs, REFERENCE_LIMIT, "references")
    found = finish(accuracy_tasks(cases, store, stamps, alter), jobs, limit, "accuracy")
    return rows_of(cases, found), pd.DataFrame([entry["row"] for _, entry in sorted(references.items())])


def reference_tasks(cases: list[Case], store: str, stamps: dict[Case, str]) -> list[Task]:
    """One task for each linkage, scenario and duration."""
    wanted = sorted({(c.linkage, c.scenario, c.t_end): stamps[c] for c in cases}.items())
    return [Task(f"reference|{'|'.join(map(str, k))}", _reference_row, (*k, store), stamp) for k, stamp in wanted]


def accuracy_tasks(cases: list[Case], store: str, stamps: dict[Case, str], alter: Alteration = unaltered) -> list[Task]:
    return [Task(case.key(), measure, (case, store, alter), stamps[case]) for case in cases]


def driven_tasks(stamp: str, store: str) -> list[Task]:
    """Kinematics three ways, driving torques by every engine, the papers, and the certificates, of the built-in linkages."""
    wanted = [("geometry", geometry, x) for x in geometry_linkages] + [("driving", driving, x) for x in driving_linkages]
    turns = [
        Task(f"{name}|{x}", function, (x,), f"{stamp}.{mechanism_of(x, 'driven').sha256[:16]}") for name, function, x in wanted
    ]
    truth = f"{stamp}.{certificates_digest()}"
    told = [Task(f"papers|{name}", function, (), truth) for name, function in PAPER_TASKS.items()]
    return [
        *turns,
        *told,
        Task("papers|motion", example_motion, (store,), truth),
        Task("certificates|", certificate_table, (), truth),
    ]


def cost_tasks(cases: list[Case], stamps: dict[Case, str]) -> list[Task]:
    """One comparison of all engines for each linkage and scenario."""
    engines = list(dict.fromkeys(c.engine for c in cases))
    wanted = sorted({(c.linkage, c.scenario): stamps[c] for c in cases}.items())
    return [Task(f"cost|{'|'.join(k)}|{','.join(engines)}", compare_costs, (*k, engines), stamp) for k, stamp in wanted]


def fit(cases: list[Case], found: dict[str, dict[str, Any]]) -> list[Case]:
    """The cases of engines that can share a process with others: they have neither crashed nor hung on that linkage."""
    lost = {(c.linkage, c.engine) for c in cases if found[c.key()]["row"]["status"] in (Status.CRASHED, Status.TIMEOUT)}
    return [c for c in cases if (c.linkage, c.engine) not in lost]


def _reference_row(linkage: str, scenario: str, t_end: float, store: str) -> dict[str, Any]:
    """What the table of references says of one, and the file it is kept in."""
    mechanism = mechanism_of(linkage, scenario)
    reference = reference_of(linkage, scenario, t_end, store)
    coordinate = mechanism.measured.coordinate
    row: dict[str, Any] = {
        "mechanism": mechanism.name,
        "scenario": mechanism.scenario,
        "t_end": t_end,
        "method": reference.method,
        "error_bar_q": float(reference.error_q.max()),
        "error_bar_v": float(reference.error_v.max()),
        "floor_q": float(np.nanmax(reference.floor_q)) if np.isfinite(reference.floor_q).any() else None,
    }
    for t in CHECKPOINTS:
        at = np.flatnonzero(np.abs(reference.t - t) < 1e-9)
        row[f"crank_t{t:g}".replace(".", "")] = float(value(coordinate, reference.q[at[0]])) if len(at) else None
    return {"row": row}


def rows_of(cases: Iterable[Case], found: dict[str, dict[str, Any]]) -> pd.DataFrame:
    """The table of accuracy rows, with the observed order of each run."""
    rows = []
    for case in cases:
        mechanism = mechanism_of(case.linkage, case.scenario)
        key = asdict(case) | {"mechanism": mechanism.name, "scenario": mechanism.scenario}
        rows.append(key | found[case.key()]["row"])
    return with_orders(table(rows))


def with_orders(frame: pd.DataFrame) -> pd.DataFrame:
    """Fill in observed_order from the crank error at the last checkpoint that the run reached."""
    for _, group in frame.groupby([k for k in KEY if k != "step"], sort=False):
        column = next((c for c in ("crank_error_t2", "crank_error_t1", "crank_error_t05") if group[c].notna().any()), None)
        if column and len(group) > 1:
            steps, errors = group["step"].to_numpy(), group[column].to_numpy()
            floors = group["position_error_bar"].fillna(0.0).to_numpy()
            frame.loc[group.index, "observed_order"] = observed_order(steps, errors, floors)
    return frame


def with_costs(frame: pd.DataFrame, samples: pd.DataFrame) -> pd.DataFrame:
    """Fill in the cost columns: the same for every step and stabilisation of a mechanism, engine, setting and integrator."""
    for mechanism, group in samples.groupby("mechanism"):
        cells = {tuple(k): g.sort_values("round")["seconds"].to_numpy() for k, g in group.groupby([*VARIANT, "quantity"])}
        for (engine, settings, integrator, quantity), seconds in cells.items():
            here = (frame["mechanism"] == mechanism) & (frame["engine"] == engine) & (frame["settings"] == settings)
            if quantity in ("step", "native_step"):
                here &= frame["integrator"] == integrator
            frame.loc[here, f"{quantity}_time"] = np.quantile(seconds, 0.25)
            against = "acceleration" if quantity == "acceleration" else "step"
            baseline = cells.get((BASELINE, "default", "rk4", against))
            if baseline is not None and quantity != "build":
                frame.loc[here, [f"{quantity}_{k}" for k in ("ratio", "ratio_low", "ratio_high")]] = ratio(seconds, baseline)
    return frame


def _write(cases: list[Case], found: dict[str, dict[str, Any]], folder: Path, suite: str) -> pd.DataFrame:
    """Every file of a run: rows, references, curves, samples, environment."""
    frame = rows_of(cases, found)
    failed = [c for key, entry in found.items() if key.startswith("cost|") for c in _costs_failed(key, entry)]
    samples = [s for key, entry in found.items() if key.startswith("cost|") for s in _samples(key, entry)]
    if samples:
        frame = with_costs(frame, pd.DataFrame(samples))
    names = {case.key(): asdict(case) | {"mechanism": mechanism_of(case.linkage, case.scenario).name} for case in cases}
    curves = [{k: names[key][k] for k in KEY} | point for key in names for point in found[key].get("series", [])]
    where = environment() | {
        "suite": suite,
        "baseline_engine": BASELINE,
        "gates": LIMITS,
        "engines": described_engines(list(dict.fromkeys(c.engine for c in cases))),
        "costs_failed": failed,
    }
    write_table(frame, folder / "results.parquet", where)
    write_table(frame, folder / "results.csv")
    turned = [entry for key, entry in sorted(found.items()) if key.startswith(SIDE_TASKS)]
    for name in SIDE_TABLES[1:]:
        write_table(pd.DataFrame([row for entry in turned for row in entry.get(name, [])]), folder / f"{name}.csv")
    references = [entry["row"] for key, entry in sorted(found.items()) if key.startswith("reference|")]
    write_table(with_all_digits(pd.DataFrame(references)), folder / f"{SIDE_TABLES[0]}.csv")
    drawn = pd.DataFrame(curves, columns=[*KEY, *CURVES]).astype(dict.fromkeys(CURVES, "float32"))  # a pen's width is 1e-3
    write_table(drawn, folder / "series.parquet")
    write_table(pd.DataFrame(samples, columns=["mechanism", *VARIANT, "quantity", "round", "seconds"]), folder / "samples.parquet")
    write_text(folder / "environment.json", json.dumps(where, indent=1) + "\n")
    return frame


SIDE_TASKS = ("geometry|", "driving|", "certificates|", "papers|")
CURVES = ("t", "crank_error", "position_drift", "velocity_drift", "energy_error")


def _samples(key: str, entry: dict[str, Any]) -> list[dict[str, Any]]:
    name = mechanism_of(*key.split("|")[1:3]).name
    return [{"mechanism": name, **s} for s in entry.get("samples", [])]


def _costs_failed(key: str, entry: dict[str, Any]) -> list[dict[str, Any]]:
    name = mechanism_of(*key.split("|")[1:3]).name
    lost = [{"engine": "all", **entry["row"]}] if "row" in entry else []
    return [{"mechanism": name, **c} for c in [*entry.get("failed", []), *lost]]


def with_all_digits(references: pd.DataFrame) -> pd.DataFrame:
    """The certified crank angles as texts: a table's ten digits are not enough for them."""
    cranks = [c for c in references.columns if c.startswith("crank_")]
    return references.assign(**{c: [repr(float(x)) if pd.notna(x) else "" for x in references[c]] for c in cranks})


def described_engines(engines: list[str]) -> dict[str, Any]:
    """Version and every setting of the engines, as the report prints them."""
    return {x.name: {"version": x.version, "settings": x.settings} for x in offers(engines)}
