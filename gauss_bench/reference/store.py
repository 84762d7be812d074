"""References kept in files, under the digest of what they follow from: the linkage, its scenario, and this room's code."""

import hashlib
import os
from pathlib import Path

import numpy as np

from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.build import build_reference
from gauss_bench.trajectory import Reference

FIELDS = ("t", "q", "v", "a", "error_q", "error_v", "error_a")


def reference_key(mechanism: Mechanism, t_end: float) -> str:
    """Name, scenario and digest of everything the reference depends on."""
    digest = hashlib.sha256(f"{mechanism.sha256} {mechanism.scenario} {t_end!r} {np.__version__}".encode())
    for room in ("reference", "mechanism"):
        for source in sorted((Path(__file__).parents[1] / room).glob("*.py")):
            digest.update(source.read_bytes())
    return f"{mechanism.name}.{mechanism.scenario}.{digest.hexdigest()[:16]}"


def stored_reference(mechanism: Mechanism, t_end: float, folder: Path) -> Reference:
    """The reference from 0 to t_end, read from `folder` or built and kept there."""
    path = folder / f"{reference_key(mechanism, t_end)}.npz"
    if path.exists():
        with np.load(path) as data:
            return Reference(**{name: data[name] for name in FIELDS}, method=str(data["method"]))
    reference = build_reference(mechanism, t_end)
    folder.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.stem}.{os.getpid()}.part.npz")
    np.savez_compressed(part, method=reference.method, **{name: getattr(reference, name) for name in FIELDS})
    part.replace(path)
    return reference
