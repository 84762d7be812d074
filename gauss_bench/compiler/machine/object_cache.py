"""Object code on disk: machine code that will be run, and so nothing is loaded that this user has not written.

One file for each key, in a folder that belongs to the user and that nobody else may enter. A file holds the hash of its own content
before it; whatever does not match is as if it were not there. Files are written under another name and then moved, so that two
processes never see half of one.
"""

import hashlib
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

DIGEST = hashlib.sha256().digest_size
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
    try:
        handle, name = tempfile.mkstemp(dir=path, suffix=".part")
        with os.fdopen(handle, "wb") as file:
            file.write(MAGIC + _digest(key, code) + code)
        os.replace(name, path / f"{key}.o")
    except OSError:
        return False
    return True


def _digest(key: str, code: bytes) -> bytes:
    return hashlib.sha256(key.encode() + code).digest()
