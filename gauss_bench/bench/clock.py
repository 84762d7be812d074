"""Measure times in races: blocks of work run interleaved in one process, in a new random order every round.

The speed of a machine varies with time, but blocks that run one after the other are affected alike: the ratio of lower quartiles of
interleaved blocks varies by a few per cent where single timings vary by half. Times are processor times, because waits for a shared
processor would affect long blocks more often than short ones. A block lasts at least two milliseconds, and shorter work is repeated
within it: its first repetition is slow, because the processor's caches hold the code of other blocks. The garbage collector is off
during a race. No block is discarded.

A race is repeated in several processes, because the addresses of code and data change a time by some per cent and stay the same in
one process: rounds of one process scatter less than two races differ. A time is the median over the processes of the lower
quartiles of their rounds; a ratio is the ratio of two such times, over the processes that ran both. The spread of a time or ratio
covers the value of each process, and the result of a second race of as many processes with a probability of 99 % (`foreseen`).
With a single process, the spread of a time is the range from the 5 % to the 95 % quantile of its rounds, that of a ratio the same
range over resampled rounds; neither predicts a second race. An entry that cannot be built or run has a reason instead of times.

Source: T. Kalibera and R. Jones, Rigorous benchmarking in reasonable time, 2013 (paired benchmarks).
"""

import gc
import math
import random
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.special import stdtrit

from gauss_bench.engines import not_installed
from gauss_bench.runs.blocks import Block, BlockElsewhere
from gauss_bench.terms import Array
from gauss_bench.trajectory import Failure, RunFailure, Status

SLOW, SLOW_ROUNDS = 0.1, 4  # [s] slower blocks run in the first rounds only: all rounds would take minutes
CERTAIN = 0.99  # chance that a second race falls within a spread
RESAMPLES = 200  # of the rounds, for the spread of a ratio

Row = dict[str, Any]
K = TypeVar("K", bound=Hashable)


class Key(NamedTuple):
    """The key of a timed quantity: its name, the engine and its setting."""

    quantity: str
    engine: str
    settings: str = "default"
    integrator: str = "rk4"
    stabilization: str = "none"


