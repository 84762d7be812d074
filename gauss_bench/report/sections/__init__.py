"""The sections of the report, each in a file; `report/build.py` describes the functions of such a file."""

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType


def all_sections() -> list[ModuleType]:
    """Return the modules of this package, sorted by the number PLACE of each module, then by name."""
    modules = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]
    return sorted(modules, key=lambda module: (module.PLACE, module.__name__))
