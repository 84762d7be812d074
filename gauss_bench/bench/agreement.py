"""Checks of an engine's numbers: accelerations at given states, and runs against the motion that they should follow.

Accelerations are compared with those of the suite's own equations (`probes`), under every setting, integrator and variant. A run is
compared with the suite's own motion or, under a setting that the engine declares `soft` (compliant constraints close the loops),
with the motion that follows from the engine's own accelerations, which are compared first. The allowed error of a run is a multiple
of the change when the step is halved or the tolerance is tightened. A variant that is declared `unfinished` is known to be wrong:
its accelerations are not checked, and an error of its motion does not count as a failed check.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from gauss_bench.bench.probes import AS_IT_IS, EVERYTHING, PROBE, Probe, changes, probe
from gauss_bench.bench.subject import DURATION, ONE_STEP, PLAIN, Check, Subject
from gauss_bench.engines.base import Choice
from gauss_bench.engines.variants import MIN_REASON_LENGTH
from gauss_bench.integrate.fixed_step import dop853_tableau
from gauss_bench.linkage.load import document_of
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.metrics import drift
from gauss_bench.reference.build import absolute_motion
from gauss_bench.runs.one_run import Run, ask_nothing
from gauss_bench.runs.questions import SUBSTEPS, ForceQuestion, accelerations, follow_accelerations
from gauss_bench.suites.read import FOLDER
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory

EXACT = 1e-9  # allowed error relative to the largest acceleration: rounding leaves 1e-12, Pinocchio's articulated bodies 1e-10
ALONG = 1e-8  # allowed N^T (M a - Q) relative to N^T Q: MuJoCo's solver leaves 1e-9 if it ends by its own tolerance
SINGLE = (1e-8, 1e-5)  # range of relative errors in single precision, whose rounding error is 6e-8
LEAST_GAMMA = 0.5  # least fraction of gamma in a row of J a: 1.0000 with MuJoCo's softest closures, 0 without the velocity term
LOOSE = 0.05  # allowed gap relative to the linkage's size: MuJoCo's loops open by 0.01, while open trees fall by 0.1
RATIO = 3.0  # allowed error relative to the change by half the step: 2 for a method of order one, less for higher orders
ROUNDING = 1e-9  # added to the allowed error, relative to the largest displacement, velocity or acceleration
GAVE_UP = (Status.NOT_CONVERGED, Status.WARNING, Status.DIVERGED)  # statuses of a run whose solver gave up
COARSE, TIGHT = 1e-6, 1e-8  # tolerances of integrators that choose their steps
TIMES = np.linspace(0.0, DURATION, 21)  # [s] samples of a run
STIFF = 40  # steps between two samples if SUBSTEPS are too few: steps of 1/8 ms resolve vibrations with a period of 1 ms
LEVELS = ("positions", "velocities", "accelerations")
KINDS = str(FOLDER / "linkages" / "kinds.toml")  # slides on moving links, three degrees of freedom, every kind of driver
LINKAGES = (  # linkages and scenarios, moved by loads and by drivers; parallelogram has redundant rows
    *((PROBE, x) for x in ("loaded", "driven")),
    *((KINDS, x) for x in ("loaded", "driven")),
    *(("parallelogram", x) for x in ("torque", "cycloid")),
    *PLAIN,
)


def check_declarations(subject: Subject) -> Iterator[Check]:
    """Check that the settings and variants that an engine declares `soft` or `unfinished` exist, and that each has a cause."""
    offer = subject.offer
    faults = []
    for word, declared in (("soft", offer.soft), ("unfinished", offer.unfinished)):
        for label, cause in declared.items():
            if label not in (*offer.settings, *offer.variants):
                faults.append(f"there are no settings and no variant {label!r}")
            if len(cause) < MIN_REASON_LENGTH:
                faults.append(f"{label}: {word} without a cause")
            if word == "unfinished" and label in offer.settings:
                faults.append(f"{label}: only variants may be declared unfinished")
    causes = dict.fromkeys((*offer.soft.values(), *offer.unfinished.values()))
    yield Check("every declared inexactness has a cause", not faults, "; ".join(faults or causes))


@dataclass(frozen=True)
class Answer:
    """The accelerations of an engine at the states of a probe, compared with the suite's own accelerations.

    Attributes:
        off: largest error of the accelerations, relative to a state's largest acceleration; NaN if the engine gave none.
        along: |N^T (M a - Q)| relative to |N^T Q|, where the columns of N are the motions that the constraints leave free: the
            error of the equations of motion without the constraint forces; NaN if the engine gave no accelerations.
        gamma: smallest fraction of gamma that a row of J a contains; the constraints require J a = gamma.
        refused: the reason why the engine cannot model the linkage, or an empty text.
        wrong: the reason why the engine gave no accelerations, or an empty text.
        given: the engine's accelerations (k, n), or None.
    """

    off: float = float("nan")
    along: float = float("nan")
    gamma: float = 1.0
    refused: str = ""
    wrong: str = ""
    given: Array | None = None

    def fault(self, soft: bool) -> str:
        """Return the fault of the accelerations as a sentence, or "" if there is none or the engine refuses the linkage.

        Accelerations of `soft` loops must be right only along the free directions N.
        """
        if self.wrong or self.refused:
            return self.wrong
        if not self.along <= ALONG:  # `not <=` instead of `>`, here and below: NaN is a fault too
            cause = explain_size(self.along) or "soft loops do not explain this; a mass, force or row of J is wrong"
            return f"N^T (M a - Q) is {self.along:.1e} of N^T Q: {cause}"
        if not self.gamma >= LEAST_GAMMA:
            share = round(self.gamma, 2) + 0.0  # no negative zero
            return f"J a is {share:.2f} of gamma: the velocity term dJ/dt v of the constraints is missing or wrong"
        if not soft and not self.off <= EXACT:
            return ": ".join(filter(None, (f"accelerations are off by {self.off:.1e} of the largest", explain_size(self.off))))
        return ""


def explain_size(error: float) -> str:
    """Return a sentence if a relative error is as large as in single precision, else an empty text."""
    least, most = SINGLE
    if not least < error <= most:
        return ""
    return "as large as the rounding of single precision (float32); in double precision a number is wrong"


def ask(subject: Subject, choice: Choice, known: Probe) -> Answer:
    """Ask an engine for its accelerations at the states of a probe, and return their errors, or why it gives none."""
    question = partial(accelerations, known.t, known.q, known.v)
    run = subject.perform(known.mechanism, choice, ONE_STEP, question, known.a.size)
    if is_excusable(subject, choice, run, known.mechanism):
        return Answer(refused=run.message)
    if run.status is not Status.OK:
        return Answer(wrong=run.message)
    a = np.asarray(run.answer, dtype=float)
    if a.shape != known.a.shape:
        return Answer(wrong=f"accelerations have the shape {a.shape}, not {known.a.shape}")
    return Answer(off=known.error(a), along=known.residual_along_free(a), gamma=known.share_of_gamma(a), given=a)


def is_excusable(subject: Subject, choice: Choice, run: Run, mechanism: Mechanism) -> bool:
    """Tell whether a run failed for a reason that is not a fault of the engine.

    The engine may refuse the linkage or its redundant rows, and the time for all checks may be used up. The solver may give up with
    a variant, which only searches try, but not with a setting, which users choose.
    """
    redundant = run.status is Status.RANK_LOST and mechanism.redundant > 0
    return run.status is Status.SKIP or redundant or (choice.settings in subject.offer.variants and run.status in GAVE_UP)


def _check_failed(subject: Subject, choice: Choice, run: Run, mechanism: Mechanism, title: str) -> Check:
    """Return the check of a run that gave no trajectory: not made (None) if the failure `is_excusable`, else failed."""
    return Check(title, None if is_excusable(subject, choice, run, mechanism) else False, run.message)


def name_choice(choice: Choice) -> str:
    """Return the names of the settings, the integrator and the stabilisation of a choice, as a text."""
    return ", ".join((choice.settings, choice.integrator, choice.stabilization))


def digits(error: float) -> str:
    """Return how many decimal digits a relative error leaves correct, from 0 to 16, as a text such as "9.0 digits"."""
    return f"{max(0.0, -np.log10(max(error, 1e-16))):.1f} digits"


def check_accelerations(subject: Subject) -> Iterator[Check]:
    """Check accelerations at given states: every linkage with each setting, and one linkage with every integrator and variant."""
    offer = subject.offer
    for choice in subject.choices():
        title = f"accelerations ({name_choice(choice)})"
        if cause := offer.unfinished.get(choice.settings):
            yield Check(title, None, f"declared unfinished: {cause}")  # None: neither passed nor failed
            continue
        subject.tell(f"Accelerations under {name_choice(choice)}.")
        probes = [probe(*subject.accepted[0])]  # the first linkage that the engine accepts
        if choice.integrator == offer.integrators[0] and choice.settings in offer.settings:
            # settings with the default integrator: all linkages, and the first accepted one with all its numbers changed
            probes = [*(probe(*x) for x in LINKAGES), probe(*subject.accepted[0], EVERYTHING)]
        answers = {}
        for known in probes:
            name = f"{known.mechanism.name} {known.mechanism.scenario}"
            answers[name if known.change == AS_IT_IS else f"{name}, {known.change}"] = ask(subject, choice, known)
        yield _combine(title, answers, choice.settings in offer.soft)


def _combine(title: str, answers: dict[str, Answer], soft: bool) -> Check:
    """Combine an engine's answers (name of the probe -> answer) into one check.

    The message quotes the worst fault and lists the probes with a fault or, without a fault, says how many digits agree, at how
    many states, and which linkages the engine refused. Accelerations of `soft` loops must be right only along the free directions.
    """
    modelled = {name: x for name, x in answers.items() if not x.refused}
    if not modelled:
        return Check(title, None, next(iter(answers.values())).refused)
    faults = {name: fault for name, x in modelled.items() if (fault := x.fault(soft))}
    if faults:
        worst = max(faults, key=lambda name: np.nan_to_num(modelled[name].off, nan=np.inf))  # no accelerations: worst of all
        others = f"; it shows on {len(faults)} of {len(modelled)}: {_list_few(list(faults))}"
        return Check(title, False, f"{faults[worst]} ({worst}){others}")
    message = f"agree to {digits(max(x.off for x in modelled.values()))}"
    if soft:  # errors `off` of whole accelerations are reported without a limit; those along free directions (`along`) have one
        message += f", those along free directions to {digits(max(x.along for x in modelled.values()))},"
    count = sum(len(x.given) for x in modelled.values() if x.given is not None)
    message += f" at {count} states of {len(modelled)} linkage{'s' * (len(modelled) > 1)}"
    refused = [name for name, x in answers.items() if x.refused]
    return Check(title, True, message + (f"; refused or not asked: {_list_few(refused)}" if refused else ""))


def _list_few(names: list[str]) -> str:
    """Return the first three names and the number of the others as a text, such as "a, b, c and 2 more"."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def check_changed_numbers(subject: Subject) -> Iterator[Check]:
    """Check accelerations on linkages with changed numbers: each number alone, all numbers of one kind, and all numbers."""
    soft = subject.usual.settings in subject.offer.soft
    for linkage, scenario in subject.accepted:
        names = [x for x in changes(linkage, scenario) if x != AS_IT_IS]  # AS_IT_IS names the linkage without a change
        answers = {name: ask(subject, subject.usual, probe(linkage, scenario, name)) for name in names}
        yield _combine(f"accelerations follow every number ({probe(linkage, scenario).mechanism.name})", answers, soft)


