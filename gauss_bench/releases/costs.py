"""Race the steps of all releases of an engine in interleaved blocks, each in processes of its own environment.

A run of N steps takes  fixed + N step.  Runs of two lengths give both: the time of a step is the slope, the fixed overhead of a run
the rest. A ratio is to the newest release, over the processes. The newest runs a second time in processes of its own: the spread of
that ratio is the noise.
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
        version, other: the release, and the one to which the ratio is: the newest, or the neighbour before it.
        linkage, setting, work: what was timed; work is STEP_TIME or OVERHEAD.
        seconds: median of the processes.
        ratio, low, high: with the range of a second race.
        verdict: "slower", "faster" or "same", or why it has no time; "" where nothing is judged.
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
    """Return the costs of all releases, oldest first, and those of neighbours that differ by more than noise."""
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
            found = list_costs([*entrants], measured, failed), find_changes([x.version for x in releases], measured, NULL)
            for into, some in zip((costs, changes), found, strict=True):
                into += [replace(x, linkage=name, setting=setting, work=work) for x in some]
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


def list_costs(versions: Sequence[str], measured: Mapping[str, Array], failed: Mapping[str, str]) -> list[Cost]:
    """Return the cost of every version. The last but one is the newest, to which ratios are; the last is the same once more."""
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
    """Return the costs that differ from the neighbour's before, of those measured, beyond their range and that of the null."""
    timed = [x for x in versions if x in measured]
    if not timed or null not in measured:
        return []
    width = null_width(measured[null], measured[timed[-1]])
    costs = [compare_times(after, before, measured, width) for before, after in pairwise(timed)]
    return [x for x in costs if x.verdict in ("slower", "faster")]


def compare_times(version: str, other: str, measured: Mapping[str, Array], width: float | None) -> Cost:
    """Return the cost of a version with its ratio to another, judged where the width of the null is known."""
    cost = Cost(version, other, seconds=float(np.median(measured[version])))
    if other not in measured:
        return cost
    ratio, low, high = ratio_of(measured[version], measured[other])
    return replace(cost, ratio=ratio, low=low, high=high, verdict="" if width is None else judge_ratio(low, high, width))


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
