"""Export linkages to other programs and import models from them: the objects that `export --json` and `import --json` print."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from dataclasses import replace as replace_fields
from pathlib import Path

from gauss_bench.advice.answer import LOOPS, format_errors, format_limits
from gauss_bench.advice.budget import Budget
from gauss_bench.advice.recommending import SEARCHED, Recommender
from gauss_bench.advice.truth import NoTruth, shorten
from gauss_bench.api.files import writable
from gauss_bench.api.in_worker import answer_in_worker
from gauss_bench.api.program_error import LIMIT, ProgramError, measure_program
from gauss_bench.api.recommend import list_requirements, list_variants, setting_of
from gauss_bench.api.telling import Result, Told, nobody
from gauss_bench.atomic import write_text
from gauss_bench.bench.ways import Run
from gauss_bench.compiler.stepping.driver import INTEGRATORS
from gauss_bench.engines import all_names, is_class
from gauss_bench.engines.base import Choice, Variant
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import KINDS, Exported, Kind, describe_refusal, export_linkage, export_program
from gauss_bench.exchange.imports import import_file
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reach import UNITS
from gauss_bench.runs.offers import ChoiceError, check_budget, check_size, interpreter_of, offer, offers_from_outside
from gauss_bench.runs.programs import ask_program, writes_programs
from gauss_bench.runs.worker import Worker, WorkerFailure
from gauss_bench.trajectory import RunFailure

WRITING, READING = 120.0, 30.0  # [s] limits for writing and reading a model, since a model can keep a compiler busy for hours
BUDGET = LIMIT  # [s] default of the time for a search
STEP = 1e-3  # [s] default of the step in a file
TOLERANCE = 1e-8  # default of the tolerance in a program whose integrator chooses its steps
OPEN, MOTION = 1e-6, 1e-4  # largest gap of loops [m] and error of motion [m, rad]; with a tuned step, errors are at most half
SHORTEST, LONGEST = 5.0, 10.0  # [s] limits of the time over which a step is tried, which is otherwise the scenario's duration


@dataclass(frozen=True)
class Tuning(Result):
    """The step that was found for an exported file, and the errors that were measured with it.

    Attributes:
        settings, integrator: names of the engine's settings and integrator.
        step: integration step [s]; until: end of the measured run [s].
        loops_open: largest gap of any joint [m, rad].
        motion_error: largest error of any link's position or angle [m, rad].
        truth: how the reference motion was made; known: error bar of the reference [m, rad].
        loops_wanted, motion_wanted: requirements on both errors [m, rad]; the errors must be at most half of them.
    """

    computed = ("met",)
    settings: str
    integrator: str
    step: float
    until: float
    loops_open: float
    motion_error: float
    truth: str
    known: float
    loops_wanted: float
    motion_wanted: float

    @property
    def met(self) -> bool:
        """Whether both errors are at most half of the required ones, and the error bar at most a tenth of `motion_wanted`."""
        is_precise = self.known <= self.motion_wanted / 10
        return is_precise and self.loops_open <= self.loops_wanted / 2 and self.motion_error <= self.motion_wanted / 2

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences for the head of the exported file."""
        how = f"settings {self.settings}, {self.integrator}, step {self.step:g} s"
        outcome = "both errors are at most half of these" if self.met else "NOT HELD by any step that was tried"
        return (
            f"Measured over {self.until:g} s with {how}:",
            f"joints open by {self.loops_open:.1e} (m, rad) at most, links off by {self.motion_error:.1e} (m, rad) at most.",
            f"Reference motion: {self.truth}; known to {self.known:.1e}.",
            f"Limits: joints {self.loops_wanted:g}, links {self.motion_wanted:g}: {outcome}.",
        )


@dataclass(frozen=True)
class Export(Result):
    """A linkage that was written for another program.

    Attributes:
        engine: name of the kind of file; what: description of the kind.
        mechanism, scenario: names of the exported linkage and scenario.
        file: path of the file, which is not written if `refused` has a reason; bytes: its size.
        step: integration step in the file [s].
        left_out: parts of the linkage file that the exported file lacks.
        tuning: how the step was found; None if the step was not tuned.
        error: measured error of an exported program; None if the file is an MJCF model, or if no setting was found.
        refused: the reason why nothing was written; empty if the file was written.
    """

    engine: str
    mechanism: str
    scenario: str
    file: str
    what: str
    bytes: int
    step: float
    left_out: tuple[str, ...]
    tuning: Tuning | None
    error: ProgramError | None = None
    refused: str = ""

    @property
    def succeeded(self) -> bool:
        return not self.refused and (self.tuning is None or self.tuning.met)