def check_forces(subject: Subject) -> Iterator[Check]:
    """Check that every kind of force acts as defined: first all forces together and, if that fails, each force alone."""
    soft = subject.usual.settings in subject.offer.soft
    answer = ask(subject, subject.usual, probe(KINDS, "loaded"))
    together = _combine("every kind of force acts as defined", {"kinds": answer}, soft)
    yield together
    bare = probe(KINDS, "loaded", forces=())  # without any force, to find the effect of a single force
    unloaded = Answer() if together.passed else ask(subject, subject.usual, bare)
    if together.passed or unloaded.refused:
        return
    document = document_of(KINDS)[0]
    for name in document["scenarios"]["loaded"]["forces"]:
        single = probe(KINDS, "loaded", forces=(name,))
        answer = ask(subject, subject.usual, single)
        check = _combine(f"a {document['forces'][name]['type']} acts as defined ({name})", {"kinds": answer}, soft)
        if check.passed is False and answer.given is not None and unloaded.given is not None:
            # the effect of a force is the difference of accelerations with it and without it
            check = replace(check, message=effect((answer.given - unloaded.given).ravel(), (single.a - bare.a).ravel()))
        yield check


def effect(measured: Array, true: Array) -> str:
    """Return the fault of a force in words, given its measured and its true effect on the accelerations (n,)."""
    factor = float(measured @ true / (true @ true))  # least squares for measured = factor * true
    if np.abs(measured).max() <= 1e-6 * np.abs(true).max():  # rounding errors of the two accelerations
        return "it has no effect"
    if np.abs(measured + true).max() <= 0.5 * np.abs(true).max():  # measured is nearer to -true than to 0
        return "it acts in the opposite direction"
    return f"its effect is {factor:.6g} times what it should be, along the right direction"


