"""Validation and benchmarking of closed-loop planar linkage dynamics.

    load(name_or_path, scenario=None) -> Mechanism
    simulate(name_or_path, engine, ...) -> dict, as `gauss-bench simulate --json` prints it
    compile_kernel(mechanism, formulation="auto", stabilization="none", ...) -> Kernel, native code of a linkage
    compare(name_or_path, engines=None, ...) -> DataFrame, one row per engine, setting and step

Each is loaded when first asked for, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
__all__ = ["Kernel", "__version__", "compare", "compile_kernel", "load", "simulate"]

_HOMES = {"load": "gauss_bench.mechanism.load", "simulate": "gauss_bench.api.simulate", "compare": "gauss_bench.api.compare"}
_HOMES |= {"compile_kernel": "gauss_bench.compiler.kernel", "Kernel": "gauss_bench.compiler.kernel"}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
