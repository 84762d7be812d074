"""The store of references: a certificate that holds, or else a built reference that is kept under a hash of its inputs."""

import hashlib
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np

from gauss_bench.atomic import atomically
from gauss_bench.linkage.digest import source_digest
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import build_reference
from gauss_bench.reference.certificate import find_certified
from gauss_bench.trajectory import Reference
from gauss_bench.untrusted import harmless

FIELDS = ("t", "q", "v", "a", "error_q", "error_v", "error_a", "floor_q", "floor_v", "floor_a")


def load_stored(mechanism: Mechanism, t_end: float, folder: Path) -> Reference:
    """Return the reference from 0 to t_end [s], from a certificate with a sample at t_end, or else from the cache in `folder`.

    A reference that is in neither is built, and written to the cache.
    """
    if certified := find_certified(mechanism, t_end):
        return certified
    # the name has a hash of all that a built reference depends on
    sources = source_digest("reference", "linkage", "mechanism", "terms.py")
    made_of = f"{mechanism.sha256} {mechanism.scenario} {t_end!r} {np.__version__} {sources}"
    path = folder / f"{mechanism.name}.{mechanism.scenario}.{hashlib.sha256(made_of.encode()).hexdigest()[:16]}.npz"
    if path.exists():
        if stored := read_reference(path):
            return stored
        print(harmless(f"warning: {path}: is not as it was written; the reference is built again"), file=sys.stderr)
    reference = build_reference(mechanism, t_end)

    def write(part: Path) -> None:
        """Write the reference with its digest; given a path instead of a file, numpy would append .npz to its name."""
        with part.open("wb") as file:
            arrays = {name: getattr(reference, name) for name in FIELDS}
            np.savez_compressed(file, digest=_digest(reference), method=reference.method, **arrays)

    atomically(path, write)
    return reference


def read_reference(path: Path) -> Reference | None:
    """Return the reference in a file, or None if the file is missing or damaged."""
    try:
        with np.load(path) as data:
            reference = Reference(**{name: data[name] for name in FIELDS}, method=str(data["method"]))
            return reference if str(data["digest"]) == _digest(reference) else None
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None


def _digest(reference: Reference) -> str:
    """Return a hash of a reference's method and arrays."""
    hashed = hashlib.sha256(reference.method.encode())
    for name in FIELDS:
        x = np.ascontiguousarray(getattr(reference, name))
        hashed.update(f"{name} {x.shape} {x.dtype}".encode() + x.tobytes())
    return hashed.hexdigest()
