"""Race the steps of all releases of an engine in interleaved blocks, each in processes of its own environment.

A run of N steps takes the time  overhead + N step.  Runs of two lengths give both numbers. Ratios are to the times of the newest
release. The newest release is timed twice in each race, in processes of its own each time. The second time is the null comparison:
the ratio of both times should be 1, and how far its range reaches from 1 is the noise.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from gauss_bench.bench.clock import NO_KEY, Race, foreseen, quartiles
from gauss_bench.engines.base import Choice
from gauss_bench.releases.asking import FOLDERS, LONGEST
from gauss_bench.releases.cases import STEP, find_mechanism, linkage_of
from gauss_bench.releases.environments import Release, second_name
from gauss_bench.releases.library import Library
from gauss_bench.runs.blocks import block_elsewhere, running
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.worker import keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import Failure

PROCESSES, ROUNDS = 5, 10  # number of processes of each entrant (a release that is timed), and of rounds in a process
SHORT, LONG = 40, 240  # number of steps of the two runs
STEP_TIME, OVERHEAD = "a step", "the fixed overhead of a run"
LEAST = 0.05  # smallest difference of a ratio from 1 that counts
NULL = "newest, raced against itself"  # stands for the version of the newest release where it is timed a second time


@dataclass(frozen=True, eq=False)
class Times:
    """The times of one release in one setting: seconds (processes,) of a step, and of the fixed overhead of a run."""

    step: Array
    overhead: Array


@dataclass(frozen=True)
class Cost:
    """A time of a release, and its ratio to that of another release.

    Attributes:
        version: the release.
        other: the release by whose time the ratio divides: the newest, or the one before `version`.
        linkage, setting, work: what was timed; work is STEP_TIME or OVERHEAD.
        seconds: median over the processes [s].
        ratio: median ratio.
        low, high: range in which the ratio of a repeated race is expected.
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
    """Return the costs of all releases relative to the newest, and those relative to the release before that exceed the noise.

    Args:
        library: library of the releases.
        releases: at least two, the oldest first.
        told: called with each sentence of progress.
    """
    costs: list[Cost] = []
    changes: list[Cost] = []
    entrants = {x.version: x.name for x in releases} | {NULL: second_name(releases[-1])}  # version -> name of its engine
    for name, settings, integrator in library.raced:
        told(f"{library.engine}: racing {settings} {integrator} on {name}, {PROCESSES} times")
        choice, setting = Choice(settings, integrator, "none", STEP), f"{settings} {integrator}"
        times, failed = race(name, choice, entrants)
        steps = {version: x.step for version, x in times.items()}
        overheads = {version: x.overhead for version, x in times.items()}
        for work, measured in ((STEP_TIME, steps), (OVERHEAD, overheads)):
            found = list_costs([*entrants], measured, failed)
            differing = find_changes([x.version for x in releases], measured, NULL)
            costs += [replace(x, linkage=name, setting=setting, work=work) for x in found]
            changes += [replace(x, linkage=name, setting=setting, work=work) for x in differing]
    return costs, changes


def race(linkage: str, choice: Choice, entrants: dict[str, str]) -> tuple[dict[str, Times], dict[str, str]]:
    """Time releases on a linkage in PROCESSES processes each; every process builds its models anew.

    Args:
        entrants: version, or NULL -> name of its engine.

    Returns:
        Version -> times, and version -> reason why it has no times.
    """
    mechanism = find_mechanism(*linkage_of(linkage))
    rounds: dict[tuple[str, int], list[Array]] = {}  # version and number of steps -> seconds of the rounds, of each process
    failed: dict[str, str] = {}
    for _ in range(PROCESSES):
        runners = Race()
        for version, name in entrants.items():
            for count in (SHORT, LONG):
                work = partial(running, NO_KEY, choice, np.array([0.0, count * STEP]), 1.0)  # the whole run
                runners.add((version, count), block_elsewhere, name, mechanism, choice, work)
        measured = runners.run(ROUNDS)
        for version, name in entrants.items():
            for count in (SHORT, LONG):
                try:
                    rounds.setdefault((version, count), []).append(measured.of((version, count)))
                except Failure as failure:
                    failed[version] = str(failure)
            keep(f"races in {interpreter_of(name).python}").stop()  # ends its process, and the next repetition starts a new one
    times = {}
    for version in entrants:
        if version not in failed:
            short, long = (np.concatenate([quartiles(x) for x in rounds[version, count]]) for count in (SHORT, LONG))
            times[version] = split(short, long)
    return times, failed


