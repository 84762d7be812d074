"""Measure times in races: blocks of work are timed in turn in one process, in a new random order in every round.

An entry of a race is a timed quantity, such as the step of an engine with a setting; it has a key and one block, the piece of work
that is timed at once. The speed of a machine varies with time, but blocks that run one after the other are affected alike: the
ratio of the lower quartiles of interleaved blocks varies by a few per cent, while single timings vary by half. Times are processor
times, because waits for a shared processor would affect long blocks more often than short ones. A block lasts at least two
milliseconds: shorter work is repeated within it, because the first repetition is slow while the caches still hold the code of other
blocks. The garbage collector is off during a race. No block is discarded.

A race is repeated in several processes, because the memory addresses of code and data change a measured time by some per cent and
are fixed during a process. The time of an entry in a process is the lower quartile of its rounds, and its time in the race the
median over the processes. A ratio is the quotient of two such times over common rounds and processes. A spread contains the value
of each process and, with a probability of 99 %, the result of a repeated race (`prediction_interval`). A single process says
nothing about other processes: its spread is the range from the 5 % to the 95 % quantile of its rounds, or of bootstrap samples of
these.

Source: T. Kalibera and R. Jones, Rigorous benchmarking in reasonable time, 2013 (paired benchmarks).
"""

import gc
import math
import random
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from gauss_bench.engines import not_installed
from gauss_bench.runs.blocks import Block, BlockElsewhere
from gauss_bench.terms import Array
from gauss_bench.trajectory import Failure, RunFailure, Status

SLOW, SLOW_ROUNDS = 0.1, 4  # [s] a block that takes longer runs in the first rounds only: all rounds would take minutes
CERTAIN = 0.99  # probability that the result of a repeated race falls within a spread
RESAMPLES = 200  # resamplings of the rounds, for the spread of a ratio
NO_KEY = None  # key of a block until a race sets it

Row = dict[str, Any]

Watch = Callable[[Hashable], object]  # called with the key of an entry before the entry's code runs


def watch_nothing(entry: Hashable) -> None:
    """Ignore the key of the entry whose block is about to run."""


class Key(NamedTuple):
    """The key of an entry of a race: the name of the timed quantity, the engine and its setting."""

    quantity: str
    engine: str
    settings: str = "default"
    integrator: str = "rk4"
    stabilization: str = "none"


