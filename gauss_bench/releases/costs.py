"""Race the steps of all releases of an engine in interleaved blocks, each in processes of its own environment.

A run of N steps takes the time  overhead + N step.  Runs of two lengths give both numbers. Ratios are to the times of the newest
release. The newest release also runs as a second entrant, the null, in other processes: the spread of its ratio is the noise.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from gauss_bench.bench.clock import Race, foreseen, quartiles
from gauss_bench.engines.base import Choice
from gauss_bench.releases.asking import FOLDERS, LONGEST
from gauss_bench.releases.cases import STEP, find_mechanism, linkage_of
from gauss_bench.releases.environments import Release, again
from gauss_bench.releases.library import Library
from gauss_bench.runs.blocks import block_elsewhere, running
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.worker import keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import Failure

PROCESSES, ROUNDS = 5, 10  # number of processes of each entrant, and of rounds in a process
SHORT, LONG = 40, 240  # number of steps of the two runs
STEP_TIME, OVERHEAD = "a step", "the fixed overhead of a run"
LEAST = 0.05  # smallest difference of a ratio from 1 that counts
NULL = "newest, raced against itself"  # name of the second entrant of the newest release


@dataclass(frozen=True, eq=False)
class Times:
    """The times of one release in one setting: seconds (processes,) of a step, and of the fixed overhead of a run."""

    step: Array
    overhead: Array


@dataclass(frozen=True)
class Cost:
    """A time of a release, and its ratio to that of another release.

    Attributes:
        version: the release; other: the release to which the ratio is, the newest or the neighbour before.
        linkage, setting, work: what was timed; work is STEP_TIME or OVERHEAD.
        seconds: median over the processes [s].
        ratio: median ratio; low, high: range in which a second race would find it.
        verdict: "slower", "faster" or "same", or the reason why there is no time; "" if the ratio is not judged.
    """

    version: str
    other: str
    linkage: str = ""
    setting: str = ""
    work: str = ""
    seconds: float = float("nan")
    ratio: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    verdict: str = ""


def race_releases(library: Library, releases: Sequence[Release], told: Callable[[str], None]) -> tuple[list[Cost], list[Cost]]:
    """Return the costs of all releases, and the costs relative to the neighbour before that differ by more than the noise.

    Args:
        library: library of the releases; releases: at least two, the oldest first.
        told: called with each sentence of progress.
    """
    costs: list[Cost] = []
    changes: list[Cost] = []
    entrants = {x.version: x.name for x in releases} | {NULL: again(releases[-1])}
    for name, settings, integrator in library.raced:
        told(f"{library.engine}: racing {settings} {integrator} on {name}, {PROCESSES} times")
        choice, setting = Choice(settings, integrator, "none", STEP), f"{settings} {integrator}"
        times, failed = race(name, choice, entrants)
        steps = {version: x.step for version, x in times.items()}
        overheads = {version: x.overhead for version, x in times.items()}
        for work, measured in ((STEP_TIME, steps), (OVERHEAD, overheads)):
            for into, some in (
                (costs, list_costs([*entrants], measured, failed)),
                (changes, find_changes([x.version for x in releases], measured, NULL)),
            ):
                into += [replace(x, linkage=name, setting=setting, work=work) for x in some]
    return costs, changes


def race(linkage: str, choice: Choice, entrants: dict[str, str]) -> tuple[dict[str, Times], dict[str, str]]:
    """Race entrants (version -> name of its engine); return version -> times, and version -> reason why it has no times.

    Every process builds its models anew.
    """
    mechanism = find_mechanism(*linkage_of(linkage))
    rounds: dict[tuple[str, int], list[Array]] = {}
    failed: dict[str, str] = {}
    for _ in range(PROCESSES):
        runners = Race()
        for version, name in entrants.items():
            for count in (SHORT, LONG):
                work = partial(running, None, choice, np.array([0.0, count * STEP]), 1.0)
                runners.add((version, count), block_elsewhere, name, mechanism, choice, work)
        measured = runners.run(ROUNDS)
        for version, name in entrants.items():
            for count in (SHORT, LONG):
                try:
                    rounds.setdefault((version, count), []).append(measured.of((version, count)))
                except Failure as failure:
                    failed[version] = str(failure)
            keep(f"races in {interpreter_of(name).python}").stop()
    times = {}
    for version in entrants:
        if version not in failed:
            short, long = (np.concatenate([quartiles(x) for x in rounds[version, count]]) for count in (SHORT, LONG))
            times[version] = split(short, long)
    return times, failed


def split(short: Array, long: Array) -> Times:
    """Return the time of a step and the fixed overhead, from runs of SHORT and of LONG steps, each (processes,)."""
    step = (long - short) / (LONG - SHORT)
    return Times(step, short - SHORT * step)


def list_costs(versions: Sequence[str], measured: Mapping[str, Array], failed: Mapping[str, str]) -> list[Cost]:
    """Return the cost of every version, relative to the newest release.

    Args:
        versions: all versions in order; the last but one is the newest, and the last is the null.
        measured: version -> times (processes,) [s]; failed: version -> reason why it has no times.
    """
    newest, null = versions[-2], versions[-1]
    costs = []
    for version in versions:
        if version in failed:
            costs.append(Cost(version, newest, verdict=FOLDERS.sub("", failed[version])[:LONGEST]))
        else:
            width = null_width(measured[null], measured[newest]) if {newest, null} <= measured.keys() else None
            costs.append(compare_times(version, newest, measured, None if version in (newest, null) else width))
    return costs


def find_changes(versions: Sequence[str], measured: Mapping[str, Array], null: str) -> list[Cost]:
    """Return the costs that differ from those of the neighbour before by more than the noise.

    Args:
        versions: versions in order; measured: version or null -> times (processes,) [s].
        null: key of the newest release's second entrant.
    """
    timed = [x for x in versions if x in measured]
    if not timed or null not in measured:
        return []
    width = null_width(measured[null], measured[timed[-1]])
    costs = [compare_times(after, before, measured, width) for before, after in pairwise(timed)]
    return [x for x in costs if x.verdict in ("slower", "faster")]


def compare_times(version: str, other: str, measured: Mapping[str, Array], width: float | None) -> Cost:
    """Return the cost of a version relative to another; the ratio is judged if the width of the null is not None."""
    cost = Cost(version, other, seconds=float(np.median(measured[version])))
    if other not in measured:
        return cost
    ratio, low, high = ratio_of(measured[version], measured[other])
    return replace(cost, ratio=ratio, low=low, high=high, verdict="" if width is None else judge_ratio(low, high, width))


def ratio_of(times: Array, others: Array) -> tuple[float, float, float]:
    """Return the median ratio of two times (processes,), and the range of a second race; NaN if a time is not positive."""
    good = (times > 0) & (others > 0)
    if good.sum() < 2 or not good.all():
        return float("nan"), float("nan"), float("nan")
    quotients = times / others
    low, high = foreseen(quotients)
    return float(np.median(quotients)), low, high


def null_width(null: Array, newest: Array) -> float:
    """Return the largest distance from 1 in the range of the ratio of the newest release's two entrants."""
    _, low, high = ratio_of(null, newest)
    return max(1.0 - low, high - 1.0) if np.isfinite(low) else float("inf")


def judge_ratio(low: float, high: float, width: float) -> str:
    """Return "slower" or "faster" if the range (low, high) of a ratio differs from 1 by more than LEAST and the null's width."""
    margin = max(LEAST, width)
    if low > 1.0 + margin:
        return "slower"
    if high < 1.0 - margin:
        return "faster"
    return "same"
