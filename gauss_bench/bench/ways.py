"""Run, judge and time settings of engines, for the searches in `measurements/search.py` and `../advice`."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from gauss_bench.bench.clock import NO_KEY
from gauss_bench.bench.tasks import CASE_LIMIT
from gauss_bench.engines import environment_of
from gauss_bench.engines.base import Choice, Variant
from gauss_bench.engines.own_options import is_assignment
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import joint_force_errors, state_errors
from gauss_bench.reach import Trial
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.blocks import Block, Models, Work, block_elsewhere, get_model, lead_block, run_block, share_of, steps_block
from gauss_bench.runs.offers import Offer, offer
from gauss_bench.runs.one_run import Run as Ended
from gauss_bench.runs.one_run import Sampling
from gauss_bench.trajectory import Reference

# numbers of equal parts (beats) into which a run may be divided; errors are taken at the ends of the parts, and the first number is
# used for which the reference has samples there
BEATS = (50, 40, 30, 20, 10)
ROUGH_ROUNDS = 8  # rounds of the estimate of a step's time, whose error must be well below the factor `search.NEAR`


class Way(NamedTuple):
    """A setting of an engine: the names of engine, settings, integrator and stabilisation, and a size.

    The size is a step [s], or a tolerance if the integrator chooses its steps. `settings` is the name of a variant, the label of
    settings, or a list of assignments "key=value".
    """

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
    """Return option -> value for an engine's setting; empty if the engine does not know the settings that `way` names."""
    engine = offer(way.engine)
    if is_assignment(way.settings):
        return engine.resolve_settings(way.settings)
    variant = engine.variants.get(way.settings)
    return variant.options if variant else engine.settings.get(way.settings, {})


def loop_of(way: Way) -> str:
    """Return the option `loop` of a setting, the name of its loop over the time steps, or an empty text."""
    return str(options_of(way).get("loop", ""))


def choice_of(way: Way, adaptive: bool, until: float) -> Choice:
    """Return a setting as a `Choice` for a run that ends at `until` [s].

    If the integrator is `adaptive`, the size becomes the tolerance, and the step is the whole duration, so that it sets no limit.
    """
    if adaptive:
        return Choice(way.settings, way.integrator, way.stabilization, step=until, tolerance=way.size)
    return Choice(way.settings, way.integrator, way.stabilization, step=way.size)


def evaluate_run(run: Run, evaluator: Evaluator, truth: Reference, way: Way, adaptive: bool, beats: int) -> Trial:
    """Run a setting of an engine, and return the largest errors at the sample times that are ends of steps.

    Args:
        adaptive: whether the integrator chooses its steps; the run then has samples at all sample times.
        beats: number of sample times, at equal distances, at which errors are taken.
    """
    steps = beats if adaptive else round(run.until / way.size)
    # k equal parts of the run end at sample times and at ends of steps if k divides both `beats` and `steps`
    request = request_of(run, way, adaptive, sample(run, steps, math.gcd(steps, beats)))
    return judge_trial(run, evaluator, truth, way, run_of(request, run.mechanism, CASE_LIMIT, keep_model=True))


def sample(run: Run, steps: int, samples: int) -> Sampling:
    """Return the sample times of a run of `steps` equal steps: the start, and `samples` further times at equal distances."""
    return Sampling(run.until / samples * np.arange(samples + 1), run.until / steps, steps, 0)


def request_of(run: Run, way: Way, adaptive: bool, wanted: Sampling) -> Request:
    """Return the request for a run of one engine with one setting."""
    return Request(run.linkage, run.mechanism.scenario, way.engine, choice_of(way, adaptive, run.until), wanted)


def judge_trial(run: Run, evaluator: Evaluator, truth: Reference, way: Way, ended: Ended) -> Trial:
    """Return the trial of an ended run: the reason for its failure, or its largest errors.

    Errors are taken at the common sample times of run and reference; "end" is the error of position at the last one.
    """
    if ended.trajectory is None:
        return Trial(way.size, {}, ended.sampling.count, ended.status, ended.message)
    errors = state_errors(run.mechanism, ended.trajectory, truth)
    force = joint_force_errors(evaluator, ended.trajectory, truth)
    over_time = {"position": errors.length, "angle": errors.angle, "force": force}
    found = {kind: float(x.max()) for kind, x in over_time.items()} | {"end": float(errors.length[-1].max())}
    steps = ended.trajectory.steps
    if steps is None and not is_adaptive(way):  # equal steps: those that were asked for
        steps = ended.sampling.count
    return Trial(way.size, found, steps, evaluations=ended.trajectory.evaluations)


def is_adaptive(way: Way) -> bool:
    """Tell whether the integrator of a setting chooses its own steps, so that `way.size` is a tolerance."""
    return way.integrator in offer(way.engine).adaptive


def block_of(run: Run, way: Way, models: Models, work: Work) -> Block:
    """Build or reuse a model, here or in the engine's environment, and return the timing block that `work` makes of it.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    choice = choice_of(way, is_adaptive(way), run.until)
    if environment_of(way.engine) is None:
        return work(get_model(models, way.engine, run.mechanism, choice))
    return block_elsewhere(way.engine, run.mechanism, choice, work)


def one_step(run: Run, way: Way, steps: int | None, models: Models) -> Block:
    """Return a timing block that measures the time of one step.

    If the integrator chooses its steps, the block is a whole run, which counts as `steps` repetitions, or as one if the engine does
    not count its steps (None).
    """
    if not is_adaptive(way):
        return block_of(run, way, models, partial(steps_block, NO_KEY, step=way.size, native=True))
    block = whole_run(run, way, steps, seconds=0.0, lead=math.inf, models=models)  # lead=inf: the whole run is timed
    block.count = steps or 1
    return block


def whole_run(run: Run, way: Way, steps: int | None, seconds: float, lead: float, models: Models) -> Block:
    """Return a timing block that measures the time of the whole run.

    If a run with equal steps would take longer than `lead` [s], according to the estimate `seconds`, only its first part is timed,
    and the time of the whole run is extrapolated. `steps` is None if the engine does not count the steps that its integrator
    chooses.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    share = 1.0 if is_adaptive(way) or steps is None else share_of(seconds, lead, steps)
    choice = choice_of(way, is_adaptive(way), run.until)
    return block_of(run, way, models, partial(run_block, NO_KEY, choice, np.array([0.0, share * run.until]), share))


def pace_run(run: Run, way: Way, steps: int | None, lead: float, samples: int, models: Models) -> Block:
    """Return a timing block as `whole_run` does, but estimate the time of the run from its first steps, which are timed now.

    Args:
        samples: number of sample times if the integrator chooses its steps, as in the run whose errors were measured.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    choice = choice_of(way, is_adaptive(way), run.until)
    if is_adaptive(way) or steps is None:
        return block_of(run, way, models, partial(run_block, NO_KEY, choice, np.linspace(0.0, run.until, samples + 1), 1.0))
    return block_of(run, way, models, partial(lead_block, NO_KEY, choice, run.until, steps, lead))