def check_joint_forces(subject: Subject) -> Iterator[Check]:
    """Check that the joint forces that the engine reports are those that Newton's laws give for the true accelerations."""
    title = "joint forces follow from the accelerations"
    if subject.usual.settings in subject.offer.soft:
        yield Check(title, None, "declared soft: its joints exert other forces")
        return
    agreed = ""  # the digits for the last linkage for which the engine reports joint forces
    for linkage, scenario in (subject.accepted[0], *PLAIN):
        known = probe(linkage, scenario)
        question = ForceQuestion(known.mechanism, Trajectory(known.t, known.q, known.v, known.a, None))
        run = subject.perform(known.mechanism, subject.usual, ONE_STEP, question.ask, question.answers)
        if run.trajectory is None:
            yield _check_failed(subject, subject.usual, run, known.mechanism, title)
            return
        error, largest = question.compare(run.answer)  # both are NaN if the engine reports no forces
        if error > EXACT * largest:
            off = f"they are off by {error:.1e} (N, N m), where the largest is {largest:.1e}"
            yield Check(title, False, f"{off} ({known.mechanism.name})")
            return
        if not np.isnan(error):
            agreed = f"agree to {digits(error / largest)}"
    yield Check(title, True if agreed else None, agreed or "it reports none")


def check_motions(subject: Subject) -> Iterator[Check]:
    """Check that runs with each integrator, settings label, stabilisation and variant follow the equations of motion."""
    usual, offer = subject.usual, subject.offer
    for choice in subject.choices():
        yield _follow(subject, choice, *subject.accepted[0])
    for linkage, scenario in ((PROBE, "driven"), ("parallelogram", "torque")):
        yield _follow(subject, usual, linkage, scenario)
    for name in (x for x in offer.stabilizations if x != usual.stabilization):
        for integrator in offer.integrators:  # the first one that can be combined with the stabilisation
            check = _follow(subject, replace(usual, stabilization=name, integrator=integrator), *subject.accepted[0])
            if check.passed is not None:
                break
        yield check


