"""One linkage, one engine, one run: the object that `gauss-bench simulate --json` prints."""

from typing import Any

import numpy as np

from gauss_bench import metrics
from gauss_bench.api.results import Simulation, name_files
from gauss_bench.api.telling import Told, nobody, tell
from gauss_bench.engines import OWN
from gauss_bench.engines.base import Choice
from gauss_bench.judge import Evidence, Judgement, advice, judge, remark, trusted_until
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import acceleration, position, velocity
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.mechanism.parts import spread
from gauss_bench.reference.store import find_certified
from gauss_bench.runs.apart import Request, run_of
from gauss_bench.runs.asked import affordable
from gauss_bench.runs.first_builds import build_first
from gauss_bench.runs.offers import ChoiceError, offer
from gauss_bench.runs.one_run import Run, sampling_through
from gauss_bench.runs.scrutiny import (
    as_truth,
    at_samples,
    evidence_of,
    has_sound_rates,
    repeat_finer,
    sample_spacing,
    warn_of_forcing,
)
from gauss_bench.runs.worker import keep
from gauss_bench.terms import Array
from gauss_bench.trajectory import Reference, Status, Trajectory

RAN = (Status.OK, Status.NAN, Status.DIVERGED, Status.NOT_CONVERGED)  # what half the step can tell something of
QUICKEST = 2e-8, 1e-4  # [s] of a step, compiled and interpreted, of the smallest linkage on a fast machine
LIMIT = 600.0  # [s] that a worker may take where nothing else is asked for


def simulate(
    linkage: str,
    engine: str = "gauss",
    scenario: str | None = None,
    settings: str | None = None,
    integrator: str | None = None,
    stabilization: str | None = None,
    step: float = 1e-3,
    at: list[float] | None = None,
    limit: float = LIMIT,
    told: Told = nobody,
) -> Simulation:
    """The motion of a linkage (a built-in name or a file) in one engine, judged.

    Own formulations run in this process, every other engine in a worker: one that crashes, hangs or cannot be imported is a result
    with a status and a sentence. What it computed is judged in this process. A run that fails on its way is told up to there.

    Args:
        linkage: name of a built-in linkage, or a path.
        engine: one of `gauss_bench.engines.names()`.
        scenario: of the file; the first with a start where not given.
        settings: of the engine: a name, KEY=VALUE,... of its own options, or both; its defaults where not given.
        integrator, stabilization: of the engine; its defaults where not given.
        step: integration step [s]. A time of `at` that whole steps miss is met by shorter ones, and the message says so.
        at: times [s] to report; 0 and the scenario's duration where not given.
        limit: seconds after which a worker is stopped.
        told: is told that the run begins, once nothing is left to be refused.

    Raises:
        LinkageError: the file has faults.
        ChoiceError: the engine does not offer what was asked for.
        KeyError: unknown engine.
    """
    offered = offer(engine)
    choice = offered.choose(settings, integrator, stabilization, step)
    mechanism = load(linkage, scenario)
    at = sorted(set(at)) if at else [0.0, mechanism.duration]
    if not all(np.isfinite(x) and x >= 0 for x in at):
        raise ChoiceError("times must be numbers that are not negative")
    if not (np.isfinite(limit) and limit > 0):
        raise ChoiceError(f"the limit must be a positive number of seconds, not {limit}")
    if not offered.usable:
        return describe(mechanism, engine, choice, offered.status, offered.reason, at[-1])
    affordable(choice.step, at[-1], QUICKEST[engine in OWN], limit)
    wanted = sampling_through(choice.step, at, sample_spacing(mechanism, at[-1]))
    request = Request(linkage, mechanism.scenario, engine, choice, wanted)
    adaptive = choice.integrator in offered.adaptive
    if warning := warn_of_forcing(mechanism, choice, adaptive):
        tell(f"warning: {warning}")
    told(f"{mechanism.name}, scenario {mechanism.scenario}, by {engine}: {wanted.count} steps up to {at[-1]:g} s")
    build_first(engine, [choice.settings], told)
    worker = keep(engine)  # which has described it already
    try:
        run = run_of(request, mechanism, limit, worker)
        trajectory, truth, finer = run.trajectory or run.reached, None, None
        if trajectory is not None and run.status in RAN:
            truth = certified_until(mechanism, at[-1])
            if len(trajectory.t) > 1 and (truth is None or not has_sound_rates(mechanism, trajectory)):
                again = run_of(repeat_finer(request, offered, run.seconds, trajectory.t), mechanism, limit, worker)
                finer = at_samples(again, trajectory.t)
    finally:
        worker.stop()
    return judge_run(mechanism, engine, choice, run, at, truth, finer, adaptive)


