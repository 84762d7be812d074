"""Write a copy of a user's MJCF file with settings that meet a required accuracy.

Settings are tried at the file's own timestep first; with `allow_step` the timestep is then halved. The written file is compiled by
MuJoCo and run again, and its errors must meet the requirement too.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.advice.budget import Budget
from gauss_bench.advice.recommending import HALF, KNOWN
from gauss_bench.advice.truth import NoTruth, Truth, compute_reference, shorten
from gauss_bench.api.exchange import READING
from gauss_bench.api.files import writable
from gauss_bench.api.in_worker import answer_in_worker
from gauss_bench.api.own_model import OwnFile, read_own_file, refuse_what_acts
from gauss_bench.api.recommend import list_requirements
from gauss_bench.api.telling import Result, Told, nobody
from gauss_bench.atomic import atomically
from gauss_bench.bench.clock import interleave, time_of
from gauss_bench.bench.ways import Run, Way, judge_trial
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.mujoco.adapter import Mujoco
from gauss_bench.engines.mujoco.own_model import compare_models
from gauss_bench.exchange.edit_mjcf import write_settings
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.own_model import ENGINE, setting_text
from gauss_bench.exchange.safe_xml import MAX_BYTES
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reach import UNITS, Requirement, Trial, share
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.blocks import steps_block
from gauss_bench.runs.offers import check_budget, duration
from gauss_bench.runs.one_run import Sampling
from gauss_bench.runs.worker import Worker
from gauss_bench.untrusted import read_bytes

BUDGET = 60.0  # [s] default of the time for the whole call
REFERENCE = 0.5  # share of the budget for the reference
ACCEPTED_SHARE = HALF.limit  # largest error of an accepted setting, relative to the required error
SAMPLES = 200  # largest number of samples of a run
HALVINGS = 10  # number of timesteps that are tried, each half of the one before
STIFF = Mujoco.settings["tuned"]  # settings with the stiffest closures that MuJoCo's documented options allow
# a setting of MuJoCo's interface that no attribute of MJCF expresses: a factor on the inverse masses that scale closures
UNWRITABLE = {"body_invweight0": Mujoco.settings["rigid"]["body_invweight0_factor"]}
IN_OPTION = ("timestep", "integrator", "tolerance", "iterations")  # attributes of <option>; the others are those of closures
RACING, ROUNDS = 60.0, 7  # [s] time limit of the timing of both models side by side, and its number of rounds


@dataclass(frozen=True, eq=False)
class Tuned(Result):
    """A model file with settings that meet a required accuracy, or the reason why no file was written.

    Attributes:
        model: path of the file that was read; file: path of the file that was written, or empty.
        changed: attribute of MJCF -> value in the written file.
        required: kind of error -> largest allowed error [m], [rad], [N]; the errors of the written file are at most half of these.
        until: end of the runs [s]; step: timestep of the written file [s].
        before: kind of error -> largest error of the original file [m], [rad], [N].
        errors: kind of error -> largest error [m], [rad], [N] of the written file, or of the best setting if no file was written.
        reference: how the reference motion was made; known: kind of error -> error bar of the reference [m], [rad], [N].
        cost: processor time of the written model divided by that of the original, for the same motion; None if no file was written.
        left_out: parts of the model file that the linkage lacks.
        remarks: sentences on settings that were not tried, and on better settings that MJCF cannot express.
    """

    computed = ("succeeded",)
    model: str
    file: str
    changed: Mapping[str, str | float | list[float]]
    required: Mapping[str, float]
    until: float
    step: float
    before: Mapping[str, float]
    errors: Mapping[str, float]
    reference: str
    known: Mapping[str, float]
    cost: float | None
    left_out: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def succeeded(self) -> bool:
        """Whether a file was written."""
        return bool(self.file)


@dataclass(frozen=True, eq=False)
class Tried:
    """A setting that was tried.

    Attributes:
        changes: attribute -> value, for the values that differ from those of the file.
        trial: status and largest errors of the run.
        share: largest ratio of an error, plus the error bar of the reference, to the required error; infinite if an error is
            unknown.
    """

    changes: dict[str, Any]
    trial: Trial
    share: float


class Judge:
    """Runs a model file with changed settings, and compares each run with the reference.

    Attributes:
        file: the model file.
        run: the linkage that the file describes, and the end of the runs [s].
        required: kind of error -> largest allowed error [m], [rad], [N].
        known: the reference motion with its error bars.
        evaluator: evaluates the linkage's equations.
        worker: the process in which all runs take place.
        budget: the time for all runs together.
    """

    def __init__(self, file: OwnFile, until: float, required: Mapping[str, float], known: Truth, worker: Worker, budget: Budget):
        self.file, self.required, self.known = file, required, known
        self.run = Run(str(file.path), file.mechanism, until)
        self.evaluator, self.worker, self.budget = Evaluator(file.mechanism), worker, budget

    def try_setting(self, changes: Mapping[str, Any], path: Path | None = None) -> Tried:
        """Run the model file, or the file at `path`, with changed attributes, and compare the run with the reference."""
        step = float(changes.get("timestep", self.file.settings["timestep"]))
        steps = max(1, int(self.run.until / step * (1 + 1e-12)))  # 1e-12: rounding may bring the quotient just below an integer
        times = step * np.unique(np.linspace(0, steps, min(steps, SAMPLES) + 1).round())  # (k,) [s], multiples of the step
        choice = Choice(setting_text(path or self.file.path, changes), "", "none", step)
        wanted = Sampling(times, step, count=steps, shortened=0)
        request = Request(self.run.linkage, self.run.mechanism.scenario, ENGINE, choice, wanted)
        ran = run_apart(request, self.run.mechanism, max(1.0, self.budget.remaining()), self.worker)
        way = Way(ENGINE, settings="", integrator="", stabilization="none", size=step)
        trial = judge_trial(self.run, self.evaluator, self.known.at(self.run, times), way, ran)
        # the true error may be larger than the measured one by the error bar of the reference
        bounds = {kind: x + self.known.bars.get(kind, 0.0) for kind, x in trial.errors.items()}
        worst = share(replace(trial, errors=bounds), [Requirement(*x) for x in self.required.items()])
        return Tried(dict(changes), trial, math.inf if math.isnan(worst) else worst)  # NaN: an error is unknown


def tune(
    model: str,
    out: str | Path,
    position: float | None = None,
    angle: float | None = None,
    force: float | None = None,
    until: float | None = None,
    allow_step: bool = False,
    budget: float | None = None,
    replace: bool = False,
    told: Told = nobody,
) -> Tuned:
    """Write a copy of an MJCF file whose settings meet a required accuracy; only the values of a few attributes differ.

    Args:
        model: path of the file, which is judged at its keyframe and with the keyframe's controls.
        out: path of the file to write; files that the model includes must be found from the folder of `out`.
        position, angle, force: largest allowed error of any link's centre of mass [m] or angle [rad], or of any joint force [N].
        until: end of the time over which the errors are compared [s]; by default five seconds, or less for a chaotic motion.
        allow_step: whether the timestep may be shortened if no setting is accurate enough at the file's own timestep.
        budget: longest time of the whole call [s]; by default 60.
        replace: whether an existing file may be replaced.
        told: function that is called with each sentence of progress.

    Raises:
        ExchangeError: the file is no planar linkage, or is a URDF file, or has a contact, joint limit or dry friction that acts; or
            there is no reference for its motion.
        ChoiceError: no required error is given, or a required error is no positive number.
        MissingExtra: MuJoCo is not installed.
        OSError: the file cannot be written.
    """
    required = list_requirements(position=position, angle=angle, force=force)
    path = writable(out, replace, suffix=".xml", source=model)
    seconds = Budget(check_budget(budget, BUDGET))
    with Worker() as worker:
        told(f"{model}: reading the model")
        file = read_own_file(model, (), worker)
        if file.kind != "MJCF":
            raise ExchangeError(
                f"{model}: a {file.kind} holds no settings; `gauss-bench import`, then `export` writes a tuned model"
            )
        end, truth = find_reference(file, until, required, seconds, worker, told)
        refuse_what_acts(file, end, worker)
        judge = Judge(file, end, required, truth, worker, seconds)
        before = judge.try_setting({})
        told(f"as it stands: {describe_errors(before)}")
        best = find_setting(judge, before, allow_step, told)
        written = best.share <= ACCEPTED_SHARE
        remarks = list_remarks(judge, best)
        if not written and not allow_step:
            remarks.append(f"the timestep was kept at {file.settings['timestep']:g} s: --allow-step also tries shorter ones")
        cost = None
        if written:
            best, cost = write_tuned(judge, best, path)
    return Tuned(
        model=model,
        file=str(path) if written else "",
        changed=best.changes,
        required=required,
        until=end,
        step=float(best.changes.get("timestep", file.settings["timestep"])),
        before=before.trial.errors,
        errors=best.trial.errors,
        reference=truth.description,
        known=truth.bars,
        cost=cost,
        left_out=file.left_out,
        remarks=tuple(remarks),
    )


def find_reference(
    file: OwnFile, until: float | None, required: Mapping[str, float], budget: Budget, worker: Worker, told: Told
) -> tuple[float, Truth]:
    """Return the end of the runs [s], and the reference motion until this end.

    If `until` is None, shorter durations are tried until the error bars are at most KNOWN times the required errors. If no error
    bars are small enough, the reference over the shortest duration is returned.

    Raises:
        ExchangeError: no reference could be computed, for any of the durations.
    """
    full_duration = duration(file.mechanism.duration, until=until)
    durations = [*shorten(full_duration)] if until is None else [full_duration]
    wanted_bars = {kind: KNOWN * x for kind, x in required.items()}
    last, reason = None, ""
    for end in durations:
        attempt = Budget(budget.remaining(REFERENCE) / 2)  # half of the time that is left; the rest is for shorter motions
        try:
            reference = compute_reference(Run(str(file.path), file.mechanism, end), wanted_bars, attempt.remaining, worker, told)
        except NoTruth as failure:
            reason = str(failure)
            continue
        last = (end, reference)
        if all(reference.bars.get(kind, 0.0) <= x for kind, x in wanted_bars.items()):
            break
    if last is None:
        raise ExchangeError(f"{file.path}: cannot be judged over {end:g} s: {reason}")
    return last


def list_settings(file: OwnFile, step: float) -> Iterator[dict[str, Any]]:
    """Yield the changes (attribute -> value) that are tried at a timestep [s].

    The first changes keep the solver parameters of the file's closures; the later changes set stiff parameters. Values that the
    file already has are left out.
    """
    integrators = dict.fromkeys((file.settings["integrator"], "RK4", "implicitfast", "Euler"))  # the file's own first
    steps, damping = STIFF["solref"]  # a time constant in steps; MuJoCo's option refsafe allows no less than two
    stiff = {"solref": [steps * step, damping]} | {key: STIFF[key] for key in ("solimp", "tolerance", "iterations")}
    for closures in ({}, stiff):
        for integrator in integrators:
            changes = {"timestep": step, "integrator": integrator} | closures
            yield {key: x for key, x in changes.items() if not has_value(file.settings[key], x)}


def has_value(value: Any, wanted: Any) -> bool:
    """Tell whether an option already has the wanted value.

    `value` is a dictionary, name of a closure -> value, if each closure has its own value of the option.
    """
    return all(x == wanted for x in value.values()) if isinstance(value, dict) else bool(value == wanted)


def find_setting(judge: Judge, before: Tried, allow_step: bool, told: Told) -> Tried:
    """Return the first accurate setting at the longest timestep; if there is none, the setting with the smallest share.

    A setting is accurate if its `share` is at most ACCEPTED_SHARE. `before` is the trial of the file's own setting.
    """
    best, step = before, float(judge.file.settings["timestep"])
    for _ in range(HALVINGS if allow_step else 1):
        for changes in list_settings(judge.file, step):
            if judge.budget.remaining() <= 0:
                return best
            tried = judge.try_setting(changes) if changes else before  # no changes: the file's own setting
            told(f"{describe_changes(changes)}: {describe_errors(tried)}")
            if tried.share < best.share:
                best = tried
            if best.share <= ACCEPTED_SHARE:
                return best
        step /= 2
    return best


def write_tuned(judge: Judge, best: Tried, path: Path) -> tuple[Tried, float]:
    """Write the edited file and run it; return its trial, and its processor time divided by that of the original file.

    Raises:
        ExchangeError: an attribute does not take effect, something else changed, included files are not found from the
            result's folder, or the written file does not meet the requirement.
        OSError: the file cannot be written.
    """
    return atomically(path, partial(_write_and_judge, judge, best, path))


def _write_and_judge(judge: Judge, best: Tried, path: Path, draft: Path) -> tuple[Tried, float]:
    """Write the edited file as `draft`, which becomes `path` if this function returns; the results are those of `write_tuned`.

    `draft` is a temporary file in the folder of `path`, because MuJoCo looks there for included files.
    """
    source, changes = judge.file.path, best.changes
    content = read_bytes(source, MAX_BYTES)
    option = {key: attribute_text(x) for key, x in changes.items() if key in IN_OPTION}
    closures = {key: attribute_text(x) for key, x in changes.items() if key not in IN_OPTION}
    reason = ""
    # attributes of each closure are changed first; if closures stand in included files, only attributes in <default> have effect
    for by_default in (False, True):
        draft.write_bytes(write_settings(content, str(source), option, closures, by_default))
        arguments: tuple[Any, ...] = (str(source), str(draft), changes)
        reason = answer_in_worker(judge.worker, compare_models, arguments, READING, str(path))["reason"]
        if not reason:
            break
    if reason:
        raise ExchangeError(f"{path}: not written: {reason}")
    # the written file has all changes already; the timestep is passed again because `try_setting` derives the samples from it
    written = judge.try_setting({key: x for key, x in changes.items() if key == "timestep"}, draft)
    if written.share > ACCEPTED_SHARE:
        raise ExchangeError(f"{path}: not written: it misses the requirement: {describe_errors(written)}")
    arguments = (judge.run.mechanism, str(source), judge.file.settings["timestep"], str(draft), written.trial.size)
    cost = float(answer_in_worker(judge.worker, race_there, arguments, RACING, str(path))["ratio"])
    return Tried(changes, written.trial, written.share), cost


def race_there(mechanism: Mechanism, before: str, step_before: float, after: str, step_after: float) -> dict[str, float]:
    """Return {"ratio": ...}: processor time per second of motion with the model file `after`, divided by that with `before`.

    Blocks of steps of both models alternate in this process (a worker), so that disturbances affect both alike.
    """
    engine, steps = get(ENGINE), (step_before, step_after)
    blocks = []
    for k, path in enumerate((before, after)):
        model = engine.build(mechanism, Choice(setting_text(Path(path), {}), "", "none", steps[k]))
        blocks.append(steps_block(k, model, steps[k], native=True))
    times: list[list[float]] = [[], []]
    for block, _, seconds in interleave(blocks, ROUNDS):
        k = blocks.index(block)
        times[k].append(seconds / steps[k])
    time_before, time_after = (time_of(np.array(x)) for x in times)
    return {"ratio": time_after / time_before}


def list_remarks(judge: Judge, best: Tried) -> list[str]:
    """Return sentences on settings that were not tried, and on a more accurate setting that MJCF cannot express."""
    if judge.budget.remaining() <= 0:
        holds = best.share <= ACCEPTED_SHARE
        return [] if holds else ["the budget ended before all settings were tried: a larger --budget may find one"]
    stiffer = judge.try_setting(best.changes | UNWRITABLE)
    if not stiffer.share < best.share / 2:
        return []
    factor, errors = UNWRITABLE["body_invweight0"], describe_errors(stiffer)
    return [f"no attribute of MJCF scales body_invweight0; with a factor of {factor:g} on it the errors would be {errors}"]


def describe_errors(tried: Tried) -> str:
    """Return the largest errors of a run as text, such as "position 1.20e-05 m", or the reason why they are unknown."""
    if not tried.trial.errors:
        return tried.trial.message or str(tried.trial.status)
    return ", ".join(f"{kind} {tried.trial.errors[kind]:.2e} {UNITS[kind]}" for kind in UNITS if kind in tried.trial.errors)


def describe_changes(changes: Mapping[str, Any]) -> str:
    """Return changed attributes of an MJCF file in its notation, such as `timestep="0.001" integrator="RK4"`."""
    return " ".join(f'{key}="{attribute_text(x)}"' for key, x in changes.items()) or "as it stands"


def attribute_text(value: Any) -> str:
    """Return the text of an attribute's value; a number read from this text is exactly the given number."""
    if isinstance(value, str):
        return value
    return " ".join(map(repr, value)) if isinstance(value, list) else repr(value)
