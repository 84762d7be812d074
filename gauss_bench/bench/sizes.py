"""The size on disk of an engine: its environment, or its library with all packages that the library requires."""

import math
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from gauss_bench.engines import AUTHORED, ELSEWHERE, environment_of
from gauss_bench.engines.installation import read_offered

MEGABYTE = 1e6
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")  # name of a package, with which a line of requirements begins


@dataclass(frozen=True)
class Size:
    """The size on disk of an engine [MB], NaN if unknown; `measured` names what was measured, or the reason why nothing was."""

    megabytes: float
    measured: str


def size_of(engine: str) -> Size:
    """Return the size on disk of an engine's environment, or of its library."""
    if environment := environment_of(engine):
        folder = Path(environment.python).parent.parent
        if not (folder / "pyvenv.cfg").is_file():  # every environment that venv makes has this file
            return Size(math.nan, "its interpreter is in no environment of its own that could be measured")
        files = (Path(place, file) for place, _, names in os.walk(folder) for file in names)  # links are not followed
        return Size(size_of_files(files) / MEGABYTE, "its environment")
    if engine in ELSEWHERE:  # its environment is not installed here
        return Size(read_offered(engine).installed, "its environment, as stated before installation")
    if engine in AUTHORED:
        return Size(math.nan, "a part of the suite")
    packages = [*required_by(direct_requirements(engine))]
    if not packages:
        return Size(math.nan, "no package of this environment is known to be its library")
    return Size(sum(map(size_of_distribution, packages)) / MEGABYTE, "its library and what that requires")


def size_of_distribution(package: Distribution) -> int:
    """Return the size [bytes] of the files of an installed package, without caches of compiled Python."""
    return size_of_files([Path(str(x.locate())) for x in package.files or ()])


def size_of_files(paths: Iterable[Path]) -> int:
    """Return the total size [bytes] of files, without symbolic links and without caches of compiled Python, which grow with use."""
    files = [path for path in paths if path.is_file() and not path.is_symlink() and "__pycache__" not in path.parts]
    return sum(path.stat().st_size for path in files)


def direct_requirements(engine: str) -> list[str]:
    """Return the names of the packages that this suite's extra `gauss-bench[ENGINE]` requires; empty without such an extra."""
    try:
        lines = distribution("gauss-bench").requires or []
    except PackageNotFoundError:
        return []
    of_extra = re.compile(rf"extra == ['\"]{re.escape(engine)}['\"]")
    return [name[0] for line in lines if of_extra.search(line) and (name := NAME.match(line))]


def required_by(names: Iterable[str]) -> Iterator[Distribution]:
    """Yield the installed packages with these names and all packages that they require, except for their extras, each once."""
    waiting, seen = [*names], set()
    while waiting:
        name = waiting.pop()
        plain = re.sub(r"[-_.]+", "-", name).lower()  # the same package may be spelt in several ways
        if plain in seen:
            continue
        seen.add(plain)
        try:
            package = distribution(name)
        except PackageNotFoundError:  # required only on other systems
            continue
        yield package
        waiting += [x[0] for line in package.requires or () if "extra ==" not in line and (x := NAME.match(line))]
