"""Run an engine in a process of its own: the request to that process, and the checks of its answer.

All engines except the suite's own formulations run in a worker process. Its answer is checked in the parent process, whose code the
engine cannot change. The engine's process imports this file first. The file therefore imports no modules that are slow to import,
such as those that read linkages or keep journals, and a mechanism is sent as data.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gauss_bench.engines import SAFE, get
from gauss_bench.engines.base import Choice, Model, ask
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import LIMIT, interpreter_of, is_isolated, offer
from gauss_bench.runs.one_run import Asked, Outcome, Run, Sampling, ask_nothing, one_run, receive
from gauss_bench.runs.worker import Worker, WorkerFailure, get_worker
from gauss_bench.trajectory import Status, Trajectory, in_a_sentence

TEXT = 1 << 20  # bytes for the texts of an answer, besides its arrays
LEVELS = ("q", "v", "a")
BUILDING = 1800.0  # [s] to build a library: on a busy machine it takes ten times as long as on an idle one
Alteration = Callable[[Mechanism], Mechanism]


def leave_unaltered(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism itself: no fault is planted."""
    return mechanism


@dataclass(frozen=True, eq=False)
class Request:
    """A request for a run: the arguments of `one_run`, with the engine given by name.

    Attributes:
        linkage, scenario: names of the mechanism, under which a process keeps its model for later requests.
        engine, choice, wanted, ask, shortest: as in `one_run`; `ask` must be picklable.
        answers: largest number of elements of the array that `ask` returns.
        alter: function that plants a fault in the mechanism that the engine is given; the default changes nothing.
    """

    linkage: str
    scenario: str
    engine: str
    choice: Choice
    wanted: Sampling
    ask: Asked = ask_nothing
    shortest: float = 0.0
    answers: int = 0
    alter: Alteration = leave_unaltered

    def largest(self, n: int) -> int:
        """Return the largest size of an answer [bytes], with t, and q, v, a of n coordinates, at every sample."""
        return 8 * (len(self.wanted.times) * (1 + len(LEVELS) * n) + self.answers) + TEXT


def run_of(request: Request, mechanism: Mechanism, limit: float, worker: Worker | None = None, keep_model: bool = False) -> Run:
    """Carry out a requested run: one of the suite's own formulations in this process, any other engine in a worker process.

    Args:
        limit: time [s] after which a worker is stopped; waits for a processor do not count.
        worker: by default the one that is kept for the engine.
        keep_model: whether the process may keep its model for the next request.
    """
    if is_isolated(request.engine):
        return run_apart(request, mechanism, limit, worker or get_worker(request.engine), keep_model)
    return _run(request, mechanism, keep_model)


def run_apart(
    request: Request, mechanism: Mechanism, limit: float, worker: Worker, keep_model: bool = False, longest: float = math.inf
) -> Run:
    """Carry out a requested run in a worker; arguments are as in `run_of`.

    `longest` limits the elapsed time [s], with the time during which the worker waits for a processor.
    """
    try:
        process = worker.under(interpreter_of(request.engine))
        answer = process.call(perform_there, (request, mechanism, keep_model), limit, request.largest(mechanism.n), longest)
    except WorkerFailure as failure:
        return Run(failure.status, str(failure), None, None, request.wanted)
    return receive(outcome_of(answer), request.wanted, mechanism.n)


def perform_there(request: Request, mechanism: Mechanism, keep_model: bool) -> dict[str, Any]:
    """Carry out a request in the engine's process, and return the run as texts, numbers and arrays, which `outcome_of` reads."""
    run = _run(request, mechanism, keep_model)
    trajectory = run.samples  # of a failed run, the part before the failure
    fields = {"status": str(run.status), "message": run.message, "build_time": run.build_time, "seconds": run.seconds}
    answer = None if run.answer is None else np.asarray(run.answer, dtype=float)
    return fields | {"answer": answer, "trajectory": None if trajectory is None else asdict(trajectory)}


