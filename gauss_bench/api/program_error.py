"""Measure the error of an exported program: run its engine and setting, judge the run, and compare the run with a reference.

If there is a compiler, an exported program in C is compiled and run, because its arithmetic differs from that of any engine. A
program that an engine's adapter writes is run in the engine's environment, without this package.
"""

import csv
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gauss_bench.advice.answer import format_errors, format_setting
from gauss_bench.advice.budget import Budget
from gauss_bench.advice.recommending import KNOWN
from gauss_bench.advice.truth import NoTruth, compute_reference
from gauss_bench.api.simulate import Simulation, simulate
from gauss_bench.api.telling import Result, Told, nobody
from gauss_bench.bench.ways import Run
from gauss_bench.engines.base import Choice
from gauss_bench.engines.c_code import NO_COMPILER, compiler
from gauss_bench.engines.programs import coordinates, plan, rates
from gauss_bench.judge import OFF_MOTION
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import state_errors
from gauss_bench.runs.offers import check_affordable, offer
from gauss_bench.runs.programs import run_there
from gauss_bench.runs.worker import Interpreter, Worker, WorkerFailure
from gauss_bench.trajectory import Status, Trajectory, in_a_sentence, spread_evenly

LIMIT = 60.0  # [s] default of the time for the run, its repetition with half the step, the reference and the program
COMPILING = 20.0  # [s] limit of the C compiler
RUNNING = 5.0  # [s] limit of a program in C
OWN_LIMIT = 0.8  # limit of a program in Python, as a share of its worker's limit: the program must be stopped before the worker
COMPILED_STEP = 2e-6  # [s] time of a compiled step of a linkage of usual size
QUICK, PRECISE = 1e-6, 1e-9  # error bars of the two references, relative to the linkage's size, and [rad]
ROUGH = 1e-3  # largest error bar of a reference that is used, relative to the linkage's size, and [rad]
COMPARED = 400  # largest number of samples that are compared
KINDS = ("position", "angle")  # kinds of error that are measured
NUMPY = "gauss"  # own formulation whose run is judged if the engine of a program in C cannot be used


