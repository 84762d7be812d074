"""Run all computations ("questions") of the comparison with one release, in a worker of the release's environment.

The result of one computation is a `Figure`.
"""

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.bench.measure import mechanism_of
from gauss_bench.mechanism.evaluate import evaluator_of
from gauss_bench.metrics import drift, state_errors
from gauss_bench.releases.cases import FIRST, SAMPLES, SHIFTS, STATES, STEP, Case, list_cases, states_of, truth_of
from gauss_bench.releases.compare import CLOSURE, DEFAULT, STEPS, Figure, relative_difference
from gauss_bench.releases.environments import Release
from gauss_bench.releases.library import Library
from gauss_bench.releases.probes import states_of_probe
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import Offer, interpreter_of, offer
from gauss_bench.runs.one_run import Run, ask_nothing, sampling_at
from gauss_bench.runs.questions import accelerations, call_by_name, describe_python, shift_start
from gauss_bench.runs.worker import Worker, WorkerFailure, get_worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

MOVING, RESTING, MOTION, DRIFT = "accelerations in motion", "accelerations at rest", "motion over 1 s", "gaps of loops after 1 s"
LIMIT = 20.0  # [s] time limit of one question
BUDGET = 90.0  # [s] default time limit for all questions to one release together
LONGEST = 160  # largest number of characters of a message
FOLDERS = re.compile(r"(/[\w.+-]+)+/(?=[\w.+-]+)")  # the folders of a path, which differ between machines
CASES = "release_cases"  # module of an engine's folder that builds probes and reads defaults


@dataclass(frozen=True)
class Answers:
    """The results that one release of an engine's library computed.

    Attributes:
        version: number of the release; library: name and version that the library reports.
        python, numpy: versions in the environment of the release.
        how: text that says whether the hash of the release's file was checked.
        figures: the results, one for each question; empty if the release cannot be used.
        left_out: number of cases (a linkage with a setting) that were not run within the time budget.
        status, message: "ok", or the kind of failure; and why there are no results.
    """

    version: str
    library: str = ""
    python: str = ""
    numpy: str = ""
    how: str = ""
    figures: tuple[Figure, ...] = ()
    left_out: int = 0
    status: str = str(Status.OK)
    message: str = ""

    @property
    def usable(self) -> bool:
        """Whether the release gave results."""
        return self.status == Status.OK


def ask_release(library: Library, release: Release, budget: float, told: Callable[[str], None]) -> Answers:
    """Run all computations with an installed release, and return its results, or the reason why the release cannot be used.

    No case is begun later than `budget` [s]. `told` is called with each sentence of progress.
    """
    begin = time.monotonic()
    answers = Answers(release.version, how=release.how)
    offered = offer(release.name)
    get_worker(release.name).stop()  # the process that described the engine is no longer needed
    if not offered.usable:
        return replace(answers, status=str(offered.status), message=offered.reason)
    with Worker() as worker:
        try:
            versions = worker.under(interpreter_of(release.name)).call(describe_python, (), LIMIT)
        except WorkerFailure as failure:
            return replace(answers, status=str(failure.status), message=str(failure))
        figures = [*ask_defaults(library, worker), *map(shorten, ask_closures(library, worker))]
        cases, left_out = list_cases(offered), 0
        for number, case in enumerate(cases):
            if time.monotonic() - begin > budget:
                left_out = len(cases) - number
                break
            if number % 10 == 0:
                told(f"{library.engine} {release.version}: case {number + 1} of {len(cases)}")
            figures += map(shorten, ask_case(release.name, offered, case, worker))
    answers = replace(answers, library=offered.version, **versions, figures=tuple(figures), left_out=left_out)
    return distrust(answers)  # removes all figures of a release that computed nothing


def shorten(figure: Figure) -> Figure:
    """Return a figure whose message is cut to LONGEST characters and names no folder of this machine."""
    message = FOLDERS.sub("", figure.message)
    return replace(figure, message=message if len(message) <= LONGEST else f"{message[: LONGEST - 3]}...")


