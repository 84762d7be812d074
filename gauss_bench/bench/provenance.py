"""Provenance of a run: date, commit, machine and versions."""

import os
import platform
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.runs.offers import NOT_INSTALLED, offers_from_outside
from gauss_bench.tables import ENVIRONMENT, TIMES, TableError, read_environment

PACKAGES = ("gauss-bench", "numpy", "scipy", "casadi", "llvmlite", "pin", "exudyn", "mujoco")  # of the suite and its adapters


def package_versions() -> dict[str, str]:
    """Return package -> version, for PACKAGES and the packages that engines name, without those that are not installed.

    If the environment of an engine has another version of a package, that version is listed as "PACKAGE of ENGINE".
    """
    versions = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    for engine in offers_from_outside():
        for name, found in engine.packages.items():
            is_same = versions.get(name, found) == found  # as in this process's environment, if the package is installed there
            if found != NOT_INSTALLED:
                versions[name if is_same else f"{name} of {engine.name}"] = found
    return versions


def check_publishable(folder: Path) -> None:
    """Check that a run may be published.

    The commit must be known, without uncommitted changes; kernels must have been compiled without shortcuts; and if the run has
    times, their processor must be recorded.

    Raises:
        TableError: the run may not be published.
    """
    facts = read_environment(folder)
    faults = {
        "does not name the commit of the code that was run": not facts.get("commit"),
        "the code had uncommitted changes": facts.get("dirty"),
        f"kernels were compiled with shortcuts: {facts.get('shortened')}": facts.get("shortened"),
        "does not name the processor on which times were measured": (folder / TIMES).exists() and not facts.get("cpu"),
    }
    for fault, is_present in faults.items():
        if is_present:
            raise TableError(f"{folder / ENVIRONMENT}: {fault}: not to be published")


def environment() -> dict[str, Any]:
    """Return the machine, the commit and the versions of a run that begins now."""
    from gauss_bench.compiler.elimination.program import SHORTER  # imported here, because it loads the compiler
    from gauss_bench.compiler.machine.native_code import QUICK

    config: Any = np.show_config(mode="dicts")
    blas = config.get("Build Dependencies", {}).get("blas", {})
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commit": _git("rev-parse", "--short=12", "HEAD"),
        "dirty": bool(_git("status", "--porcelain", "--untracked-files=no", "--", ":/", ":(top,exclude)reports")),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "shortened": " ".join(f"{name}={os.environ[name]}" for name in (SHORTER, QUICK) if os.environ.get(name)),
        "threads": 1,
        "blas": f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip(),
        "versions": package_versions(),
    }


def _git(*arguments: str) -> str:
    """Return the output of a git command in the folder of this package, or an empty text if it fails."""
    try:
        command = ["git", "-C", str(Path(__file__).parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


def _cpu() -> str:
    """Return the name of the processor."""
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()