@dataclass(frozen=True)
class Import(Result):
    """A linkage file that was made from a model of another program.

    Attributes:
        model: path of the model; kind: "MJCF" or "URDF".
        file: path of the linkage file; name: name of the linkage.
        links, dof: number of links and of degrees of freedom.
        left_out: parts of the model that the linkage file lacks or represents in another way.
        note: if the model closes no loop, a sentence that says so and how to close one; else empty.
    """

    model: str
    kind: str
    file: str
    name: str
    links: int
    dof: int
    left_out: tuple[str, ...]
    note: str = ""

    @property
    def notices(self) -> tuple[str, ...]:
        return (*(f"not imported: {x}" for x in self.left_out), *([self.note] if self.note else []))


def export(
    linkage: str,
    engine: str,
    out: str | Path,
    scenario: str | None = None,
    tuned: bool = False,
    step: float | None = None,
    replace: bool = False,
    budget: float | None = None,
    told: Told = nobody,
    position: float | None = None,
    angle: float | None = None,
    force: float | None = None,
    anyway: bool = False,
) -> Export:
    """Write a linkage as a model or program that runs without this package.

    A program is run before its file is written, and the comment at the top of the file states the measured error of the program. If
    the judge refuses the program's motion, the file is not written, and the result's `refused` gives the reason.

    Args:
        linkage: name of a built-in linkage, or a path.
        engine: kind of the file: "mujoco" (MJCF), "pinocchio", "exudyn" or "casadi" (Python), "c", or the name of an engine that
            writes programs itself (`program` in `gauss_bench.engines.base`).
        out: path of the file to write.
        scenario: name of a scenario; by default the first one that gives the motion a start.
        tuned: find the largest step with errors of at most half of 1e-6 m (gaps of loops) and of 1e-4 m or rad (motion), and write
            the measured errors into the file.
        step: integration step in the file [s]; by default 0.001.
        replace: whether an existing file may be replaced.
        budget: time limit of the search [s], by default 60. Measuring an exported program has a separate limit, which is equal but
            at least 60 s. Time in which other programs had the processor is not counted.
        told: function that is called with each message of progress.
        position, angle, force: largest allowed errors [m], [rad], [N]. The file gets the engine's cheapest setting whose errors
            stay within them over the scenario's duration. If no setting is accurate enough, nothing is written.
        anyway: write the program even if the judge refuses its motion, with a warning at the top of the file.

    Raises:
        LinkageError: the linkage file has faults.
        ExchangeError: the format cannot express a part of the linkage, which the message names, or the file exists already.
        ChoiceError: the kind of file is unknown, the step is not positive, or a required accuracy cannot be used for this kind.
        MissingExtra: the library that builds the model is not installed.
        OSError: the file cannot be written.
    """
    kind = find_kind(engine)
    _check_step(engine, kind, step, tuned)
    wanted = read_requirements(engine, kind, step is not None or tuned, position=position, angle=angle, force=force)
    path = writable(out, replace, suffix=kind.suffix, source=linkage)
    seconds = check_budget(budget, BUDGET)
    mechanism = load(linkage, scenario)
    default = kind.choose(step or STEP)
    check_size(default.step, mechanism.duration)
    order = Order(linkage, mechanism, engine, kind)
    answer = Export(engine, mechanism.name, mechanism.scenario, str(path), kind.what, 0, default.step, (), None)
    told(f"{mechanism.name}, scenario {mechanism.scenario}: writing the model")
    file = order.write(default)  # raises ExchangeError, before any search, if the format cannot express the linkage
    tuning, choice, warning = None, default, ""
    remarks: tuple[str, ...] = ()
    try:
        if tuned:
            tuning = find_step(order, seconds, told)
            choice, remarks = kind.choose(tuning.step), tuning.sentences
        elif wanted:
            choice, remarks = find_setting(order, wanted, seconds, told)
    except NotReached as reason:
        return replace_fields(answer, refused=str(reason))
    answer = replace_fields(answer, tuning=tuning, step=choice.step)
    if kind.is_program:
        interpreter = None if kind.writer else interpreter_of(kind.engine)
        # a program that cannot run by itself is measured by the suite's own run with the same engine and setting
        runs_itself = engine == "c" or interpreter is not None
        if runs_itself and choice != default:
            file = order.write(choice)
        source = file.text if runs_itself else ""
        error = measure_program(linkage, mechanism, kind.engine, choice, source, max(seconds, LIMIT), told, interpreter)
        refused = describe_miss(error, wanted) or ("" if error.is_valid or anyway else error.refusal)
        answer = replace_fields(answer, error=error, refused=refused)
        if refused:
            return answer
        remarks, warning = (*error.sentences, *remarks), error.warning
    if remarks:
        file = order.write(choice, remarks, warning)
    write_text(path, file.text)
    return replace_fields(answer, bytes=len(file.text.encode()), left_out=file.left_out)


