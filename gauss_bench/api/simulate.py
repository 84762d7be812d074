"""Run one linkage in one engine, and judge the run: the object that `gauss-bench simulate --json` prints."""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np

from gauss_bench import metrics
from gauss_bench.api.telling import HIDDEN, UNLESS_EMPTY, Result, Told, nobody, tell
from gauss_bench.engines import OWN
from gauss_bench.engines.base import Choice
from gauss_bench.judge import Evidence, Judgement, Objection, Subject, advice, judge, remark, trusted_until
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.coordinates import acceleration, motion_of_links, position, velocity
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism, Point
from gauss_bench.mechanism.spaces import bodies
from gauss_bench.metrics import Loads
from gauss_bench.reference.certificate import find_certified
from gauss_bench.runs.apart import Request, build_first, run_of
from gauss_bench.runs.offers import ChoiceError, Offer, check_affordable, check_positive, offer
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
from gauss_bench.runs.worker import get_worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Caption, Reference, Status, Trajectory

REPEATED = (Status.OK, Status.NAN, Status.DIVERGED, Status.NOT_CONVERGED)  # statuses of runs that are repeated at half the step
# [s] least time of a step (smallest linkage, fast machine); a run whose steps would then exceed its time limit is refused
QUICKEST_COMPILED, QUICKEST_INTERPRETED = 2e-8, 1e-4
LIMIT = 600.0  # [s] default of the time limit of the worker process


class PointState(TypedDict):
    """The motion of a point.

    Attributes:
        x, y: (k,) position [m].
        vx, vy: (k,) velocity [m/s].
        ax, ay: (k,) acceleration [m/s^2].
    """

    x: Array
    y: Array
    vx: Array
    vy: Array
    ax: Array
    ay: Array


class LinkState(TypedDict):
    """The motion of a link.

    Attributes:
        x, y: (k,) position of the link's centre of mass [m]; theta: (k,) angle of the link, unwrapped [rad].
        vx, vy: (k,) velocity of the centre of mass [m/s]; omega: (k,) angular velocity [rad/s].
        ax, ay: (k,) acceleration of the centre of mass [m/s^2]; alpha: (k,) angular acceleration [rad/s^2].
    """

    x: Array
    y: Array
    theta: Array
    vx: Array
    vy: Array
    omega: Array
    ax: Array
    ay: Array
    alpha: Array


class JointForce(TypedDict):
    """The force that a joint or weld exerts.

    Attributes:
        fx, fy: (k,) force [N].
        moment: (k,) moment [N m].
    """

    fx: Array
    fy: Array
    moment: Array


class Observed(TypedDict):
    """The points and links of a linkage that its file lists as observed.

    Attributes:
        points: names of points, as link.point.
        links: names of links.
    """

    points: list[str]
    links: list[str]


class Metrics(TypedDict, total=False):
    """The figures of a run that need no reference, and its costs; empty if the run has no samples.

    Attributes:
        until: time that the run reached [s].
        position_drift: largest residual of the constraints [m, rad]; velocity_drift: largest rate of the residual [m/s, rad/s].
        acceleration_residual: largest second rate of the residual [m/s^2, rad/s^2].
        acceleration_error: median relative error of the accelerations at the run's own states.
        energy_error: largest error of the balance of energy, work and losses [J]; energy_error_bar: error of the quadrature [J].
        energy_scale: the larger of the largest kinetic energy and the range of the potential energy [J].
        steps: number of steps; null if the engine does not count them.
        shortened_steps: number of steps that were shortened to reach a requested time.
        evaluations: number of evaluations of the equations of motion; null if the engine does not count them.
        build_time: time to build the model [s]; step_time: time of one step [s]; null if steps are not counted.
        halving_length: largest change of a link's position in the repetition at half the step [m]; null without a repetition.
        halving_angle: largest change of a link's angle in that repetition [rad]; null without a repetition.
        steps_a_period: number of steps in a period of the fastest oscillation; null if the judge did not need it.
        acceleration_disagreement: median relative difference between two of the suite's formulations; null if not needed.
    """

    until: float
    position_drift: float
    velocity_drift: float
    acceleration_residual: float
    acceleration_error: float | None
    energy_error: float
    energy_error_bar: float
    energy_scale: float
    steps: int | None
    shortened_steps: int
    evaluations: int | None
    build_time: float
    step_time: float | None
    halving_length: float | None
    halving_angle: float | None
    steps_a_period: float | None
    acceleration_disagreement: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class OneRun(Result):
    """The result of one run of one linkage in one engine.

    Attributes:
        engine, mechanism, scenario, settings, integrator, stabilization: names that identify the run.
        step: integration step [s].
    """

    engine: str
    mechanism: str
    scenario: str
    settings: str
    integrator: str
    stabilization: str
    step: float


