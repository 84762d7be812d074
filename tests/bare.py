"""Make an environment with the wheel and the packages that it requires, as after `pip install gauss-bench` without extras.

Nothing is downloaded. The required packages are links to those of the running environment; their own requirements tell which
packages are needed.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
ENVIRONMENT = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | {"OMP_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Bare:
    """An environment: its interpreter `python`, and a `folder` in which commands run."""

    python: Path
    folder: Path

    def run(self, *arguments: str, limit: float = 300.0) -> subprocess.CompletedProcess[str]:
        """Run `gauss-bench ARGUMENTS` in the environment, for `limit` [s] at most."""
        command = [str(self.python), "-I", "-m", "gauss_bench", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=limit, cwd=self.folder, env=ENVIRONMENT, check=False)


def wheel(folder: Path) -> Path:
    """Build the project's wheel into a folder, and return its path."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT, env=ENVIRONMENT)
    (found,) = folder.glob("*.whl")
    return found


def required(lines: list[str], known: set[str]) -> Iterator[Distribution]:
    """Yield the distributions that requirements need, directly or through others; extras that nobody asks for are left out.

    Args:
        lines: requirements.
        known: names that were yielded before; it is extended.
    """
    for line in lines:
        requirement = Requirement(line)
        name = requirement.name.lower().replace("_", "-")
        extras = [*requirement.extras, ""]
        if name in known or (requirement.marker and not requirement.marker.evaluate({**default_environment(), "extra": ""})):
            continue
        known.add(name)
        found = distribution(requirement.name)
        yield found
        needed = [x for x in found.requires or [] if any(_wanted(x, extra) for extra in extras)]
        yield from required([x.split(";")[0] for x in needed], known)


def _wanted(line: str, extra: str) -> bool:
    """Tell whether a requirement applies in this environment with an extra."""
    marker = Requirement(line).marker
    return marker is None or marker.evaluate({**default_environment(), "extra": extra})


def bare(folder: Path) -> Bare:
    """Make the environment in an empty folder, and return it."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True, env=ENVIRONMENT)
    (site,) = (folder / "venv" / "lib").glob("python*/site-packages")
    built = wheel(folder)
    python = folder / "venv" / "bin" / "python"
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps", "--no-index", "--quiet", str(built)]
    subprocess.run(command, check=True, env=ENVIRONMENT)
    (own,) = site.glob("gauss_bench-*.dist-info")
    for found in required(_base(own), set()):
        places = {Path(str(file)).parts[0] for file in found.files or []} - {"..", "__pycache__"}
        for name in places:
            (site / name).exists() or (site / name).symlink_to(Path(str(found.locate_file(name))))
    work = folder / "work"
    work.mkdir()
    return Bare(python, work)


def _base(info: Path) -> list[str]:
    """Return the requirements in the metadata of a distribution that apply without any extra."""
    lines = (info / "METADATA").read_text(encoding="utf-8").split("\n\n")[0].splitlines()
    stated = [line.removeprefix("Requires-Dist: ") for line in lines if line.startswith("Requires-Dist: ")]
    return [line for line in stated if _wanted(line, "")]