def _check_step(engine: str, kind: Kind, step: float | None, tuned: bool) -> None:
    """Check the arguments that determine the time step [s] of an exported file."""
    if step is not None and not 0.0 < step < float("inf"):
        raise ChoiceError(f"the step must be a positive number of seconds, not {step:g}")
    if step is not None and tuned:
        raise ChoiceError("give either --step, or --tuned, which finds a step")
    if kind.tolerance is not None and (step is not None or tuned):
        raise ChoiceError(f"{engine} chooses its steps: --position, --angle or --force finds its tolerance")


@dataclass(frozen=True, eq=False)
class Order:
    """A linkage that is to be written as a file.

    Attributes:
        linkage: name of a built-in linkage, or a path.
        mechanism: the linkage in one scenario.
        name: name of the kind of file, as the user gave it.
        kind: the properties of this kind of file.
    """

    linkage: str
    mechanism: Mechanism
    name: str
    kind: Kind

    def write(self, choice: Choice, remarks: tuple[str, ...] = (), warning: str = "") -> Exported:
        """Return the exported file for a setting (`choice`), with remarks and a warning in its header comment.

        A worker process writes the text of the file, because libraries may crash or hang. A kind of file without a `writer` is a
        program, which the engine's adapter writes.

        Raises:
            ExchangeError: the format cannot express a part of the linkage, which the message names.
            MissingExtra: a library is not installed.
        """
        if self.kind.writer:
            return write_file(self.mechanism, self.name, choice, remarks, warning)
        try:
            with Worker() as worker:
                text = ask_program(worker, self.kind.engine, self.mechanism, choice, WRITING)
        except (RunFailure, WorkerFailure) as failure:
            raise ExchangeError(f"{describe_refusal(self.mechanism, self.kind)}: {failure}") from failure
        return export_program(self.mechanism, text, remarks, warning)


def find_kind(name: str) -> Kind:
    """Return the kind of file with this name: one of KINDS, or a Python program if an engine of this name writes programs itself.

    Raises:
        ChoiceError: there is no kind of file with this name; the message lists all kinds.
    """
    if name in KINDS:
        return KINDS[name]
    if (is_class(name) or name in all_names()) and writes_programs(name):
        offered = offer(name)
        fixed_step = [x for x in offered.integrators if x not in offered.adaptive]
        choice = offered.choose(None, fixed_step[0] if fixed_step else None, None, STEP)
        tolerance = None if fixed_step else TOLERANCE  # an integrator that chooses its own steps needs a tolerance instead
        return Kind("", name, choice.settings, choice.integrator, choice.stabilization, "a Python program", ".py", tolerance)
    writers = [x.name for x in offers_from_outside() if "program" in x.methods]
    raise ChoiceError(f"no export for {name!r}; there are {', '.join([*KINDS, *writers])}, and engines with a method `program`")


def read_requirements(engine: str, kind: Kind, has_step: bool, **limits: float | None) -> dict[str, float]:
    """Return the requirements that the user gave: kind of error (position, angle, force) -> largest allowed error [m], [rad], [N].

    Without requirements the result is empty. `has_step` tells whether --step or --tuned determines the step.

    Raises:
        ChoiceError: a file of this kind cannot express the settings that a search may find, or another argument fixes the step.
    """
    if all(x is None for x in limits.values()):
        return {}
    if not kind.is_program:
        raise ChoiceError(
            f"{engine}: {kind.what} cannot hold the settings that --position, --angle and --force look for: take --tuned, "
            f"or `gauss-bench recommend --engine {engine} --out FOLDER`, which writes a program"
        )
    if has_step:
        raise ChoiceError("give either --step or --tuned, or --position, --angle and --force, which find a setting")
    return list_requirements(**limits)


class NotReached(ArithmeticError):
    """No setting of an engine is known to meet the requirement."""


def find_setting(order: Order, wanted: Mapping[str, float], budget: float, told: Told) -> tuple[Choice, tuple[str, ...]]:
    """Return the engine's cheapest setting that is accurate enough over the scenario's duration, and remarks for the file's head.

    `wanted` is kind of error -> largest allowed error [m], [rad], [N]; `budget` is the time for the search [s].

    Raises:
        NotReached: no such setting was found, or no reference is accurate enough.
    """
    engine, end = order.kind.engine, order.mechanism.duration
    # a program in C has only the integrators that are written in C
    tried = [x for x in list_variants(offer(engine)) if order.name != "c" or x.integrator in INTEGRATORS]
    limit = format_limits(wanted)
    try:
        with Recommender(Run(order.linkage, order.mechanism, end), wanted, {engine: tried}, Budget(budget), told) as recommender:
            recommender.search()
            (answer,) = recommender.answers(recommender.race())
    except NoTruth as reason:
        raise NotReached(f"no setting can be judged: {reason}") from reason
    if answer.status != "ok":
        raise NotReached(f"no setting of {engine} is known to hold {limit} over {end:g} s: {answer.message}")
    reached = format_errors(answer.errors, wanted)
    return answer.choose(end), (f"Found for at most {limit}: {setting_of(answer)}, with {reached} in the search.",)