def name_run(mechanism: Mechanism, engine: str, choice: Choice) -> dict[str, Any]:
    """Return the fields of `OneRun` (name -> value), which identify a run."""
    names = {"engine": engine, "mechanism": mechanism.name, "scenario": mechanism.scenario}
    return names | {name: getattr(choice, name) for name in ("settings", "integrator", "stabilization", "step")}


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulation(OneRun):
    """A run, with its samples at k times.

    Attributes:
        status: "ok", "skip", "invalid" if the run ended but the judge rejects it, or the kind of failure.
        message: reason of the status, or a remark on the run.
        t: (k,) times of the samples [s]. If the run failed, t has the requested times before the failure, and the time of the last
            sample before the failure. If there is no sample before the failure, all arrays are empty.
        links: name of a link -> motion of the link.
        points: name of an observed point -> motion of the point.
        joints: name of a joint -> constraint force and moment that act on the joint's second link.
        metrics: figures of the run that need no reference, and its costs.
        valid: whether the run ended and the judge has no objection.
        objections: the judge's objections to the run, or to the part of a failed run before the failure.
        trusted_until: end of the part of the run to which the judge has no objection [s]; None if the run has no samples to judge.
        advice: changes that may make an invalid run valid, or an empty text.
        observed: names of the points and links that the linkage file observes.
        drivers: name of a driver -> torque [N m] or force [N] that the driver exerts (k,). Dictionaries leave `drivers` out if it
            is empty.
        welds: name of a weld -> force on the welded link, and moment about the point of the weld. Dictionaries leave `welds` out if
            it is empty.
        warnings: warnings of the loader on the linkage file. Dictionaries leave `warnings` out if it is empty.
        loads: the largest and mean loads of joints, welds and drivers until `trusted_until`; None if loads were not requested. The
            loads are empty if the accelerations of the run are wrong.
        asked_until: requested end of the run [s]; model: the linkage; trajectory: all samples of the run, or None if there are
            none. Dictionaries leave out `asked_until`, `model` and `trajectory`; `gauss_bench.history` makes curves of them.
    """

    status: Status
    message: str
    t: Array
    links: dict[str, LinkState]
    points: dict[str, PointState]
    joints: dict[str, JointForce]
    metrics: Metrics = field(default_factory=Metrics)
    valid: bool = False
    objections: tuple[Objection, ...] = ()
    observed: Observed
    trusted_until: float | None = None
    advice: str = ""
    asked_until: float = field(metadata=HIDDEN)
    model: Mechanism = field(metadata=HIDDEN)
    trajectory: Trajectory | None = field(default=None, metadata=HIDDEN)
    drivers: dict[str, Array] = field(default_factory=dict, metadata=UNLESS_EMPTY)
    welds: dict[str, JointForce] = field(default_factory=dict, metadata=UNLESS_EMPTY)
    warnings: tuple[str, ...] = field(default=(), metadata=UNLESS_EMPTY)
    loads: Loads | None = field(default=None, metadata=UNLESS_EMPTY)

    @property
    def succeeded(self) -> bool:
        return self.status in (Status.OK, Status.SKIP)

    @property
    def notices(self) -> tuple[str, ...]:
        return tuple(f"warning: {x}" for x in self.warnings)

    def told(self) -> Caption:
        """Return the caption of plots and animations: title, setting, verdict, and two times [s].

        The times are the end of the run, and the end of the part to which the judge has no objection (None if it is the whole run).
        """
        how = f"{self.engine} ({self.settings}), {self.integrator}, stabilization {self.stabilization}, step {self.step:g} s"
        verdict = "" if self.valid else _join(f"{self.status}: {self.message}", self.advice)
        end = max(self.asked_until, float(self.t[-1]) if len(self.t) else 0.0)
        trusted = None if self.trusted_until is None or self.trusted_until >= end else self.trusted_until
        return Caption(f"{self.mechanism} / {self.scenario}", how, verdict, end, trusted)


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
    tolerance: float | None = None,
    whole: bool = False,
    forces: bool = False,
) -> Simulation:
    """Simulate a linkage in one engine, and judge the run.

    The suite's own formulations run in this process, and every other engine runs in a worker process. If an engine crashes, hangs
    or cannot be imported, the result has a status and a sentence on the reason. A failed run has the samples before its failure.

    Args:
        linkage: name of a built-in linkage, or a path.
        engine: one of `gauss_bench.engines.names()`.
        scenario: name of a scenario; by default the first one that gives the motion a start.
        settings: settings of the engine, as a name, as KEY=VALUE,... or as both; by default the engine's own.
        integrator, stabilization: names of the integrator and the stabilisation; by default the first ones that the engine offers.
        step: integration step [s]. A time of `at` that is no multiple of the step is reached by a shorter step, and the message
            says so.
        at: times [s] to report; by default 0 and the scenario's duration. The run ends at the last of them.
        limit: time limit of the worker process [s].
        told: function that is called with a sentence when the run begins, after all arguments were checked.
        tolerance: relative tolerance of an integrator that chooses its own steps; the absolute tolerance is a hundredth of it. By
            default the settings give both tolerances.
        whole: run through the whole duration of the scenario, for plots and tables of all samples.
        forces: run through the whole duration, and find the largest and mean loads of joints, welds and drivers.

    Raises:
        LinkageError: the file has faults.
        ChoiceError: the engine does not offer the setting, or a time or step cannot be used.
        KeyError: the engine is unknown.
    """
    offered = offer(engine)
    choice = offered.choose_tolerance(offered.choose(settings, integrator, stabilization, step), tolerance)
    mechanism = load(linkage, scenario)
    at = sorted(set(at)) if at else [0.0, mechanism.duration]
    if not all(np.isfinite(x) and x >= 0 for x in at):
        raise ChoiceError("--at: times must be numbers that are not negative")
    check_positive("the limit", limit)
    # a report at single times needs no run beyond the last of them, but plots, tables and loads need the whole motion
    end = max(at[-1], mechanism.duration) if whole or forces else at[-1]
    # the fields of `Simulation` that are known before the run
    known: dict[str, Any] = name_run(mechanism, engine, choice) | {"warnings": mechanism.warnings, "asked_until": end}
    known |= {"model": mechanism, "observed": list_observed(mechanism)}
    if not offered.usable:
        return _without_samples(known, offered.status, offered.reason)
    check_affordable(choice.step, end, QUICKEST_INTERPRETED if engine in OWN else QUICKEST_COMPILED, limit)
    sampling = sampling_through(choice.step, sorted({*at, end}), sample_spacing(mechanism, end))
    if warning := warn_of_forcing(mechanism, choice, choice.integrator in offered.adaptive):
        tell(f"warning: {warning}")
    told(f"{mechanism.name}, scenario {mechanism.scenario}, by {engine}: {sampling.count} steps up to {end:g} s")
    build_first(engine, [choice.settings], told)
    runs = run_twice(Request(linkage, mechanism.scenario, engine, choice, sampling), mechanism, offered, limit)
    samples = runs.run.samples
    if samples is None:
        return _without_samples(known, runs.run.status, runs.run.message)
    with np.errstate(all="ignore"):  # no warnings of numpy: the judge objects to a diverged run, which overflows
        try:
            return Simulation(**known, **_judge(mechanism, choice, runs, samples, at, forces))
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            status = Status.ERROR if runs.run.trajectory else runs.run.status
            return _without_samples(known, status, _join(runs.run.message, f"the motion cannot be judged: {error}"))


