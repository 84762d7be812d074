"""Deprecated: `gauss_bench.load` and what else lies in `gauss_bench.linkage.load`; goes with the next release."""

import warnings
from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    if name.startswith("__"):  # what the import itself asks for
        raise AttributeError(name)
    home = import_module("gauss_bench.linkage.load")  # asked for by name alone: the room knows no linkage file
    warnings.warn("gauss_bench.mechanism.load is now gauss_bench.linkage.load", DeprecationWarning, stacklevel=2)
    return getattr(home, name)
