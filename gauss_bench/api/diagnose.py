"""The diagnosis of an engine on a linkage: the object that `gauss-bench diagnose --json` prints."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gauss_bench.advice import truth as truths
from gauss_bench.api.own_model import OwnFile, describe_closures, is_model_file, read_own_file, refuse_what_acts
from gauss_bench.api.recommend import list_requirements
from gauss_bench.api.simulate import OneRun, name_run
from gauss_bench.api.telling import UNLESS_EMPTY, Told, nobody
from gauss_bench.bench.ways import Run as WayRun
from gauss_bench.diagnosis.causes import Cause, Part
from gauss_bench.diagnosis.diagnosis import Ended, Verdict, diagnose_runs, without_run
from gauss_bench.diagnosis.observations import checkpoints, ladder
from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.own_model import INTEGRATORS
from gauss_bench.exchange.own_model import ENGINE, setting_text
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import state_errors
from gauss_bench.reach import UNITS
from gauss_bench.reference.certificate import find_certified
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import ChoiceError, Offer, check_budget, check_positive, check_size, duration, offer
from gauss_bench.runs.one_run import Run, Sampling
from gauss_bench.runs.questions import ForceQuestion, ask_along
from gauss_bench.runs.worker import Worker
from gauss_bench.trajectory import Reference, Trajectory

STEP = 1e-3  # [s] default of the integration step
BUDGET = 120.0  # [s] default of the time for the whole diagnosis
USUAL = 1.0  # [s] longest motion by default: in longer runs errors grow until they no longer add up linearly
MIN_TIME = 1.0  # [s] computing time that every run may take, even after the deadline
KNOWN = {"position": 1e-9, "angle": 1e-9}  # [m], [rad] wanted error bars of a reference, a thousandth of the least diagnosed error


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis(Verdict, OneRun):
    """The diagnosis of one engine on one linkage.

    Attributes:
        until: end of the run [s].
        part: part of the error to which the cause belongs, or None.
        reference: how the reference motion was made.
        remarks: sentences on the closures of a model file, on the engine's own joint forces, and on each required accuracy.
    """

    until: float
    part: Part | None
    reference: str
    remarks: tuple[str, ...] = field(default=(), metadata=UNLESS_EMPTY)

    @property
    def succeeded(self) -> bool:
        return self.cause is not Cause.UNKNOWN


@dataclass(frozen=True, eq=False)
class Subject:
    """The engine and the setting that are diagnosed.

    Attributes:
        engine: name or address of the engine, as `engines.get` takes it.
        name, settings: the engine and its settings as they are printed.
        choice: the setting of the first run.
        offered: the engine's offer.
        file: the user's model file if the settings in this file are diagnosed, else None.
    """

    engine: str
    name: str
    settings: str
    choice: Choice
    offered: Offer
    file: OwnFile | None = None


def diagnose(
    linkage: str,
    engine: str | None = None,
    scenario: str | None = None,
    settings: str | None = None,
    integrator: str | None = None,
    stabilization: str | None = None,
    step: float | None = None,
    until: float | None = None,
    budget: float | None = None,
    told: Told = nobody,
    close: Sequence[str] = (),
    position: float | None = None,
    angle: float | None = None,
) -> Diagnosis:
    """Split an engine's error on a linkage by its causes, and name the dominant cause.

    The engine runs in a worker process with the given step, half of it and a quarter of it, or with finer tolerances if it chooses
    its own steps. No cause dominates if both of the following are true (`diagnosis/diagnosis.py`). The largest error of a link's
    position or angle is below 1e-6 m or rad, or below three times the error bar of the reference. The reported accelerations agree
    with the linkage's to 1e-3.

    A model file is diagnosed like the linkage that it describes, at its keyframe and with the keyframe's controls. MuJoCo runs an
    MJCF file with the file's own timestep, integrator and closures; other engines run the linkage.

    Args:
        linkage: name of a built-in linkage, or a path of a linkage file, an MJCF file (MODEL.xml) or a URDF file (MODEL.urdf).
        engine: name of the engine; may be left out for an MJCF file, which MuJoCo runs.
        scenario: name of a scenario; by default the first one that gives the motion a start.
        settings, integrator, stabilization: names of the engine's options; by default the engine's own, or those of the MJCF file.
        step: integration step [s]; by default 0.001, or the timestep of the MJCF file.
        until: end of the run [s]; by default one second, or the scenario's duration if that is shorter.
        budget: time for the whole diagnosis [s]; by default 120.
        told: function that is called with each sentence of progress.
        close: pairs of points to be joined, which close the loops of a URDF file; each as LINK.FRAME=LINK.FRAME.
        position, angle: largest allowed errors [m], [rad]; a remark says whether the run stays within them.

    Raises:
        LinkageError, ExchangeError: the file has faults, or the model has a contact, joint limit or dry friction that acts, which
            linkage files cannot express.
        ChoiceError: the engine does not offer the setting, the run has too few steps, or no reference can be made.
        KeyError: the engine is unknown.
    """
    required = {} if position is None and angle is None else list_requirements(position=position, angle=angle)
    file = read_file(linkage, tuple(close))
    if file is not None and scenario is not None:
        raise ChoiceError("--scenario: a model file has no scenarios; it starts at its keyframe")
    mechanism = load(linkage, scenario) if file is None else file.mechanism
    if file is not None and file.kind == "MJCF" and engine in (None, "mujoco") and settings is None:
        subject = subject_as_it_stands(file, integrator, stabilization, step)
    else:
        subject = subject_with_settings(engine, settings, integrator, stabilization, step)
    end = duration(min(USUAL, mechanism.duration), until=until)
    deadline = time.monotonic() + check_budget(budget, BUDGET)
    check_size(subject.choice.step, end)
    checkpoints(subject.choice.step, end)  # raises ChoiceError if the run has too few steps
    if not subject.offered.usable:
        missing = Ended(subject.offered.status, subject.offered.reason)
        return make_diagnosis(mechanism, subject, end, without_run(missing), "", ())
    with Worker() as worker:
        if subject.file is not None:
            refuse_what_acts(subject.file, end, worker)
        told(f"{mechanism.name}, scenario {mechanism.scenario}, until {end:g} s: computing the reference")
        reference = find_reference(linkage, mechanism, end, deadline, told)
        question = ask_along(mechanism, reference)
        verdict, first = run_ladder(linkage, mechanism, subject, end, reference, deadline, worker, told, question)
    remarks = [] if subject.file is None else describe_closures(subject.file.settings)
    error, largest = question.compare(None if first is None else first.answer)  # [N, N m]; NaN if the engine reports no forces
    if not np.isnan(error):
        remarks.append(
            f"the engine's joint forces are off by {error:.1e} (N, N m) at the same states; the largest is {largest:.1e}"
        )
    if required and first is not None and first.trajectory is not None:
        remarks += compare_errors(mechanism, first.trajectory, reference, required)
    return make_diagnosis(mechanism, subject, end, verdict, reference.method, remarks)


def subject_with_settings(
    engine: str | None, settings: str | None, integrator: str | None, stabilization: str | None, step: float | None
) -> Subject:
    """Return an engine with the settings to be diagnosed; None takes the engine's default, or STEP [s]."""
    if engine is None:
        raise ChoiceError("--engine: name the engine to diagnose")
    offered = offer(engine)
    choice = offered.choose(settings, integrator, stabilization, STEP if step is None else step)
    return Subject(engine, engine, choice.settings, choice, offered)