def _without_samples(known: dict[str, Any], status: Status, message: str) -> Simulation:
    """Return the result of a run that gave no samples to judge; `known` has the fields of `Simulation` known before the run."""
    mechanism: Mechanism = known["model"]
    none = np.zeros((0, mechanism.n))
    return Simulation(**known, **states_at(mechanism, Trajectory(np.zeros(0), none, none, none, 0)), status=status, message=message)


@dataclass(frozen=True, eq=False)
class Runs:
    """A run, with the reference motion and the repetition with a finer setting by which the run is judged.

    Attributes:
        reference: the motion from the certificate; None if there is none.
        finer: the run repeated at half the step or a tighter tolerance; None if the run was not repeated.
        adaptive: whether the integrator chooses its own steps.
    """

    run: Run
    reference: Reference | None
    finer: Run | None
    adaptive: bool


def run_twice(request: Request, mechanism: Mechanism, offered: Offer, limit: float) -> Runs:
    """Carry out a run, and repeat it with a finer setting if it cannot be judged otherwise; either takes at most `limit` seconds.

    A run is not repeated if the motion is certified, and velocities and accelerations agree with the changes of the positions.
    """
    reference, finer = None, None
    worker = get_worker(request.engine)  # the worker that already described the engine
    try:
        run = run_of(request, mechanism, limit, worker)
        samples = run.samples
        if samples is not None and run.status in REPEATED:
            with suppress(OSError, ValueError):  # with a damaged certificate the run is judged by its repetition
                reference = find_certified(mechanism, float(request.wanted.times[-1]))
            if len(samples.t) > 1 and (reference is None or not has_sound_rates(mechanism, samples)):
                repetition = run_of(repeat_finer(request, offered, run.seconds, samples.t), mechanism, limit, worker)
                finer = at_samples(repetition, samples.t)
    finally:
        worker.stop()
    return Runs(run, reference, finer, request.choice.integrator in offered.adaptive)


