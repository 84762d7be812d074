"""Time the steps of all releases of an engine's library in interleaved blocks, each release in processes of its own environment.

The time of a run of N steps is overhead + N * (time per step). Runs with two numbers of steps give the overhead and the time per
step. Costs are ratios to the time of the newest release, and changes of cost are ratios to the time of the release before. The
newest release is timed twice in each comparison, in separate processes. The ratio of these two times should be 1. The noise is the
distance from 1 to the farther end of the range in which this ratio is expected.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from gauss_bench.bench.clock import NO_KEY, Race, prediction_interval, quartiles
from gauss_bench.bench.measure import mechanism_of
from gauss_bench.engines.base import Choice
from gauss_bench.releases.asking import FOLDERS, LONGEST
from gauss_bench.releases.cases import STEP, linkage_of
from gauss_bench.releases.environments import Release, second_name
from gauss_bench.releases.library import Library
from gauss_bench.runs.blocks import block_elsewhere, run_block
from gauss_bench.runs.offers import interpreter_of
from gauss_bench.runs.worker import get_worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Failure

PROCESSES, ROUNDS = 5, 10  # number of processes of each release that is timed, and of rounds in a process
SHORT, LONG = 40, 240  # number of steps of the two runs
STEP_TIME, OVERHEAD = "a step", "the fixed overhead of a run"
LEAST = 0.05  # smallest difference of a ratio from 1 that counts
NULL = "newest, raced against itself"  # version under which the newest release is timed a second time
NO_TIMES = np.array([np.nan])  # of a release that could not be timed

Rows = list[dict[str, Any]]


def race_releases(library: Library, releases: Sequence[Release], told: Callable[[str], None]) -> tuple[Rows, Rows]:
    """Time at least two releases, the oldest first; return their costs, and the changes of cost from one release to the next.

    The costs are relative to the newest release. The changes are costs relative to the release before, where these differ from 1
    by more than LEAST and the noise. `told` is called with a sentence when a race begins.

    Both are rows of `compare_times` with the additional columns `case`, `setting` and `work` (STEP_TIME or OVERHEAD).
    """
    costs: Rows = []
    changes: Rows = []
    entrants = {x.version: x.name for x in releases} | {NULL: second_name(releases[-1])}  # version -> name of its engine
    for name, settings, integrator in library.raced:
        told(f"{library.engine}: racing {settings} {integrator} on {name}, in {PROCESSES} processes")
        choice, setting = Choice(settings, integrator, "none", STEP), f"{settings} {integrator}"
        times, failed = race(name, choice, entrants)
        for work in (STEP_TIME, OVERHEAD):
            measured = {version: x[work] for version, x in times.items()}
            what = {"case": name, "setting": setting, "work": work}
            costs += [what | row for row in list_costs([*entrants], measured, failed)]
            changes += [what | row for row in find_changes([x.version for x in releases], measured, NULL)]
    return costs, changes


def race(linkage: str, choice: Choice, entrants: dict[str, str]) -> tuple[dict[str, dict[str, Array]], dict[str, str]]:
    """Time releases side by side in PROCESSES processes each; every process builds its models itself.

    Return version -> its times (`split_times`), and version -> the reason why it could not be timed.

    Args:
        linkage: "LINKAGE:SCENARIO".
        entrants: version -> name of its engine; the version NULL is the second timing of the newest release.
    """
    mechanism = mechanism_of(*linkage_of(linkage))
    rounds: dict[tuple[str, int], list[Array]] = {}  # version and number of steps -> for each process, times of its rounds [s]
    failed: dict[str, str] = {}
    for _ in range(PROCESSES):
        runners = Race()
        for version, name in entrants.items():
            for count in (SHORT, LONG):
                work = partial(run_block, NO_KEY, choice, np.array([0.0, count * STEP]), 1.0)  # the whole run
                runners.add((version, count), block_elsewhere, name, mechanism, choice, work)
        measured = runners.run(ROUNDS)
        for version, name in entrants.items():
            for count in (SHORT, LONG):
                try:
                    rounds.setdefault((version, count), []).append(measured.of((version, count)))
                except Failure as failure:
                    failed[version] = str(failure)
            get_worker(f"races in {interpreter_of(name).python}").stop()  # the next repetition starts a new process
    times = {}
    for version in entrants:
        if version not in failed:
            short, long = (np.concatenate([quartiles(x) for x in rounds[version, count]]) for count in (SHORT, LONG))
            times[version] = split_times(short, long)
    return times, failed


def split_times(short: Array, long: Array) -> dict[str, Array]:
    """Return the times STEP_TIME and OVERHEAD (processes,) [s], from the times of runs with SHORT and with LONG steps."""
    step = (long - short) / (LONG - SHORT)
    return {STEP_TIME: step, OVERHEAD: short - SHORT * step}


def list_costs(versions: Sequence[str], measured: Mapping[str, Array], failed: Mapping[str, str]) -> Rows:
    """Return the cost (`compare_times`) of every release of a library, relative to the newest release.

    Args:
        versions: versions of all releases, the newest last, and then NULL for the second timing of the newest release.
        measured: version or NULL -> times (processes,) [s].
        failed: version or NULL -> reason why it could not be timed.
    """
    newest, null = versions[-2:]
    width = noise_of_ratios(measured[null], measured[newest]) if {newest, null} <= measured.keys() else None
    costs = []
    for version in versions:
        cost = compare_times(version, newest, measured, None if version in (newest, null) else width)
        if version in failed:
            cost["verdict"] = FOLDERS.sub("", failed[version])[:LONGEST]  # without the folders of this machine
        costs.append(cost)
    return costs


def find_changes(versions: Sequence[str], measured: Mapping[str, Array], null: str) -> Rows:
    """Return the costs of releases whose time differs from that of the timed release before by more than LEAST and the noise.

    The column `before` has the version of the release before. `versions` are in order, the newest last; `measured` maps a version,
    or `null` for the second timing of the newest, to times (processes,) [s].
    """
    timed = [x for x in versions if x in measured]
    if not timed or null not in measured:
        return []
    width = noise_of_ratios(measured[null], measured[timed[-1]])
    costs = [{"before": before} | compare_times(after, before, measured, width) for before, after in pairwise(timed)]
    return [row for row in costs if row["verdict"] in ("slower", "faster")]


def compare_times(version: str, other: str, measured: Mapping[str, Array], width: float | None) -> dict[str, Any]:
    """Return the cost of the release `version` relative to the release `other`, as columns of the table `release_costs`.

    Times and ratios of a release that is not in `measured` are NaN. If the noise of ratios, `width`, is None, the verdict is empty.
    """
    times, others = (measured.get(x, NO_TIMES) for x in (version, other))
    ratio, low, high = ratio_of(times, others)
    verdict = "" if width is None else judge_ratio(low, high, width)
    seconds = float(np.median(times))
    return {"version": version, "seconds": seconds, "ratio": ratio, "ratio_low": low, "ratio_high": high, "verdict": verdict}


def ratio_of(times: Array, others: Array) -> tuple[float, float, float]:
    """Return the median over the processes of times / others, and the ends of the range in which a repeated median is expected.

    All are NaN if there are fewer than two processes, or if a time is not positive.
    """
    good = (times > 0) & (others > 0)
    if good.sum() < 2 or not good.all():
        return float("nan"), float("nan"), float("nan")
    quotients = times / others
    low, high = prediction_interval(quotients)
    return float(np.median(quotients)), low, high


def noise_of_ratios(null: Array, newest: Array) -> float:
    """Return the noise of ratios: the distance from 1 to the farther end of the range of null / newest.

    `null` and `newest` are the times (processes,) [s] of both timings of the newest release. The noise is infinite if the range is
    not known.
    """
    _, low, high = ratio_of(null, newest)
    return max(1.0 - low, high - 1.0) if np.isfinite(low) else float("inf")


def judge_ratio(low: float, high: float, width: float) -> str:
    """Return "slower" or "faster" if every ratio from low to high differs from 1 by more than LEAST and the noise, else "same"."""
    margin = max(LEAST, width)
    if low > 1.0 + margin:
        return "slower"
    if high < 1.0 - margin:
        return "faster"
    return "same"