def interleave(blocks: list[Block], rounds: int, watch: Watch = watch_nothing) -> Iterator[tuple[Block, int, float]]:
    """Time each block once in every round, in a new random order; yield block, round and seconds per repetition.

    A block that takes longer than SLOW, such as the generation of code, is left out after SLOW_ROUNDS rounds.
    """
    order = random.Random(1)
    slow: set[int] = set()  # identities of blocks, because blocks cannot be hashed
    gc.disable()
    try:
        for number in range(rounds):
            for item in order.sample(blocks, len(blocks)):
                if id(item) in slow and number >= SLOW_ROUNDS:
                    continue
                watch(item.entry)
                seconds = item.seconds()
                if seconds * item.count * item.calls > SLOW:  # the time of the whole block
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
        samples: key of an entry -> seconds per repetition of its work, (processes, rounds); NaN where it was not timed.
        failed: key of an entry -> the reason why the entry has no times.
        facts: key of an entry -> further columns of its row, such as the error of the timed work.
    """

    samples: Mapping[Hashable, Array]
    failed: Mapping[Hashable, Failure]
    facts: Mapping[Hashable, Row] = field(default_factory=dict)

    def of(self, key: Hashable) -> Array:
        """Return the measured times [s] of an entry, (processes, rounds).

        Raises:
            Failure: the entry was not measured.
        """
        if key in self.samples:
            return self.samples[key]
        words = key if isinstance(key, tuple) else (key,)
        raise self.failed.get(key) or Missing(Status.SKIP, f"{' '.join(map(str, words))} was not measured")

    def time(self, key: Hashable) -> float:
        """Return the time [s] of an entry, as `time_of` does."""
        return time_of(self.of(key))

    def summary(self, key: Hashable) -> Row:
        """Return the columns of the time of an entry and its spread, and those of its facts.

        Raises:
            Failure: the entry was not measured.
        """
        return spread("seconds", self.of(key)) | self.facts.get(key, {})

    def compare(self, own: Hashable, rival: Hashable) -> Row:
        """Return the columns that `compare` computes from the samples of two entries; raise a Failure if one was not measured."""
        return compare(self.of(own), self.of(rival))


class Race:
    """Entries that are timed against each other; for an entry that cannot be built, `failed` has the reason.

    `watch` is called with the key of an entry before the entry's code runs, so that a crash can be attributed to the entry.
    """

    def __init__(self, watch: Watch = watch_nothing) -> None:
        self.watch = watch
        self.blocks: list[Block] = []
        self.failed: dict[Hashable, Failure] = {}

    def add(self, key: Hashable, make: Callable[..., Block], *arguments: Any) -> None:
        """Add an entry with a key and the block that make(*arguments) returns; if `make` fails, keep the reason in `failed`."""
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
        """Time all blocks in this process, in a number of rounds; return their times (1, rounds) [s] and the failures."""
        samples: dict[Hashable, list[float]] = {block.entry: [] for block in self.blocks}
        for block, _, seconds in interleave(self.blocks, rounds, watch=self.watch):
            samples[block.entry].append(seconds)
        for block in self.blocks:
            if isinstance(block, BlockElsewhere) and block.failure:
                self.failed[block.entry] = block.failure
                samples.pop(block.entry)
        return Measured({key: pad([np.array(x)]) for key, x in samples.items()}, self.failed)


def key_of(row: Row) -> Key:
    """Return the key of the timed quantity to which a row of a result table belongs."""
    return Key(*(row[x] for x in Key._fields))


def gather_rounds(rows: Iterable[Row], key: Callable[[Row], Hashable] = key_of, strict: bool = False) -> Measured:
    """Group the result rows of several processes of a race by entry; `key` returns the key of a row's entry.

    Each row has the seconds of an entry in one round of one process, the entry's `facts`, or the status and reason of its failure.
    With `strict`, an entry that failed in one process counts as failed even if it has times in other processes.
    """
    samples: dict[Hashable, dict[int, list[float]]] = {}  # key of an entry -> number of a process -> times of its rounds [s]
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
    processes = sorted({number for times in kept.values() for number in times})
    padded = {k: pad([np.array(times.get(number, ())) for number in processes]) for k, times in kept.items()}
    return Measured(padded, failed, facts)


def pad(processes: Sequence[Array]) -> Array:
    """Return the times of the rounds of several processes, (rounds,) each, as one array (processes, rounds), filled up with NaN."""
    table = np.full((len(processes), max(map(len, processes), default=0)), np.nan)
    for line, rounds in zip(table, processes, strict=True):
        line[: len(rounds)] = rounds
    return table


def quartiles(samples: Array) -> Array:
    """Return, for each process, the lower quartile (processes,) of the times of its rounds; NaN for a process without times.

    Here and below, `samples` and other times are (processes, rounds) in seconds, or (rounds,) of a single process.
    """
    timed = [row[np.isfinite(row)] for row in np.atleast_2d(samples)]
    return np.array([np.quantile(x, 0.25) if x.size else np.nan for x in timed])


def time_of(samples: Array) -> float:
    """Return the time [s] of an entry: the lower quartile of the rounds in each process, then the median over the processes."""
    return float(np.nanmedian(quartiles(samples)))


def quotients(samples: Array, baseline: Array) -> Array:
    """Return values (j,) of the ratio samples / baseline of two measured times; their scatter shows the ratio's uncertainty.

    There is one value for each process that timed both quantities or, if only one did, RESAMPLES values from bootstrap samples of
    its rounds.
    """
    numerators, denominators = restrict_to_common(samples, baseline)
    if len(numerators) != 1:
        return quartiles(numerators) / quartiles(denominators)
    rounds = np.isfinite(numerators[0])
    pair = numerators[0][rounds], denominators[0][rounds]
    # the same rounds are drawn for both: a disturbance of one round affects both alike and cancels
    picks = np.random.default_rng(1).integers(0, rounds.sum(), (RESAMPLES, rounds.sum()))
    longer, shorter = (np.quantile(x[picks], 0.25, axis=1) for x in pair)
    return np.asarray(longer / shorter)


def ratio(samples: Array, baseline: Array) -> tuple[float, float, float]:
    """Return the ratio samples / baseline over the rounds in which both were timed, and the lower and upper end of its spread.

    Both arguments are times [s], (processes, rounds), NaN where a quantity was not timed. All three are NaN if no process timed
    both.
    """
    numerators, denominators = restrict_to_common(samples, baseline)
    if not len(numerators):
        return math.nan, math.nan, math.nan
    low, high = spread_ends(quotients(samples, baseline), several=len(numerators) > 1)
    return time_of(numerators) / time_of(denominators), low, high


def ratio_columns(samples: Array, baseline: Array, name: str = "ratio") -> Row:
    """Return the columns of the ratio samples / baseline and its spread; their names begin with `name`."""
    return dict(zip((name, f"{name}_low", f"{name}_high"), ratio(samples, baseline), strict=True))


def spread_ends(values: Array, several: bool) -> tuple[float, float]:
    """Return the lower and upper end of the spread of times or ratios.

    Args:
        values: one value for each process if `several`, else one for each round (or bootstrap sample) of a single process.
        several: whether several processes ran: the spread is then the `prediction_interval`, else the middle 90 % of the values.
    """
    if several:
        return prediction_interval(values)
    low, high = np.quantile(values, (0.05, 0.95)).tolist()
    return low, high


def prediction_interval(values: Array) -> tuple[float, float]:
    """Return the ends of an interval that contains all `values` and, with probability CERTAIN, the median of a repeated race.

    `values` (n,) has one time or ratio for each of n processes; both ends are NaN if n < 2. The logarithms of the
    values are taken as normally distributed with the standard deviation s. The median of n of them has the variance pi s^2 / (2 n),
    so that the difference between the medians of two races has the standard deviation s (pi / n)^(1/2). Because s is estimated from
    n values, the quantile is that of Student's t with n - 1 degrees of freedom.
    """
    if len(values) < 2:
        return math.nan, math.nan
    logarithms = np.log(values)
    scatter = logarithms.std(ddof=1) * math.sqrt(math.pi / len(values))
    half_width = float(stdtrit(len(values) - 1, (1 + CERTAIN) / 2)) * scatter  # stdtrit: quantile of Student's t
    middle = float(np.median(logarithms))
    return min(float(values.min()), math.exp(middle - half_width)), max(float(values.max()), math.exp(middle + half_width))


def restrict_to_common(one: Array, other: Array) -> tuple[Array, Array]:
    """Return the times (processes, rounds) of two timed quantities, restricted to the processes that timed both.

    In rounds in which only one of the two was timed, both times are NaN.
    """
    first, second = np.atleast_2d(one), np.atleast_2d(other)
    rounds = min(first.shape[1], second.shape[1])
    first, second = first[:, :rounds], second[:, :rounds]
    both = np.isfinite(first) & np.isfinite(second)  # (processes, rounds)
    ran = both.any(axis=1)  # (processes,)
    return np.where(both, first, np.nan)[ran], np.where(both, second, np.nan)[ran]


def spread(name: str, samples: Array) -> dict[str, float]:
    """Return the columns of a measured time (`time_of`) and the two ends of its spread; their names begin with `name`."""
    times = quartiles(samples)  # [s], one for each process
    times = times[np.isfinite(times)]
    rounds = samples[np.isfinite(samples)]
    low, high = spread_ends(times if len(times) > 1 else rounds, several=len(times) > 1)
    return {name: float(np.median(times)), f"{name}_low": low, f"{name}_high": high}


def compare(own: Array, rival: Array) -> Row:
    """Return the columns of the times of two entries, each over all its rounds, and of the ratio rival / own over common rounds.

    The time of an entry thus does not depend on the other one, and the ratio may differ from the quotient of the two times.
    """
    return spread("seconds", own) | {"rival_seconds": time_of(rival)} | ratio_columns(rival, own)


def row(start: Row, make: Callable[..., Row], *arguments: Any) -> Row:
    """Return a table row: the columns `start`, the status OK, and the columns that make(*arguments) returns.

    If the call raises a Failure, the row has the columns `start`, the status of the failure and its reason.
    """
    try:
        return start | {"status": str(Status.OK), "message": ""} | make(*arguments)
    except Failure as failure:
        return start | failure.columns


def at_least(columns: Row, column: str, target: float | None) -> Row:
    """Return a row with two more columns, the `target` and `met`: whether a column's value is at least the target.

    A missing value does not meet the target. Without a target, the row is returned unchanged.
    """
    if target is None:
        return columns
    value = columns.get(column)
    return columns | {"target": target, "met": value is not None and bool(value >= target)}


def at_most(columns: Row, column: str, target: float) -> Row:
    """Return a row with two more columns, the `target` and `met`: whether a column's value is known and at most the target."""
    value = columns.get(column)
    return columns | {"target": target, "met": value is not None and bool(value <= target)}
