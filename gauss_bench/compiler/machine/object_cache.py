"""Object code on disk: machine code that will be run, and so nothing is loaded that this user has not written.

One file for each key, in a folder that belongs to the user and that nobody else may enter. A file holds the hash of its own content
before it; whatever does not match is as if it were not there. Files are written under another name and then moved, so that two
processes never see half of one; what a killed process left under such a name is removed by whoever writes later.
"""

import hashlib
import os
import stat
import tempfile
import time
from contextlib import suppress
from pathlib import Path

DIGEST = hashlib.sha256().digest_size
PART, LEFT = ".part", 600.0  # ending of unfinished files, and the age [s] from which nobody is writing them any more
MAGIC = b"gauss-bench kernel 1\n"


def folder() -> Path:
    """Where object code is kept."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    home = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    return home / "gauss-bench" / "kernels"


def trusted() -> Path | None:
    """The folder, made where it is missing; None where it is not the user's own or others may enter it."""
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


def load(key: str) -> bytes | None:
    """The object code kept under a key, or None."""
    path = trusted()
    if path is None:
        return None
    try:
        content = (path / f"{key}.o").read_bytes()
    except OSError:
        return None
    head = len(MAGIC) + DIGEST
    code = content[head:]
    return code if content[:head] == MAGIC + _digest(key, code) and code else None


def store(key: str, code: bytes) -> bool:
    """Keep object code; False where it cannot be kept."""
    path = trusted()
    if path is None:
        return False
    _collect(path)
    name = ""
    try:
        handle, name = tempfile.mkstemp(dir=path, suffix=PART)
        with os.fdopen(handle, "wb") as file:
            file.write(MAGIC + _digest(key, code) + code)
        os.replace(name, path / f"{key}.o")
    except OSError:
        if name:
            Path(name).unlink(missing_ok=True)
        return False
    return True


def _collect(path: Path) -> None:
    """Remove what killed processes left."""
    for left in path.glob(f"*{PART}"):
        with suppress(OSError):
            if abs(time.time() - left.stat().st_mtime) > LEFT:  # a clock may have jumped either way
                left.unlink()


def _digest(key: str, code: bytes) -> bytes:
    return hashlib.sha256(key.encode() + code).digest()
