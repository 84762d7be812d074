"""The sections of a room, found by looking: a new one is a file and nothing else."""

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType


def parts_of(package: ModuleType) -> list[ModuleType]:
    """The sections of a room, in order."""
    names = (module.name for module in iter_modules(package.__path__))
    return sorted((import_module(f"{package.__name__}.{name}") for name in names), key=lambda m: (m.PLACE, m.__name__))