@dataclass(frozen=True, kw_only=True)
class ProgramError(Result):
    """The error of an exported program with the setting that is written in the program, over the scenario's duration.

    Attributes:
        status, message: the judge's verdict on the run: "ok", or another status with its reason.
        settings, integrator, stabilization, step, tolerance: setting of the program; with a tolerance, the step is the time between
            printed rows [s].
        until: end of the run [s].
        position, angle: largest error of any link's centre of mass [m] or angle [rad]; None if there is no reference.
        known: error bar of the reference [m, rad]; None if there is no reference.
        reference: how the reference was made, or why there is none.
        measured_on: the run that was measured: the program itself, or the suite's run of the same setting.
    """

    status: str
    message: str
    settings: str
    integrator: str
    stabilization: str
    step: float
    tolerance: float | None
    until: float
    position: float | None
    angle: float | None
    known: float | None
    reference: str
    measured_on: str

    @property
    def is_valid(self) -> bool:
        return self.status == str(Status.OK)

    @property
    def warning(self) -> str:
        """The warning at the top of a program whose motion the judge refuses; empty if the judge accepts the motion."""
        return "" if self.is_valid else f"WARNING: do not trust this program with {self.setting}. {self.status}: {self.message}"

    @property
    def refusal(self) -> str:
        """The message to the user if the judge refuses the program's motion, with options that may help."""
        hints = {
            str(Status.TIMEOUT): "a larger --budget gives it more time, ",
            str(Status.INVALID): "--position finds a setting that holds an accuracy, ",
        }
        hint = hints.get(self.status, "")
        return f"{self.status} with {self.setting}: {self.message}; {hint}--anyway writes it with a warning"

    @property
    def setting(self) -> str:
        """The program's setting as text."""
        return format_setting(self.settings, self.integrator, self.stabilization, self.step, self.tolerance)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences on the measured error for the header comment of the program."""
        run = f"Measured over {self.until:g} s with {self.setting}, on {self.measured_on}:"
        if self.position is None or self.angle is None:
            return run, f"Error: not known: {self.reference}."
        return run, describe_error(self.position, self.angle), describe_reference(self.reference, self.known)


def describe_error(position: float, angle: float) -> str:
    """Return the sentence about the errors [m] and [rad] that stands at the top of a program."""
    return f"Error: centres of mass are off by {position:.1e} m at most, angles by {angle:.1e} rad at most."


def describe_reference(reference: str, known: float | None) -> str:
    """Return the sentence about the reference and its error bar [m, rad] that stands at the top of a program."""
    return f"Reference: {reference}; known to {known:.1e} (m, rad)."


@dataclass(frozen=True)
class Comparison:
    """The largest errors of a run [m], [rad], and the error bar and method of the reference, or the reason why there is none."""

    reference: str
    position: float | None = None
    angle: float | None = None
    known: float | None = None


class ProgramFailed(Exception):
    """Raised if a program fails or prints rows that cannot be used; the message gives the reason."""


def measure_program(
    linkage: str,
    mechanism: Mechanism,
    engine: str,
    choice: Choice,
    source: str,
    seconds: float,
    told: Told,
    interpreter: Interpreter | None = None,
) -> ProgramError:
    """Run the engine and setting of a program with the program's steps, judge the run, and compare it with a reference.

    Args:
        source: text of the program if the program itself is run, else empty.
        seconds: time [s], a quarter each for the suite's run and for its repetition at half the step, and half for the reference. A
            program in Python gets the rest of the first half, and at least a quarter.

    Raises:
        ChoiceError: the steps would take longer than a quarter of `seconds`.
    """
    end, budget = mechanism.duration, Budget(seconds)
    steps, every = plan(end, choice.step)  # number of steps, and steps between the rows that the program prints
    choice = choice if choice.tolerance is not None else replace(choice, step=end / steps)
    row_times = (end / steps * np.arange(0, steps + 1, every)).tolist()  # [s]
    if source and interpreter is None:
        # the suite's run beside a program in C: by the program's engine, or by NUMPY if this engine cannot be used here
        engine = engine if offer(engine).usable else NUMPY
        check_affordable(choice.step, end, COMPILED_STEP, seconds / 4)
    told(f"measuring the program's error: {engine}, {end:g} s")
    setting = (choice.settings, choice.integrator, choice.stabilization, choice.step)
    run = simulate(linkage, engine, mechanism.scenario, *setting, row_times, limit=seconds / 4, tolerance=choice.tolerance)
    comparison, status, message, trajectory = Comparison("the run did not end"), run.status, run.message, None
    measured_on = f"the suite's run of {run.engine} with the same setting"
    try:
        trajectory, measured_on = run_program(run, measured_on, source, interpreter, max(budget.remaining(0.5), seconds / 4))
    except ProgramFailed as failure:
        status, message = Status.ERROR, str(failure)  # without a trajectory nothing is measured
    if trajectory is not None and status is Status.OK:
        told("computing the reference")
        comparison = find_error(Run(linkage, mechanism, end), trajectory, seconds / 2)
        if comparison.position is None or comparison.angle is None:
            message = refuse_other(mechanism, trajectory, run.trajectory)
        else:
            message = refuse_far(mechanism, comparison.position, comparison.angle)
        status = Status.INVALID if message else Status.OK
    return ProgramError(
        status=str(status),
        message=message,
        measured_on=measured_on,
        until=end,
        **vars(choice),
        **vars(comparison),
    )


def run_program(
    run: Simulation, run_name: str, source: str, interpreter: Interpreter | None, seconds: float
) -> tuple[Trajectory | None, str]:
    """Run a program, in Python for at most `seconds`; return its samples, and a text that names the run.

    If the program cannot be run here, the samples are those of `run`, the suite's run of the same setting, called `run_name`.
    `source` is empty if a program of this kind cannot be run on its own; `interpreter` is None for a program in C.

    Raises:
        ProgramFailed: the program stopped with an error before its end.
    """
    if not source:
        return run.trajectory, run_name
    if interpreter is None:
        trajectory, missing = run_c(source, run.model.n)
    else:
        trajectory, missing = run_python(source, run.model, interpreter, seconds)
    if trajectory is None:
        return run.trajectory, f"{run_name}, because {missing}"
    return trajectory, "this program itself"


def find_error(run: Run, trajectory: Trajectory, seconds: float) -> Comparison:
    """Return the largest errors of a trajectory against a reference.

    Computing references takes at most `seconds`. If the error bar of the first reference, QUICK relative to the linkage's size, is
    more than a tenth of the error, a second reference with the error bar PRECISE follows. At most COMPARED samples are compared.
    """
    samples = trajectory[spread_evenly(len(trajectory.t), COMPARED)]
    size, budget = run.mechanism.size, Budget(seconds)
    best = Comparison("no reference could be computed")
    with Worker() as worker:
        for wanted_bar in (QUICK, PRECISE):
            reason = ""
            try:
                wanted = {"position": wanted_bar * size, "angle": wanted_bar}  # [m], [rad]
                truth = compute_reference(run, wanted, budget.remaining, worker, nobody)
            except NoTruth as failure:
                reason = str(failure)
            else:
                bars = truth.bars
                if max(bars["position"] / size, bars["angle"]) > ROUGH:
                    reason = f"the motion is known to {format_errors(bars, KINDS)} only: {truth.description}"
            if reason:  # the first reference, if there is one, is used
                return best if best.known is not None else Comparison(f"{best.reference}: {reason}")
            errors = state_errors(run.mechanism, samples, truth.at(run, samples.t)).largest
            best = Comparison(truth.description, errors["position"], errors["angle"], truth.bar)
            if all(bars[kind] <= KNOWN * errors[kind] for kind in KINDS):
                break
    return best


def refuse_far(mechanism: Mechanism, position: float, angle: float) -> str:
    """Return the reason to refuse a motion with errors [m], [rad] that the judge does not allow, or an empty text."""
    if not position <= OFF_MOTION * mechanism.size:
        return f"a link ends up {position:.2g} m from where it should be"
    return "" if angle <= OFF_MOTION else f"a link ends up turned by {angle:.2g} rad from where it should be"


def refuse_other(mechanism: Mechanism, trajectory: Trajectory, own: Trajectory | None) -> str:
    """Return the reason to refuse a program whose run ends far from the end of the suite's own run; empty if both ends agree."""
    if own is None or trajectory is own:
        return ""
    # lengths are measured relative to the linkage's size, and angles to 1 rad; one limit for both is the smaller of the two
    gap = np.abs(trajectory.q[-1] - own.q[-1]).max()
    return "" if gap <= OFF_MOTION * min(mechanism.size, 1.0) else f"the program ends {gap:.2g} (m, rad) from the suite's own run"