def distrust(answers: Answers) -> Answers:
    """Return the answers of a release, without figures if nothing was computed or the adapter rejects the model in every case.

    This happens, for example, if numpy reads the library's arrays wrongly.
    """
    computed = [x for x in answers.figures if x.quantity != DEFAULT]
    by_adapter = [x for x in computed if x.quantity in (MOVING, RESTING) and x.status != Status.SKIP]
    is_accepted = any(x.status == Status.OK for x in by_adapter) or not by_adapter
    if is_accepted and any(x.status == Status.OK for x in computed):
        return answers
    reasons = [x.message for x in by_adapter or computed if x.message]
    message = f"every case fails: {reasons[0] if reasons else 'none was asked'}"
    return replace(answers, figures=(), status=str(Status.ERROR), message=message)


def ask_case(name: str, offered: Offer, case: Case, worker: Worker) -> Iterator[Figure]:
    """Run the engine `name` of a release on a linkage with one setting, and yield the results.

    They are the accelerations at states in motion and at rest, and on the linkage FIRST also the results of `read_motion`. If a
    computation failed, its figure has the status and the message of the run.
    """
    linkage, scenario, choice = case
    mechanism, states = mechanism_of(linkage, scenario), states_of(linkage, scenario)
    # on other linkages than FIRST the run is one step long, because only accelerations are read
    sampling = sampling_at(STEP, SAMPLES if linkage == FIRST else [0.0, STEP])
    ask = partial(accelerations, states.t, states.q, states.v)
    request = Request(mechanism.name, mechanism.scenario, name, choice, sampling, ask, answers=states.q.size)
    run = run_apart(request, mechanism, LIMIT, worker)
    setting = " ".join(x for x in (choice.settings, choice.integrator, choice.stabilization) if x != "none")
    names = mechanism.name, setting  # the fields `case` and `setting` of every figure
    if isinstance(run.answer, np.ndarray) and run.answer.shape == states.q.shape:
        yield from read_accelerations(*names, run.answer, states.a)
    else:
        for quantity in (MOVING, RESTING):
            yield Figure(quantity, *names, str(run.status), run.message)
    if linkage != FIRST:
        return
    if run.trajectory is None:
        yield Figure(MOTION, *names, str(run.status), run.message)
        return
    shifted = []  # runs from slightly changed starts, which show how much rounding alone changes the result
    for seed in range(SHIFTS):
        changed = replace(request, ask=ask_nothing, answers=0, alter=partial(shift_start, seed))
        shifted.append(run_apart(changed, mechanism, LIMIT, worker))
    yield from read_motion(case, names, run, [x for x in shifted if x.trajectory], choice.integrator in offered.adaptive)


def read_accelerations(case: str, setting: str, answer: Array, true: Array) -> Iterator[Figure]:
    """Yield two results: the accelerations at states in motion, and those at states at rest.

    Args:
        answer: (2 STATES (1 + SHIFTS), n) accelerations in the order of `states_of`: STATES in motion, STATES at rest, and then
            both groups again for each of the SHIFTS changed starts.
        true: (2 STATES, n) true accelerations, in motion and at rest.
    """
    groups = answer.reshape(1 + SHIFTS, 2, STATES, -1)  # axes: unchanged and changed starts; motion and rest; states; n
    for k, quantity in enumerate((MOVING, RESTING)):
        error = relative_difference(groups[0, k], true.reshape(2, STATES, -1)[k])
        yield Figure(quantity, case, setting, values=groups[0, k], shifted=groups[1:, k], error=error)


