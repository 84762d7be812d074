"""Input and output of both pipelines of a certificate: a first guess in double precision, and a motion in extended precision."""

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from numpy.typing import NDArray

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import assemble
from gauss_bench.mechanism.model import Mechanism

Progress = Callable[[float], None]  # told the time reached [s]


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples of a motion in extended precision, in the absolute coordinates and row order of the mechanism.

    Attributes:
        times: decimal texts of the sample times [s] that were reached.
        q, v, a: (k, n) in the pipeline's own type of number.
        multipliers: (k, m) of M a + J^T lambda = Q, rows as in the mechanism; None where redundant rows leave them undetermined.
        drift: largest |phi| and |phi'| over the samples, as a double (m, rad and per second).
        stopped: why the samples end before the last time asked for, or empty.
        method: one line on how it was made, with versions.
    """

    times: tuple[str, ...]
    q: NDArray[Any]
    v: NDArray[Any]
    a: NDArray[Any]
    multipliers: NDArray[Any] | None
    drift: tuple[float, float]
    stopped: str
    method: str


def assemble_doubles(document: dict[str, Any], scenario: str) -> Mechanism:
    """Assemble the linkage in double precision: the first guess of a pipeline. The scenario's override must be merged already.

    Raises:
        AssemblyError: it cannot be assembled.
    """
    rough = _doubles(document)
    return assemble(build_mechanism(rough, scenario, "", ""), rough)


def _doubles(value: Any) -> Any:
    """Return a copy of the document with every Decimal as the nearest double."""
    if isinstance(value, dict):
        return {key: _doubles(x) for key, x in value.items()}
    if isinstance(value, list):
        return [_doubles(x) for x in value]
    return float(value) if isinstance(value, Decimal) else value
