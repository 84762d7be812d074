"""Ways: a way is a variant of an engine at a step or tolerance. This file runs, judges and times ways for searches.

The searches are `measurements/search.py` and `../advice`.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.bench.tasks import CASE_LIMIT
from gauss_bench.engines import environment_of
from gauss_bench.engines.base import Choice, Variant
from gauss_bench.engines.own_options import is_assignment
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import joint_force_errors, state_errors
from gauss_bench.reach import Trial
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.blocks import Block, Models, Work, block_elsewhere, build_once, leading, running, share_of, stepping
from gauss_bench.runs.offers import Offer, offer
from gauss_bench.runs.one_run import Run as Ended
from gauss_bench.runs.one_run import Sampling
from gauss_bench.trajectory import Reference

BEATS = (50, 40, 30, 20, 10)  # parts of a run; the first number is used for which the reference has samples at all ends of parts
ROUGH_ROUNDS = 8  # rounds of the estimate of a step, which must be right within `search.NEAR`


class Way(NamedTuple):
    """A variant of an engine at a size."""

    engine: str
    settings: str
    integrator: str
    stabilization: str
    size: float


class Run(NamedTuple):
    """The motion of a search: a linkage (name or path) from 0 to `until` [s]."""

    linkage: str
    mechanism: Mechanism
    until: float


def space(engine: Offer) -> list[Variant]:
    """Return the variants of an engine: its own list, or every setting with every integrator and stabilisation."""
    if engine.variants:
        return list(engine.variants.values())
    return [
        Variant(label, integrator, stabilization, options)
        for label, options in engine.settings.items()
        for integrator in engine.integrators
        for stabilization in engine.stabilizations
    ]


def options_of(way: Way) -> Mapping[str, Any]:
    """Return the options that the settings of a way stand for: a variant, a label, or options one by one."""
    offered = offer(way.engine)
    if is_assignment(way.settings):
        return offered.resolve_settings(way.settings)
    variant = offered.variants.get(way.settings)
    return variant.options if variant else offered.settings.get(way.settings, {})


def loop_of(way: Way) -> str:
    """Return the name of the time loop of a setting (option `loop`), or an empty text where there is no such option."""
    return str(options_of(way).get("loop", ""))


def choice_of(way: Way, adaptive: bool, until: float) -> Choice:
    """Return the choice that a way stands for; its size is a tolerance if the integrator is adaptive, else a step [s]."""
    chosen = (way.settings, way.integrator, way.stabilization)
    return Choice(*chosen, step=until, tolerance=way.size) if adaptive else Choice(*chosen, step=way.size)


def has_samples(truth: Reference, until: float, beats: int) -> bool:
    """Tell whether the reference has samples at the ends of all `beats` equal parts of a run."""
    times = until / beats * np.arange(beats + 1)
    near = np.minimum(np.searchsorted(truth.t, times - 1e-9), len(truth.t) - 1)
    return bool((np.abs(truth.t[near] - times) < 1e-9).all())


def evaluate_run(run: Run, judge: Evaluator, truth: Reference, way: Way, adaptive: bool, beats: int) -> Trial:
    """Run a way, with samples at the beats that its steps meet, and return the largest errors of the run."""
    steps = beats if adaptive else round(run.until / way.size)
    wanted = sample(run, steps, math.gcd(steps, beats))
    return judge_trial(
        run, judge, truth, way, run_of(request_of(run, way, adaptive, wanted), run.mechanism, CASE_LIMIT, again=True)
    )


def sample(run: Run, steps: int, samples: int) -> Sampling:
    """Return the sampling of a run of equal steps, with the start and `samples` further samples."""
    return Sampling(run.until / samples * np.arange(samples + 1), run.until / steps, steps, 0)


def request_of(run: Run, way: Way, adaptive: bool, wanted: Sampling) -> Request:
    """Return the request for a run of a way."""
    return Request(run.linkage, run.mechanism.scenario, way.engine, choice_of(way, adaptive, run.until), wanted)


def judge_trial(run: Run, judge: Evaluator, truth: Reference, way: Way, ran: Ended) -> Trial:
    """Return the trial of a run: its largest errors at the times that it shares with the reference."""
    if ran.trajectory is None:
        return Trial(way.size, {}, ran.sampling.count, ran.status, ran.message)
    errors = state_errors(run.mechanism, ran.trajectory, truth)
    force = joint_force_errors(judge, ran.trajectory, truth)
    largest = {"position": errors.length, "angle": errors.angle, "force": force}
    found = {kind: float(x.max()) for kind, x in largest.items()} | {"end": float(errors.length[-1].max())}
    steps = ran.trajectory.steps
    if steps is None and not is_adaptive(way):  # equal steps: those that were asked for
        steps = ran.sampling.count
    return Trial(way.size, found, steps, evaluations=ran.trajectory.evaluations)


def is_adaptive(way: Way) -> bool:
    """Tell whether the integrator of a way chooses its steps, so that its size is a tolerance."""
    return way.integrator in offer(way.engine).adaptive


def block_of(run: Run, way: Way, models: Models, work: Work) -> Block:
    """Return the block, without its entry, of some work of a way: here, or in the environment in which its engine lives.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    choice = choice_of(way, is_adaptive(way), run.until)
    if environment_of(way.engine) is None:
        return work(build_once(models, way.engine, run.mechanism, choice))
    return block_elsewhere(way.engine, run.mechanism, choice, work)


def one_step(run: Run, way: Way, steps: int | None, models: Models) -> Block:
    """Return a block of steps; if the integrator chooses its steps, the block is a whole run of `steps` repetitions.

    A run whose steps are not counted is one repetition.
    """
    if not is_adaptive(way):
        return block_of(run, way, models, partial(stepping, None, step=way.size, native=True))
    block = whole_run(run, way, steps, 0.0, math.inf, models)
    block.count = steps or 1
    return block


def whole_run(run: Run, way: Way, steps: int | None, seconds: float, lead: float, models: Models) -> Block:
    """Return a block of a whole run, repeated for BLOCK seconds; of equal steps only a part that takes `lead` [s].

    `steps` is None where the integrator chooses them and the engine does not count them.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    adaptive = is_adaptive(way)
    share = 1.0 if adaptive or steps is None else share_of(seconds, lead, steps)
    choice = choice_of(way, adaptive, run.until)
    return block_of(run, way, models, partial(running, None, choice, np.array([0.0, share * run.until]), share))


def pace_run(run: Run, way: Way, steps: int | None, lead: float, samples: int, models: Models) -> Block:
    """Return a block as `whole_run` does, for a way whose run time is not known: its first steps are timed before.

    If the integrator chooses its steps, the run has `samples` samples, as the run that was judged.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    choice = choice_of(way, is_adaptive(way), run.until)
    if is_adaptive(way) or steps is None:
        return block_of(run, way, models, partial(running, None, choice, np.linspace(0.0, run.until, samples + 1), 1.0))
    return block_of(run, way, models, partial(leading, None, choice, run.until, steps, lead))
