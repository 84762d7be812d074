"""What a closure is asked to follow, and how each sample of it ends."""

from dataclasses import dataclass
from enum import IntEnum

from gauss_bench.terms import Array


class Status(IntEnum):
    """How a sample was closed."""

    CLOSED = 0
    LIBRARY = 1  # by the library's closure
    LOST = 2  # not: the numbers are NaN


@dataclass(frozen=True)
class Loss:
    """Where and why a motion ended.

    Attributes:
        linkage: row of the parameters; 0 for one linkage.
        sample: the first that could not be closed.
        kind: "limit of motion", "singular position" or "not assembled".
        inputs: name -> value [rad, m] up to which it went.
        text: one sentence.
    """

    linkage: int
    sample: int
    kind: str
    inputs: dict[str, float]
    text: str


@dataclass(frozen=True, eq=False)
class Start:
    """Where a linkage starts.

    Attributes:
        x: (U,) unknowns, NaN where there is no start; u: (K,) inputs.
        signs: (G,) that the guards keep.
        fault: why there is no start.
    """

    x: Array
    u: Array
    signs: Array
    fault: str = ""


@dataclass(frozen=True, eq=False)
class Motion:
    """One linkage to be followed.

    Attributes:
        levels: (k, 3 K) inputs, rates, second rates; one array for all linkages that share them.
        p: (n_p,) open numbers.
    """

    levels: Array
    p: Array
    start: Start

    @property
    def u(self) -> Array:
        return self.levels[:, : self.levels.shape[1] // 3]
