"""The store of references: a certificate that holds, or else a built reference that is kept under a hash of its inputs."""

import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.atomic import atomically
from gauss_bench.linkage.digest import content_digest, source_digest
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
    # the file's name has a hash of everything on which a built reference depends
    sources = source_digest("reference", "linkage", "mechanism", "terms.py")
    digest = content_digest(mechanism.sha256, mechanism.scenario, t_end, np.__version__, sources)
    path = folder / f"{mechanism.name}.{mechanism.scenario}.{digest[:16]}.npz"
    if path.exists():
        if stored := read_reference(path):
            return stored
        print(harmless(f"warning: {path}: is damaged; the reference is built again"), file=sys.stderr)
    reference = build_reference(mechanism, t_end)
    arrays = {name: getattr(reference, name) for name in FIELDS}
    write_arrays(path, digest=content_digest(reference), method=reference.method, **arrays)
    return reference


def write_arrays(path: Path, **arrays: Any) -> None:
    """Write named arrays and texts to a file .npz atomically; the same arrays give the same bytes."""

    def write(draft: Path) -> None:
        """Write the arrays to a temporary file; given its path instead of the open file, numpy would append .npz to its name."""
        with draft.open("wb") as file:
            np.savez_compressed(file, **arrays)

    atomically(path, write)


def read_reference(path: Path) -> Reference | None:
    """Return the reference in a file, or None if the file is missing or damaged."""
    try:
        with np.load(path) as data:
            reference = Reference(**{name: data[name] for name in FIELDS}, method=str(data["method"]))
            return reference if str(data["digest"]) == content_digest(reference) else None
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None