def _judge(mechanism: Mechanism, choice: Choice, runs: Runs, samples: Trajectory, at: list[float], forces: bool) -> dict[str, Any]:
    """Judge a run, and return the fields of `Simulation` that are computed from its samples.

    The returned states are those at the times `at` [s]; for a failed run, those before the failure and the last sample. Loads are
    computed only with `forces`.
    """
    run, is_complete = runs.run, runs.run.trajectory is not None
    # undecided: a sentence if the repetition covers only a part of the run, else ""
    evidence, undecided = evidence_of(mechanism, choice, samples, runs.reference, runs.finer, adaptive=runs.adaptive)
    verdict, last = judge(evidence), float(samples.t[-1])  # last: time of the last sample [s]
    status = (Status.OK if verdict.valid else Status.INVALID) if is_complete else run.status
    # the reason of the status comes first: the verdict's sentence for an invalid run, the run's own message for a failed one
    reasons = (run.message, verdict.sentence) if status is run.status else (verdict.sentence, run.message)
    until = last
    if not verdict.valid:
        repetition = None if runs.finer is None or runs.finer.trajectory is None else as_truth(runs.finer.trajectory)
        until = trusted_until(Evaluator(mechanism), samples, runs.reference, repetition)
    times = np.array(at if is_complete else [*(x for x in at if x < last), last])
    nearest = np.abs(samples.t - times[:, None]).argmin(axis=1)  # index of the sample nearest to each time
    return states_at(mechanism, samples[nearest]) | {
        "status": status,
        "message": _join(*reasons, undecided, remark(evidence)),
        "metrics": measure(evidence, samples, run),
        "valid": status is Status.OK and verdict.valid,
        "objections": verdict.objections,
        "trusted_until": until,
        "advice": advice(verdict.objections, choice.step, choice.stabilization != "none", runs.adaptive),
        "trajectory": samples,
        "loads": loads_until(mechanism, samples, until, verdict) if forces else None,
    }


