"""Cache of references: a certificate if there is one that holds, else a built reference stored under a hash of its inputs."""

import hashlib
import sys
import zipfile
import zlib
from functools import partial
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


def reference_key(mechanism: Mechanism, t_end: float) -> str:
    """Return name, scenario and a hash of everything that a built reference depends on, joined by dots."""
    sources = source_digest("reference", "linkage", "mechanism", "terms.py")
    made_of = f"{mechanism.sha256} {mechanism.scenario} {t_end!r} {np.__version__} {sources}"
    return f"{mechanism.name}.{mechanism.scenario}.{hashlib.sha256(made_of.encode()).hexdigest()[:16]}"


def load_stored(mechanism: Mechanism, t_end: float, folder: Path) -> Reference:
    """Return the reference from 0 to t_end: certified if a certificate has a sample there, else from the cache in `folder`."""
    certified = find_certified(mechanism, t_end)
    if certified:
        return certified
    path = folder / f"{reference_key(mechanism, t_end)}.npz"
    if path.exists():
        if stored := read_reference(path):
            return stored
        print(harmless(f"warning: {path}: is not as it was written; the reference is built again"), file=sys.stderr)
    reference = build_reference(mechanism, t_end)
    atomically(path, partial(_write_reference, reference))
    return reference


def _write_reference(reference: Reference, path: Path) -> None:
    """Write a reference with its digest; the file need not end in .npz."""
    with path.open("wb") as file:
        levels = {name: getattr(reference, name) for name in FIELDS}
        np.savez_compressed(file, digest=_digest(reference), method=reference.method, **levels)


def read_reference(path: Path) -> Reference | None:
    """Read a reference; None if the file is missing or damaged."""
    try:
        with np.load(path) as data:
            reference = Reference(**{name: data[name] for name in FIELDS}, method=str(data["method"]))
            return reference if str(data["digest"]) == _digest(reference) else None
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None


def _digest(reference: Reference) -> str:
    """Return a hash of the method and of all arrays."""
    hashed = hashlib.sha256(reference.method.encode())
    for name in FIELDS:
        x = np.ascontiguousarray(getattr(reference, name))
        hashed.update(f"{name} {x.shape} {x.dtype}".encode() + x.tobytes())
    return hashed.hexdigest()
