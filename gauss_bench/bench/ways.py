"""Run, judge and time settings of engines, for the searches in `measurements/search.py` and `../advice`.

A setting of this kind (class `Way`) is an engine with one of its variants (options, integrator, stabilisation) and a size, that is,
a step or a tolerance.
"""

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
from gauss_bench.runs.blocks import Block, Models, Work, block_elsewhere, build_or_reuse, leading, running, share_of, stepping
from gauss_bench.runs.offers import Offer, offer
from gauss_bench.runs.one_run import Run as Ended
from gauss_bench.runs.one_run import Sampling
from gauss_bench.trajectory import Reference

# numbers of equal parts of a run, at whose ends errors are taken (beats); the first number is used for which the reference has a
# sample at the end of every part
BEATS = (50, 40, 30, 20, 10)
ROUGH_ROUNDS = 8  # rounds of the estimate of a step's time, whose error must be small compared with the factor `search.NEAR`


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
    """Return option -> value for an engine's setting; empty if the engine does not know `way.settings`.

    `way.settings` is a list of assignments "key=value", the name of a variant, or the label of one of the engine's settings.
    """
    engine = offer(way.engine)
    if is_assignment(way.settings):
        return engine.resolve_settings(way.settings)
    variant = engine.variants.get(way.settings)
    return variant.options if variant else engine.settings.get(way.settings, {})


def loop_of(way: Way) -> str:
    """Return the option `loop` of a setting: the name of the loop over the time steps; an empty text if there is no such option."""
    return str(options_of(way).get("loop", ""))


def choice_of(way: Way, adaptive: bool, until: float) -> Choice:
    """Return a setting as a `Choice`, the object in which an engine is given its setting, for a run that ends at `until` [s].

    Args:
        adaptive: whether the integrator chooses its steps. For such an integrator, `way.size` becomes the tolerance of the choice,
            and the step is set to the whole duration and thus limits nothing. Otherwise `way.size` becomes the step.
    """
    names = way[1:4]  # settings, integrator, stabilisation
    return Choice(*names, step=until, tolerance=way.size) if adaptive else Choice(*names, step=way.size)


def has_samples(truth: Reference, until: float, beats: int) -> bool:
    """Tell whether the reference motion has samples at the ends of all parts of a run that is divided into `beats` equal parts."""
    times = until / beats * np.arange(beats + 1)
    near = np.minimum(np.searchsorted(truth.t, times - 1e-9), len(truth.t) - 1)
    return bool((np.abs(truth.t[near] - times) < 1e-9).all())


def evaluate_run(run: Run, evaluator: Evaluator, truth: Reference, way: Way, adaptive: bool, beats: int) -> Trial:
    """Run one setting of an engine, and return its largest errors at those sample times that are ends of steps.

    Args:
        run: the motion to be computed.
        evaluator, truth: evaluator of the run's mechanism, and the reference motion.
        way: the engine and its setting.
        adaptive: whether the integrator chooses its steps; the run then has samples at all sample times.
        beats: number of sample times, at equal distances, at which errors are taken.
    """
    steps = beats if adaptive else round(run.until / way.size)
    # k equal parts end at ends of steps and at sample times if k divides both numbers
    wanted = sample(run, steps, math.gcd(steps, beats))
    ended = run_of(request_of(run, way, adaptive, wanted), run.mechanism, CASE_LIMIT, again=True)
    return judge_trial(run, evaluator, truth, way, ended)


def sample(run: Run, steps: int, samples: int) -> Sampling:
    """Return the sample times of a run of `steps` equal steps: the start, and `samples` further times at equal distances."""
    return Sampling(run.until / samples * np.arange(samples + 1), run.until / steps, steps, 0)


def request_of(run: Run, way: Way, adaptive: bool, wanted: Sampling) -> Request:
    """Return the request for a run of one engine with one setting, including its step or tolerance."""
    return Request(run.linkage, run.mechanism.scenario, way.engine, choice_of(way, adaptive, run.until), wanted)


def judge_trial(run: Run, evaluator: Evaluator, truth: Reference, way: Way, ended: Ended) -> Trial:
    """Return the trial of an ended run: the reason for its failure, or its largest errors.

    Errors are taken at the sample times that the run and the reference have in common. The error "end" is the largest position
    error at the last of these times.
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
    """Tell whether the integrator of a setting chooses its own steps; if it does, `way.size` is a tolerance, otherwise a step."""
    return way.integrator in offer(way.engine).adaptive


def block_of(run: Run, way: Way, models: Models, work: Work) -> Block:
    """Build the model of an engine with a setting, or reuse a model, and return the timing block that `work` makes from it.

    The engine runs in this process or, if it has an environment of its own, in a process of that environment.

    Args:
        models: cache of the models that were built in this process; a new model is added.
        work: function that returns the timing block (the piece of work to be timed), given the model.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    choice = choice_of(way, is_adaptive(way), run.until)
    if environment_of(way.engine) is None:
        return work(build_or_reuse(models, way.engine, run.mechanism, choice))
    return block_elsewhere(way.engine, run.mechanism, choice, work)


def one_step(run: Run, way: Way, steps: int | None, models: Models) -> Block:
    """Return a timing block for one step of an engine with one setting; the block's time is the time of one step.

    If the integrator chooses its steps, the block is a whole run, which counts as `steps` repetitions, or as one if the engine does
    not count its steps (None).
    """
    if not is_adaptive(way):
        return block_of(run, way, models, partial(stepping, NO_KEY, step=way.size, native=True))
    block = whole_run(run, way, steps, seconds=0.0, lead=math.inf, models=models)  # lead=inf: the whole run is timed
    block.count = steps or 1
    return block


def whole_run(run: Run, way: Way, steps: int | None, seconds: float, lead: float, models: Models) -> Block:
    """Return a timing block for a whole run of an engine with one setting; the block's time is the time of the whole run.

    If the run has equal steps and would take longer than `lead`, only its first part is run, and its time is extrapolated.

    Args:
        steps: number of steps of the run; None if the integrator chooses its steps and the engine does not count them.
        seconds: estimated time of the run [s].
        lead: time [s] that the first part of a longer run takes.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    adaptive = is_adaptive(way)
    share = 1.0 if adaptive or steps is None else share_of(seconds, lead, steps)
    choice = choice_of(way, adaptive, run.until)
    return block_of(run, way, models, partial(running, NO_KEY, choice, np.array([0.0, share * run.until]), share))


def pace_run(run: Run, way: Way, steps: int | None, lead: float, samples: int, models: Models) -> Block:
    """Return a timing block for a whole run of an engine with one setting, if it is not known how long the run takes.

    The block's time is the time of the whole run. If the run has equal steps, its first steps are timed now, together, to estimate
    this time. If the run would take longer than `lead`, only its first part is run in a race, and the time is extrapolated.

    Args:
        steps: number of steps of the run; None if the integrator chooses its steps and the engine does not count them.
        lead: time [s] that the first part of a longer run takes.
        samples: number of sample times of a run whose integrator chooses its steps: the same number as in the run in which its
            errors were measured.

    Raises:
        RunFailure: the engine cannot run the mechanism.
    """
    choice = choice_of(way, is_adaptive(way), run.until)
    if is_adaptive(way) or steps is None:
        whole = 1.0  # share of the run that is timed: the time is not extrapolated
        work = partial(running, NO_KEY, choice, np.linspace(0.0, run.until, samples + 1), whole)
    else:
        work = partial(leading, NO_KEY, choice, run.until, steps, lead)
    return block_of(run, way, models, work)