def _join(*sentences: str) -> str:
    """Return the sentences that are not empty, joined by semicolons."""
    return "; ".join(filter(None, sentences))


def loads_until(mechanism: Mechanism, trajectory: Trajectory, until: float, verdict: Judgement) -> Loads:
    """Return the largest and mean loads of joints, welds and drivers over the samples until the time `until` [s].

    The judge objects to later samples. Forces follow from accelerations: if the judge objects to these, the loads are empty.
    """
    accelerations_are_wrong = any(x.subject is Subject.MODEL for x in verdict.objections)
    is_trusted = verdict.valid or (until > 0.0 and not accelerations_are_wrong)
    count = int(np.searchsorted(trajectory.t, until, "right")) if is_trusted else 0
    samples = trajectory[:count]
    return metrics.summarise_loads(mechanism, samples, metrics.load_curves(Evaluator(mechanism), samples))


def states_at(mechanism: Mechanism, x: Trajectory) -> dict[str, Any]:
    """Return the fields of `Simulation` with times, states and forces at the samples of a trajectory."""
    # mechanism.whole: the linkage with every link of the file; mechanism itself has one body for links that are welded together
    evaluator, links = Evaluator(mechanism), motion_of_links(mechanism, x)
    exerted = metrics.driving_forces(evaluator, x).T if mechanism.drivers else ()  # (drivers, k) [N, N m]
    return {
        "t": x.t,
        "links": link_states(mechanism.whole, links),
        "points": point_states(mechanism.whole.observed_points, links),
        "joints": metrics.joint_forces(evaluator, x),
        "welds": metrics.weld_forces(evaluator, x),
        "drivers": {driver.name: force for driver, force in zip(mechanism.drivers, exerted, strict=True)},
    }


def list_observed(mechanism: Mechanism, points: tuple[Point, ...] | None = None) -> Observed:
    """Return the names of the observed points and links; `points` replaces the points that the file observes."""
    whole = mechanism.whole
    observed = whole.observed_points if points is None else points
    return {"points": [p.name for p in observed], "links": [whole.link_name(k) for k in whole.observed_links]}


def measure(evidence: Evidence, trajectory: Trajectory, run: Run) -> Metrics:
    """Return the errors of a run that need no reference motion, and its costs: the judge's evidence and the run's counts."""
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


def point_levels(point: Point, x: Trajectory) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration (k, 2) of a point [m, s]."""
    return position(x.q, point), velocity(x.q, x.v, point), acceleration(x.q, x.v, x.a, point)


def link_states(mechanism: Mechanism, x: Trajectory) -> dict[str, LinkState]:
    """Return name of a link -> motion of the link, for all links of a mechanism."""
    states: dict[str, LinkState] = {}
    for i, link in enumerate(mechanism.links):
        (px, py, theta), (vx, vy, omega), (ax, ay, alpha) = (bodies(level)[:, i].T for level in (x.q, x.v, x.a))
        states[link.name] = LinkState(x=px, y=py, theta=theta, vx=vx, vy=vy, omega=omega, ax=ax, ay=ay, alpha=alpha)
    return states


def point_states(points: tuple[Point, ...], x: Trajectory) -> dict[str, PointState]:
    """Return name of a point -> motion of the point."""
    states: dict[str, PointState] = {}
    for point in points:
        (px, py), (vx, vy), (ax, ay) = (level.T for level in point_levels(point, x))
        states[point.name] = PointState(x=px, y=py, vx=vx, vy=vy, ax=ax, ay=ay)
    return states