def certified_until(mechanism: Mechanism, t_end: float) -> Reference | None:
    """The certified motion of a linkage that nothing has been changed in, or None."""
    try:
        return find_certified(mechanism, t_end)
    except (OSError, ValueError):
        return None


def judge_run(
    mechanism: Mechanism,
    engine: str,
    choice: Choice,
    run: Run,
    at: list[float],
    truth: Reference | None = None,
    finer: Run | None = None,
    adaptive: bool = False,
) -> Simulation:
    """The result of a run: at the times asked for or, where it failed, at those that it reached and at the last that it reached.

    It is judged by the truth where that is known, else by what its repetition found.
    """
    with np.errstate(all="ignore"):  # what grows beyond bounds is told as that
        return _judge(mechanism, engine, choice, run, at, truth, finer, adaptive)


def _second(finer: Run | None) -> Reference | None:
    """The findings of a repetition, in the place of a truth."""
    return None if finer is None or finer.trajectory is None else as_truth(finer.trajectory)


def _judge(
    mechanism: Mechanism,
    engine: str,
    choice: Choice,
    run: Run,
    at: list[float],
    truth: Reference | None,
    finer: Run | None,
    adaptive: bool,
) -> Simulation:
    trajectory = run.trajectory or run.reached
    if trajectory is None:
        return describe(mechanism, engine, choice, run.status, run.message, at[-1])
    try:
        evaluator = Evaluator(mechanism)
        evidence, undecided = evidence_of(mechanism, choice, trajectory, truth, finer, adaptive=adaptive)
        figures, verdict = measure(evidence, trajectory, run), judge(evidence)
        until = float(trajectory.t[-1]) if verdict.valid else trusted_until(evaluator, trajectory, truth, _second(finer))
        last, status = float(trajectory.t[-1]), run.status
        chosen = at_times(trajectory, at if run.trajectory else [*(x for x in at if x < last), last])
        if run.trajectory:
            status = Status.OK if verdict.valid else Status.INVALID
        sentences = (run.message, verdict.sentence) if status is run.status else (verdict.sentence, run.message)
        told = "; ".join(filter(None, (*sentences, undecided, remark(evidence))))
        return describe(mechanism, engine, choice, status, told, at[-1], trajectory, chosen, verdict, figures, until, adaptive)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        said = "; ".join(filter(None, (run.message, f"what was computed cannot be judged: {error}")))
        return describe(mechanism, engine, choice, Status.ERROR if run.trajectory else run.status, said, at[-1])