def interleave(
    blocks: list[Block], rounds: int, seed: int = 1, watch: Callable[[Hashable], object] = id
) -> Iterator[tuple[Block, int, float]]:
    """Time each block once a round, in a new random order every round; yield block, round and seconds per repetition.

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


class Missing(Failure):
    """Raised for a quantity that was not measured."""


@dataclass(frozen=True, eq=False)
class Measured:
    """The result of a race.

    Attributes:
        samples: entry -> seconds per repetition (processes, rounds); NaN in rounds that the entry skipped, and in all rounds of a
            process in which it did not run.
        failed: entry -> why it has no times.
        facts: entry -> further columns.
    """

    samples: Mapping[Hashable, Array]
    failed: Mapping[Hashable, Failure]
    facts: Mapping[Hashable, Row] = field(default_factory=dict)

    def of(self, key: Hashable) -> Array:
        """Return the samples (processes, rounds) of an entry.

        Raises:
            Failure: it was not measured.
        """
        if key in self.samples:
            return self.samples[key]
        words = key if isinstance(key, tuple) else (key,)
        raise self.failed.get(key) or Missing(Status.SKIP, f"{' '.join(map(str, words))} was not measured")

    def time(self, key: Hashable) -> float:
        """Return the time [s] of an entry.

        Raises:
            Failure: it was not measured.
        """
        return time_of(self.of(key))

    def compare(self, own: Hashable, rival: Hashable) -> Row:
        """Return the times of two entries and their ratio, as `compare` does for samples.

        Raises:
            Failure: one of them was not measured.
        """
        return compare(self.of(own), self.of(rival))


class Race:
    """Entries that are timed against each other; one that cannot be built is left out with the reason.

    `watch` is called with an entry before its code runs, so that a crash can be attributed to it.
    """

    def __init__(self, watch: Callable[[Hashable], object] = id) -> None:
        self.watch = watch
        self.blocks: list[Block] = []
        self.failed: dict[Hashable, Failure] = {}

    def add(self, key: Hashable, make: Callable[..., Block], *arguments: Any) -> None:
        """Enter the block that make(*arguments) returns, under the key."""
        self.watch(key)
        try:
            block = make(*arguments)
        except RunFailure as failure:
            self.failed[key] = failure
        except ImportError as error:
            self.failed[key] = Missing(Status.SKIP, not_installed(error))
        else:
            block.entry = key
            self.blocks.append(block)

    def run(self, rounds: int) -> Measured:
        samples: dict[Hashable, list[float]] = {block.entry: [] for block in self.blocks}
        for block, _, seconds in interleave(self.blocks, rounds, watch=self.watch):
            samples[block.entry].append(seconds)
        for block in self.blocks:
            if isinstance(block, BlockElsewhere) and block.failure:
                self.failed[block.entry] = block.failure
                samples.pop(block.entry)
        return Measured({key: pad([np.array(x)]) for key, x in samples.items()}, self.failed)


def key_of(row: Row) -> Key:
    """Return the key of the timed quantity in a row."""
    return Key(*(row[x] for x in Key._fields))


def gather_rounds(rows: Iterable[Row], key: Callable[[Row], Hashable] = key_of, strict: bool = False) -> Measured:
    """Collect the rows of races by entry: seconds of each round in each process, facts, or a status with its reason.

    With `strict`, an entry that failed in one process counts as failed, even if others have times.
    """
    samples: dict[Hashable, dict[int, list[float]]] = {}
    failed: dict[Hashable, Failure] = {}
    facts: dict[Hashable, Row] = {}
    for r in sorted(rows, key=lambda r: r.get("round") or 0):
        if r.get("seconds") is not None:
            samples.setdefault(key(r), {}).setdefault(r["process"], []).append(r["seconds"])
        elif "facts" in r:
            facts[key(r)] = r["facts"]
        else:
            failed.setdefault(key(r), Missing(Status(r["status"]), r["message"]))
    kept = {k: x for k, x in samples.items() if not (strict and k in failed)}
    return Measured(over_processes(kept), failed, facts)


def pad(processes: Sequence[Array]) -> Array:
    """Return rounds of several processes, (rounds,) each, as one array (processes, rounds), filled with NaN."""
    table = np.full((len(processes), max(map(len, processes), default=0)), np.nan)
    for row, x in zip(table, processes, strict=True):
        row[: len(x)] = x
    return table


def over_processes(samples: Mapping[K, Mapping[int, Sequence[float]]]) -> dict[Hashable, Array]:
    """Return the samples (processes, rounds) of every entry, given the seconds of its rounds by number of the process."""
    numbers = sorted({number for x in samples.values() for number in x})
    return {key: pad([np.array(x.get(number, ())) for number in numbers]) for key, x in samples.items()}


def quartiles(samples: Array) -> Array:
    """Lower quartiles (processes,) of the rounds, NaN where there are none; `samples` (processes, rounds), or (rounds,) of one."""
    return np.array([np.quantile(x, 0.25) if x.size else np.nan for x in (row[np.isfinite(row)] for row in np.atleast_2d(samples))])


def time_of(samples: Array) -> float:
    """Return the time [s] of an entry: the median over processes of the lower quartile of their rounds."""
    return float(np.nanmedian(quartiles(samples)))


def quotients(samples: Array, baseline: Array, seed: int = 1) -> Array:
    """Return the scatter of a ratio: one value a process, or RESAMPLES resampled ones where only one process ran both.

    Both (processes, rounds), or (rounds,) of one.
    """
    one, other = common(samples, baseline)
    if len(one) != 1:
        return quartiles(one) / quartiles(other)
    rounds = np.isfinite(one[0])
    pair = one[0][rounds], other[0][rounds]
    picks = np.random.default_rng(seed).integers(0, rounds.sum(), (RESAMPLES, rounds.sum()))
    longer, shorter = (np.quantile(x[picks], 0.25, axis=1) for x in pair)
    return np.asarray(longer / shorter)


def ratio(samples: Array, baseline: Array) -> tuple[float, float, float]:
    """Return the ratio of two times over the rounds that both have, with the lower and upper end of its spread; NaN without any."""
    one, other = common(samples, baseline)
    if not len(one):
        return math.nan, math.nan, math.nan
    low, high = ends(quotients(samples, baseline), several=len(one) > 1)
    return time_of(one) / time_of(other), low, high


def ends(values: Array, several: bool) -> tuple[float, float]:
    """Return the ends of the spread of values: of several processes, or of the rounds of one, as the middle 90 %."""
    if several:
        return foreseen(values)
    low, high = np.quantile(values, (0.05, 0.95)).tolist()
    return low, high


def foreseen(values: Array) -> tuple[float, float]:
    """Return an interval that covers all `values` (processes,) and, with probability CERTAIN, the median of a second race.

    With a standard deviation s of the logarithms, two medians of n values each differ with a standard deviation of
    s (pi / n)^(1/2). As s is estimated from n values, n >= 2, the quantile is that of Student's t with n - 1 degrees of freedom.
    """
    logarithms = np.log(values)
    scatter = logarithms.std(ddof=1) * math.sqrt(math.pi / len(values))
    half = float(stdtrit(len(values) - 1, (1 + CERTAIN) / 2)) * scatter
    middle = float(np.median(logarithms))
    return min(float(values.min()), math.exp(middle - half)), max(float(values.max()), math.exp(middle + half))


def common(one: Array, other: Array) -> tuple[Array, Array]:
    """Return both samples (processes, rounds), restricted to processes that ran both; NaN where either has no value."""
    pair = [np.atleast_2d(x) for x in (one, other)]
    rounds = min(x.shape[1] for x in pair)
    first, second = (x[:, :rounds] for x in pair)
    both = np.isfinite(first) & np.isfinite(second)
    ran = both.any(axis=1)
    return np.where(both, first, np.nan)[ran], np.where(both, second, np.nan)[ran]


def spread(name: str, samples: Array) -> dict[str, float]:
    """Return the columns of a time and its spread; `samples` (processes, rounds), or (rounds,) of one process."""
    found = quartiles(samples)
    found = found[np.isfinite(found)]
    rounds = samples[np.isfinite(samples)]
    low, high = ends(found if len(found) > 1 else rounds, several=len(found) > 1)
    return {name: float(np.median(found)), f"{name}_low": low, f"{name}_high": high}


def compare(own: Array, rival: Array) -> Row:
    """Return both times, each over all its rounds, and the ratio of the rival's to the own over the rounds that both have.

    A time is the same in every comparison. Where one entry has fewer rounds, the ratio is therefore not the quotient of the times.
    """
    row: Row = spread("seconds", own) | {"rival_seconds": time_of(rival)}
    return row | dict(zip(("ratio", "ratio_low", "ratio_high"), ratio(rival, own), strict=True))


def row(start: Row, make: Callable[..., Row], *arguments: Any) -> Row:
    """Return the row that make(*arguments) measures, with status OK, or a row with the reason why there is no measurement."""
    try:
        return start | {"status": str(Status.OK), "message": ""} | make(*arguments)
    except Failure as failure:
        return start | failure.columns


def at_least(row: Row, column: str, target: float | None) -> Row:
    """Return the row with its target, and whether the column reaches it; a missing measurement does not reach it."""
    if target is None:
        return row
    return row | {"target": target, "met": row.get(column) is not None and bool(row[column] >= target)}


def at_most(row: Row, column: str, target: float) -> Row:
    """As `at_least`, for a quantity with an upper limit."""
    return row | {"target": target, "met": row.get(column) is not None and bool(row[column] <= target)}