def _follow(subject: Subject, choice: Choice, linkage: str, scenario: str) -> Check:
    """Check a run with one setting, and its repetitions with shorter steps, against the motion that they should follow.

    The springs that close the loops of a soft setting may vibrate fast. If such a run differs from the motion that is integrated
    with SUBSTEPS steps per sample, it is compared with the motion that is integrated with STIFF steps per sample.
    """
    check = _follow_motion(subject, choice, linkage, scenario, SUBSTEPS)
    if check.passed is False and choice.settings in subject.offer.soft:
        return _follow_motion(subject, choice, linkage, scenario, STIFF)
    return check


def _follow_motion(subject: Subject, choice: Choice, linkage: str, scenario: str, finer: int) -> Check:
    """Compare a run and its repetitions with the motion that they should follow, and return the check.

    The expected motion is the suite's own or, for a soft setting, is integrated from the engine's own accelerations with `finer`
    steps between two samples. The check is not made (None) if a failure is excusable, if a soft setting is combined with a
    stabilisation, or if a variant with a wrong motion is declared unfinished.
    """
    subject.tell(f"A run under {name_choice(choice)}.")
    mechanism = probe(linkage, scenario).mechanism
    title = f"a run ({name_choice(choice)}; {mechanism.name} {scenario})"
    unfinished = choice.settings in subject.offer.unfinished
    soft = choice.settings in subject.offer.soft and not unfinished
    motion = partial(follow_accelerations, dop853_tableau(), TIMES, mechanism.q0, mechanism.v0, finer=finer)
    answers = len(LEVELS) * len(TIMES) * mechanism.n  # number of elements of the motion in the engine's answer
    runs, samples = [], []  # `samples` has the positions, velocities and accelerations (3, k, n) of each run
    for tried in _from_coarse_to_fine(choice, choice.integrator in subject.offer.adaptive):
        run = subject.perform(mechanism, tried, TIMES, motion if soft else ask_nothing, answers, keep=True)
        if run.trajectory is None:
            return _check_failed(subject, choice, run, mechanism, title)
        runs.append(run)
        samples.append(np.array([run.trajectory.q, run.trajectory.v, run.trajectory.a]))
    if soft and (fault := find_loose(mechanism, runs[0].complete())):
        return Check(title, False, fault)
    if soft and choice.stabilization != "none":
        return Check(title, None, "it runs; the motion of soft loops with a stabilisation is not known")
    distance = ""
    for run, given in zip(runs[:-1], samples[:-1], strict=True):
        expected = np.asarray(run.answer, dtype=float) if soft else _true_motion(linkage, scenario)
        if expected.shape != given.shape:
            return Check(title, False, "its accelerations cannot be integrated")
        # accelerations of a soft loop are its gap times a stiffness, and are not compared
        distance, fault = _compare(expected, given, samples[-1], LEVELS[: 2 if soft else 3])
        if fault:
            return Check(title, None, f"{fault}, declared unfinished") if unfinished else Check(title, False, fault)
    return Check(title, True, distance)


