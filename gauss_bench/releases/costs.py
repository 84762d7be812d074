"""Race the steps of all releases of an engine in interleaved blocks, each in processes of its own environment.

A run of N steps takes  fixed + N step.  Runs of two lengths give both: the time of a step is the slope, the fixed overhead of a run
the rest. A ratio is to the newest release, over the processes. The newest runs a second time in processes of its own: the spread of
that ratio is the noise.
"""

from collections.abc import Callable, Sequence
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

PROCESSES, ROUNDS = 5, 10
SHORT, LONG = 40, 240  # steps of the two runs
STEP_TIME, OVERHEAD = "a step", "the fixed overhead of a run"
LEAST = 0.05  # a ratio must differ from 1 by more than this
NULL = "newest, raced against itself"


@dataclass(frozen=True, eq=False)
class Times:
    """The times of one release in one setting: seconds (processes,) of a step, and of what a run takes beside its steps."""

    step: Array
    overhead: Array


@dataclass(frozen=True)
class Cost:
    """A time of a release, and its ratio to that of another.

    Attributes:
        work: STEP_TIME or OVERHEAD; seconds: median of the processes.
        ratio, low, high: to the newest release, with the range of a second race.
        verdict: "slower" or "faster" than the newest, "same", or why it has no time.
    """

    version: str
    linkage: str
    setting: str
    work: str
    seconds: float = float("nan")
    ratio: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    verdict: str = ""


@dataclass(frozen=True)
class CostChange:
    """A change of cost between neighbours: the time of the later release divided by that of the earlier."""

    before: str
    after: str
    linkage: str
    setting: str
    work: str
    ratio: float
    low: float
    high: float


def race_releases(
    library: Library, releases: Sequence[Release], told: Callable[[str], None]
) -> tuple[list[Cost], list[CostChange]]:
    """Return the costs of all releases, oldest first, and the changes between neighbours that are more than noise."""
    costs: list[Cost] = []
    changes: list[CostChange] = []
    entrants = {x.version: x.name for x in releases} | {NULL: again(releases[-1])}
    for name, settings, integrator in library.raced:
        told(f"{library.engine}: racing {settings} {integrator} on {name}, {PROCESSES} times")
        choice, setting = Choice(settings, integrator, "none", STEP), f"{settings} {integrator}"
        times, failed = race(name, choice, entrants)
        steps = {version: x.step for version, x in times.items()}
        overheads = {version: x.overhead for version, x in times.items()}
        for work, measured in ((STEP_TIME, steps), (OVERHEAD, overheads)):
            costs += list_costs(name, setting, work, [*entrants], measured, failed)
            found = find_changes([x.version for x in releases], measured, NULL)
            changes += [replace(x, linkage=name, setting=setting, work=work) for x in found]
    return costs, changes


def race(linkage: str, choice: Choice, entrants: dict[str, str]) -> tuple[dict[str, Times], dict[str, str]]:
    """Return version -> times, and version -> the reason why it has none; every process builds its models anew."""
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


def list_costs(
    linkage: str, setting: str, work: str, versions: Sequence[str], measured: dict[str, Array], failed: dict[str, str]
) -> list[Cost]:
    """Return the cost of every version. The last but one is the newest, to which ratios are; the last is the same once more."""
    newest, null = versions[-2], versions[-1]
    costs = []
    for version in versions:
        if version in failed:
            costs.append(Cost(version, linkage, setting, work, verdict=FOLDERS.sub("", failed[version])[:LONGEST]))
            continue
        cost = Cost(version, linkage, setting, work, float(np.median(measured[version])))
        if newest in measured:
            ratio, low, high = ratio_of(measured[version], measured[newest])
            cost = replace(cost, ratio=ratio, low=low, high=high)
            if null in measured and version not in (newest, null):
                cost = replace(cost, verdict=judge_ratio(low, high, null_width(measured[null], measured[newest])))
        costs.append(cost)
    return costs


def find_changes(versions: Sequence[str], measured: dict[str, Array], null: str) -> list[CostChange]:
    """Return the changes of cost between neighbours that were both measured, each beyond its range and that of the null."""
    timed = [x for x in versions if x in measured]
    if not timed or null not in measured:
        return []
    width = null_width(measured[null], measured[timed[-1]])
    changes = []
    for before, after in pairwise(timed):
        ratio, low, high = ratio_of(measured[after], measured[before])
        if judge_ratio(low, high, width) in ("slower", "faster"):
            changes.append(CostChange(before, after, "", "", "", ratio, low, high))
    return changes


def ratio_of(times: Array, others: Array) -> tuple[float, float, float]:
    """Return the median ratio of two times (processes,), with the range of a second race; NaN where a time is not positive."""
    good = (times > 0) & (others > 0)
    if good.sum() < 2 or not good.all():
        return float("nan"), float("nan"), float("nan")
    quotients = times / others
    low, high = foreseen(quotients)
    return float(np.median(quotients)), low, high


def null_width(null: Array, newest: Array) -> float:
    """Return how far the ratio of the newest release to itself reaches from 1."""
    _, low, high = ratio_of(null, newest)
    return max(1.0 - low, high - 1.0) if np.isfinite(low) else float("inf")


def judge_ratio(low: float, high: float, width: float) -> str:
    """Return "slower" or "faster" if a ratio's range lies beyond LEAST and beyond the null's; else "same"."""
    margin = max(LEAST, width)
    if low > 1.0 + margin:
        return "slower"
    if high < 1.0 - margin:
        return "faster"
    return "same"
