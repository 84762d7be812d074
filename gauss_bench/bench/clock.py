"""Measure times in races: blocks of work run interleaved in one process, in a new random order every round.

The speed of a machine varies with time, but blocks that run one after the other are affected alike. The ratio of the lower
quartiles of interleaved blocks varies by a few per cent, while single timings vary by half. Times are processor times, because
waits for a shared processor would affect long blocks more often than short ones. A block lasts at least two milliseconds. Shorter
work is repeated within the block, because the first repetition is slow: the processor's caches hold the code of other blocks. The
garbage collector is off during a race. No block is discarded.

A race is repeated in several processes. The memory addresses of code and data change a time by some per cent, and they are fixed
within a process. Therefore the rounds of one process scatter less than the times of two processes differ. A time is the median over
the processes of the lower quartiles of their rounds. A ratio is the ratio of two times, over the processes that ran both. The
spread of a time or ratio is an interval. It covers the value of each process and, with a probability of 99 %, the result of a
repeated race of as many processes (`foreseen`). If there is only one process, the spread says nothing about a repeated race: the
spread of a time is then the range from the 5 % to the 95 % quantile of its rounds, and the spread of a ratio is the same range over
resampled rounds. An entry that cannot be built or run has a reason instead of times.

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

SLOW, SLOW_ROUNDS = 0.1, 4  # [s] a block that takes longer runs in the first rounds only: all rounds would take minutes
CERTAIN = 0.99  # probability that the result of a repeated race falls within a spread
RESAMPLES = 200  # resamplings of the rounds, for the spread of a ratio
NO_KEY = None  # stands for the key of a block's entry until a race enters the block under a key

Row = dict[str, Any]
K = TypeVar("K", bound=Hashable)


Watch = Callable[[Hashable], object]  # called with the key of an entry before the entry's code runs


def watch_nothing(entry: Hashable) -> None:
    """Do nothing with the key of an entry that is about to run."""


class Key(NamedTuple):
    """The key of an entry: the name of the timed quantity, the engine and its setting."""

    quantity: str
    engine: str
    settings: str = "default"
    integrator: str = "rk4"
    stabilization: str = "none"


def interleave(blocks: list[Block], rounds: int, seed: int = 1, watch: Watch = watch_nothing) -> Iterator[tuple[Block, int, float]]:
    """Time each block once a round, in a new random order every round; yield block, round and seconds per repetition.

    A block that takes longer than SLOW, such as the generation of code, is left out after SLOW_ROUNDS rounds.
    """
    order = random.Random(seed)
    slow: set[int] = set()  # identities of blocks, because blocks cannot be hashed
    gc.disable()
    try:
        for number in range(rounds):
            for item in order.sample(blocks, len(blocks)):
                if id(item) in slow and number >= SLOW_ROUNDS:
                    continue
                watch(item.entry)
                seconds = item.seconds()
                if seconds * item.count * item.again > SLOW:  # the time of the whole block
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
        samples: key of an entry -> seconds per repetition (processes, rounds); NaN in rounds that the entry skipped, and in all
            rounds of a process in which it did not run.
        failed: key of an entry -> why it has no times.
        facts: key of an entry -> further columns of its row.
    """

    samples: Mapping[Hashable, Array]
    failed: Mapping[Hashable, Failure]
    facts: Mapping[Hashable, Row] = field(default_factory=dict)

    def of(self, key: Hashable) -> Array:
        """Return the samples (processes, rounds) of an entry.

        Raises:
            Failure: the entry was not measured.
        """
        if key in self.samples:
            return self.samples[key]
        words = key if isinstance(key, tuple) else (key,)
        raise self.failed.get(key) or Missing(Status.SKIP, f"{' '.join(map(str, words))} was not measured")

    def time(self, key: Hashable) -> float:
        """Return the time [s] of an entry.

        Raises:
            Failure: the entry was not measured.
        """
        return time_of(self.of(key))

    def compare(self, own: Hashable, rival: Hashable) -> Row:
        """Return the columns of `compare` for the samples of two entries.

        Raises:
            Failure: one of the entries was not measured.
        """
        return compare(self.of(own), self.of(rival))


