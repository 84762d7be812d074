"""Find the cheapest of an engine's variants that meets a requirement, by fixed rules.

First, each variant is evaluated at sizes from coarse to fine; a size is a step, or a tolerance where the integrator chooses its own
steps. An evaluation is a whole run and its largest errors, which no timing affects, so that the same sizes pass in every search. A
ladder of some of the sizes ends when each requirement is met or cannot be met. Then the gap between the coarsest size that meets a
requirement and the next coarser one is halved until no size is left between them. `budget` limits the evaluations of one variant.

Second, the variants that meet the requirement race. A setting is left out if it costs more than NEAR times the cheapest, estimated
as the time of a step times the number of steps. The first process of the race includes all others, further processes only those
within CLOSE times the fastest in the first. A setting ties with the fastest if it is as fast in a quarter of the processes: then 1
lies within the middle half of their ratios. The whole range of ratios would also let a setting tie that takes a tenth longer. Of
those that tie, the first in the engine's file wins, so that a second search names the same winner, or one that tied.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from gauss_bench.bench.clock import common, quotients, time_of
from gauss_bench.reach import Requirement, Trial, convergence
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

# statuses that a finer size may cure
MENDABLE = (Status.NAN, Status.DIVERGED, Status.NOT_CONVERGED, Status.WARNING, Status.ERROR, Status.RANK_LOST)
COARSEST = 10  # steps of a run
PER_OCTAVE = 4  # sizes: neighbours differ by a fifth where they need not meet beats, and by a half at most
FIFTHS = 50  # steps of a run: fewer are multiples of five
SETTLED = 300  # steps of a run: with fewer, errors of fast links are as large as the motion and show no convergence
STALLED = 3  # a ladder ends after so many rungs without ...
FALLS = 0.7  # ... an unmet error below this share of the least before; order one at half the step gives 0.5
HOPE = 2.0  # a ladder ends if extrapolated errors need more than so many times the allowed steps
NEAR = 2.0  # times the cheapest estimate, which is right to a few per cent unless Newton's iterations grow with the step
CLOSE = 1.25  # times the fastest of the first process: ratios differ between processes by a tenth and more
LUCK = 0.05  # share of the resampled rounds of one process in which a setting that ties is as fast as the fastest
FINALISTS = 8  # settings of an engine that race for a requirement, at most

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Scale:
    """The sizes that may be tried, from coarse to fine, and the indices (`rungs`) of those that the ladder tries."""

    sizes: tuple[float, ...]
    rungs: tuple[int, ...]


def equal_steps(until: float, beats: int, most: int) -> Scale:
    """Return steps [s] that divide a run into COARSEST to `most` equal parts, PER_OCTAVE sizes for each factor of two.

    The run has `beats` equally spaced reference times, a multiple of ten, and a run is judged where its steps end at some of them.
    So that few steps are possible at all, fewer than FIFTHS steps need only meet five of these times, fewer than 5 `beats` steps
    ten of them, and more steps all. The rungs of the ladder are every factor of two, and the finest size.
    """
    wanted = [COARSEST * 2 ** (k / PER_OCTAVE) for k in range(math.floor(PER_OCTAVE * math.log2(most / COARSEST)) + 1)]
    units = [5 if x < FIFTHS else 10 if x < 5 * beats else beats for x in wanted]
    near = [unit * round(x / unit) for x, unit in zip(wanted, units, strict=True)]
    counts = sorted({x for x in near if x <= most})
    rungs = {counts.index(x) for x in near[::PER_OCTAVE] if x <= most}
    return Scale(tuple(until / x for x in counts), tuple(sorted({*rungs, len(counts) - 1})))


def no_coarser(scale: Scale, size: float) -> Scale:
    """Return the sizes of a scale that are not larger than `size`; the finest alone where all are larger."""
    first = next((k for k, x in enumerate(scale.sizes) if x <= size), len(scale.sizes) - 1)
    return Scale(scale.sizes[first:], tuple(sorted({0, *(k - first for k in scale.rungs if k > first)})))


def tolerances(largest: int = 2, smallest: int = 13) -> Scale:
    """Return tolerances from 10^-largest to 10^-smallest by factors of 10^(1/2); the ladder tries the whole powers."""
    exponents = range(2 * largest, 2 * smallest + 1)
    return Scale(tuple(10.0 ** (-k / 2) for k in exponents), tuple(range(0, len(exponents), 2)))


def explore(
    evaluate: Callable[[float], Trial], scale: Scale, wanted: Sequence[Requirement], budget: int, most: int = 0
) -> tuple[list[Trial], str]:
    """Return the trials of one variant, from coarse to fine, and the reason why the search ended.

    `most` is the largest number of steps of a run, 0 where the integrator chooses its steps.
    """
    tried: dict[int, Trial] = {}
    ended = "the finest size was tried"
    for k in scale.rungs:
        if len(tried) == budget:
            ended = f"the budget of {budget} evaluations was spent"
            break
        tried[k] = evaluate(scale.sizes[k])
        if reason := why_ended([tried[x] for x in sorted(tried)], wanted, most):
            ended = reason
            break
    while len(tried) < budget and (gap := next((g for w in wanted if (g := _gap(tried, w)) is not None), None)) is not None:
        tried[gap] = evaluate(scale.sizes[gap])
    return [tried[k] for k in sorted(tried)], ended


def _gap(tried: Mapping[int, Trial], wanted: Requirement) -> int | None:
    """Return the index halfway between the coarsest size that meets a requirement and the next coarser one tried, or None."""
    passing = min((k for k, trial in tried.items() if trial.meets(wanted)), default=0)
    coarser = max((k for k in tried if k < passing), default=passing)
    return (passing + coarser) // 2 if passing - coarser > 1 else None


def why_ended(trials: Sequence[Trial], wanted: Sequence[Requirement], most: int = 0) -> str:
    """Return the reason why a ladder ends with its last trial, or an empty text if it goes on."""
    last = trials[-1]
    if last.status is not Status.OK and last.status not in MENDABLE:
        return last.message
    unmet = [w for w in wanted if not any(t.meets(w) for t in trials) and not _is_undetermined(trials, w)]
    if not unmet:
        return "every requirement is met"
    if not most or len(trials) <= STALLED or (trials[-STALLED].steps or 0) < SETTLED:
        return ""
    if all(_has_stalled([t.errors.get(kind, math.inf) for t in trials]) for kind in {w.kind for w in unmet}):
        return f"no error fell in {STALLED} rungs"
    if all(convergence(trials, [w])[1] > HOPE * most for w in unmet):
        return f"errors fall too slowly for {most:,} steps".replace(",", " ")
    return ""


def _is_undetermined(trials: Sequence[Trial], wanted: Requirement) -> bool:
    """Tell whether the required error is NaN in a trial, such as joint forces of redundant rows."""
    return any(math.isnan(t.errors.get(wanted.kind, 0.0)) for t in trials)


def _has_stalled(errors: Sequence[float]) -> bool:
    """Tell whether the last STALLED errors are all larger than FALLS times the least one before."""
    before, after = min(errors[:-STALLED], default=math.inf), min(errors[-STALLED:])
    return after > FALLS * before or (math.isinf(before) and math.isinf(after))


def coarsest(trials: Sequence[Trial], wanted: Requirement) -> Trial | None:
    """Return the trial of the largest size that meets a requirement, or None."""
    return max((t for t in trials if t.meets(wanted)), key=lambda t: t.size, default=None)


def nearest(trials: Sequence[Trial], kind: str) -> Trial | None:
    """Return the trial with the least error of a kind, or None where no trial has that error."""
    known = [t for t in trials if t.status is Status.OK and math.isfinite(t.errors.get(kind, math.nan))]
    return min(known, key=lambda t: t.errors[kind], default=None)


def finalists(costs: Mapping[K, float]) -> list[K]:
    """Return the settings that race: FINALISTS at most, within NEAR times the cheapest by estimated cost [s]; order is kept."""
    chosen = sorted(costs, key=lambda k: costs[k])[:FINALISTS]
    least = min(costs.values(), default=math.inf)
    return [k for k in costs if k in chosen and costs[k] <= NEAR * least]


def close(times: Mapping[K, float]) -> list[K]:
    """Return the settings within CLOSE times the fastest, by their times [s] in the first process; order is kept."""
    least = min(times.values(), default=math.inf)
    return [k for k, x in times.items() if x <= CLOSE * least]


def pick_winner(samples: Mapping[K, Array]) -> tuple[K, list[K]]:
    """Return the winner of a race, and all settings that tie with the fastest.

    `samples` are the seconds (processes, rounds), or (rounds,) of one process, of each setting; of those that tie, the first wins.
    """
    times = {k: time_of(x) for k, x in samples.items()}
    fastest = min(times, key=lambda k: times[k])
    tied = [k for k in times if k == fastest or ties_with(samples[k], samples[fastest])]
    return tied[0], tied


def ties_with(samples: Array, fastest: Array) -> bool:
    """Tell whether a setting ties with the fastest: it took no longer in a quarter of the processes, or in LUCK of resamplings."""
    several = len(common(samples, fastest)[0]) > 1
    return bool(np.quantile(quotients(samples, fastest), 0.25 if several else LUCK) <= 1.0)
