"""Find the modules of a package, so that a new section of the report needs only a new file."""

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType


def parts_of(package: ModuleType) -> list[ModuleType]:
    """Return the modules of a package, sorted by the number PLACE of each module, then by name."""
    modules = [import_module(f"{package.__name__}.{found.name}") for found in iter_modules(package.__path__)]
    return sorted(modules, key=lambda module: (module.PLACE, module.__name__))
