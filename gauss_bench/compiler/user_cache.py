"""The compiler's cache on disk: object code in `NAME.o`, the outcome of a search in `NAME.json`.

Machine code from the cache is executed, so only files that this user wrote are loaded: all are in one folder that belongs to the
user and that nobody else may enter. A file begins with the hash of its content; one that does not match is ignored. Files
appear as a whole (`atomic.py`); what killed processes left unfinished is removed by a later write.
"""

import hashlib
import os
import stat
import time
from contextlib import suppress
from pathlib import Path

from gauss_bench.atomic import PART, write_bytes

DIGEST = hashlib.sha256().digest_size
LEFT = 600.0  # age [s] of an unfinished file from which nobody is writing it any more
MAGIC = b"gauss-bench cache 2\n"


def folder() -> Path:
    """Return the folder of the cache."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    home = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    return home / "gauss-bench" / "kernels"


def is_trusted() -> Path | None:
    """Return the folder, created if needed; None if it does not belong to the user or others may enter it."""
    path = folder()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
        status = path.lstat()
    except OSError:
        return None
    own = not hasattr(os, "getuid") or status.st_uid == os.getuid()
    closed = os.name == "nt" or stat.S_IMODE(status.st_mode) == 0o700
    return path if stat.S_ISDIR(status.st_mode) and own and closed else None


def load(name: str) -> bytes | None:
    """Read an entry, or None."""
    path = is_trusted()
    if path is None:
        return None
    try:
        content = (path / name).read_bytes()
    except OSError:
        return None
    head = len(MAGIC) + DIGEST
    kept = content[head:]
    return kept if content[:head] == MAGIC + _digest(name, kept) and kept else None


def store(name: str, content: bytes) -> bool:
    """Store an entry under a name; return False if that is not possible."""
    path = is_trusted()
    if path is None:
        return False
    _collect(path)
    try:
        write_bytes(path / name, MAGIC + _digest(name, content) + content)
    except OSError:
        return False
    return True


def _collect(path: Path) -> None:
    """Remove temporary files of killed processes."""
    for left in path.glob(f"*{PART}"):
        with suppress(OSError):
            if abs(time.time() - left.stat().st_mtime) > LEFT:  # a clock may have jumped either way
                left.unlink()


def _digest(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + content).digest()
