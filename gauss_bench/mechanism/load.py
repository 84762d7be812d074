"""Deprecated alias of `gauss_bench.linkage.load`; the next release will not have it."""

import warnings
from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    if name.startswith("__"):  # attributes that the import system looks up
        raise AttributeError(name)
    home = import_module("gauss_bench.linkage.load")  # by name, because this folder must not import gauss_bench.linkage
    warnings.warn("gauss_bench.mechanism.load is now gauss_bench.linkage.load", DeprecationWarning, stacklevel=2)
    return getattr(home, name)
