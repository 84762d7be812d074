"""Find the cheapest of an engine's variants that meets a requirement, by fixed rules.

A variant is an engine with options, an integrator and a stabilisation. A size is a step, or a tolerance if the integrator chooses
its own steps. A setting is a variant with a size.

First, each variant is evaluated at sizes from coarse to fine: an evaluation is a whole run and its largest errors. The search tries
a coarse sequence of sizes (rungs of a ladder) until each requirement is met or it is clear that it cannot be met. Then it halves
the interval between the coarsest size that meets a requirement and the next coarser size tried.

Then settings that meet the requirement race: in a first process those whose estimated cost is at most NEAR times the least, and in
further processes those whose time in the first process is at most CLOSE times the shortest. If several settings tie with the
fastest (`ties_with`), the first one in the engine's file wins. A repeated search names the same winner or another tied setting.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from gauss_bench.bench.clock import quotients, restrict_to_common, time_of
from gauss_bench.reach import Requirement, Trial, convergence
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

# statuses that a finer size may prevent
MENDABLE = (Status.NAN, Status.DIVERGED, Status.NOT_CONVERGED, Status.WARNING, Status.ERROR, Status.RANK_LOST)
COARSEST = 10  # fewest steps of a run
# sizes for each factor of two: neighbours differ by a fifth, or by a half at most if steps must end at the sample times
PER_OCTAVE = 4
FIFTHS = 50  # with fewer steps, their number is a multiple of five
SETTLED = 300  # with fewer steps, errors of fast links are as large as the motion and show no convergence
STALLED = 3  # no finer sizes are tried if no error above its limit fell at this many successive sizes
FALLS = 0.7  # an error has fallen if it is below this fraction of the least error before; order one at half the step gives 0.5
HOPE = 2.0  # no finer sizes are tried if extrapolated errors need more than HOPE times the allowed steps
NEAR = 2.0  # times the least estimated cost; estimates are right to a few per cent unless Newton's iterations grow with the step
CLOSE = 1.25  # times the shortest time in the first process: ratios differ between processes by a tenth and more
LUCK = 0.05  # a setting that ran in one process ties if it takes no longer than the fastest in this fraction of the resamplings
FINALISTS = 8  # most settings of an engine that race for a requirement

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Scale:
    """The sizes (steps or tolerances) that may be tried, from coarse to fine, and the indices `rungs` of those tried first."""

    sizes: tuple[float, ...]
    rungs: tuple[int, ...]


def equal_steps(until: float, beats: int, most: int) -> Scale:
    """Return steps [s] that divide a run into COARSEST to `most` equal parts, with PER_OCTAVE sizes for each factor of two.

    The errors of a run are taken at sample times, which must be ends of steps. There are `beats` sample times, a multiple of ten,
    or fewer for a run with few steps. The number of steps is rounded to a multiple of

        5:        for fewer than FIFTHS steps; errors are taken at five sample times
        10:       for fewer than 5 `beats` steps; errors are taken at ten sample times
        `beats`:  for more steps; errors are taken at all sample times

    The `rungs` differ by factors of about two, and include the finest.
    """

    def round_steps(x: float) -> int:
        """Return the multiple of the number of sample times that is nearest to x steps."""
        times = 5 if x < FIFTHS else 10 if x < 5 * beats else beats
        return times * round(x / times)

    octaves = math.log2(most / COARSEST)
    rounded = [round_steps(COARSEST * 2 ** (k / PER_OCTAVE)) for k in range(math.floor(PER_OCTAVE * octaves) + 1)]
    counts = sorted({x for x in rounded if x <= most})  # numbers of steps
    rungs = {counts.index(x) for x in rounded[::PER_OCTAVE] if x <= most}
    return Scale(tuple(until / x for x in counts), tuple(sorted({*rungs, len(counts) - 1})))


def no_coarser(scale: Scale, size: float) -> Scale:
    """Return the part of a scale with the sizes that are at most `size`, or the finest size alone if all are larger."""
    first = next((k for k, x in enumerate(scale.sizes) if x <= size), len(scale.sizes) - 1)  # index of the coarsest of these
    return Scale(scale.sizes[first:], tuple(sorted({0, *(k - first for k in scale.rungs if k > first)})))


def tolerances(smallest: int = 13) -> Scale:
    """Return tolerances from 10^-2 to 10^-`smallest` with factors of 10^(1/2); the rungs are the whole powers of ten."""
    exponents = range(2 * 2, 2 * smallest + 1)  # k of the tolerance 10^(-k / 2)
    return Scale(tuple(10.0 ** (-k / 2) for k in exponents), tuple(range(0, len(exponents), 2)))


def explore(
    evaluate: Callable[[float], Trial], scale: Scale, wanted: Sequence[Requirement], budget: int, most: int = 0
) -> tuple[list[Trial], str]:
    """Return the trials of one variant, from coarse to fine, and the reason why no finer size was tried.

    Args:
        evaluate: returns the trial (a run and its errors) at a given size.
        budget: largest number of trials.
        most: largest number of steps of a run; 0 if the integrator chooses its steps.
    """
    tried: dict[int, Trial] = {}  # index of a size -> its trial
    ended = "the finest size was tried"
    for k in scale.rungs:
        if len(tried) == budget:
            ended = f"the budget of {budget} evaluations was spent"
            break
        tried[k] = evaluate(scale.sizes[k])
        if reason := why_ended([tried[x] for x in sorted(tried)], wanted, most):
            ended = reason
            break
    # the budget that is left is used to find the coarsest size that meets each requirement
    while len(tried) < budget and (halfway := _halve_gaps(tried, wanted)):
        tried[halfway[0]] = evaluate(scale.sizes[halfway[0]])
    return [tried[k] for k in sorted(tried)], ended


def _halve_gaps(tried: Mapping[int, Trial], wanted: Sequence[Requirement]) -> list[int]:
    """Return the indices of the sizes to be tried next, one per requirement, to bisect for the coarsest size that meets it.

    The index lies halfway between the coarsest size that meets the requirement and the next coarser size tried. There is none for a
    requirement that no size meets, or if no untried size lies between the two. `tried` maps indices of sizes to trials.
    """
    halfway = []
    for requirement in wanted:
        passing = min((k for k, trial in tried.items() if trial.meets(requirement)), default=0)
        coarser = max((k for k in tried if k < passing), default=passing)
        if passing - coarser > 1:
            halfway.append((passing + coarser) // 2)
    return halfway


def why_ended(trials: Sequence[Trial], wanted: Sequence[Requirement], most: int = 0) -> str:
    """Return why a search tries no finer sizes after its last trial, or an empty text if it goes on.

    The trials are from coarse to fine. `most` is the largest number of steps; 0 if the integrator chooses its steps.
    """
    last = trials[-1]  # finer steps cannot help if its status is neither OK nor one of MENDABLE
    if last.status is not Status.OK and last.status not in MENDABLE:
        return last.message
    # an error of NaN, such as that of forces which redundant rows leave undetermined, can meet no requirement
    undetermined = {kind for t in trials for kind, error in t.errors.items() if math.isnan(error)}
    unmet = [w for w in wanted if w.kind not in undetermined and not any(t.meets(w) for t in trials)]
    if not unmet:
        return "every requirement is met"
    # convergence is judged only from several runs with equal steps, and not too few of them
    if not most or len(trials) <= STALLED or (trials[-STALLED].steps or 0) < SETTLED:
        return ""
    if all(_has_stalled([t.errors.get(kind, math.inf) for t in trials]) for kind in {w.kind for w in unmet}):
        return f"no error fell in {STALLED} rungs"
    # the second result of `convergence` is the number of steps that would meet the requirement
    if all(convergence(trials, [w])[1] > HOPE * most for w in unmet):
        return f"errors fall too slowly for {most:,} steps".replace(",", " ")
    return ""


def _has_stalled(errors: Sequence[float]) -> bool:
    """Tell whether errors no longer fall: the last STALLED errors all exceed FALLS times the smallest one before them."""
    before, after = min(errors[:-STALLED], default=math.inf), min(errors[-STALLED:])
    return after > FALLS * before or (math.isinf(before) and math.isinf(after))


def coarsest(trials: Sequence[Trial], wanted: Requirement) -> Trial | None:
    """Return the trial with the largest size that meets a requirement, or None."""
    return max((t for t in trials if t.meets(wanted)), key=lambda t: t.size, default=None)


def nearest(trials: Sequence[Trial], kind: str) -> Trial | None:
    """Return the trial with the smallest error of a given kind, such as "position"; None if no trial has one."""
    known = [t for t in trials if t.status is Status.OK and math.isfinite(t.errors.get(kind, math.nan))]
    return min(known, key=lambda t: t.errors[kind], default=None)


def finalists(costs: Mapping[K, float]) -> list[K]:
    """Return the settings to be timed, in the order of `costs`: the FINALISTS cheapest, without those above NEAR times the least.

    `costs` maps a setting to the estimated time of its run [s].
    """
    cheapest = sorted(costs, key=lambda k: costs[k])[:FINALISTS]
    least = min(costs.values(), default=math.inf)
    return [k for k in costs if k in cheapest and costs[k] <= NEAR * least]


def close_to_fastest(times: Mapping[K, float]) -> list[K]:
    """Return the settings, in the order of `times`, whose time [s] in the first process is at most CLOSE times the least."""
    least = min(times.values(), default=math.inf)
    return [k for k, x in times.items() if x <= CLOSE * least]


def pick_winner(samples: Mapping[K, Array]) -> tuple[K, list[K]]:
    """Return the winner of a race, and all settings that tie with the fastest; the first of those that tie wins.

    `samples` maps a setting to its seconds (processes, rounds), or (rounds,) of one process.
    """
    times = {k: time_of(x) for k, x in samples.items()}
    fastest = min(times, key=lambda k: times[k])
    tied = [k for k in times if k == fastest or ties_with(samples[k], samples[fastest])]
    return tied[0], tied


def ties_with(samples: Array, fastest: Array) -> bool:
    """Tell whether a setting takes no longer than the fastest in at least a quarter of the processes that timed both.

    If only one process did, the setting must take no longer in at least a fraction LUCK of the bootstrap samples of the rounds.
    Both arguments are times [s] (processes, rounds).
    """
    several = len(restrict_to_common(samples, fastest)[0]) > 1
    return bool(np.quantile(quotients(samples, fastest), 0.25 if several else LUCK) <= 1.0)