def find_loose(mechanism: Mechanism, trajectory: Trajectory) -> str:
    """Return a sentence if the loops of a run open by more than LOOSE times the linkage's size, else an empty text.

    Loops that are closed by springs open less.
    """
    opened = float(drift(Evaluator(mechanism), trajectory).position.max())
    return f"the loops open by {opened:.2g} (m, rad): nothing holds them" if opened > LOOSE * mechanism.size else ""


def _from_coarse_to_fine(choice: Choice, adaptive: bool) -> list[Choice]:
    """Return the choices with which a run is made and repeated; the last has the shortest step or tightest tolerance."""
    if adaptive:
        return [replace(choice, tolerance=COARSE), choice, replace(choice, tolerance=TIGHT)]
    return [choice, replace(choice, step=choice.step / 2)]


def _compare(expected: Array, given: Array, finest: Array, names: tuple[str, ...]) -> tuple[str, str]:
    """Compare a run with the expected motion; return (sentence on the agreement, "") or ("", sentence on the fault).

    All motions, including `finest`, the run's finest repetition, are positions, velocities and accelerations (3, k, n); those in
    `names` are compared. An error is a fault if it exceeds RATIO times the change between the run and its finest repetition.
    """
    travel = np.array([expected[0] - expected[0, 0], expected[1], expected[2]])  # displacements from the start instead of positions
    scale = np.abs(travel).max(axis=(1, 2))
    off, changed = (np.abs(given - x).max(axis=(1, 2)) / scale for x in (expected, finest))  # (3,)
    for name, error, change in zip(names, off, changed, strict=False):  # `names` lacks accelerations if loops are soft
        if not error <= RATIO * change + ROUNDING:
            return "", f"{name} are off by {error:.1e} of their largest value; a finer run changes them by {change:.1e}"
    return f"positions agree within {off[0]:.1e} of the largest displacement; a finer run changes them by {changed[0]:.1e}", ""


@lru_cache(maxsize=16)
def _true_motion(linkage: str, scenario: str) -> Array:
    """Return the suite's own motion at TIMES: positions, velocities and accelerations (3, k, n)."""
    return np.array(absolute_motion(probe(linkage, scenario).mechanism, TIMES))


MEASURED = (check_declarations, check_forces, check_accelerations, check_joint_forces, check_motions, check_changed_numbers)
