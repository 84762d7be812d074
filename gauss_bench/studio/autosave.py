"""Keep unsaved drawings in the user's cache folder, so that nothing is lost when the browser or the server ends.

Each file of unsaved work belongs to one process of the studio and one document. After the process has ended, the studio offers the
unsaved work when a user opens the document again.
"""

import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from gauss_bench.atomic import write_text

NAME = re.compile(r"[A-Za-z0-9_]{1,60}")  # names that a temporary file may have
LARGEST = 8 << 20  # [bytes] larger files are ignored, because the studio writes none


@dataclass(frozen=True)
class Picture:
    """A picture behind the grid.

    Attributes:
        url: the picture itself as a data URL.
        at: x and y of its lower left corner [m].
        width, height: its size [m].
    """

    url: str
    at: tuple[float, float]
    width: float
    height: float

    @cached_property
    def id(self) -> str:
        """A hash by which a page knows whether it has the picture already."""
        return hashlib.sha256(self.url.encode()).hexdigest()[:16]

    def describe(self) -> dict[str, Any]:
        """Return place, size and id, without the picture itself."""
        return {"id": self.id, "at": list(self.at), "width": self.width, "height": self.height}


@dataclass(frozen=True)
class Unsaved:
    """Unsaved work that was kept in a file.

    Attributes:
        file: path of this file.
        text: text of the linkage file.
        locks: ids of locked parts.
        picture: picture behind the grid, or None.
    """

    file: Path
    text: str
    locks: tuple[str, ...]
    picture: Picture | None = None


def cache_folder() -> Path:
    """Return the folder of unsaved drawings: in XDG_CACHE_HOME if this is an absolute path, otherwise in ~/.cache."""
    caches = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(caches) if os.path.isabs(caches) else Path.home() / ".cache") / "gauss-bench" / "studio"


class Autosave:
    """The file in which this process keeps the unsaved work on one document.

    Attributes:
        key: hash of the document's name: the path of its file, or for a new drawing a path in the working folder.
        file: path of the file in the cache folder, KEY.PROCESS.json.
    """

    def __init__(self, name: str):
        """Choose the file in the cache folder for the document with the given name."""
        self.key = hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:20]
        self.file = cache_folder() / f"{self.key}.{os.getpid()}.json"

    def keep(self, text: str, locks: tuple[str, ...], picture: Picture | None) -> None:
        """Write unsaved work to the file; if the file cannot be written, the work is not kept and no error is raised."""
        content = {"text": text, "locks": locks, "picture": picture and asdict(picture)}
        # number and start time of this process ("since") tell later whether the studio that wrote the file still runs
        with suppress(OSError):
            self.file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_text(self.file, json.dumps(content | {"process": os.getpid(), "since": start_of(os.getpid())}))

    def find_unsaved(self) -> Unsaved | None:
        """Return the newest unsaved work on this document that an ended process has kept, or None; ignore damaged files."""
        unsaved = []
        with suppress(OSError):
            for path in cache_folder().glob(f"{self.key}.*.json"):
                with suppress(OSError, ValueError, KeyError, TypeError):  # a damaged or deleted file does not stop the search
                    if path == self.file or path.is_symlink() or not path.is_file() or path.stat().st_size > LARGEST:
                        continue
                    content = json.loads(path.read_text(encoding="utf-8"))
                    process = int(content["process"])
                    # process numbers are reused: only number and start time together identify a process. This process writes only
                    # `self.file`: another file with its number is from a process that has ended
                    if process == os.getpid() or start_of(process) != content["since"]:
                        unsaved.append(_parse(path, content))
            return max(unsaved, key=lambda x: x.file.lstat().st_mtime, default=None)
        return None


def _parse(file: Path, content: dict[str, Any]) -> Unsaved:
    """Return the unsaved work from the content of a file that `Autosave.keep` has written.

    Raises:
        KeyError, TypeError, ValueError: the content is damaged.
    """
    text, locks, entry = content["text"], content["locks"], content.get("picture")
    if not isinstance(text, str) or not isinstance(locks, list) or not all(isinstance(x, str) for x in locks):
        raise TypeError("text or locks have a wrong type")
    picture = None
    if entry is not None and str(entry["url"]).startswith("data:image/"):
        x, y = entry["at"]
        picture = Picture(entry["url"], (float(x), float(y)), float(entry["width"]), float(entry["height"]))
    return Unsaved(file, text, tuple(locks), picture)


def forget(file: Path) -> None:
    """Delete a file of unsaved work; do nothing if it does not exist or cannot be deleted."""
    with suppress(OSError):
        file.unlink(missing_ok=True)


@contextmanager
def temporary_file(text: str, name: Any, suffix: str = ".toml") -> Iterator[Path]:
    """Yield the path of a temporary file with a text, for functions that read files; the file is deleted afterwards.

    The file is called `name`, or "drawing" if `name` is not a text of at most 60 letters, digits and underscores.

    Raises:
        OSError: no file can be written, neither in the cache folder nor in the system's temporary folder.
    """
    try:
        cache_folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        parent = cache_folder() if os.access(cache_folder(), os.W_OK) else None
    except OSError:
        parent = None  # TemporaryDirectory then takes the system's temporary folder
    # number and start time identify this process, so that `remove_orphans` can tell later that it has ended
    prefix = f"run.{os.getpid()}.{start_of(os.getpid())}."
    with tempfile.TemporaryDirectory(prefix=prefix, dir=parent, ignore_cleanup_errors=True) as folder:
        path = Path(folder) / f"{name if isinstance(name, str) and NAME.fullmatch(name) else 'drawing'}{suffix}"
        path.write_text(text, encoding="utf-8")
        yield path


def remove_orphans() -> None:
    """Delete the folders that `temporary_file` made for processes that have ended."""
    with suppress(OSError):
        for path in cache_folder().glob("run.*.*.*"):
            _, process, began, *_ = path.name.split(".")
            if process.isdigit() and start_of(int(process)) != began and path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)


def start_of(process: int) -> str:
    """Return the start time of a process [clock ticks] as text; "" if it has ended. Without /proc, return "alive" while it runs."""
    with suppress(OSError, IndexError):
        # after the name in brackets, which may contain spaces, the first field is the state and the 20th the start time
        fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        return "" if fields[0] in "ZX" else fields[19]  # Z: a zombie, which has ended; X: dead
    if Path("/proc/self/stat").exists():
        return ""
    try:
        os.kill(process, 0)
    except OSError:
        return ""
    return "alive"
