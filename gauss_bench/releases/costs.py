"""Time the steps of all releases of an engine's library in interleaved blocks, each release in processes of its own environment.

The time of a run of N steps is overhead + N * (time per step). Runs with two numbers of steps give the overhead and the time per
step. Ratios have the time of the newest release as denominator. The newest release is timed twice in each comparison, in separate
processes. The ratio of these two times should be 1. The noise is the distance from 1 to the farther end of the range in which this
ratio is expected.
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

PROCESSES, ROUNDS = 5, 10  # number of processes of each release that is timed, and of rounds in a process
SHORT, LONG = 40, 240  # number of steps of the two runs
STEP_TIME, OVERHEAD = "a step", "the fixed overhead of a run"
LEAST = 0.05  # smallest difference of a ratio from 1 that counts
NULL = "newest, raced against itself"  # stands for the version of the newest release where it is timed a second time


@dataclass(frozen=True, eq=False)
class Times:
    """The times of one release in one setting, each as an array (processes,) [s] with one value per process.

    Attributes:
        step: time of one step.
        overhead: fixed time of a run, whatever its number of steps.
    """

    step: Array
    overhead: Array


@dataclass(frozen=True)
class Cost:
    """A time of a release, and its ratio to that of another release.

    Attributes:
        version: the release that is timed.
        other: the release whose time is the denominator of the ratio: the newest release, or the one before `version`.
        linkage, setting, work: what was timed; work is STEP_TIME or OVERHEAD.
        seconds: time of `version`, the median over the processes [s].
        ratio: median over the processes of the time of `version` divided by that of `other`.
        low, high: range in which the ratio of a repeated timing is expected.
        verdict: "slower", "faster" or "same", or the reason why there is no time; "" if there is no verdict on the ratio.
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
    """Time all releases, and return two lists of costs.

    The first list has the cost of every release relative to the newest release. The second list has the cost of a release relative
    to the release before it, for releases whose times differ by more than the noise.

    Args:
        library: library of the releases.
        releases: at least two releases, the oldest first.
        told: function that is called with each sentence of progress.
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
    """Time releases side by side on a linkage, in PROCESSES processes each; every process builds its models anew.

    Args:
        linkage: the linkage as a text LINKAGE:SCENARIO.
        choice: the setting.
        entrants: version of a release -> name under which it is an engine. The key NULL stands for the second timing of the newest
            release.

    Returns:
        Two dictionaries with the keys of `entrants`: version -> measured times, and version -> reason why it could not be timed.
    """
    mechanism = find_mechanism(*linkage_of(linkage))
    rounds: dict[tuple[str, int], list[Array]] = {}  # version and number of steps -> for each process, seconds of its rounds
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
    """Return the time of a step and the fixed overhead of a run, from the times of runs of two lengths.

    Args:
        short, long: times (processes,) [s] of runs with SHORT steps and with LONG steps.
    """
    step = (long - short) / (LONG - SHORT)
    return Times(step, short - SHORT * step)


def list_costs(versions: Sequence[str], measured: Mapping[str, Array], failed: Mapping[str, str]) -> list[Cost]:
    """Return the cost of every release of a library, relative to the newest release.

    Args:
        versions: versions of all releases, the newest last, and then NULL for the second timing of the newest release.
        measured: version or NULL -> times (processes,) [s].
        failed: version or NULL -> reason why it could not be timed.
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
    """Return the costs of releases whose time differs from that of the release before them by more than the noise.

    Args:
        versions: versions in order, the newest last.
        measured: version or `null` -> times (processes,) [s].
        null: key in `measured` under which the second timing of the newest release is stored; how far its ratio to the first timing
            is from 1 shows the noise.
    """
    timed = [x for x in versions if x in measured]
    if not timed or null not in measured:
        return []
    width = null_width(measured[null], measured[timed[-1]])
    costs = [compare_times(after, before, measured, width) for before, after in pairwise(timed)]
    return [x for x in costs if x.verdict in ("slower", "faster")]


def compare_times(version: str, other: str, measured: Mapping[str, Array], width: float | None) -> Cost:
    """Return the cost of the release `version` relative to the release `other`.

    Args:
        version, other: the two releases; the ratio has the time of `other` as denominator.
        measured: version -> times (processes,) [s].
        width: noise of the ratio, as `null_width` returns it; with None the cost has no verdict ("slower", "faster" or "same").
    """
    cost = Cost(version, other, seconds=float(np.median(measured[version])))
    if other not in measured:
        return cost
    ratio, low, high = ratio_of(measured[version], measured[other])
    return replace(cost, ratio=ratio, low=low, high=high, verdict="" if width is None else judge_ratio(low, high, width))


def ratio_of(times: Array, others: Array) -> tuple[float, float, float]:
    """Return the median over the processes of times / others, and the lower and upper end of the expected range of the median.

    The median is expected in this range if the whole measurement is repeated (`foreseen`). The median and both ends are NaN if
    there are fewer than two processes, or if a time is not positive.

    Args:
        times, others: times of two releases (processes,) [s].
    """
    good = (times > 0) & (others > 0)
    if good.sum() < 2 or not good.all():
        return float("nan"), float("nan"), float("nan")
    quotients = times / others
    low, high = foreseen(quotients)
    return float(np.median(quotients)), low, high


def null_width(null: Array, newest: Array) -> float:
    """Return the noise of ratios: the distance from 1 to the farther end of the range of null / newest; infinite if not known.

    Args:
        null, newest: times (processes,) [s] of two identical measurements of the newest release; without noise the ratio is 1.
    """
    _, low, high = ratio_of(null, newest)
    return max(1.0 - low, high - 1.0) if np.isfinite(low) else float("inf")


def judge_ratio(low: float, high: float, width: float) -> str:
    """Return "slower" or "faster" if every ratio in a range differs from 1 by more than LEAST and the noise, else "same".

    Args:
        low, high: lower and upper end of the range of the ratio.
        width: the noise: how far from 1 the ratio of two times of the same release may be.
    """
    margin = max(LEAST, width)
    if low > 1.0 + margin:
        return "slower"
    if high < 1.0 - margin:
        return "faster"
    return "same"