def describe_miss(error: ProgramError, wanted: Mapping[str, float]) -> str:
    """Return a sentence on the first requirement that a program misses although its setting met it in the search, or ""."""
    for kind, limit in wanted.items():
        measured = {"position": error.position, "angle": error.angle}.get(kind)
        if measured is not None and not measured <= limit:
            return f"the program is off by {measured:.1e} {UNITS[kind]} on {error.measured_on}, more than {limit:g} {UNITS[kind]}"
    return ""


def write_file(mechanism: Mechanism, kind: str, choice: Choice, remarks: tuple[str, ...] = (), warning: str = "") -> Exported:
    """Return an exported file of one of KINDS, with remarks and a warning in its header comment.

    Raises:
        ExchangeError: the format cannot express a part of the linkage, which the message names.
        MissingExtra: a library is not installed.
    """
    with Worker() as worker:
        arguments = (mechanism, kind, choice.step, remarks, choice, warning)
        file = answer_in_worker(worker, export_linkage, arguments, WRITING, mechanism.source)
    return Exported(file["text"], tuple(file["left_out"]))


def import_model(
    model: str | Path, out: str | Path, close: Sequence[str] = (), replace: bool = False, told: Told = nobody
) -> Import:
    """Write a linkage file from a planar model in MJCF or URDF.

    Args:
        model: path of the model. MJCF is read by MuJoCo's own compiler.
        out: path of the linkage file to write; the file's name without its ending becomes the name of the linkage.
        close: pairs of points to be joined, which close the loops of a URDF file; each as LINK.FRAME=LINK.FRAME.
        replace: whether an existing file may be replaced.
        told: function that is called with each sentence of progress.

    Raises:
        ExchangeError: an element is not planar or cannot be part of a linkage, or the file exists already.
        MissingExtra: MuJoCo is not installed.
        OSError: the file cannot be written.
    """
    path = writable(out, replace, suffix=".toml", source=model)
    told(f"{model}: reading the model")
    with Worker() as worker:
        linkage = answer_in_worker(worker, import_file, (Path(model), path.stem, list(close)), READING, str(model))
    write_text(path, linkage["text"])
    left_out, note = tuple(linkage["left_out"]), linkage["note"]
    return Import(str(model), linkage["kind"], str(path), path.stem, linkage["links"], linkage["dof"], left_out, note)


def find_step(order: Order, budget: float, told: Told) -> Tuning:
    """Find the largest step with which loops open by at most OPEN / 2 and the motion is off by at most MOTION / 2.

    If no step is accurate enough, the result has the step with the smallest errors. The motion may be chaotic, so that no reference
    is accurate enough over the whole duration. Then the search is repeated over a quarter of the duration, and then over a
    sixteenth.

    Raises:
        ExchangeError: no run reaches its end within the budget, or no reference is accurate enough.
    """
    kind, mechanism = order.kind, order.mechanism
    named = f"{mechanism.source}: {mechanism.name}"
    space = {kind.engine: [Variant(kind.settings, kind.integrator, kind.stabilization, {})]}
    wanted = {"position": MOTION, "angle": MOTION, LOOPS: OPEN}  # the Recommender accepts errors up to half of these
    # a Recommender searches for the share SEARCHED of its budget; nothing is timed afterwards here, so the search gets it all
    search_budget = Budget(budget / SEARCHED)
    for until in shorten(min(max(mechanism.duration, SHORTEST), LONGEST)):
        try:
            with Recommender(Run(order.linkage, mechanism, until), wanted, space, search_budget, told) as recommender:
                truth = recommender.search()
                (answer,) = recommender.answers({})
        except NoTruth as reason:
            told(f"no reference over {until:g} s: {reason}")
            unknown, search_budget = reason, Budget(search_budget.remaining())
            if search_budget.seconds <= 0:
                break
        else:
            if not (answer.steps and answer.errors):
                raise ExchangeError(f"{named}: no run of {kind.engine} ended within {budget:g} s: {answer.message}")
            motion = max(answer.errors["position"], answer.errors["angle"])
            step, gap = until / answer.steps, answer.errors[LOOPS]
            return Tuning(kind.settings, kind.integrator, step, until, gap, motion, truth.description, truth.bar, OPEN, MOTION)
    raise ExchangeError(f"{named}: no step can be judged over {until:g} s, choose it by --step: {unknown}") from unknown