class Race:
    """Entries that are timed against each other; an entry that cannot be built is left out, and its reason is kept.

    Attributes:
        watch: called with the key of an entry before its code runs, so that a crash can be attributed to it.
        blocks: the blocks to be timed.
        failed: key of an entry -> why it has no block, or no times.
    """

    def __init__(self, watch: Watch = watch_nothing) -> None:
        """Begin a race without entries."""
        self.watch = watch
        self.blocks: list[Block] = []
        self.failed: dict[Hashable, Failure] = {}

    def add(self, key: Hashable, make: Callable[..., Block], *arguments: Any) -> None:
        """Enter the block that make(*arguments) returns under a key, or keep the reason why there is no block."""
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
        """Time all blocks in a number of rounds in this process, and return the samples (1, rounds) and failures."""
        samples: dict[Hashable, list[float]] = {block.entry: [] for block in self.blocks}
        for block, _, seconds in interleave(self.blocks, rounds, watch=self.watch):
            samples[block.entry].append(seconds)
        for block in self.blocks:
            if isinstance(block, BlockElsewhere) and block.failure:
                self.failed[block.entry] = block.failure
                samples.pop(block.entry)
        return Measured({key: pad([np.array(x)]) for key, x in samples.items()}, self.failed)


def key_of(row: Row) -> Key:
    """Return the key of the entry that a row belongs to."""
    return Key(*(row[x] for x in Key._fields))


