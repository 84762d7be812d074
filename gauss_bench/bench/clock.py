"""The clock: everything that is compared races in one process, in blocks, in a new random order every round.

A machine's speed wanders, but it wanders for neighbours alike: the ratio of lower quartiles of interleaved blocks varies by a few
per cent where single timings vary by half. What counts is the processor's time: waiting for a processor that others use too would
lengthen long blocks, which always meet it, and spare short ones. Blocks last at least two milliseconds, the garbage collector
rests, and every block is kept. Work that takes less, such as a second of compiled steps, is repeated within its block, so that the
first repetition, which finds the processor's caches full of others' code, does not count for all.

A time is the lower quartile of the rounds, with the 5 % and the 95 % point of the rounds beside it; a ratio is that of lower
quartiles, with its spread over resampled rounds, or over processes where a race is run in several (`Races`). What could not be
built or run leaves its reason. Sources: the practice of paired benchmarking as in Kalibera and Jones, Rigorous benchmarking in
reasonable time (2013).
"""

import gc
import math
import random
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.engines.base import Model
from gauss_bench.engines.extras import not_installed
from gauss_bench.runs.processor_time import timed as timed
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

BLOCK = 2e-3  # [s] shortest block, twice the millisecond that the clock and the scheduler need to look fine
MOTION = 1.0  # [s] longest run in a block: beyond it drift would change what is timed
SLOW, SLOW_ROUNDS = 0.1, 4  # [s] blocks beyond it run in the first rounds only: all of them would take minutes
RESAMPLES = 200  # of the rounds, for the spread of a ratio

Row = dict[str, Any]


class Key(NamedTuple):
    """What is timed: a quantity of an engine and everything that is chosen for it."""

    quantity: str
    engine: str
    settings: str = "default"
    integrator: str = "rk4"
    stabilization: str = "none"


@dataclass
class Block:
    """A piece of work known by its entry.

    `ready()` is not timed, `go()` is, both `again` times; `count` repetitions, or a share of one, are in one `go()`.
    """

    entry: Hashable
    ready: Callable[[], None]
    go: Callable[[], object]
    count: float
    again: int = 1

    def seconds(self) -> float:
        """Of one repetition, over the whole block."""
        whole = 0.0
        for _ in range(self.again):
            self.ready()
            whole += timed(self.go)
        return whole / (self.count * self.again)


def lasting(entry: Hashable, call: Callable[[], object], work: float = 1) -> Block:
    """A call that needs nothing ready, as often as BLOCK seconds take; each counts as `work` repetitions."""
    call()
    count = max(1, math.ceil(BLOCK / max(min(timed(call) for _ in range(3)), 1e-8)))

    def calls() -> None:
        for _ in range(count):
            call()

    return Block(entry, lambda: None, calls, count * work)


