"""Validation and benchmarking of closed-loop planar linkage dynamics.

    load(name_or_path, scenario=None) -> Mechanism
    simulate(name_or_path, engine, ...) -> dict, as `gauss-bench simulate --json` prints it
    compare(name_or_path, engines=None, ...) -> DataFrame, one row per engine, setting and step

Each is loaded when first asked for, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
__all__ = ["__version__", "compare", "load", "simulate"]

_HOMES = {"load": "gauss_bench.mechanism.load", "simulate": "gauss_bench.api.simulate", "compare": "gauss_bench.api.compare"}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
