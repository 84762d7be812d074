"""The self-test plants faults one by one, and the suite's own checks must detect each of them.

Faults of the suite's own functions are planted in memory while a check runs, without a change of any file (`planted.py`). Engines
with planted faults are run, and the diagnosis must name the cause (`faults.py`). The checks must detect nothing if no fault is
planted.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from gauss_bench.diagnosis.causes import Cause
from gauss_bench.diagnosis.checks import CRANK_SLIDER, DRIVEN, FOUR_BAR, truth
from gauss_bench.diagnosis.diagnosis import Verdict, diagnose_runs
from gauss_bench.diagnosis.faults import CLEAN, ENGINES, Fault, Faulty
from gauss_bench.diagnosis.observations import ladder
from gauss_bench.diagnosis.planted import PLANTED, SIZES, Check, smallest
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.one_run import Run, Sampling, one_run
from gauss_bench.trajectory import in_a_sentence

STEP, UNTIL = 4e-3, 0.4  # [s] step and end of the diagnosed runs, the cheapest with which all faults are named
ADAPTERS = "adapters"  # kind of the faults of engines
SOUND = (Cause.NONE, Cause.INTEGRATOR, Cause.DRIFT)  # possible verdicts on an engine without a fault, whose steps have errors
KINDS = (*dict.fromkeys(x.kind for x in PLANTED), ADAPTERS)


@dataclass(frozen=True)
class Finding:
    """One planted fault, and whether it was detected.

    Attributes:
        kind: place of the fault; fault: description of the fault.
        seen: whether a check detected the fault; said: the sentence that the check returned.
    """

    kind: str
    fault: str
    seen: bool
    said: str


@dataclass(frozen=True)
class Smallest:
    """The smallest fault of one kind that the checks detect.

    Attributes:
        fault: kind of the fault in words.
        size: size of the smallest fault of this kind that is detected; unit: unit of the size.
    """

    fault: str
    size: float
    unit: str


@dataclass(frozen=True)
class SelfTest:
    """The result of a self-test.

    Attributes:
        findings: one finding for every planted fault.
        false_alarms: sentences of checks that report a fault of the unaltered suite.
        silent: number of checks that report no fault of the unaltered suite.
        smallest: smallest detected fault of each kind.
        seconds: processor time of the self-test [s].
    """

    findings: tuple[Finding, ...]
    false_alarms: tuple[str, ...]
    silent: int
    smallest: tuple[Smallest, ...]
    seconds: float

    @property
    def planted(self) -> int:
        """Number of planted faults."""
        return len(self.findings)

    @property
    def detected(self) -> int:
        """Number of planted faults that a check found."""
        return sum(x.seen for x in self.findings)

    @property
    def passed(self) -> bool:
        """True if every planted fault was detected, and no check reports a fault where none is planted."""
        return self.detected == self.planted and not self.false_alarms


def diagnose_fault(fault: Fault, where: tuple[str, str] | None = None) -> Verdict:
    """Run an engine with a planted fault, diagnose it and return the verdict.

    Args:
        fault: the planted fault.
        where: linkage and scenario; by default those in which the fault shows.
    """
    which = where or fault.where
    mechanism, engine = load(*which), Faulty(fault)

    def run(choice: Choice, wanted: Sampling) -> Run:
        """Run the faulty engine."""
        return one_run(engine, mechanism, choice, wanted)

    chosen = Choice(integrator="rk4", step=STEP)
    projected = replace(chosen, stabilization="projection")
    return diagnose_runs(run, mechanism, truth(which, UNTIL), ladder(chosen, adaptive=False), UNTIL, projected=projected)


def diagnose_sound(where: tuple[str, str]) -> str | None:
    """Diagnose an engine that has no fault, on the linkage and scenario `where`.

    Return a sentence if the diagnosis names a fault although there is none, and otherwise None.
    """
    verdict = diagnose_fault(CLEAN, where)
    return None if verdict.cause in SOUND else f"an engine without a fault: {verdict.sentence}"


def diagnose_planted(fault: Fault) -> Finding:
    """Diagnose an engine with a fault; the finding tells whether the verdict names the cause of the fault."""
    verdict = diagnose_fault(fault)
    return Finding(ADAPTERS, fault.sentence, verdict.cause is fault.cause, f"{verdict.cause}: {verdict.sentence}")


def selftest(only: Sequence[str] = (), told: Callable[[str], object] = lambda _: None) -> SelfTest:
    """Plant every fault of the chosen kinds, and also run every check while no fault is planted.

    Without a planted fault, a sentence that a check returns is a false alarm. For some parameters the smallest fault that is still
    detected is determined, if "models" is among the chosen kinds.

    Args:
        only: the kinds of faults to plant, a part of KINDS; by default all.
        told: called with each sentence of progress.
    """
    started, kinds = time.process_time(), only or KINDS
    chosen = [x for x in PLANTED if x.kind in kinds]
    sound: dict[str, Check] = {f"{x.kind}: {x.sound}": x.sound for x in chosen}
    if ADAPTERS in kinds:
        sound |= {f"{ADAPTERS}: {' '.join(x)}": partial(diagnose_sound, x) for x in (FOUR_BAR, CRANK_SLIDER, DRIVEN)}
    told(f"{len(sound)} checks of the sound suite")
    alarms = [sentence for sentence in map(_ask, sound.values()) if sentence is not None]
    findings: list[Finding] = []
    for kind in kinds:
        told(f"faults in {kind}")
        for fault in (x for x in chosen if x.kind == kind):
            sentence = _ask(fault.check)
            findings.append(Finding(kind, fault.sentence, sentence is not None, sentence or "the check detects nothing"))
        if kind == ADAPTERS:
            findings += map(diagnose_planted, ENGINES)
    sizes: tuple[Smallest, ...] = ()
    if "models" in kinds:
        told("the smallest faults that are seen")
        sizes = tuple(Smallest(name, smallest(check), unit) for name, (unit, check) in SIZES.items())
    took = time.process_time() - started
    return SelfTest(tuple(findings), tuple(alarms), len(sound) - len(alarms), sizes, took)


def _ask(check: Check) -> str | None:
    """Run a check; return its sentence on the fault that it detected, or None if it detected none.

    If the check raises an exception, return a sentence on this failure.
    """
    try:
        return check()
    except Exception as error:
        return f"the check fails: {type(error).__name__}: {in_a_sentence(error)}"