def stepping(entry: Hashable, model: Model, step: float, native: bool) -> Block:
    """Steps of a model, called from Python or in its own loop: for BLOCK seconds, over MOTION at most, again where that is less.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    most, count = max(1, round(MOTION / step)), 1
    while True:
        block = Block(entry, _starting(model, step * np.arange(2.0) * count, native), model.run, count)
        block.ready()
        elapsed = timed(block.go)
        if elapsed >= BLOCK or count >= most:
            block.again = max(1, math.ceil(BLOCK / max(elapsed, 1e-6)))
            return block
        count = min(most, int(count * min(10.0, 1.3 * BLOCK / max(elapsed, 1e-7))) + 1)


def _starting(model: Model, times: Array, native: bool) -> Callable[[], None]:
    return lambda: model.prepare(times, native=native)


def interleaved(
    blocks: list[Block], rounds: int, seed: int = 1, watch: Callable[[Hashable], object] = id
) -> Iterator[tuple[Block, int, float]]:
    """Each block once a round, in a new random order every round: the block, the round, and seconds per repetition.

    A block that takes long, such as generating code, sits out the later rounds.
    """
    order = random.Random(seed)
    slow: set[int] = set()
    gc.disable()
    try:
        for number in range(rounds):
            for item in order.sample(blocks, len(blocks)):
                if id(item) in slow and number >= SLOW_ROUNDS:
                    continue
                watch(item.entry)
                seconds = item.seconds()
                if seconds * item.count * item.again > SLOW:
                    slow.add(id(item))
                yield item, number, seconds
    finally:
        gc.enable()


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
        raise self.failed.get(key) or not_measured(key)

    def quartile(self, key: Hashable) -> float:
        """The time of an entry.

        Raises:
            Missing: there is none.
        """
        return float(np.quantile(self.of(key), 0.25))

    def compared(self, own: Hashable, rival: Hashable) -> Row:
        """`compared` of two entries.

        Raises:
            Missing: one of them was not measured.
        """
        return compared(self.of(own), self.of(rival))


def not_measured(key: Hashable) -> Missing:
    words = key if isinstance(key, tuple) else (key,)
    return Missing(Status.SKIP, f"{' '.join(map(str, words))} was not measured")


class Race:
    """Entries to be timed against each other; one that cannot be built drops out with its reason.

    Before anything is done for an entry, `watch` is told, so that others know whose fault a crash is.
    """

    def __init__(self, watch: Callable[[Hashable], object] = id) -> None:
        self.watch = watch
        self.blocks: list[Block] = []
        self.failed: dict[Hashable, Missing] = {}

    def add(self, key: Hashable, make: Callable[..., Block], *arguments: Any) -> None:
        """Enter the block that make(*arguments) returns, under the key."""
        self.watch(key)
        try:
            block = make(*arguments)
        except RunFailure as failure:
            self.failed[key] = Missing(failure.status, str(failure))
        except ImportError as error:
            self.failed[key] = Missing(Status.SKIP, not_installed(error))
        else:
            block.entry = key
            self.blocks.append(block)

    def run(self, rounds: int) -> Measured:
        samples: dict[Hashable, list[float]] = {block.entry: [] for block in self.blocks}
        for block, _, seconds in interleaved(self.blocks, rounds, watch=self.watch):
            samples[block.entry].append(seconds)
        return Measured({key: np.array(x) for key, x in samples.items()}, self.failed)


def ratio(samples: Array, baseline: Array, seed: int = 1) -> tuple[float, float, float]:
    """Ratio of lower quartiles, and its 5 % and 95 % points over resampled rounds; both (rounds,) [s]."""
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, len(samples), (RESAMPLES, len(samples)))
    resampled = np.quantile(samples[picks], 0.25, axis=1) / np.quantile(baseline[picks], 0.25, axis=1)
    low, high = np.quantile(resampled, (0.05, 0.95))
    return float(np.quantile(samples, 0.25) / np.quantile(baseline, 0.25)), float(low), float(high)


def common(one: Array, other: Array) -> tuple[Array, Array]:
    """Both in the rounds that both have: slow blocks sit the later ones out."""
    rounds = min(len(one), len(other))
    return one[:rounds], other[:rounds]


class Races:
    """The same entries raced in several processes, each of which loads code and data anew.

    Where they happen to lie moves a time by some per cent and stays as it is for the life of a process, so that rounds of one
    process scatter less than a second race differs from the first. A time is the median over the processes of lower quartiles of
    their rounds, and its spread reaches from the least to the largest of those. A ratio is that of two times, over the processes
    that ran both; its spread, from the least to the largest of the processes' own ratios, always holds it.
    """

    def __init__(self, races: Sequence[Measured]):
        self.races = races
        self.failed: dict[Hashable, Missing] = {key: x for race in reversed(races) for key, x in race.failed.items()}

    def __contains__(self, key: Hashable) -> bool:
        return any(key in race.samples for race in self.races)

    def of(self, key: Hashable) -> Array:
        """Seconds (processes,) of an entry, NaN where it did not run.

        Raises:
            Missing: it ran nowhere.
        """
        if key not in self:
            raise self.failed.get(key) or not_measured(key)
        return np.array([race.quartile(key) if key in race.samples else math.nan for race in self.races])

    def spread(self, name: str, key: Hashable) -> dict[str, float]:
        """The time of an entry and its spread, which one process does not tell.

        Raises:
            Missing: it ran nowhere.
        """
        times = self.of(key)
        times = times[np.isfinite(times)]
        low, high = (times.min(), times.max()) if len(times) > 1 else (math.nan, math.nan)
        return {name: float(np.median(times)), f"{name}_low": float(low), f"{name}_high": float(high)}

    def ratio(self, one: Hashable, other: Hashable) -> tuple[float, float, float]:
        """How many times longer one entry takes than the other, and its spread; NaN where no process ran both.

        Raises:
            Missing: one of them ran nowhere.
        """
        times = np.array([self.of(one), self.of(other)])
        times = times[:, np.isfinite(times).all(axis=0)]
        if not times.size:
            return math.nan, math.nan, math.nan
        quotients, (longer, shorter) = times[0] / times[1], np.median(times, axis=1)
        return float(longer / shorter), float(quotients.min()), float(quotients.max())


def spread(name: str, samples: Array) -> dict[str, float]:
    """Lower quartile, and the 5 % and 95 % points."""
    values = (float(x) for x in np.quantile(samples, (0.25, 0.05, 0.95)))
    return dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))


def compared(own: Array, rival: Array) -> Row:
    """Both times, each over all its rounds, and how many times longer the rival takes in the rounds that both have.

    A time has one value, whoever it is compared with; where one has fewer rounds, the ratio is not the quotient of the two.
    """
    mine, theirs = common(own, rival)
    row: Row = spread("seconds", own) | {"rival_seconds": float(np.quantile(rival, 0.25))}
    return row | dict(zip(("ratio", "ratio_low", "ratio_high"), ratio(theirs, mine), strict=True))


def row(start: Row, make: Callable[..., Row], *arguments: Any) -> Row:
    """A row with its status: of what make(*arguments) measures, or of why it measures nothing."""
    try:
        return start | {"status": str(Status.OK), "message": ""} | make(*arguments)
    except Missing as missing:
        return start | {"status": str(missing.status), "message": str(missing)}


def at_least(row: Row, column: str, target: float | None) -> Row:
    """The row with its target, and whether the column reaches it; what was not measured has not reached it."""
    if target is None:
        return row
    return row | {"target": target, "met": bool(_number(row, column) >= target)}


def at_most(row: Row, column: str, target: float) -> Row:
    """As `at_least`, for what should be small."""
    return row | {"target": target, "met": bool(_number(row, column) <= target)}


def _number(row: Row, column: str) -> float:
    x = row.get(column)
    return math.nan if x is None else float(x)
