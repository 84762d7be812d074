"""Keep unsaved drawings in the user's cache folder, so that neither a browser nor a server that ends can lose them.

A file belongs to one process and one document. If the process has ended, its file is offered when the document is opened next.
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
LARGEST = 8 << 20  # bytes: a larger file was not written by the studio


@dataclass(frozen=True)
class Picture:
    """A picture behind the grid: its data URL, lower left corner, width and height [m]."""

    url: str
    at: tuple[float, float]
    width: float
    height: float

    @cached_property
    def id(self) -> str:
        """A hash by which a page knows whether it has the picture already."""
        return hashlib.sha256(self.url.encode()).hexdigest()[:16]

    def as_named(self) -> dict[str, Any]:
        """Return place, size and id, without the picture itself."""
        return {"id": self.id, "at": list(self.at), "width": self.width, "height": self.height}


@dataclass(frozen=True)
class Left:
    """Unsaved work that an ended process has left: the text, the ids of locks, and the picture."""

    file: Path
    text: str
    locks: tuple[str, ...]
    picture: Picture | None = None


def folder() -> Path:
    """Return the folder of unsaved drawings."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "gauss-bench" / "studio"


class Autosave:
    """The file that this process keeps for one document; `named` is the document's path, or a word for a new drawing."""

    def __init__(self, named: str):
        self.key = hashlib.sha256(named.encode("utf-8", "surrogateescape")).hexdigest()[:20]
        self.file = folder() / f"{self.key}.{os.getpid()}.json"

    def keep(self, text: str, locks: tuple[str, ...]) -> None:
        """Keep a text and its locks."""
        store(self.file, {"text": text, "locks": locks, "process": os.getpid(), "since": since(os.getpid())})

    def lay(self, picture: Picture | None) -> None:
        """Keep a picture in a separate file, because it is large and changes rarely."""
        store(picture_of(self.file), None if picture is None else asdict(picture))

    def forget(self) -> None:
        """Delete what is kept of this document."""
        forget(self.file)

    def left(self) -> Left | None:
        """Return the newest unsaved work that an ended process left of this document; damaged files are ignored."""
        saved = []
        with suppress(OSError):
            for path in folder().glob(f"{self.key}.*.json"):
                with suppress(OSError, ValueError, KeyError, TypeError):
                    content = load(path)
                    text, locks, process = content["text"], content["locks"], int(content["process"])
                    # a process number may be in use again: only number and start time together identify a process
                    sound = isinstance(text, str) and isinstance(locks, list) and all(isinstance(x, str) for x in locks)
                    if sound and (process == os.getpid() or since(process) != content["since"]) and path != self.file:
                        saved.append(Left(path, text, tuple(locks), _picture(picture_of(path))))
            return max(saved, key=lambda x: x.file.lstat().st_mtime, default=None)
        return None


def keep_text(paths: Iterable[Path]) -> list[str]:
    """List the names of the files of which an ended process left unsaved work."""
    with suppress(OSError):
        keys = {path.name.partition(".")[0] for path in folder().glob("*.json")}
        saved = {path.name: Autosave(str(path)) for path in paths}
        return [name for name, own in saved.items() if own.key in keys and own.left()]
    return []


def store(file: Path, content: dict[str, Any] | None) -> None:
    """Write a file, or delete it if the content is None; if that fails, drawing goes on without it."""
    with suppress(OSError):
        if content is None:
            file.unlink(missing_ok=True)
        else:
            file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_text(file, json.dumps(content))


def load(file: Path) -> Any:
    """Load a file that the studio has written.

    Raises:
        OSError, ValueError: it cannot be read, or the studio has not written it.
    """
    if not file.is_file() or file.is_symlink() or file.stat().st_size > LARGEST:
        raise ValueError("no file of ours")
    return json.loads(file.read_text(encoding="utf-8"))


def forget(file: Path) -> None:
    """Remove a text and its picture."""
    store(file, None)
    store(picture_of(file), None)


def picture_of(file: Path) -> Path:
    """Return the path of the picture that belongs to a kept text."""
    return file.with_suffix(".picture")


def _picture(path: Path) -> Picture | None:
    """Load the picture of a file; None if there is none or it is damaged."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        content = load(path)
        (x, y), width, height = content["at"], content["width"], content["height"]
        if isinstance(content["url"], str) and content["url"].startswith("data:image/"):
            return Picture(content["url"], (float(x), float(y)), float(width), float(height))
    return None


@contextmanager
def workplace(text: str, name: Any, suffix: str = ".toml") -> Iterator[Path]:
    """Yield a temporary file with this text, called `name` + suffix, for functions that read from files.

    Raises:
        OSError: no file can be written, neither in the cache folder nor in the system's temporary folder.
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
    """Delete the temporary files of processes that have ended."""
    with suppress(OSError):
        for path in folder().glob("run.*"):
            _, process, began, *_ = [*path.name.split("."), "", ""]
            if process.isdigit() and since(int(process)) != began and path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)


def since(process: int) -> str:
    """Return when a process began, in the system's own units; "" if it has ended, even if it is still a zombie."""
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