def run_ladder(
    linkage: str,
    mechanism: Mechanism,
    subject: Subject,
    end: float,
    reference: Reference,
    deadline: float,
    worker: Worker,
    told: Told,
    question: ForceQuestion,
) -> tuple[Verdict, Run | None]:
    """Diagnose runs with finer and finer steps or tolerances; return the verdict and the first run (None if there was no run).

    Args:
        end: duration of the runs [s].
        deadline: time of the monotonic clock [s] by which the last run ends.
        told: function that is called with each sentence of progress.
        question: the states at which the first run also asks the engine for its own joint forces.
    """
    choice, offered, runs = subject.choice, subject.offered, list[Run]()

    def run(chosen: Choice, wanted: Sampling) -> Run:
        """Run the engine once with the setting `chosen` within the time that is left, and add the run to `runs`."""
        limit = max(MIN_TIME, deadline - time.monotonic())
        request = Request(linkage, mechanism.scenario, subject.engine, chosen, wanted)
        if not runs:  # the first run alone is asked for forces
            request = replace(request, ask=question.ask, answers=question.answers)
        runs.append(run_apart(request, mechanism, limit, worker))
        return runs[-1]

    adaptive = choice.integrator in offered.adaptive
    # If the error comes from drift off the constraints, a further run of the same setting with projection has a smaller error. An
    # integrator that chooses its own steps would also choose other steps with projection, and the two runs could not be compared.
    can_project = choice.stabilization == "none" and "projection" in offered.stabilizations
    projected = replace(choice, stabilization="projection") if can_project and not adaptive else None
    verdict = diagnose_runs(run, mechanism, reference, ladder(choice, adaptive), end, adaptive, projected, told)
    return verdict, runs[0] if runs else None


