"""The diagnosis of an engine on a linkage: the object that `gauss-bench diagnose --json` prints."""

import time
from dataclasses import dataclass, replace

import numpy as np

from gauss_bench.advice import truth as truths
from gauss_bench.api.simulate import OneRun, name_run
from gauss_bench.api.telling import Told, nobody
from gauss_bench.bench.ways import Run as WayRun
from gauss_bench.diagnosis.causes import Cause, Part
from gauss_bench.diagnosis.diagnosis import Ended, Numbers, Verdict, diagnose_runs, without_run
from gauss_bench.diagnosis.explanations import Explained
from gauss_bench.diagnosis.observations import checkpoints, ladder
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.reference.certificate import find_certified
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import ChoiceError, check_budget, check_size, duration, offer
from gauss_bench.runs.one_run import Run, Sampling
from gauss_bench.runs.worker import Worker
from gauss_bench.trajectory import Reference

BUDGET = 120.0  # [s] for everything
USUAL = 1.0  # [s] of motion by default: in longer runs errors grow until they no longer add up linearly
LEAST = 1.0  # [s] that every run may take, even after the deadline
KNOWN = {"position": 1e-9, "angle": 1e-9}  # [m], [rad] error bars that the reference must have: errors below 1e-6 are not diagnosed


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis(OneRun):
    """The diagnosis of one engine on one linkage; the fields of OneRun say what was asked for.

    Attributes:
        until: end of the run [s].
        cause: the dominant cause, a `diagnosis.causes.Cause`; part: the part of the error that it belongs to, or None.
        verdict: the diagnosis in one sentence.
        parts: [m, rad] how much of the error each part accounts for: model, constraint softness, integrator, drift, round-off and
            output sampling.
        numbers: `diagnosis.diagnosis.Numbers`, or None without a run.
        explanations: of wrong accelerations, the best first: cause, what, amount, share and a sentence.
        candidates: the explanations that reproduce the accelerations within their noise, each with its amount and residual.
        runs: status and message of each run.
        reference: how the reference was made.
    """

    until: float
    cause: Cause
    part: Part | None
    verdict: str
    parts: dict[Part, float]
    numbers: Numbers | None
    explanations: tuple[Explained, ...]
    candidates: tuple[Explained, ...]
    runs: tuple[Ended, ...]
    reference: str

    @property
    def succeeded(self) -> bool:
        return self.cause is not Cause.UNKNOWN


def diagnose(
    linkage: str,
    engine: str,
    scenario: str | None = None,
    settings: str | None = None,
    integrator: str | None = None,
    stabilization: str | None = None,
    step: float = 1e-3,
    until: float | None = None,
    budget: float | None = None,
    told: Told = nobody,
) -> Diagnosis:
    """Split an engine's error on a linkage (a built-in name or a file) by its causes, and name the one that dominates.

    The engine runs in a worker with the step asked for, half of it and a quarter of it (with finer tolerances if it chooses its own
    steps). "No dominant cause" means that the largest position error is below 1e-6 m or rad, or below three times the error bar of
    the reference, and that the reported accelerations agree with the linkage's to 1e-3: `diagnosis.diagnosis`.

    Args:
        linkage: name of a built-in linkage, or a path.
        engine: one of `gauss_bench.engines.names()`.
        scenario: of the file; the first with a start where not given.
        settings, integrator, stabilization: of the engine; its defaults where not given.
        step: integration step [s].
        until: [s]; one second, or the scenario's duration where that is shorter, where not given.
        budget: seconds for everything (120).
        told: called with each sentence of progress.

    Raises:
        LinkageError: the file has faults.
        ChoiceError: the engine does not offer what was asked for, the run has too few steps, or no reference can be made.
        KeyError: unknown engine.
    """
    offered = offer(engine)
    choice = offered.choose(settings, integrator, stabilization, step)
    mechanism = load(linkage, scenario)
    end = duration(min(USUAL, mechanism.duration), until=until)
    deadline = time.monotonic() + check_budget(budget, BUDGET)
    check_size(choice.step, end)
    checkpoints(choice.step, end)  # refused before anything is run

    def make_diagnosis(verdict: Verdict, reference: str) -> Diagnosis:
        fields = ("cause", "parts", "numbers", "explanations", "candidates", "runs")
        found = {x: getattr(verdict, x) for x in fields} | {"part": verdict.cause.part, "verdict": verdict.sentence}
        return Diagnosis(**name_run(mechanism, engine, choice), **found, until=end, reference=reference)

    if not offered.usable:
        return make_diagnosis(without_run(Ended(offered.status, offered.reason)), "")
    adaptive = choice.integrator in offered.adaptive
    with Worker() as worker:
        told(f"{mechanism.name}, scenario {mechanism.scenario}, until {end:g} s: the truth")
        reference = truth(linkage, mechanism, end, deadline, told)

        def run(chosen: Choice, wanted: Sampling) -> Run:
            left = max(LEAST, deadline - time.monotonic())
            return run_apart(Request(linkage, mechanism.scenario, engine, chosen, wanted), mechanism, left, worker)

        # drift is recognised by what projection takes off the error of the same setting
        can_project = choice.stabilization == "none" and "projection" in offered.stabilizations
        projected = replace(choice, stabilization="projection") if can_project and not adaptive else None
        verdict = diagnose_runs(run, mechanism, reference, ladder(choice, adaptive), end, adaptive, projected, told)
    return make_diagnosis(verdict, reference.method)


def truth(linkage: str, mechanism: Mechanism, until: float, deadline: float, told: Told) -> Reference:
    """Return the certified motion, or a reference by smaller and smaller steps before the deadline, as for a recommendation.

    Raises:
        ChoiceError: no reference is known well enough in time.
    """
    if certified := find_certified(mechanism, until):
        return certified
    try:
        with Worker() as worker:
            found = truths.truth(WayRun(linkage, mechanism, until), KNOWN, lambda: deadline - time.monotonic(), worker, told)
    except truths.NoTruth as failure:
        raise ChoiceError(f"{mechanism.name}, scenario {mechanism.scenario}, has no truth to compare with: {failure}") from failure
    bar = np.full(len(found.reference.t), max(found.bars[kind] for kind in KNOWN))
    return replace(found.reference, error_q=bar, error_v=bar, error_a=bar)
