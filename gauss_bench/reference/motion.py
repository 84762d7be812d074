"""The result of one pipeline of a certificate: a motion in numbers of its own type, and where it had to stop."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

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