def run_c(source: str, n: int) -> tuple[Trajectory | None, str]:
    """Compile and run a program in C, which prints the time, n coordinates and their n rates in each row.

    Return (trajectory, ""), or (None, reason) if the program could not be compiled or run.

    Raises:
        ProgramFailed: the program stopped with an error before its end.
    """
    c_compiler = compiler()
    if c_compiler is None:
        return None, f"there is {NO_COMPILER}"
    with TemporaryDirectory() as folder:
        file, program = Path(folder, "linkage.c"), Path(folder, "linkage")
        file.write_text(source, encoding="utf-8")
        try:
            command = [c_compiler, "-O2", "-o", str(program), str(file), "-lm"]
            done = subprocess.run(command, capture_output=True, text=True, timeout=COMPILING, check=False)
            if done.returncode:
                return None, f"{Path(c_compiler).name} does not compile this program here: {in_a_sentence(done.stderr)[:200]}"
            done = subprocess.run([str(program)], capture_output=True, text=True, timeout=RUNNING, check=False)
        except subprocess.TimeoutExpired as slow:
            name = "the program" if slow.cmd[0] == str(program) else Path(c_compiler).name
            return None, f"{name} took longer than {slow.timeout:g} s"
    if done.returncode:
        raise ProgramFailed(in_a_sentence(done.stderr) or f"the program ended with code {done.returncode}")
    return read_rows(done.stdout.splitlines()[1:], n), ""


def run_python(source: str, mechanism: Mechanism, interpreter: Interpreter, seconds: float) -> tuple[Trajectory | None, str]:
    """Run a program in Python with the given interpreter.

    Return (trajectory, ""), or (None, reason) if the program printed no table that can be read.

    Raises:
        ProgramFailed: the program stopped with an error before its end, or took longer than OWN_LIMIT times `seconds`.
    """
    heading = ",".join(["t", *coordinates(mechanism), *rates(mechanism)])
    try:
        with Worker() as worker:
            answer = worker.under(interpreter).call(run_there, (source, OWN_LIMIT * seconds), seconds)
    except WorkerFailure as failure:
        raise ProgramFailed(str(failure)) from failure
    match answer:
        case {"printed": str(text)}:
            lines = text.splitlines()
            if heading in lines:
                rows = [x for x in lines[lines.index(heading) + 1 :] if "," in x]  # libraries may print lines between the rows
                return read_rows(rows, mechanism.n), ""
        case {"failed": str(reason)}:
            raise ProgramFailed(reason)
    return None, "the program prints no table of t, positions and velocities of the links"


def read_rows(lines: list[str], n: int) -> Trajectory:
    """Return a trajectory from lines of CSV, each with t, n positions and n velocities; its accelerations are zero.

    Raises:
        ProgramFailed: a line does not consist of 1 + 2 n numbers, or a number is not finite.
    """
    try:
        rows = np.array([*csv.reader(lines)], dtype=float).reshape(-1, 1 + 2 * n)
    except ValueError as error:
        raise ProgramFailed(f"the program's rows are no numbers: {in_a_sentence(error)}") from error
    if not (rows.size and np.isfinite(rows).all()):
        raise ProgramFailed("the program's numbers are not finite")
    t, q, v = rows[:, 0], rows[:, 1 : n + 1], rows[:, n + 1 :]
    return Trajectory(t, q, v, np.zeros_like(q), 0)