def make_diagnosis(
    mechanism: Mechanism, subject: Subject, end: float, verdict: Verdict, reference: str, remarks: Sequence[str]
) -> Diagnosis:
    """Return the diagnosis: a verdict with the names of the run, the description of its reference, and remarks."""
    return Diagnosis(
        **name_run(mechanism, subject.name, replace(subject.choice, settings=subject.settings)),
        **vars(verdict),
        until=end,
        part=verdict.cause.part,
        reference=reference,
        remarks=tuple(remarks),
    )


def read_file(name: str, close: tuple[str, ...]) -> OwnFile | None:
    """Return the model file with this name, or None if the name is that of a linkage, for which `close` is refused."""
    if is_model_file(name):
        with Worker() as worker:
            return read_own_file(name, close, worker)
    if close:
        raise ChoiceError("--close: only a URDF file needs it; a linkage file names its joints")
    return None


def subject_as_it_stands(file: OwnFile, integrator: str | None, stabilization: str | None, step: float | None) -> Subject:
    """Return MuJoCo with the settings of an MJCF file; `integrator` and `step` [s] replace those of the file unless they are None.

    Raises:
        ChoiceError: an MJCF file cannot express this integrator, stabilisation or step.
    """
    integrator = integrator or file.settings["integrator"]
    step = file.settings["timestep"] if step is None else step
    if integrator not in INTEGRATORS:
        raise ChoiceError(f"--integrator {integrator}: MJCF has {', '.join(INTEGRATORS)}")
    if stabilization not in (None, "none"):
        raise ChoiceError(f"--stabilization {stabilization}: MuJoCo has none but the solref of its closures")
    check_positive("the step", step)
    choice = Choice(setting_text(file.path, {}), integrator, "none", step)
    return Subject(ENGINE, "mujoco", f"as {file.path.name} has them", choice, offer(ENGINE), file)


def compare_errors(mechanism: Mechanism, trajectory: Trajectory, reference: Reference, required: Mapping[str, float]) -> list[str]:
    """Return for each requirement (kind -> largest error [m], [rad]) a sentence that says whether a run meets it."""
    # a reference without certificate has equally spaced samples, and is interpolated at the times of the run, without error bars
    if not reference.certified:
        q, v = truths.interpolate(reference, trajectory.t)
        reference = Reference.with_one_bar(replace(trajectory, q=q, v=v), reference.method)
    largest = state_errors(mechanism, trajectory, reference).largest  # kind -> largest error [m], [rad]
    sentences = []
    for kind, limit in required.items():
        verb, unit = "meets" if largest[kind] <= limit else "does not meet", UNITS[kind]
        sentences.append(f"the run {verb} the required {kind} error of {limit:g} {unit}: its error is {largest[kind]:.1e} {unit}")
    return sentences


def find_reference(linkage: str, mechanism: Mechanism, until: float, deadline: float, told: Told) -> Reference:
    """Return the certified motion up to `until` [s]; without a certificate, compute a reference with smaller and smaller steps.

    Raises:
        ChoiceError: no reference was completed before the deadline (monotonic clock [s]), or it failed its checks.
    """
    if certified := find_certified(mechanism, until):
        return certified
    try:
        with Worker() as worker:
            run = WayRun(linkage, mechanism, until)
            truth = truths.compute_reference(run, KNOWN, lambda: deadline - time.monotonic(), worker, told)
    except truths.NoTruth as failure:
        raise ChoiceError(f"{mechanism.name}, scenario {mechanism.scenario}: no reference to compare with: {failure}") from failure
    return Reference.with_one_bar(truth.reference.samples, truth.reference.method, truth.bar)
