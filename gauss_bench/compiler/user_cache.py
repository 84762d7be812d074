"""The compiler's cache on disk: object code in `NAME.o`, the outcome of a search in `NAME.json`.

Machine code from the cache is executed. All files of the cache are therefore in one folder that belongs to the user and that nobody
else may enter. Each file of the cache begins with a hash of its name and content, and is ignored if the hash does not match. Files
are written atomically (`atomic.py`); the unfinished files of killed processes are removed when another file is stored.
"""

import hashlib
import os
import stat
import time
from contextlib import suppress
from pathlib import Path

from gauss_bench.atomic import PART, write_bytes

DIGEST = hashlib.sha256().digest_size
ABANDONED = 600.0  # [s] age above which an unfinished file is removed: its process must have been killed
MAGIC = b"gauss-bench cache 2\n"


def folder() -> Path:
    """Return the path of the cache folder: gauss-bench/kernels in $XDG_CACHE_HOME if that is an absolute path, else in ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    home = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    return home / "gauss-bench" / "kernels"


def trusted_folder() -> Path | None:
    """Create the cache folder if needed, and return its path; None if the folder is not the user's own or others may enter it."""
    path = folder()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
        status = path.lstat()
    except OSError:
        return None
    is_own = not hasattr(os, "getuid") or status.st_uid == os.getuid()
    is_private = os.name == "nt" or stat.S_IMODE(status.st_mode) == 0o700
    return path if stat.S_ISDIR(status.st_mode) and is_own and is_private else None


def load(name: str) -> bytes | None:
    """Return the content stored under a file name; None if the file is missing or damaged, or the folder is not trusted."""
    path = trusted_folder()
    if path is None:
        return None
    try:
        content = (path / name).read_bytes()
    except OSError:
        return None
    begin = len(MAGIC) + DIGEST
    head, entry = content[:begin], content[begin:]
    return entry if entry and head == MAGIC + _digest(name, entry) else None


def store(name: str, content: bytes) -> bool:
    """Store bytes under a file name; return False if the cache folder cannot be written or is not trusted (`trusted_folder`)."""
    path = trusted_folder()
    if path is None:
        return False
    for file in path.glob(f"*{PART}"):  # unfinished files of processes that were killed
        with suppress(OSError):
            if abs(time.time() - file.stat().st_mtime) > ABANDONED:  # absolute, as a clock may have been set back
                file.unlink()
    try:
        write_bytes(path / name, MAGIC + _digest(name, content) + content)
    except OSError:
        return False
    return True


def _digest(name: str, content: bytes) -> bytes:
    """Return the SHA-256 of the name and the content of a file of the cache."""
    return hashlib.sha256(name.encode() + content).digest()
