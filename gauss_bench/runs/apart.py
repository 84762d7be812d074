"""A run in a process of its own: the request to the engine's process, and the checks on its answer.

Everything but the suite's own formulations runs apart. The answer holds samples and sentences; they are checked on this side of the
pipe, by code that the engine's process cannot reach. That process imports this file before anything else, so this file avoids
modules that read linkages or keep journals, which import slowly; a mechanism is sent as data.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gauss_bench.engines import FOREIGN, get
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.offers import is_isolated
from gauss_bench.runs.one_run import Asked, Outcome, Run, Sampling, nothing, one_run, receive
from gauss_bench.runs.worker import Worker, WorkerFailure, keep
from gauss_bench.trajectory import Status, Trajectory, in_a_sentence

TEXT = 1 << 20  # bytes that sentences and names may take beside the samples
LEVELS = ("q", "v", "a")
BUILDING = 1800.0  # [s] to build a library: on a busy machine it takes ten times as long as on an idle one
Alteration = Callable[[Mechanism], Mechanism]


def is_unaltered(mechanism: Mechanism) -> Mechanism:
    return mechanism


@dataclass(frozen=True, eq=False)
class Request:
    """A run of an engine by name, as `one_run` takes it.

    Attributes:
        linkage, scenario: of the mechanism, by which the engine's process knows one that it has had before.
        engine, choice, wanted, ask, shortest: as in `one_run`; `ask` is a function that can be found by its name.
        answers: numbers that the answer to `ask` has at most.
        alter: a fault that is planted in what the engine is given.
    """

    linkage: str
    scenario: str
    engine: str
    choice: Choice
    wanted: Sampling
    ask: Asked = nothing
    shortest: float = 0.0
    answers: int = 0
    alter: Alteration = is_unaltered

    def largest(self, n: int) -> int:
        """Return the size of an answer [bytes]: t, and q, v, a of n coordinates at every sample."""
        return 8 * (len(self.wanted.times) * (1 + len(LEVELS) * n) + self.answers) + TEXT


def run_of(request: Request, mechanism: Mechanism, limit: float, worker: Worker | None = None, again: bool = False) -> Run:
    """Carry out a requested run: own formulations in this process, everything else in a worker.

    Args:
        mechanism: that the request names, as read in this process.
        limit: [s] after which a worker is stopped.
        worker: to use; the one that is kept for the engine where not given.
        again: whether the process may keep the model for the next request.
    """
    if is_isolated(request.engine):
        return run_apart(request, mechanism, limit, worker or keep(request.engine), again)
    altered = request.alter(mechanism)
    return _run_again(request, altered) if again else _run(request, get(request.engine), altered)


def run_apart(
    request: Request, mechanism: Mechanism, limit: float, worker: Worker, again: bool = False, longest: float = math.inf
) -> Run:
    """Carry out a requested run in a worker, and stop it after `limit` [s] without the waits for a processor.

    It is also stopped after `longest` seconds of elapsed time.

    `again` says that the worker may keep the model for the next request: then the run has no build time.
    """
    try:
        answer = worker.call(
            perform_again if again else perform_there, (request, mechanism), limit, request.largest(mechanism.n), longest
        )
    except WorkerFailure as failure:
        return Run(failure.status, str(failure), None, None, request.wanted)
    return receive(outcome_of(answer), request.wanted, mechanism.n)


def perform_there(request: Request, mechanism: Mechanism) -> dict[str, Any]:
    """Run in the engine's process and return plain data; anything that is no sample is left out."""
    return plain_run(_run(request, get(request.engine), request.alter(mechanism)))


def perform_again(request: Request, mechanism: Mechanism) -> dict[str, Any]:
    """As `perform_there`, with the model of the last request if the two differ only in step, tolerance and samples."""
    return plain_run(_run_again(request, request.alter(mechanism)))


def _run_again(request: Request, mechanism: Mechanism) -> Run:
    engine = get(request.engine)
    if not getattr(engine, "resizable", False):
        return _run(request, engine, mechanism)
    choice = request.choice
    place = request.linkage, request.scenario, mechanism.sha256, request.alter
    key = (*place, request.engine, choice.settings, choice.integrator, choice.stabilization)
    if _again.key != key:
        _again.key, _again.model = key, None
    run = _run(request, _Keeping(engine), mechanism)
    if run.status is not Status.OK:
        _again.model = None
    return run


def _run(request: Request, engine: Any, mechanism: Mechanism) -> Run:
    return one_run(engine, mechanism, request.choice, request.wanted, request.ask, request.shortest)


class _Again:
    """The model that this process keeps."""

    key: tuple[Any, ...] = ()
    model: Any = None


_again = _Again()


class _Keeping:
    """An engine that builds a model once and gives it another step and tolerance from then on."""

    def __init__(self, engine: Any):
        self.engine = engine

    def __getattr__(self, name: str) -> Any:
        return getattr(self.engine, name)

    def build(self, mechanism: Mechanism, choice: Choice) -> Any:
        if _again.model is None:
            _again.model = self.engine.build(mechanism, choice)
        _again.model.choice = choice
        return _again.model


def plain_run(run: Run) -> dict[str, Any]:
    """Return a run as plain data, as `outcome_of` takes it."""
    trajectory = run.trajectory or run.reached
    told = {"status": str(run.status), "message": run.message, "build_time": run.build_time, "seconds": run.seconds}
    answer = None if run.answer is None else np.asarray(run.answer, dtype=float)
    return told | {"answer": answer, "trajectory": None if trajectory is None else asdict(trajectory)}


def outcome_of(answer: object) -> Outcome:
    """Read numbers and sentences from a worker's answer; anything else makes the run an error."""
    match answer:
        case {"status": str(status), "message": str(message), **rest} if status in tuple(Status):
            told = rest.get("answer")
            said = told if isinstance(told, np.ndarray) else None
            built, seconds = (_seconds(rest.get(key)) for key in ("build_time", "seconds"))
            return Outcome(Status(status), in_a_sentence(message), _trajectory(rest.get("trajectory")), said, built, seconds)
    return Outcome(Status.ERROR, "what the engine's process answered is no run")


def _seconds(x: object) -> float:
    return float(x) if isinstance(x, (int, float)) and x >= 0 else float("nan")


def _trajectory(x: object) -> Trajectory | None:
    match x:
        case {"steps": int(steps), "evaluations": int() | None as evaluations, "note": str(note), **arrays}:
            samples = [y for key in ("t", *LEVELS) if isinstance(y := arrays.get(key), np.ndarray)]
            if len(samples) == 1 + len(LEVELS):
                return Trajectory(samples[0], samples[1], samples[2], samples[3], steps, evaluations, note)
    return None


def build_first(engine: str, settings: Iterable[str], told: Callable[[str], object]) -> None:
    """Build what an engine needs for any of its settings and is not there yet, once for a user, before it is run or searched.

    It is built in a worker, which ends its compilers when its parent dies. A failure here is ignored: the engine reports it again.
    """
    if engine not in FOREIGN or not hasattr(get(engine), "build_once"):
        return
    what = next(filter(None, map(get(engine).unbuilt, settings)), "")  # type: ignore[attr-defined]
    if not what:
        return
    told(f"building {what}")
    with Worker() as worker:
        try:
            worker.call(build_there, (engine,), BUILDING)
        except WorkerFailure as failure:
            told(f"it was not built: {failure}")


def build_there(engine: str) -> None:
    get(engine).build_once()  # type: ignore[attr-defined]
