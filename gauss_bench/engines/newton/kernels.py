"""Newton's kernels, which Warp compiles to machine code at their first use; that takes a minute, and they are kept."""

import os
import tempfile
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gauss_bench.compiler.user_cache import is_trusted

FOLDER = "warp"  # of machine code, in the folder of the user's cache
MADE = "kamino-{}.made"  # file there: all kernels were compiled
PACKAGES = ("newton", "warp-lang")


@dataclass(frozen=True)
class Libraries:
    """The modules that the adapter needs.

    Attributes:
        folder: of the kernels; a temporary one is deleted when the process ends.
    """

    warp: Any
    newton: Any
    folder: object


@cache
def load_libraries() -> Libraries:
    """Import Warp and Newton, on the processor, with kernels in a folder that this user alone may enter.

    Raises:
        ImportError: one is not installed.
    """
    import warp

    trusted = is_trusted()
    folder = trusted / FOLDER if trusted else tempfile.TemporaryDirectory(prefix="gauss-bench-")
    warp.config.kernel_cache_dir = os.fspath(folder) if isinstance(folder, Path) else folder.name
    warp.config.quiet = True
    import newton

    warp.set_device("cpu")
    return Libraries(warp, newton, folder)


def find_mark() -> Path | None:
    """Return the path of the file that tells that all kernels of these releases are compiled; None if none are kept."""
    folder = is_trusted()
    return folder / FOLDER / MADE.format("-".join(map(version, PACKAGES))) if folder else None


def are_compiled() -> bool:
    """Tell whether no kernels are left to compile before a run; where none can be kept, each process compiles its own."""
    mark = find_mark()
    return mark is None or mark.exists()


def mark_compiled() -> None:
    """Note that all kernels are compiled."""
    if mark := find_mark():
        mark.parent.mkdir(exist_ok=True)
        mark.touch()