def read_motion(case: Case, names: tuple[str, str], run: Run, shifted: Sequence[Run], adaptive: bool) -> Iterator[Figure]:
    """Yield the results of a run: its motion, the gaps of loops at its end, and the number of steps that its integrator chose.

    Args:
        names: names of the linkage and the setting, for the keys of the results.
        shifted: the same run from slightly changed starts.
        adaptive: whether the integrator chooses its steps.
    """
    assert run.trajectory is not None
    linkage, scenario, _ = case
    mechanism, truth = mechanism_of(linkage, scenario), truth_of(linkage, scenario)
    shifted_motions = [x.trajectory for x in shifted if x.trajectory is not None]
    errors = state_errors(mechanism, run.trajectory, truth)
    error = float(max(errors.length.max(), errors.angle.max()))
    yield Figure(MOTION, *names, values=run.trajectory.q, shifted=np.array([x.q for x in shifted_motions]), error=error)
    last_gaps = [float(drift(evaluator_of(mechanism), x).position[-1]) for x in (run.trajectory, *shifted_motions)]
    gaps = [np.array([[gap, 1.0]]) for gap in last_gaps]  # the 1.0 makes differences relative to 1 m or 1 rad, not to a tiny gap
    yield Figure(DRIFT, *names, values=gaps[0], shifted=np.array(gaps[1:]), error=last_gaps[0])
    steps = [x.steps for x in (run.trajectory, *shifted_motions)]
    if adaptive and None not in steps:
        counts = [np.array([[x]], dtype=float) for x in steps]
        yield Figure(STEPS, *names, values=counts[0], shifted=np.array(counts[1:]))


def ask_defaults(library: Library, worker: Worker) -> Iterator[Figure]:
    """Yield one result for each option of the library, whose `text` is the default value of the option."""
    answer = call_engine_function(worker, f"{library.adapter_package}.{CASES}:defaults")
    if isinstance(answer, str):
        yield Figure(DEFAULT, "", "all", str(Status.ERROR), answer)
        return
    for name, value in answer.items():
        yield Figure(DEFAULT, "", str(name), text=str(value))


def ask_closures(library: Library, worker: Worker) -> Iterator[Figure]:
    """Yield the accelerations of probes, which are small models with one kind of loop closure each.

    In place of the results of a probe, or of all probes, a figure has the reason of a failure.
    """
    module = f"{library.adapter_package}.{CASES}"  # the engine's functions that build probes and compute their accelerations
    probes = call_engine_function(worker, f"{module}:list_probes")
    if isinstance(probes, str):
        yield Figure(CLOSURE, "", "all", str(Status.ERROR), probes)
        return
    for probe in probes:
        name, model = probe["name"], probe["model"]  # kind of closure, as the library names it, and its model
        states = states_of_probe(model)
        answer = call_engine_function(worker, f"{module}:ask_probe", name, states.q, states.v)
        if isinstance(answer, np.ndarray) and answer.shape == states.q.shape and np.isfinite(answer).all():
            for figure in read_accelerations(model, name, answer, states.a):
                yield replace(figure, quantity=f"{CLOSURE}, {figure.quantity}")
        else:
            message = answer if isinstance(answer, str) else "the answer is no array of finite accelerations"
            for quantity in (MOVING, RESTING):
                yield Figure(f"{CLOSURE}, {quantity}", model, name, str(Status.ERROR), message)


def call_engine_function(worker: Worker, address: str, *arguments: object) -> Any:
    """Call the function at `address` (MODULE:FUNCTION) in a worker process; return its result, or the reason of a failure as text.

    A text is always such a reason, because no function that is called here returns a text.
    """
    try:
        return worker.call(call_by_name, (address, *arguments), LIMIT)
    except WorkerFailure as failure:
        return str(failure)


def as_data(answers: Answers) -> dict[str, Any]:
    """Return answers as dictionaries, lists, numbers and texts, which a file of results (`Journal`) stores as JSON."""
    figures = [vars(x) | {"values": x.values.tolist(), "shifted": x.shifted.tolist()} for x in answers.figures]
    return {**vars(answers), "figures": figures}


def from_data(data: Mapping[str, Any]) -> Answers:
    """Return the answers of a release, given the dictionary that `as_data` made of them."""
    figures = []
    for x in data["figures"]:
        # an empty list has lost the number of axes of its array
        values, shifted = np.array(x["values"] or np.zeros((0, 0))), np.array(x["shifted"] or np.zeros((0, 0, 0)))
        figures.append(Figure(**x | {"values": values, "shifted": shifted}))
    return Answers(**{**data, "figures": tuple(figures)})
