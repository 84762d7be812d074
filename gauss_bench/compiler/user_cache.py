"""The compiler's cache on disk: object code in `NAME.o`, the outcome of a search in `NAME.json`.

Machine code from the cache is executed. All files are therefore in one folder that belongs to the user and that nobody else may
enter. A file begins with a hash of its name and content, and is ignored if the hash does not match. Files are written atomically
(`atomic.py`); the unfinished files of killed processes are removed when another file is stored.
"""

import hashlib
import os
import stat
import time
from contextlib import suppress
from pathlib import Path

from gauss_bench.atomic import PART, write_bytes

DIGEST = hashlib.sha256().digest_size
LEFT = 600.0  # [s] age of an unfinished file whose process has ended
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
    """Return the content of an entry, or None if there is none that may be used."""
    path = is_trusted()
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
            if abs(time.time() - left.stat().st_mtime) > LEFT:  # absolute, as a clock may have been set back
                left.unlink()


def _digest(name: str, content: bytes) -> bytes:
    """Return the hash of an entry's name and content."""
    return hashlib.sha256(name.encode() + content).digest()