def _run(request: Request, mechanism: Mechanism, keep_model: bool) -> Run:
    """Carry out a request in this process.

    With `keep_model`, the model of a `resizable` engine (which accepts another step and tolerance) is kept for requests that differ
    only in step, tolerance or samples; one model is kept at a time.
    """
    engine, choice, mechanism = get(request.engine), request.choice, request.alter(mechanism)
    # all parts of the request on which the model depends
    key: tuple[object, ...] = (request.linkage, request.scenario, mechanism.sha256, request.alter)
    key += (request.engine, choice.settings, choice.integrator, choice.stabilization)

    def build(mechanism: Mechanism, choice: Choice) -> Model:
        """Return the kept model, set to the choice of this run; build a new one if the kept model has another `key`."""
        if key not in _kept:
            _kept.clear()
            _kept[key] = engine.build(mechanism, choice)
        model: Any = _kept[key]
        model.choice = choice  # an attribute that models of resizable engines have
        return model  # type: ignore[no-any-return]

    keeps = keep_model and ask(engine, "resizable")
    run = one_run(engine, mechanism, choice, request.wanted, request.ask, request.shortest, build if keeps else None)
    if keeps and run.status is not Status.OK:  # a model may be unusable after a failure
        _kept.clear()
    return run


_kept: dict[tuple[object, ...], Model] = {}  # the one model that this process keeps


def outcome_of(answer: object) -> Outcome:
    """Return the outcome that a worker's answer describes; its status is ERROR if the answer is not valid."""
    match answer:
        case {"status": str(status), "message": str(message), **rest} if status in tuple(Status):
            numbers = rest.get("answer")
            answered = numbers if isinstance(numbers, np.ndarray) else None
            times = (rest.get(key) for key in ("build_time", "seconds"))
            built, seconds = (float(x) if isinstance(x, (int, float)) and x >= 0 else math.nan for x in times)
            return Outcome(Status(status), in_a_sentence(message), _trajectory(rest.get("trajectory")), answered, built, seconds)
    return Outcome(Status.ERROR, "the answer of the engine's process is no run")


def _trajectory(x: object) -> Trajectory | None:
    """Return a value of an answer as a trajectory, or None if it is not one."""
    match x:
        case {"steps": int() | None as steps, "evaluations": int() | None as evaluations, "note": str(note), **arrays}:
            samples = [y for key in ("t", *LEVELS) if isinstance(y := arrays.get(key), np.ndarray)]
            if len(samples) == 1 + len(LEVELS):
                return Trajectory(samples[0], samples[1], samples[2], samples[3], steps, evaluations, note)
    return None


def build_first(engine: str, settings: Iterable[str], told: Callable[[str], object]) -> None:
    """Build the compiled code that settings of an engine need, if it is missing; `told` is called with sentences of progress.

    The code is built in a worker, which ends its compilers when its parent process dies. A failure is told and not raised, because
    the run that needs the code fails with its own message.
    """
    if "build_once" not in offer(engine).methods:
        return
    with Worker() as worker:
        try:
            if library := find_unbuilt(engine, settings, worker):
                told(f"building {library}")
                # `under` selects the engine's Python interpreter
                worker.under(interpreter_of(engine)).call(build_there, (engine,), BUILDING)
        except WorkerFailure as failure:
            told(f"the code was not built: {failure}")


def find_unbuilt(engine: str, settings: Iterable[str], worker: Worker) -> str:
    """Return the name of code that settings of an engine need and that must still be compiled, or an empty text.

    Adapters in this package are asked in this process, plug-ins in the worker process.

    Raises:
        WorkerFailure: a plug-in gave no answer.
    """
    asked = (engine, list(settings))
    if engine in SAFE:
        return find_unbuilt_there(*asked)
    return in_a_sentence(worker.under(interpreter_of(engine)).call(find_unbuilt_there, asked, LIMIT))


def find_unbuilt_there(engine: str, settings: list[str]) -> str:
    """Return the same name as `find_unbuilt`, by calling the engine's method in this process."""
    names = [ask(get(engine), "unbuilt")(x) for x in settings]
    return next((x for x in names if x), "")


def build_there(engine: str) -> None:
    """Build the libraries of an engine in this process."""
    ask(get(engine), "build_once")()
