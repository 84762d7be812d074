"""Install a package with engines of others, as pip would leave it, and make environments that have little else."""

import os
import venv
from collections.abc import Mapping
from pathlib import Path

import numpy as np


def installed(folder: Path, package: str, names: tuple[str, ...]) -> dict[str, str]:
    """Write a package into a folder, and return the variables of a process that can import it.

    Args:
        package: source of the module `others`.
        names: names of its engines; the class of an engine is its name with a capital letter.
    """
    (folder / "others.py").write_text(package, encoding="utf-8")
    made = folder / "others-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n", encoding="utf-8")
    points = "".join(f"{x} = others:{x.capitalize()}\n" for x in names)
    (made / "entry_points.txt").write_text(f"[gauss_bench.engines]\n{points}", encoding="utf-8")
    root = str(Path(__file__).parents[1])
    return os.environ | {"PYTHONPATH": os.pathsep.join([root, str(folder)])}


def link_numpy(folder: Path) -> None:
    """Let the numpy of this environment be imported from a folder."""
    for part in ("numpy", "numpy.libs"):
        if (there := Path(np.__file__).parents[1] / part).exists():
            (folder / part).symlink_to(there)


def environment_with(files: Mapping[str, str], folder: Path) -> Path:
    """Make a Python environment that has numpy and these files, and nothing else, and return its interpreter."""
    venv.create(folder, with_pip=False)
    (site,) = folder.glob("lib/python*/site-packages")
    link_numpy(site)
    for name, text in files.items():
        (site / name).parent.mkdir(exist_ok=True)
        (site / name).write_text(text, encoding="utf-8")
    return folder / "bin" / "python"
