"""The report of an invented run: what it says follows from the rows, nothing is lost, and it comes out the same twice."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gauss_bench.report.build import build_report
from gauss_bench.report.rows import KEYS

LINKAGES = {"four_bar": 1.0, "six_bar": 4.0}
BAR = 3e-13
STEPS = (0.008, 0.004, 0.002, 0.001)
NATIVE = {"gauss": 60e-6, "lagrange": 40e-6, "schur": 55e-6, "yuan_ge_eq16": 70e-6}
STIFFNESS = {"default": 3e-2, "stiff": 3e-5}


def case(mechanism: str, engine: str, settings: str, integrator: str, stabilization: str, step: float) -> dict[str, object]:
    key = (mechanism, "torque", engine, settings, integrator, stabilization, step, 2.0)
    return dict(zip(KEYS, key, strict=True)) | {"status": "ok", "message": "", "note": "", "valid": True, "control": False}


def ran(row: dict[str, object], error: float, acceleration: float, cost: float) -> dict[str, object]:
    """A case that ended, with an error at the end and at the same state, and the cost of a step."""
    drift = 1e-16 if row["stabilization"] == "projection" else error / 5
    crank = {"crank_error_t05": error / 50, "crank_error_t1": error / 8, "crank_error_t2": error}
    drifts = {"position_drift": drift, "velocity_drift": 20 * drift, "acceleration_residual": 1e-13}
    bars = {"position_error_bar": BAR, "velocity_error_bar": 10 * BAR, "energy_error": error / 3, "energy_error_bar": BAR}
    worst = {"position_error": 1.5 * error, "velocity_error": 12 * error, "link_errors": "{}"}
    same = {"acceleration_error_median": acceleration, "acceleration_error_max": 8 * acceleration}
    return (
        row
        | crank
        | drifts
        | bars
        | worst
        | same
        | {"steps": int(2.0 / float(str(row["step"]))), "step_time": cost, "build_time": 2e-3}
    )


def ratios(row: dict[str, object], name: str, ratio: float) -> dict[str, object]:
    return row | {f"{name}_ratio": ratio, f"{name}_ratio_low": 0.96 * ratio, f"{name}_ratio_high": 1.05 * ratio}


def native_rows(mechanism: str, hardness: float) -> list[dict[str, object]]:
    rows = []
    for engine, cost in NATIVE.items():
        control = engine == "yuan_ge_eq16"
        for integrator, order, stages in (("rk4", 4, 4), ("semi_implicit_euler", 1, 1)):
            for stabilization in ("none", "baumgarte", "projection"):
                for step in STEPS:
                    error = 8.0 if control else hardness * {4: 2e4, 1: 3.0}[order] * step**order + 4e-15
                    row = case(mechanism, engine, "default", integrator, stabilization, step)
                    row = ran(row, error, 0.7 if control else 3e-14, stages * cost)
                    row = ratios(ratios(row, "step", cost / NATIVE["lagrange"]), "acceleration", cost / NATIVE["lagrange"] * 1.02)
                    rows.append(
                        row | {"valid": not control, "control": control, "observed_order": order, "acceleration_time": cost}
                    )
    return rows


def foreign_rows(mechanism: str, hardness: float) -> list[dict[str, object]]:
    rows = []
    for step in STEPS:
        for settings, softness in STIFFNESS.items():
            row = ran(case(mechanism, "mujoco", settings, "implicit", "none", step), hardness * softness, 10 * softness, 9e-6)
            row = ratios(ratios(row, "step", 0.06), "native_step", 0.02)
            rows.append(row | {"valid": False, "native_step_time": 3e-6, "observed_order": 0.0})
        row = ran(case(mechanism, "pinocchio", "default", "rk4", "none", step), 2e4 * step**4 + 4e-15, 2e-14, 12e-6)
        rows.append(ratios(row, "step", 0.08))
        failed = case(mechanism, "exudyn", "default", "generalized_alpha", "none", step) | {"valid": False}
        message = "Newton did not converge at t = 0.31 s | step <size>\nsee *log*"
        rows.append(
            failed | ({"status": "nan", "message": message} if step > 0.004 else {"status": "skip", "message": "no such pair"})
        )
    adaptive = case(mechanism, "gauss", "default", "dop853", "none", math.nan)
    rows.append(ran(adaptive | {"step": 0.001}, 1e-13, 3e-14, 1e-4) | {"step": math.nan})
    return rows


def histories(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    times = np.linspace(0.0, 2.0, 21)
    found = []
    for row in rows:
        if row["status"] == "ok":
            worst = {k: float(str(row[k])) for k in ("position_drift", "velocity_drift", "energy_error")}
            for t in times:
                found.append({k: row[k] for k in KEYS} | {"t": t, **{k: x * (t / 2) ** 2 for k, x in worst.items()}})
    return found


ENVIRONMENT = {
    "suite": "gauss_bench 0.1.0",
    "date": "2026-11-20",
    "commit": "0123456789abcdef",
    "dirty": False,
    "python": "3.11.2",
    "cpu": "an invented processor",
    "cores": 2,
    "versions": {"numpy": "2.3.0", "mujoco": "4.0.0"},
    "baseline_engine": "lagrange",
    "engines": {"mujoco": {"version": "mujoco 4.0.0", "settings": {"default": {}, "stiff": {"solref": [0.002, 1.0]}}}},
    "wall_time": 321.5,
}


def write_run(folder: Path, rows: list[dict[str, object]]) -> Path:
    """A folder as the runner leaves it."""
    folder.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows, columns=None if rows else [*KEYS, "status"]).to_csv(folder / "results.csv", index=False)
    pd.DataFrame(histories(rows), columns=None if rows else [*KEYS, "t"]).to_csv(folder / "series.csv", index=False)
    reference = {"scenario": "torque", "t_end": 2.0, "method": "two integrations", "error_bar_q": BAR, "error_bar_v": 10 * BAR}
    angles = {"crank_t05": 1.0, "crank_t1": 4.0, "crank_t2": 26.9}
    references = [{"mechanism": name} | reference | angles for name in sorted({str(r["mechanism"]) for r in rows})]
    pd.DataFrame(references, columns=None if rows else ["mechanism"]).to_csv(folder / "references.csv", index=False)
    pd.DataFrame(columns=["mechanism", "engine", "quantity", "round", "seconds"]).to_csv(folder / "samples.csv", index=False)
    (folder / "environment.json").write_text(json.dumps(ENVIRONMENT))
    return folder


def invented() -> list[dict[str, object]]:
    return [row for name, hardness in LINKAGES.items() for row in native_rows(name, hardness) + foreign_rows(name, hardness)]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("run"), invented())
    build_report(folder)
    return folder
