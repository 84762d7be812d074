"""Former module of the results of public functions, which are now defined beside these functions.

The next release will not have this module.
"""

import warnings
from importlib import import_module
from typing import Any

HOMES = {"Result": "telling", "OneRun": "simulate", "Simulation": "simulate", "Kinematics": "kinematics"}
HOMES |= dict.fromkeys(("Tuning", "Export", "Import"), "exchange")


def __getattr__(name: str) -> Any:
    """Return a class from the module in which it is now, with a warning."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = import_module(f"gauss_bench.api.{HOMES[name]}")
    warnings.warn(f"{__name__}.{name} is now {home.__name__}.{name}", DeprecationWarning, stacklevel=2)
    return getattr(home, name)
