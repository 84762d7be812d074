"""Linkages out to other programs and in from them: what `gauss-bench export --json` and `import --json` print."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from dataclasses import replace as replace_fields
from pathlib import Path
from typing import Any

import numpy as np

from gauss_bench.advice.answer import LOOPS, format_errors, format_limits
from gauss_bench.advice.budget import Budget
from gauss_bench.advice.recommending import SEARCHED, Recommender
from gauss_bench.advice.truth import NoTruth, shorten
from gauss_bench.api.files import writable
from gauss_bench.api.in_worker import answer_in_worker, tell_plainly
from gauss_bench.api.program_error import LIMIT, ProgramError, measure_program
from gauss_bench.api.recommend import list_requirements, setting_of, variants
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

WRITING, READING = 120.0, 30.0  # [s] to build a model and write it, and to read one: compilers can be kept busy for hours
BUDGET = LIMIT  # [s] to look for a step or a setting
STEP = 1e-3  # [s] of a file where nothing is measured
TOLERANCE = 1e-8  # of a program whose integrator chooses its steps, where none is looked for
OPEN, MOTION = 1e-6, 1e-4  # [m], [m and rad] requirements on a tuned step, which must need only half of them
SHORTEST, LONGEST = 5.0, 10.0  # [s] that a step is tried for, whatever the scenario's duration


@dataclass(frozen=True)
class Tuning(Result):
    """The step that was found for an exported file, and what was measured with it.

    Attributes:
        settings, integrator: of the engine.
        step: [s]; until: how long was measured [s].
        loops_open: largest gap of any joint [m, rad].
        motion_error: largest error of any link's place or angle [m, rad].
        truth: how the reference was made; known: its error bar [m, rad].
        loops_wanted, motion_wanted: requirements on both errors [m, rad]; the step needs half of them.
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
        """True if the errors are at most half of the requirements, and the reference is known to a tenth of them."""
        known = self.known <= self.motion_wanted / 10
        return known and self.loops_open <= self.loops_wanted / 2 and self.motion_error <= self.motion_wanted / 2

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences for the head of the exported file."""
        how = f"settings {self.settings}, {self.integrator}, step {self.step:g} s"
        held = "held with half of it" if self.met else "NOT HELD by any step that was tried"
        return (
            f"Measured over {self.until:g} s with {how}:",
            f"joints open by {self.loops_open:.1e} (m, rad) at most, links off by {self.motion_error:.1e} (m, rad) at most.",
            f"Errors are against a motion that is {self.truth}, and known to {self.known:.1e}.",
            f"Aimed at: joints {self.loops_wanted:g}, links {self.motion_wanted:g}: {held}.",
        )


@dataclass(frozen=True)
class Export(Result):
    """A linkage, written for another program.

    Attributes:
        engine: kind of the file; what: the kind in words.
        mechanism, scenario: names of the exported linkage and scenario.
        file: path that was written, or that was not because of `refused`; bytes: its size.
        step: integration step in the file [s].
        left_out: parts of the linkage file that the exported file lacks.
        tuning: how the step was found, or None.
        error: of a program, as measured with its own setting; None for a model in MJCF, or where no setting was found.
        refused: why nothing was written, or an empty text.
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
    """A linkage file, made of a model of another program.

    Attributes:
        model: the file that was read; kind: "MJCF" or "URDF".
        file: that was written; name: of the linkage.
        links, dof: how many it has.
        left_out: parts of the model that the linkage file lacks or represents in another way.
        note: sentence that says that no loop is closed, and how one is; empty if there is a closure.
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
    """Write a linkage as a file that runs without this package: MJCF, a script for Pinocchio, Exudyn or CasADi, or plain C.

    An engine that writes programs itself (`program` in `gauss_bench.engines.base`) is a kind too.

    A script or program is run before it is written, and its head states its error. One whose motion the suite's judge refuses is
    not written: the result's `refused` gives the reason.

    Args:
        linkage: name of a built-in linkage, or a path.
        engine: one of `gauss_bench.exchange.export.KINDS`: "mujoco", "pinocchio", "exudyn", "casadi" or "c"; or an
            engine that writes programs itself.
        out: the file to write.
        scenario: of the linkage; the first with a start where not given.
        tuned: find the largest step that holds the loops to 1e-6 m and the motion to 1e-4 (m, rad), and say in the file what was
            measured.
        step: of the file's integration [s] where it is not tuned (0.001).
        replace: whether a file that is there already may be replaced.
        budget: seconds to look for a step or a setting (60), and again to measure a program, which has 60 in any case. Time in
            which other programs had the processor does not count.
        told: called with each sentence of progress.
        position, angle, force: largest allowed error, as in `recommend`: the file gets the engine's cheapest setting that holds it
            over the scenario's duration. If there is none, nothing is written.
        anyway: write a program that the judge refuses, with a warning at its top.

    Raises:
        LinkageError: the linkage file has faults.
        ExchangeError: the format cannot express a named part of the linkage; or the file exists already.
        ChoiceError: an unknown kind, a step that is not positive, or a requirement that cannot be used.
        MissingExtra: the library that builds the model is not installed.
        OSError: the file cannot be written.
    """
    kind = find_kind(engine)
    _check_step(engine, kind, step, tuned)
    wanted = required(engine, kind, step is not None or tuned, position=position, angle=angle, force=force)
    path = writable(out, replace, suffix=kind.suffix, source=linkage)
    seconds = check_budget(budget, BUDGET)
    mechanism = load(linkage, scenario)
    usual = kind.choose(step or STEP)
    check_size(usual.step, mechanism.duration)
    order = Order(linkage, mechanism, engine, kind)
    answer = Export(engine, mechanism.name, mechanism.scenario, str(path), kind.what, 0, usual.step, (), None)
    told(f"{mechanism.name}, scenario {mechanism.scenario}: the model")
    file = order.write(usual)  # what the kind cannot express is refused before anything is searched
    try:
        setting = choose_setting(order, usual, tuned, wanted, seconds, told)
    except NotReached as reason:
        return replace_fields(answer, refused=str(reason))
    answer = replace_fields(answer, tuning=setting.tuning, step=setting.choice.step)
    remarks, warning = setting.remarks, ""
    if kind.is_program:
        interpreter = None if kind.writer else interpreter_of(kind.engine)
        alone = engine == "c" or interpreter is not None  # such a program is run itself
        if alone and setting.choice != usual:  # the program that is measured is the one that is written
            file = order.write(setting.choice)
        source = file.text if alone else ""
        error = measure_program(linkage, mechanism, kind.engine, setting.choice, source, max(seconds, LIMIT), told, interpreter)
        refused = name_missed(error, wanted) or ("" if error.is_valid or anyway else error.refusal)
        answer = replace_fields(answer, error=error, refused=refused)
        if refused:
            return answer
        remarks, warning = (*error.sentences, *remarks), error.warning
    if remarks:
        file = order.write(setting.choice, remarks, warning)
    write_text(path, file.text)
    return replace_fields(answer, bytes=len(file.text.encode()), left_out=file.left_out)


def _check_step(engine: str, kind: Kind, step: float | None, tuned: bool) -> None:
    """Check that a step [s] can be used, and that at most one of `step` and `tuned` gives it.

    Raises:
        ChoiceError: it cannot, both do, or the kind's integrator chooses its steps.
    """
    if step is not None and not (np.isfinite(step) and step > 0):
        raise ChoiceError(f"the step must be a positive number of seconds, not {step:g}")
    if step is not None and tuned:
        raise ChoiceError("either a step, or tuned, which finds one")
    if kind.tolerance is not None and (step is not None or tuned):
        raise ChoiceError(f"{engine} chooses its steps: --position, --angle or --force find its tolerance")


@dataclass(frozen=True, eq=False)
class Order:
    """A linkage to be written as a file.

    Attributes:
        linkage: name of a built-in linkage, or a path; mechanism: its scenario.
        name, kind: of the file.
    """

    linkage: str
    mechanism: Mechanism
    name: str
    kind: Kind

    def write(self, choice: Choice, remarks: tuple[str, ...] = (), warning: str = "") -> Exported:
        """Return the file with a setting of the engine, and with a warning and remarks in its head.

        Raises:
            ExchangeError, MissingExtra: as `export`.
        """
        if self.kind.writer:
            return write_file(self.linkage, self.mechanism.scenario, self.name, choice, remarks, warning)
        try:
            with Worker() as worker:
                text = ask_program(worker, self.kind.engine, self.mechanism, choice, WRITING)
        except (RunFailure, WorkerFailure) as failure:
            raise ExchangeError(f"{describe_refusal(self.mechanism, self.kind)}: {failure}") from failure
        return export_program(self.mechanism, text, remarks, warning)


@dataclass(frozen=True)
class Setting:
    """The setting of an exported file.

    Attributes:
        choice: of the engine.
        remarks: sentences on how it was found, for the head of the file.
        tuning: how its step was found, or None.
    """

    choice: Choice
    remarks: tuple[str, ...] = ()
    tuning: Tuning | None = None


def choose_setting(order: Order, usual: Choice, tuned: bool, wanted: Mapping[str, float], budget: float, told: Told) -> Setting:
    """Return the setting of a file: with a step that is found, the cheapest that holds a requirement, or the usual one.

    Raises:
        NotReached: no setting is known to hold the requirement.
        ExchangeError: no step can be judged.
    """
    if tuned:
        tuning = tune(order, budget, told)
        return Setting(order.kind.choose(tuning.step), tuning.sentences, tuning)
    return find_setting(order, wanted, budget, told) if wanted else Setting(usual)


def find_kind(name: str) -> Kind:
    """Return the kind of files of that name: one of KINDS, or the programs that an engine writes itself.

    Raises:
        ChoiceError: there is none; the message lists those that there are.
    """
    if name in KINDS:
        return KINDS[name]
    if (is_class(name) or name in all_names()) and writes_programs(name):
        offered = offer(name)
        equal = [x for x in offered.integrators if x not in offered.adaptive]
        usual = offered.choose(None, equal[0] if equal else None, None, STEP)
        tolerance = None if equal else TOLERANCE
        return Kind("", name, usual.settings, usual.integrator, usual.stabilization, "a Python program", ".py", tolerance)
    writers = [x.name for x in offers_from_outside() if "program" in x.methods]
    raise ChoiceError(f"no export for {name!r}; there are {', '.join([*KINDS, *writers])}, and engines with a method `program`")


def required(engine: str, kind: Kind, has_step: bool, **limits: float | None) -> dict[str, float]:
    """Return the given requirements by kind, or {} if there are none.

    Raises:
        ChoiceError: a file of this kind holds no setting of the search, or another argument gives the step already.
    """
    if all(x is None for x in limits.values()):
        return {}
    if not kind.is_program:
        raise ChoiceError(
            f"{engine}: {kind.what} cannot hold the settings that --position, --angle and --force look for: take --tuned, "
            f"or `gauss-bench recommend --engine {engine} --out FOLDER`, which writes a program"
        )
    if has_step:
        raise ChoiceError("either --step or --tuned, or --position, --angle and --force, which find a setting")
    return list_requirements(**limits)


class NotReached(ArithmeticError):
    """No setting of an engine is known to hold the requirement."""


def find_setting(order: Order, wanted: Mapping[str, float], budget: float, told: Told) -> Setting:
    """Return the engine's cheapest setting that holds the requirement over the scenario's duration.

    Raises:
        NotReached: no setting holds it within the budget, or no reference is known well enough.
    """
    engine, end = order.kind.engine, order.mechanism.duration
    tried = [x for x in variants(offer(engine)) if order.name != "c" or x.integrator in INTEGRATORS]
    limit = format_limits(wanted)
    try:
        with Recommender(Run(order.linkage, order.mechanism, end), wanted, {engine: tried}, Budget(budget), told) as recommender:
            recommender.search()
            (answer,) = recommender.answers(recommender.race())
    except NoTruth as reason:
        raise NotReached(f"no setting can be judged: {reason}") from reason
    if answer.status != "ok":
        raise NotReached(f"no setting of {engine} is known to hold {limit} over {end:g} s: {answer.message}")
    came = format_errors(answer.errors, wanted)
    return Setting(answer.choose(end), (f"Found for at most {limit}: {setting_of(answer)} came to {came} in the search.",))


def name_missed(error: ProgramError, wanted: Mapping[str, float]) -> str:
    """Return how a program misses a requirement that its setting held in the search, or an empty text."""
    for name, limit in wanted.items():
        found = {"position": error.position, "angle": error.angle}.get(name)
        if found is not None and not found <= limit:
            return f"the program is off by {found:.1e} {UNITS[name]} on {error.measured_on}, more than {limit:g} {UNITS[name]}"
    return ""


def write_file(
    linkage: str, scenario: str, kind: str, choice: Choice, remarks: tuple[str, ...] = (), warning: str = ""
) -> Exported:
    """Return a file that this package writes; it is made in a worker, since libraries may crash or hang.

    Raises:
        ExchangeError, MissingExtra: as `export`.
    """
    with Worker() as worker:
        file = answer_in_worker(worker, write_there, (linkage, scenario, kind, choice, remarks, warning), WRITING, linkage)
    return Exported(file["text"], tuple(file["left_out"]))


def write_there(linkage: str, scenario: str, kind: str, choice: Choice, remarks: tuple[str, ...], warning: str) -> dict[str, Any]:
    """Run `export_linkage` in the worker and return plain data."""
    return tell_plainly(lambda: asdict(export_linkage(load(linkage, scenario), kind, choice.step, remarks, choice, warning)))


def import_model(
    model: str | Path, out: str | Path, close: Sequence[str] = (), replace: bool = False, told: Told = nobody
) -> Import:
    """Write a linkage file from a planar model in MJCF or URDF.

    Args:
        model: the file, which is read by MuJoCo's own compiler where it is MJCF.
        out: the linkage file to write; the linkage is called as it is, without the ending.
        close: the loops of a URDF, each as LINK.FRAME=LINK.FRAME.
        replace: whether a file that is there already may be replaced.
        told: called with each sentence of progress.

    Raises:
        ExchangeError: an element is not planar or cannot be part of a linkage, with file and reason; or the file exists already.
        MissingExtra: MuJoCo is not installed.
        OSError: the file cannot be written.
    """
    path = writable(out, replace, suffix=".toml", source=model)
    told(f"{model}")
    with Worker() as worker:
        linkage = answer_in_worker(worker, read_there, (str(model), path.stem, list(close)), READING, str(model))
    write_text(path, linkage["text"])
    left_out, note = tuple(linkage["left_out"]), linkage["note"]
    return Import(str(model), linkage["kind"], str(path), path.stem, linkage["links"], linkage["dof"], left_out, note)


def read_there(model: str, name: str, close: list[str]) -> dict[str, Any]:
    """Run `import_file` in the worker and return plain data."""
    return tell_plainly(lambda: asdict(import_file(Path(model), name, close)))


def tune(order: Order, budget: float, told: Told) -> Tuning:
    """Find the largest step whose errors are at most half of OPEN and MOTION, else the nearest step, as `recommend` does.

    If no reference is exact enough over the whole time, as for a chaotic motion, a quarter of it is tried, then a sixteenth.

    Raises:
        ExchangeError: no run ends, or no reference is known well enough.
    """
    kind, mechanism = order.kind, order.mechanism
    named = f"{mechanism.source}: {mechanism.name}"
    space = {kind.engine: [Variant(kind.settings, kind.integrator, kind.stabilization, {})]}
    wanted = {"position": MOTION, "angle": MOTION, LOOPS: OPEN}
    own = Budget(budget / SEARCHED)  # no race follows, so the search may use all of the budget
    for until in shorten(min(max(mechanism.duration, SHORTEST), LONGEST)):
        try:
            with Recommender(Run(order.linkage, mechanism, until), wanted, space, own, told) as recommender:
                truth = recommender.search().truth
                (answer,) = recommender.answers({})
        except NoTruth as reason:
            told(f"not known over {until:g} s: {reason}")
            unknown, own = reason, Budget(own.remaining())
            if own.seconds <= 0:
                break
        else:
            if not (answer.steps and answer.errors):
                raise ExchangeError(f"{named}: no step of {kind.engine} came to an end within {budget:g} s: {answer.message}")
            motion = max(answer.errors["position"], answer.errors["angle"])
            step, gap = until / answer.steps, answer.errors[LOOPS]
            return Tuning(kind.settings, kind.integrator, step, until, gap, motion, truth.told, truth.bar, OPEN, MOTION)
    raise ExchangeError(f"{named}: no step can be judged over {until:g} s, give one: {unknown}") from unknown
