"""Store the machine code of Newton's kernels, which Warp compiles when they first run; this takes minutes."""

import tempfile
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gauss_bench.compiler.user_cache import trusted_folder

FOLDER = "warp"  # folder of machine code, in the user's cache
MADE = "kamino-{}.made"  # file in FOLDER whose presence says that all kernels of these versions are compiled
PACKAGES = ("newton", "warp-lang")


@dataclass(frozen=True)
class Libraries:
    """The modules `warp` and `newton`.

    Attributes:
        folder: folder of the kernels; if it is a temporary one, it is deleted together with this object.
    """

    warp: Any
    newton: Any
    folder: object


@cache
def load_libraries() -> Libraries:
    """Import Warp and Newton for the CPU; compiled kernels are stored in a folder that only this user may enter.

    Raises:
        ImportError: Warp or Newton is not installed.
    """
    import warp

    folder: Path | tempfile.TemporaryDirectory[str]
    if trusted := trusted_folder():
        folder = trusted / FOLDER
        warp.config.kernel_cache_dir = str(folder)
    else:
        folder = tempfile.TemporaryDirectory(prefix="gauss-bench-")
        warp.config.kernel_cache_dir = folder.name
    warp.config.quiet = True
    import newton

    warp.set_device("cpu")
    return Libraries(warp, newton, folder)


def find_mark() -> Path | None:
    """Return the path of the file that marks the kernels of the installed versions as compiled, or None without a safe folder."""
    folder = trusted_folder()
    return folder / FOLDER / MADE.format("-".join(map(version, PACKAGES))) if folder else None


def are_compiled() -> bool:
    """Tell whether `build_once` has nothing to do: all kernels are stored, or there is no safe folder to store them in."""
    mark = find_mark()
    return mark is None or mark.exists()


def mark_compiled() -> None:
    """Write the file that marks all kernels as compiled."""
    if mark := find_mark():
        mark.parent.mkdir(exist_ok=True)
        mark.touch()
