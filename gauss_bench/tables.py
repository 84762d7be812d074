"""The tidy table: schema of a row, provenance, and files that are never half written."""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pandas as pd

KEY = ["mechanism", "scenario", "engine", "settings", "integrator", "stabilization", "step", "t_end"]
TEXTS = ["status", "message", "note", "flag", "link_errors", "measured", "measured_unit"]
FLAGS = ["valid", "control"]
NUMBERS = [
    "steps",
    "evaluations",
    "acceleration_error_median",
    "acceleration_error_max",
    "crank_error_t05",
    "crank_error_t1",
    "crank_error_t2",
    "crank_error_bar_t05",
    "crank_error_bar_t1",
    "crank_error_bar_t2",
    "position_error",
    "length_error",
    "angle_error",
    "velocity_error",
    "position_error_bar",
    "velocity_error_bar",
    "compared",
    "observed_order",
    "position_drift",
    "velocity_drift",
    "acceleration_residual",
    "energy_error",
    "energy_error_bar",
]
COSTS = [
    "build_time",
    *(f"{q}_{k}" for q in ("step", "native_step", "acceleration") for k in ("time", "ratio", "ratio_low", "ratio_high")),
]
SIDE_TABLES = (
    "references",
    "certificates",
    "agreement",
    "singular",
    "basins",
    "driving",
    "audit",
    "reproduction",
    "paper_motion",
    "published",
)
KERNEL_TABLES = (
    "kernel_machine",
    "kernel_steps",
    "kernel_claim",
    "kernel_ladder",
    "kernel_accuracy",
    "kernel_batch",
    "kernel_rhs",
    "kernel_bounds",
    "kernel_agreement",
    "kernel_long",
    "kernel_energy",
    "kernel_kinematics",
    "scaling",
    "kernel_growth",
)
PACKAGES = ("gauss-bench", "numpy", "scipy", "casadi", "llvmlite", "pin", "exudyn", "mujoco")


def table(rows: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """All columns in order, rows sorted by key, texts never missing, numbers NaN where there is none."""
    frame = pd.DataFrame(list(rows)).reindex(columns=[*KEY, *TEXTS, *FLAGS, *NUMBERS, *COSTS])
    for column in [*KEY[:6], *TEXTS]:
        frame[column] = frame[column].fillna("").astype(str)
    for column in FLAGS:
        frame[column] = frame[column].fillna(False).astype(bool)
    for column in [*KEY[6:], *NUMBERS, *COSTS]:
        frame[column] = frame[column].astype(float)
    return frame.sort_values(KEY, ascending=[True] * 6 + [False, True], kind="stable", ignore_index=True)


def write_table(frame: pd.DataFrame, path: Path, provenance: dict[str, Any] | None = None) -> None:
    """CSV (diffable, ten digits) or Parquet (types, provenance in its metadata) by the ending of the path; atomic."""
    if path.suffix == ".csv":
        # errors mean something in their first digits; Parquet keeps them all
        atomically(path, lambda part: frame.to_csv(part, index=False, float_format="%.10g", lineterminator="\n"))
        return
    import pyarrow as pa
    import pyarrow.parquet as pq

    content = pa.Table.from_pandas(frame, preserve_index=False)
    metadata = {**(content.schema.metadata or {}), b"gauss_bench": json.dumps(provenance or {}).encode()}
    atomically(path, lambda part: pq.write_table(content.replace_schema_metadata(metadata), part, compression="zstd"))


def read_table(path: Path) -> pd.DataFrame:
    """A table written by `write_table`."""
    if path.suffix == ".parquet":
        return pd.read_parquet(path)
    frame = pd.read_csv(path, keep_default_na=False, na_values={c: [""] for c in [*NUMBERS, *COSTS]})
    return frame


def atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file beside `path`, then put it in place in one move."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(part)
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    atomically(path, lambda part: part.write_text(text, encoding="utf-8"))


def package_versions() -> dict[str, str]:
    """Versions of what computes; engines that are not installed are left out."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def environment() -> dict[str, Any]:
    """Where and with what a run was made."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commit": _git("rev-parse", "--short=12", "HEAD"),
        "dirty": bool(_git("status", "--porcelain", "--untracked-files=no")),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "threads": 1,
        "blas": _blas(),
        "versions": package_versions(),
    }


def _git(*arguments: str) -> str:
    try:
        command = ["git", "-C", str(Path(__file__).parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


def _cpu() -> str:
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


def _blas() -> str:
    import numpy as np

    config: Any = np.show_config(mode="dicts")
    blas = config.get("Build Dependencies", {}).get("blas", {})
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
