"""Data that both computations of a certificate share: a first guess in double precision, and the type of their results."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from gauss_bench.linkage.build import build_mechanism
from gauss_bench.linkage.closure import assemble
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.numbers import Number, exact

Progress = Callable[[float], None]  # a function that is called with the time [s] that a computation has reached


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples of a motion in extended precision, in absolute coordinates, with constraint rows in the order of the mechanism.

    Attributes:
        times: decimal texts of the sample times [s] that were reached.
        q, v, a: (k, n) positions, velocities and accelerations, in the number type of the computation.
        multipliers: (k, m) lambda of M a + J^T lambda = Q, with rows in the order of the mechanism; None if redundant constraint
            rows leave them undetermined.
        drift: largest residuals |phi| and |phi'| of the constraints over the samples [m, rad and per second].
        stopped: the reason why the samples end before the last requested time, or empty.
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
    """Return the linkage of a document with decimals kept as text, assembled in double precision.

    The scenario's `override` must already be merged into the document.

    Raises:
        AssemblyError: the linkage cannot be assembled.
    """
    in_doubles = json.loads(json.dumps(document, default=float))  # every Decimal as the nearest double
    return assemble(build_mechanism(in_doubles, scenario, "", ""), in_doubles)


def find_breaks(driver: dict[str, Any], number: Number) -> list[Any]:
    """Return the times [s] at which the law in a driver's table is not smooth: the end of a rise, or the knots of a table."""
    times = [driver["time"]] if "time" in driver else [row[0] for row in driver.get("rows", [])]
    return [exact(number, x) for x in times]
