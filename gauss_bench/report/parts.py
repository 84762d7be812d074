"""Find the sections of a package: a new section is a new file, without registration."""

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType


def parts_of(package: ModuleType) -> list[ModuleType]:
    """Return the modules of a package in the order of their PLACE."""
    names = (module.name for module in iter_modules(package.__path__))
    return sorted((import_module(f"{package.__name__}.{name}") for name in names), key=lambda m: (m.PLACE, m.__name__))
