"""A certificate: the samples of a motion, the error bar of each, and the linkage and scenario for which they hold.

The stored doubles are the correctly rounded values of the more precise of two independent computations. Files are compressed npz
archives with the digest of their linkage, so that no other linkage uses them.
"""

import io
import json
import sys
import zipfile
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.linkage.load import built_in_folder, generate
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference
from gauss_bench.untrusted import BadInput, harmless, read_bytes

FORMAT = "gauss-bench certificate/1"
MAX_BYTES = 1 << 28  # of a file: a thousand times the usual size
CERTIFICATES = "certificates"  # name of the folder of certificates, beside a linkage file


class CertificateError(BadInput, ValueError):
    """The file is not a certificate of a motion, or it certifies the motion of another linkage."""


@dataclass(frozen=True, eq=False)
class Certificate:
    """A certified motion, from time 0 to the time of its last sample.

    Attributes:
        name, scenario, digest: name, scenario and checksum of the linkage for which the certificate is valid.
        t: (k,) sample times [s]; q, v, a: (k, n) positions, velocities and accelerations.
        multipliers: (k, m) multipliers of M a + J^T lambda = Q; (k, 0) if redundant constraint rows leave them undetermined.
        error_q, error_v, error_a, error_multipliers: (k,) largest difference of the two computed motions up to each time; 0 for q,
            v and a of a closed form.
        floor_q, floor_v, floor_a: (k,) largest change up to each time if the parameters change by a relative 1e-16.
        digits: number of certified decimal digits of positions and velocities up to the last sample.
        duration: duration [s] of the motion that was to be certified; stopped: why the samples end before it, or empty.
        facts: methods, versions, drifts, steps and distances from a closed form, as plain data.
    """

    name: str
    scenario: str
    digest: str
    t: Array
    q: Array
    v: Array
    a: Array
    multipliers: Array
    error_q: Array
    error_v: Array
    error_a: Array
    error_multipliers: Array
    floor_q: Array
    floor_v: Array
    floor_a: Array
    digits: int
    duration: float
    stopped: str
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def until(self) -> float:
        """The last certified time [s]."""
        return float(self.t[-1])


ARRAYS = tuple(x.name for x in fields(Certificate) if x.type is Array)  # arrays of the archive; its header has the other fields


def read_certificate(path: Path) -> Certificate:
    """Read a certificate.

    Raises:
        CertificateError: the file is missing, damaged or no certificate.
    """
    try:
        with np.load(io.BytesIO(read_bytes(path, MAX_BYTES)), allow_pickle=False) as data:
            header = json.loads(str(data["header"]))
            arrays = {name: data[name] for name in ARRAYS}
    except FileNotFoundError as error:
        raise CertificateError(f"{path}: no such certificate") from error
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        raise CertificateError(f"{path}: not a certificate, or damaged") from error
    if header.pop("format", None) != FORMAT:
        raise CertificateError(f"{path}: not of the format {FORMAT!r}")
    return Certificate(**header, **arrays)


def check_holds(certificate: Certificate, mechanism: Mechanism, path: Path) -> None:
    """Check that a certificate belongs to a mechanism.

    Raises:
        CertificateError: it is of another linkage or scenario, or the linkage was changed after it was made.
    """
    motion = f"{mechanism.name} in scenario {mechanism.scenario}"
    if (certificate.name, certificate.scenario) != (mechanism.name, mechanism.scenario):
        raise CertificateError(f"{path}: certifies {certificate.name} in scenario {certificate.scenario}, not {motion}")
    if certificate.digest != mechanism.digest:
        raise CertificateError(
            f"{path}: made for another version of {motion}; the linkage has changed since, and the certificate no longer holds; "
            "make a new one with `gauss-bench certify`"
        )


def certificate_path(mechanism: Mechanism) -> Path | None:
    """Return the path of a linkage's certificate, certificates/NAME.SCENARIO.npz beside its file.

    Certificates of generated linkages are in the folder of the built-in ones. The result is None for a mechanism that was built in
    Python, which has no file.
    """
    source = Path(mechanism.source)
    folder = None
    if source.is_file():
        folder = source.parent
    elif generate(mechanism.source):
        folder = built_in_folder()
    return folder / CERTIFICATES / f"{mechanism.name}.{mechanism.scenario}.npz" if folder else None


def as_reference(certificate: Certificate, t_end: float) -> Reference:
    """Return the certified motion up to `t_end` [s] as a reference.

    Its error bars are those of the certificate, plus the rounding of the stored doubles.
    """
    k = int(np.searchsorted(certificate.t, t_end * (1 + 1e-12), side="right"))
    levels = {x: getattr(certificate, x)[:k] for x in ("q", "v", "a")}
    bars = {f"error_{x}": getattr(certificate, f"error_{x}")[:k] + rounding(values) for x, values in levels.items()}
    floors = {f"floor_{x}": getattr(certificate, f"floor_{x}")[:k] for x in levels}
    method = f"certified: {certificate.facts['method']}"
    return Reference(certificate.t[:k], **levels, **bars, **floors, method=method, certified=True)


def rounding(values: Array) -> Array:
    """Return half a unit in the last place (k,) of the largest of the values (k, n) up to each sample."""
    return np.asarray(np.spacing(np.maximum.accumulate(np.abs(values).max(axis=-1))) / 2)


def find_certified(mechanism: Mechanism, t_end: float) -> Reference | None:
    """Return the certified motion up to t_end [s]; None if there is no certificate that holds and has a sample at t_end.

    For a certificate that does not hold, or is damaged, a warning is printed on stderr.
    """
    path = certificate_path(mechanism)
    if path is None or not path.exists():
        return None
    try:
        certificate = read_certificate(path)
        check_holds(certificate, mechanism, path)
    except CertificateError as error:
        print(harmless(f"warning: {error}; the reference is built in double precision instead"), file=sys.stderr)
        return None
    # a run is also judged at its end, where the certificate therefore needs a sample
    has_end = np.isclose(certificate.t, t_end, rtol=1e-12, atol=1e-9).any()
    return as_reference(certificate, t_end) if has_end else None
