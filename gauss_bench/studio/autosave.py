"""The drawing that is not saved yet, kept beside the user's caches, so that neither browser nor server can lose it.

A file belongs to one process and one document; what a dead process left is offered to whoever opens the same document next.
"""

import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from gauss_bench.tables import write_text

NAME = re.compile(r"[A-Za-z0-9_]{1,60}")
LARGEST = 8 << 20  # bytes; what is larger is not ours


@dataclass(frozen=True)
class Picture:
    """A picture behind the grid: as an address that holds it, with its lower left corner [m], width and height [m]."""

    url: str
    at: tuple[float, float]
    width: float
    height: float

    @cached_property
    def id(self) -> str:
        """By which a page knows whether it has it already."""
        return hashlib.sha256(self.url.encode()).hexdigest()[:16]

    def as_named(self) -> dict[str, Any]:
        """Its place and size, and its name instead of itself."""
        return {"id": self.id, "at": list(self.at), "width": self.width, "height": self.height}


@dataclass(frozen=True)
class Left:
    """The remains of a process: the text, ids of what was locked, and the picture behind them."""

    file: Path
    text: str
    locks: tuple[str, ...]
    picture: Picture | None = None


def folder() -> Path:
    """The folder of drawings that are not saved yet."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "gauss-bench" / "studio"


class Autosave:
    """The file of this process for one document: `named` is its path, or a word for a new drawing."""

    def __init__(self, named: str):
        self.key = hashlib.sha256(named.encode("utf-8", "surrogateescape")).hexdigest()[:20]
        self.file = folder() / f"{self.key}.{os.getpid()}.json"

    def keep(self, text: str, locks: tuple[str, ...]) -> None:
        """Keep this."""
        store(self.file, {"text": text, "locks": locks, "process": os.getpid(), "since": since(os.getpid())})

    def lay(self, picture: Picture | None) -> None:
        """Keep a picture, in a file of its own: it is large, and changes seldom."""
        store(picture_of(self.file), None if picture is None else asdict(picture))

    def forget(self) -> None:
        """Keep nothing of this document any more."""
        forget(self.file)

    def left(self) -> Left | None:
        """The newest remains of this document by a process that is no more; spoilt ones are as if they were not there."""
        saved = []
        with suppress(OSError):
            for path in folder().glob(f"{self.key}.*.json"):
                with suppress(OSError, ValueError, KeyError, TypeError):
                    said = load(path)
                    text, locks, process = said["text"], said["locks"], int(said["process"])
                    sound = isinstance(text, str) and isinstance(locks, list) and all(isinstance(x, str) for x in locks)
                    if sound and (process == os.getpid() or since(process) != said["since"]) and path != self.file:
                        saved.append(Left(path, text, tuple(locks), _picture(picture_of(path))))
            return max(saved, key=lambda x: x.file.lstat().st_mtime, default=None)
        return None


def keep_text(paths: Iterable[Path]) -> list[str]:
    """Names of those files of which a process that is no more left what it had not saved."""
    with suppress(OSError):
        keys = {path.name.partition(".")[0] for path in folder().glob("*.json")}
        saved = {path.name: Autosave(str(path)) for path in paths}
        return [name for name, own in saved.items() if own.key in keys and own.left()]
    return []


def store(file: Path, content: dict[str, Any] | None) -> None:
    """Write a file, or none; where the folder cannot be written there is nothing that can be done, and drawing goes on."""
    with suppress(OSError):
        if content is None:
            file.unlink(missing_ok=True)
        else:
            file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_text(file, json.dumps(content))


def load(file: Path) -> Any:
    """The content of a file of ours.

    Raises:
        OSError, ValueError: it is none.
    """
    if not file.is_file() or file.is_symlink() or file.stat().st_size > LARGEST:
        raise ValueError("no file of ours")
    return json.loads(file.read_text(encoding="utf-8"))


def forget(file: Path) -> None:
    """Remove a text and its picture."""
    store(file, None)
    store(picture_of(file), None)


def picture_of(file: Path) -> Path:
    """The place of the picture that belongs to the text of a file."""
    return file.with_suffix(".picture")


def _picture(path: Path) -> Picture | None:
    """The picture of a file; None where there is none, or it is spoilt."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        said = load(path)
        (x, y), width, height = said["at"], said["width"], said["height"]
        if isinstance(said["url"], str) and said["url"].startswith("data:image/"):
            return Picture(said["url"], (float(x), float(y)), float(width), float(height))
    return None


@contextmanager
def workplace(text: str, name: Any, suffix: str = ".toml") -> Iterator[Path]:
    """A file of this text called `name` + suffix, for those who read from files; gone with its folder afterwards.

    Raises:
        OSError: neither under the caches nor among temporary files can one be written.
    """
    try:
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        home = folder() if os.access(folder(), os.W_OK) else None
    except OSError:
        home = None  # among temporary files, then
    prefix = f"run.{os.getpid()}.{since(os.getpid())}."
    with tempfile.TemporaryDirectory(prefix=prefix, dir=home, ignore_cleanup_errors=True) as made:
        path = Path(made) / f"{name if isinstance(name, str) and NAME.fullmatch(name) else 'drawing'}{suffix}"
        path.write_text(text, encoding="utf-8")
        yield path


def collect() -> None:
    """Remove the workplaces of processes that are no more."""
    with suppress(OSError):
        for path in folder().glob("run.*"):
            _, process, began, *_ = [*path.name.split("."), "", ""]
            if process.isdigit() and since(int(process)) != began and path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)


def since(process: int) -> str:
    """When a process began, in the system's own words; "" where it is no more, though nobody may have asked how it ended."""
    with suppress(OSError, IndexError):
        fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        return "" if fields[0] in "ZX" else fields[19]
    if Path("/proc/self/stat").exists():
        return ""
    try:
        os.kill(process, 0)
    except OSError:
        return ""
    return "alive"