def gather_rounds(rows: Iterable[Row], key: Callable[[Row], Hashable] = key_of, strict: bool = False) -> Measured:
    """Collect the rows of races by entry.

    Args:
        rows: each has the seconds of one round in one process, the facts (further columns) of an entry, or a status with its
            reason.
        key: returns the key of the entry that a row belongs to.
        strict: whether an entry that failed in one process counts as failed even if it has times in other processes.
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
    """Return the rounds of several processes, (rounds,) each, as one array (processes, rounds); short rows end with NaN."""
    table = np.full((len(processes), max(map(len, processes), default=0)), np.nan)
    for line, rounds in zip(table, processes, strict=True):
        line[: len(rounds)] = rounds
    return table


def over_processes(samples: Mapping[K, Mapping[int, Sequence[float]]]) -> dict[Hashable, Array]:
    """Return key -> samples (processes, rounds) of all entries, given key -> number of a process -> seconds of its rounds."""
    numbers = sorted({number for x in samples.values() for number in x})
    return {key: pad([np.array(x.get(number, ())) for number in numbers]) for key, x in samples.items()}


def quartiles(samples: Array) -> Array:
    """Return the lower quartile (processes,) of the rounds of each process; NaN for a process without rounds.

    Here and below, `samples` and other times are (processes, rounds) in seconds, or (rounds,) of a single process.
    """
    timed = [row[np.isfinite(row)] for row in np.atleast_2d(samples)]
    return np.array([np.quantile(x, 0.25) if x.size else np.nan for x in timed])


def time_of(samples: Array) -> float:
    """Return the time [s] of an entry: the median over the processes of the lower quartiles of their rounds."""
    return float(np.nanmedian(quartiles(samples)))


def quotients(samples: Array, baseline: Array, seed: int = 1) -> Array:
    """Return several values of the ratio samples / baseline, whose scatter is that of the ratio.

    They are one value (processes,) for each process that ran both, or RESAMPLES values from resampled rounds if only one did.
    """
    one, other = common(samples, baseline)
    if len(one) != 1:
        return quartiles(one) / quartiles(other)
    rounds = np.isfinite(one[0])
    pair = one[0][rounds], other[0][rounds]
    # the same rounds are drawn of both: a disturbance of one round affects both alike and cancels
    picks = np.random.default_rng(seed).integers(0, rounds.sum(), (RESAMPLES, rounds.sum()))
    longer, shorter = (np.quantile(x[picks], 0.25, axis=1) for x in pair)
    return np.asarray(longer / shorter)


def ratio(samples: Array, baseline: Array) -> tuple[float, float, float]:
    """Return the ratio samples / baseline, over the rounds that both have, and the lower and upper end of its spread.

    All three are NaN if no process ran both.
    """
    one, other = common(samples, baseline)
    if not len(one):
        return math.nan, math.nan, math.nan
    low, high = ends(quotients(samples, baseline), several=len(one) > 1)
    return time_of(one) / time_of(other), low, high


def ratio_columns(samples: Array, baseline: Array, name: str = "ratio") -> Row:
    """Return the columns of the ratio samples / baseline and its spread; their names begin with `name`."""
    return dict(zip((name, f"{name}_low", f"{name}_high"), ratio(samples, baseline), strict=True))


def ends(values: Array, several: bool) -> tuple[float, float]:
    """Return the lower and upper end of a spread.

    Args:
        values: times or ratios: one for each process if `several`, else one for each round of a single process.
        several: whether several processes ran: the spread is then an interval that predicts a repeated race (`foreseen`); else it
            is the middle 90 % of the values.
    """
    if several:
        return foreseen(values)
    low, high = np.quantile(values, (0.05, 0.95)).tolist()
    return low, high


def foreseen(values: Array) -> tuple[float, float]:
    """Return the ends of an interval that covers all `values` (processes,) and, with probability CERTAIN, a repeated race's median.

    With a standard deviation s of the logarithms, two medians of n values each differ with a standard deviation of s (pi /
    n)^(1/2). Because s is estimated from n values, n >= 2, the quantile is that of Student's t with n - 1 degrees of freedom.
    """
    logarithms = np.log(values)
    scatter = logarithms.std(ddof=1) * math.sqrt(math.pi / len(values))
    half = float(stdtrit(len(values) - 1, (1 + CERTAIN) / 2)) * scatter
    middle = float(np.median(logarithms))
    return min(float(values.min()), math.exp(middle - half)), max(float(values.max()), math.exp(middle + half))


def common(one: Array, other: Array) -> tuple[Array, Array]:
    """Return both samples (processes, rounds), restricted to processes that ran both; NaN in rounds that only one of them has."""
    pair = [np.atleast_2d(x) for x in (one, other)]
    rounds = min(x.shape[1] for x in pair)
    first, second = (x[:, :rounds] for x in pair)
    both = np.isfinite(first) & np.isfinite(second)  # (processes, rounds)
    ran = both.any(axis=1)  # (processes,)
    return np.where(both, first, np.nan)[ran], np.where(both, second, np.nan)[ran]


def spread(name: str, samples: Array) -> dict[str, float]:
    """Return the columns of a time and its spread; their names begin with `name`.

    The time is the median over the processes of their lower quartiles. The spread is `ends` of these quartiles or, if only one
    process ran, of the times of its rounds.
    """
    times = quartiles(samples)  # [s] one for each process
    times = times[np.isfinite(times)]
    rounds = samples[np.isfinite(samples)]
    low, high = ends(times if len(times) > 1 else rounds, several=len(times) > 1)
    return {name: float(np.median(times)), f"{name}_low": low, f"{name}_high": high}


def compare(own: Array, rival: Array) -> Row:
    """Return columns: both times, each over all its rounds, and the ratio rival / own over the rounds that both have.

    The time of an entry does not depend on what it is compared with. If one entry has fewer rounds, the ratio is therefore not the
    quotient of both times.

    Args:
        own, rival: samples of both entries [s], (processes, rounds) each.
    """
    return spread("seconds", own) | {"rival_seconds": time_of(rival)} | ratio_columns(rival, own)


def row(start: Row, make: Callable[..., Row], *arguments: Any) -> Row:
    """Return `start`, status OK and the columns that make(*arguments) returns; if it fails, `start`, the status and the reason."""
    try:
        return start | {"status": str(Status.OK), "message": ""} | make(*arguments)
    except Failure as failure:
        return start | failure.columns


def at_least(columns: Row, column: str, target: float | None) -> Row:
    """Return the row with a target, and with whether the value of a column is at least the target.

    A missing value does not meet the target. Without a target, the row is returned as it is.

    Args:
        columns: the row: name of a column -> value.
        column: name of the column that has a target.
    """
    if target is None:
        return columns
    return columns | {"target": target, "met": columns.get(column) is not None and bool(columns[column] >= target)}


def at_most(columns: Row, column: str, target: float) -> Row:
    """Return the row with a target, and with whether the value of a column is at most the target; a missing value is not.

    `columns` is the row: name of a column -> value.
    """
    return columns | {"target": target, "met": columns.get(column) is not None and bool(columns[column] <= target)}
