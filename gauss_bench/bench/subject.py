"""An engine under test: how checks ask it in a worker, and the result of a check."""

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gauss_bench.bench.measure import mechanism_of
from gauss_bench.bench.probes import PROBE
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import Offer
from gauss_bench.runs.one_run import Asked, Run, nothing, sampling_at
from gauss_bench.runs.worker import Worker
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status

LIMIT = 60.0  # [s] of one run; the slowest engine generates and compiles C in it
LONGEST = 100.0  # [s] of the processor, after which nothing more is asked
STEP, DURATION = 1e-3, 0.1  # [s]
EVERY_STEP = STEP * np.arange(round(DURATION / STEP) + 1)
PLAIN = (("four_bar", "torque"), ("crank_slider", "paper"))


@dataclass(frozen=True)
class Check:
    """The result of one check.

    Attributes:
        name: what an engine must keep to.
        passed: whether it does; None where it could not be asked.
        message: what was measured, what is wrong, or why it could not be asked.
    """

    name: str
    passed: bool | None
    message: str = ""


def time_of(pid: int) -> float:
    """Processor time [s] of a process and of its children that have ended; 0 where the system does not tell."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        return sum(map(int, words[11:15])) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError):
        return 0.0


@dataclass(eq=False)
class Subject:
    """An engine and the worker it runs in; `tell` hears of each run before it is made."""

    offer: Offer
    worker: Worker
    tell: Callable[[str], None]
    before: float = field(default_factory=time.process_time)

    @property
    def processor_time(self) -> float:
        """Processor time [s] of this process and of the worker, with the compilers that it has started, so far."""
        return time.process_time() - self.before + time_of(self.worker.process.pid if self.worker.process else 0)

    @cached_property
    def usual(self) -> Choice:
        """The engine's own defaults."""
        return self.offer.choose(None, None, None, STEP)

    @cached_property
    def whole(self) -> dict[str, Run]:
        """The same run of each linkage, at every step, that most checks look at."""
        return {linkage: self.run(linkage, scenario, EVERY_STEP) for linkage, scenario in PLAIN}

    @cached_property
    def moving(self) -> list[tuple[str, str]]:
        """Return the linkage with every kind of load, or those with few loads where an engine refuses it."""
        one = np.array([0.0, STEP])
        taken = [x for x in ((PROBE, "loaded"), *PLAIN) if self.run(*x, one).status is not Status.SKIP]
        return taken[:1] if taken[:1] == [(PROBE, "loaded")] else taken or [*PLAIN]

    def run(self, linkage: str, scenario: str, times: Array, ask: Asked = nothing, answers: int = 0) -> Run:
        """Run a linkage, given by name, under the engine's defaults."""
        return self.perform(mechanism_of(linkage, scenario), self.usual, times, ask, answers)

    def perform(
        self, mechanism: Mechanism, choice: Choice, times: Array, ask: Asked = nothing, answers: int = 0, again: bool = False
    ) -> Run:
        """A run of a linkage; with `again` the worker may keep its model for the next step or tolerance of the same."""
        wanted = sampling_at(choice.step, times)
        if self.processor_time > LONGEST:
            return Run(Status.SKIP, f"not asked: {LONGEST:g} s of the processor are spent", None, None, wanted)
        request = Request(mechanism.sha256, mechanism.scenario, self.offer.name, choice, wanted, ask, 0.0, answers)
        return run_apart(request, mechanism, LIMIT, self.worker, again=again)

    def choices(self) -> Iterator[Choice]:
        """The defaults, then every other settings label and integrator, then every variant."""
        usual, offer = self.usual, self.offer
        yield usual
        yield from (replace(usual, settings=label) for label in offer.settings if label != usual.settings)
        yield from (replace(usual, integrator=name) for name in offer.integrators if name != usual.integrator)
        yield from (offer.choose(name, None, None, STEP) for name in offer.variants)