def describe(
    mechanism: Mechanism,
    engine: str,
    choice: Choice,
    status: Status,
    message: str,
    asked_until: float,
    whole: Trajectory | None = None,
    chosen: Trajectory | None = None,
    verdict: Judgement | None = None,
    figures: dict[str, Any] | None = None,
    until: float | None = None,
    adaptive: bool = False,
) -> Simulation:
    """The result; without a trajectory its lists are empty."""
    evaluator = Evaluator(mechanism)
    chosen = chosen or empty(mechanism.n)
    objections = verdict.objections if verdict else ()
    forces = metrics.driving_forces(evaluator, chosen) if mechanism.drivers else None
    told = spread(mechanism, chosen)
    return Simulation(
        **name_files(mechanism, engine, choice),
        status=status,
        message=message,
        t=chosen.t,
        links=link_states(mechanism.whole, told),
        points=point_states(mechanism.whole.observed_points, told),
        joints=metrics.joint_forces(evaluator, chosen),
        metrics=figures or {},
        valid=status is Status.OK and verdict is not None and verdict.valid,
        objections=objections,
        observed=observe_names(mechanism),
        warnings=mechanism.warnings,
        welds=metrics.weld_forces(evaluator, chosen),
        trusted_until=until,
        advice=advice(objections, choice.step, choice.stabilization != "none", adaptive),
        asked_until=asked_until,
        model=mechanism,
        trajectory=whole,
        drivers={} if forces is None else {driver.name: forces[:, k] for k, driver in enumerate(mechanism.drivers)},
    )


def observe_names(mechanism: Mechanism, points: tuple[Point, ...] | None = None) -> dict[str, list[str]]:
    """The points and links to look at: those named, else those the file observes."""
    whole = mechanism.whole
    chosen = whole.observed_points if points is None else points
    return {"points": [p.name for p in chosen], "links": [whole.link_name(k) for k in whole.observed_links]}


def measure(evidence: Evidence, trajectory: Trajectory, run: Run) -> dict[str, Any]:
    """The figures that need no truth, of what was computed, and the costs."""
    return {
        "until": float(trajectory.t[-1]),
        "position_drift": float(evidence.drift.position.max()),
        "velocity_drift": float(evidence.drift.velocity.max()),
        "acceleration_residual": float(evidence.drift.acceleration.max()),
        "acceleration_error": evidence.acceleration_error,
        "energy_error": float(np.abs(evidence.energy).max()),
        "energy_error_bar": evidence.energy_bar,
        "energy_scale": evidence.energy_scale,
        "steps": trajectory.steps,
        "shortened_steps": run.sampling.shortened,
        "evaluations": trajectory.evaluations,
        "build_time": run.build_time,
        "step_time": run.step_time,
        "halving_length": None if evidence.halving is None else float(evidence.halving.length.max(initial=0.0)),
        "halving_angle": None if evidence.halving is None else float(evidence.halving.angle.max(initial=0.0)),
        "steps_a_period": evidence.steps_a_period,
        "acceleration_disagreement": evidence.disagreement,
    }


def at_times(trajectory: Trajectory, at: list[float]) -> Trajectory:
    """The samples nearest to the times."""
    k = [int(np.abs(trajectory.t - x).argmin()) for x in at]
    return Trajectory(trajectory.t[k], trajectory.q[k], trajectory.v[k], trajectory.a[k], trajectory.steps)


def empty(n: int) -> Trajectory:
    none = np.zeros((0, n))
    return Trajectory(np.zeros(0), none, none, none, 0)


def link_states(mechanism: Mechanism, x: Trajectory) -> dict[str, dict[str, Array]]:
    """Per link: centre of mass, angle (unwrapped) and their rates."""
    keys = (("x", "y", "theta"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
    return {
        link.name: {
            key: values[:, 3 * i + j] for names, values in zip(keys, (x.q, x.v, x.a), strict=True) for j, key in enumerate(names)
        }
        for i, link in enumerate(mechanism.links)
    }


def point_states(points: tuple[Point, ...], x: Trajectory) -> dict[str, dict[str, Array]]:
    """Per point: position, velocity, acceleration."""
    states = {}
    for p in points:
        levels = position(x.q, p), velocity(x.q, x.v, p), acceleration(x.q, x.v, x.a, p)
        pairs = zip((("x", "y"), ("vx", "vy"), ("ax", "ay")), levels, strict=True)
        states[p.name] = {key: values[:, j] for keys, values in pairs for j, key in enumerate(keys)}
    return states
