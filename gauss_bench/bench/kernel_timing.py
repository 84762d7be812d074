"""Rows of times: what is raced in one interleaved run, and how two of its entries compare.

A time is the lower quartile of the rounds, with the 5 % and the 95 % point of the rounds beside it; a ratio is that of lower
quartiles, with its spread over resampled rounds. What could not be built or run leaves a row with the reason.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.bench.clock import Block, interleaved, ratio
from gauss_bench.compiler.errors import KernelError
from gauss_bench.engines.extras import not_installed
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

Row = dict[str, Any]


class Key(NamedTuple):
    """What is timed: a quantity of an engine at its settings; `stabilization` as the engine calls it."""

    quantity: str
    engine: str
    settings: str = "default"
    stabilization: str = "none"


class Missing(LookupError):
    """A quantity that was not measured, with a status and a sentence."""

    def __init__(self, status: Status, message: str):
        self.status = status
        super().__init__(message)


@dataclass(frozen=True, eq=False)
class Measured:
    """Seconds per repetition of every entry, (rounds,) each, and why others have none."""

    samples: Mapping[Hashable, Array]
    failed: Mapping[Hashable, Missing]

    def of(self, key: Hashable) -> Array:
        """The samples of an entry.

        Raises:
            Missing: there are none.
        """
        if key in self.samples:
            return self.samples[key]
        raise self.failed.get(key) or Missing(Status.SKIP, f"{key} was not measured")

    def compared(self, own: Hashable, rival: Hashable) -> Row:
        """`compared` of two entries.

        Raises:
            Missing: one of them was not measured.
        """
        return compared(self.of(own), self.of(rival))


class Race:
    """Entries to be timed against each other; one that cannot be built drops out with its reason."""

    def __init__(self) -> None:
        self.blocks: list[Block] = []
        self.failed: dict[Hashable, Missing] = {}

    def add(self, key: Hashable, make: Callable[..., Block], *arguments: Any) -> None:
        """Enter the block that make(*arguments) returns, under the key."""
        try:
            block = make(*arguments)
        except RunFailure as failure:
            self.failed[key] = Missing(failure.status, str(failure))
        except ImportError as error:
            self.failed[key] = Missing(Status.SKIP, not_installed(error))
        except KernelError as error:
            self.failed[key] = Missing(Status.ERROR, str(error))
        else:
            block.entry = key
            self.blocks.append(block)

    def run(self, rounds: int) -> Measured:
        samples: dict[Hashable, list[float]] = {block.entry: [] for block in self.blocks}
        for block, _, seconds in interleaved(self.blocks, rounds):
            samples[block.entry].append(seconds)
        return Measured({key: np.array(x) for key, x in samples.items()}, self.failed)


def spread(name: str, samples: Array) -> dict[str, float]:
    """Lower quartile, and the 5 % and 95 % points."""
    values = (float(x) for x in np.quantile(samples, (0.25, 0.05, 0.95)))
    return dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))


def compared(own: Array, rival: Array) -> Row:
    """Times of both, and how many times longer the rival takes."""
    common = min(len(own), len(rival))  # rounds that both have: slow blocks sit some out
    own, rival = own[:common], rival[:common]
    found: Row = spread("seconds", own) | {"rival_seconds": float(np.quantile(rival, 0.25))}
    return found | dict(zip(("ratio", "ratio_low", "ratio_high"), ratio(rival, own), strict=True))


def row(start: Row, make: Callable[..., Row], *arguments: Any) -> Row:
    """A row with its status: of what make(*arguments) finds, or of why it finds nothing."""
    try:
        return start | {"status": str(Status.OK), "message": ""} | make(*arguments)
    except Missing as missing:
        return start | {"status": str(missing.status), "message": str(missing)}