def split(short: Array, long: Array) -> Times:
    """Return the time of a step and the fixed overhead of a run.

    Args:
        short, long: times (processes,) [s] of runs with SHORT steps and with LONG steps.
    """
    step = (long - short) / (LONG - SHORT)
    return Times(step, short - SHORT * step)


def list_costs(versions: Sequence[str], measured: Mapping[str, Array], failed: Mapping[str, str]) -> list[Cost]:
    """Return the cost of every version, relative to the newest release.

    Args:
        versions: all versions in order, and at the end NULL, the newest release timed a second time.
        measured: version or NULL -> times (processes,) [s].
        failed: version or NULL -> reason why it has no times.
    """
    newest, null = versions[-2], versions[-1]
    costs = []
    for version in versions:
        if version in failed:
            reason = FOLDERS.sub("", failed[version])[:LONGEST]  # without the folders of this machine
            costs.append(Cost(version, newest, verdict=reason))
        else:
            width = null_width(measured[null], measured[newest]) if {newest, null} <= measured.keys() else None
            costs.append(compare_times(version, newest, measured, None if version in (newest, null) else width))
    return costs


def find_changes(versions: Sequence[str], measured: Mapping[str, Array], null: str) -> list[Cost]:
    """Return the costs of releases whose time differs from that of the release before by more than the noise.

    Args:
        versions: versions in order.
        measured: version or `null` -> times (processes,) [s].
        null: key in `measured` of the second time of the newest release, which shows the noise.
    """
    timed = [x for x in versions if x in measured]
    if not timed or null not in measured:
        return []
    width = null_width(measured[null], measured[timed[-1]])
    costs = [compare_times(after, before, measured, width) for before, after in pairwise(timed)]
    return [x for x in costs if x.verdict in ("slower", "faster")]


def compare_times(version: str, other: str, measured: Mapping[str, Array], width: float | None) -> Cost:
    """Return the cost of a version relative to another.

    Args:
        measured: version -> times (processes,) [s].
        width: the noise, `null_width`; None if the ratio is not judged.
    """
    cost = Cost(version, other, seconds=float(np.median(measured[version])))
    if other not in measured:
        return cost
    ratio, low, high = ratio_of(measured[version], measured[other])
    return replace(cost, ratio=ratio, low=low, high=high, verdict="" if width is None else judge_ratio(low, high, width))


def ratio_of(times: Array, others: Array) -> tuple[float, float, float]:
    """Return the median ratio of the times of two versions, and the range in which that of a repeated race is expected.

    All three are NaN if there are fewer than two processes or if a time is not positive.

    Args:
        times, others: (processes,) [s]; the ratio is times / others.
    """
    good = (times > 0) & (others > 0)
    if good.sum() < 2 or not good.all():
        return float("nan"), float("nan"), float("nan")
    quotients = times / others
    low, high = foreseen(quotients)
    return float(np.median(quotients)), low, high


def null_width(null: Array, newest: Array) -> float:
    """Return the noise: how far the range of the ratio of two times of the newest release reaches from 1; infinite if not known.

    Args:
        null, newest: both times (processes,) [s].
    """
    _, low, high = ratio_of(null, newest)
    return max(1.0 - low, high - 1.0) if np.isfinite(low) else float("inf")


def judge_ratio(low: float, high: float, width: float) -> str:
    """Return "slower" or "faster" if the whole range of a ratio is farther from 1 than LEAST and than the noise, else "same".

    Args:
        low, high: ends of the range.
        width: the noise: how far the ratio of two times of the same release may be from 1.
    """
    margin = max(LEAST, width)
    if low > 1.0 + margin:
        return "slower"
    if high < 1.0 - margin:
        return "faster"
    return "same"
