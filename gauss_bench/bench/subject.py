"""The engine under test of `conformance`: its runs in a worker, and the results of checks."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gauss_bench.bench.measure import mechanism_of
from gauss_bench.bench.probes import PROBE
from gauss_bench.engines import environment_of
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import Offer
from gauss_bench.runs.one_run import Asked, Run, ask_nothing, sampling_at
from gauss_bench.runs.worker import Worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

LIMIT = 60.0  # [s] limit of one run, in which the slowest engine generates and compiles C
LONGEST = 100.0  # [s] processor time after which no further run is started
PATIENCE = 6.0  # factor of both limits for engines in environments of their own, one of which compiles each linkage for a minute
STEP, DURATION = 1e-3, 0.1  # [s] of the runs
EVERY_STEP = STEP * np.arange(round(DURATION / STEP) + 1)  # [s] sample times
ONE_STEP = np.array([0.0, STEP])  # [s] sample times of a short run, which shows whether the engine accepts a linkage
PLAIN = (("four_bar", "torque"), ("crank_slider", "paper"))  # linkages and scenarios that nearly all engines accept


@dataclass(frozen=True)
class Check:
    """The result of one check.

    Attributes:
        name: the rule that is checked.
        passed: whether the engine keeps the rule; None if the rule could not be checked.
        message: the measured value, the fault that was found, or the reason why the rule could not be checked.
    """

    name: str
    passed: bool | None
    message: str = ""


def check_fault(name: str, fault: str) -> Check:
    """Return a check that is passed if `fault` is an empty text, and otherwise failed with this message."""
    return Check(name, not fault, fault)


def check_failed_run(name: str, run: Run) -> Check:
    """Return the check for a run without a trajectory: not made if the engine refuses the linkage, else failed."""
    return Check(name, None if run.status is Status.SKIP else False, run.message)


def time_of(pid: int) -> float:
    """Return the processor time [s] of a process and of its ended children; 0 if the system does not report it."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()  # fields after the name
        return sum(map(int, words[11:15])) / os.sysconf("SC_CLK_TCK")  # utime, stime, cutime, cstime in ticks
    except (OSError, ValueError):
        return 0.0


def own_time() -> float:
    """Return the processor time [s] of this process and of its ended children."""
    return sum(os.times()[:4])


@dataclass(eq=False)
class Subject:
    """An engine under test, which runs in the worker.

    Attributes:
        tell: called with a sentence of progress before each run.
        before: processor time [s] that this process and its ended children had used before the first check.
    """

    offer: Offer
    worker: Worker
    tell: Callable[[str], None]
    before: float = field(default_factory=own_time)

    @property
    def processor_time(self) -> float:
        """The processor time [s] of all checks so far, in this process, in workers and in compilers."""
        return own_time() - self.before + time_of(self.worker.process.pid if self.worker.process else 0)

    @cached_property
    def usual(self) -> Choice:
        """The engine's default setting, integrator and stabilisation."""
        return self.offer.choose(None, None, None, STEP)

    @cached_property
    def plain_runs(self) -> dict[str, Run]:
        """The runs that most checks use: linkage of PLAIN -> its run with a sample at every step."""
        return {linkage: self.run(linkage, scenario, EVERY_STEP) for linkage, scenario in PLAIN}

    @cached_property
    def accepted(self) -> list[tuple[str, str]]:
        """The linkages and scenarios on which the engine's accelerations and motions are checked.

        These are PROBE, a linkage with every kind of load, if the engine can run it, otherwise the linkages in PLAIN that it can
        run, or all of PLAIN if it can run none, so that the checks report the refusals.
        """
        for places in ([(PROBE, "loaded")], PLAIN):
            if taken := [x for x in places if self.run(*x, ONE_STEP).status is not Status.SKIP]:
                return taken
        return [*PLAIN]

    def run(self, linkage: str, scenario: str, times: Array, ask: Asked = ask_nothing, answers: int = 0) -> Run:
        """Run a linkage with the engine's defaults; the other arguments are those of `perform`."""
        return self.perform(mechanism_of(linkage, scenario), self.usual, times, ask, answers)

    def perform(
        self, mechanism: Mechanism, choice: Choice, times: Array, ask: Asked = ask_nothing, answers: int = 0, keep: bool = False
    ) -> Run:
        """Run a mechanism; once the time allowed for all checks is spent, return a run with the status SKIP instead.

        Args:
            times: sample times [s].
            ask: function that is called with the model before the run; its result has at most `answers` elements.
            keep: whether the worker may keep the model, for a further run with another step or tolerance.
        """
        wanted = sampling_at(choice.step, times)
        patience = PATIENCE if environment_of(self.offer.name) else 1.0
        if self.processor_time >= patience * LONGEST:
            return Run(Status.SKIP, f"not asked: all {patience * LONGEST:g} s of processor time are used", None, None, wanted)
        # the digest serves as name, because linkages with changed numbers have the same name
        request = Request(mechanism.sha256, mechanism.scenario, self.offer.name, choice, wanted, ask, answers=answers)
        return run_apart(request, mechanism, patience * LIMIT, self.worker, keep_model=keep)

    def choices(self) -> Iterator[Choice]:
        """Yield the engine's default choice, then each other setting, each other integrator, and every variant."""
        usual, offer = self.usual, self.offer
        yield usual
        yield from (replace(usual, settings=label) for label in offer.settings if label != usual.settings)
        yield from (replace(usual, integrator=name) for name in offer.integrators if name != usual.integrator)
        yield from (offer.choose(name, None, None, STEP) for name in offer.variants)
