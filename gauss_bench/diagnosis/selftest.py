"""The self-test plants faults one by one, and the suite's own checks must detect each of them.

Faults of the suite's own functions are planted in memory while a check runs, without a change of any file. Engines with planted
faults are run, and the diagnosis must name the cause (`faults.py`). The checks must detect nothing if no fault is planted.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from gauss_bench.diagnosis import checks
from gauss_bench.diagnosis.causes import Cause
from gauss_bench.diagnosis.checks import CRANK_SLIDER, DRIVEN, FOUR_BAR, truth
from gauss_bench.diagnosis.diagnosis import Verdict, diagnose_runs
from gauss_bench.diagnosis.faults import CLEAN, ENGINES, TABLES, Fault, Faulty
from gauss_bench.diagnosis.observations import ladder
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.one_run import one_run
from gauss_bench.trajectory import in_a_sentence

Check = Callable[[], str | None]
CONSTANTS = (int, float, str, tuple, dict)  # types of the constants of a module that an altered source may change
STEP, UNTIL = 4e-3, 0.4  # [s] step and end of the diagnosed runs, the cheapest with which all faults are named
ADAPTERS = "adapters"  # kind under which the faults in ENGINES are listed, beside the kinds of `Planted`
SOUND = (Cause.NONE, Cause.INTEGRATOR, Cause.DRIFT)  # possible verdicts on an engine without a fault, whose steps have errors


@dataclass(frozen=True)
class Planted:
    """One fault of the suite and the check that must detect it.

    Attributes:
        kind: part of the suite in which the fault lies: models, formulations, metrics, references, clocks or gate.
        sound: the check without the fault, which must return None; check: the check with the fault, which must return a sentence.
    """

    kind: str
    sentence: str
    sound: Check
    check: Check


@contextmanager
def plant(file: str, text: str, mutant: str) -> Iterator[None]:
    """Let a module run, within this context, as if its source file contained `mutant` instead of `text`.

    Other modules hold references to the functions of this module. The function objects are therefore kept, and only their code
    objects are exchanged for those of the altered source. Constants of the types CONSTANTS are replaced in the module.

    Raises:
        ValueError: `text` does not occur exactly once in the file.
    """
    module = import_module(file.removesuffix(".py").replace("/", "."))
    path = Path(str(module.__file__))
    source = path.read_text(encoding="utf-8")
    if source.count(text) != 1:
        raise ValueError(f"{file} does not contain {text!r} exactly once")
    altered_names: dict[str, Any] = {"__name__": module.__name__}  # name -> object, as the altered source defines them
    exec(compile(source.replace(text, mutant), str(path), "exec"), altered_names)
    original = vars(module)
    constants = {name: x for name, x in original.items() if type(x) in CONSTANTS and not name.startswith("__")}
    # names of the module and of each of its classes, original and altered
    pairs: list[Any] = [(original, altered_names)]
    pairs += [(vars(x), vars(altered_names[name])) for name, x in original.items() if isinstance(x, type)]
    original_code, altered_code = {}, {}
    for names, altered in pairs:
        for name, function in names.items():
            if type(function) is FunctionType:
                original_code[function], altered_code[function] = function.__code__, altered[name].__code__
    try:
        original |= {name: altered_names[name] for name in constants}
        for function, code in altered_code.items():
            function.__code__ = code
        yield
    finally:
        original |= constants
        for function, code in original_code.items():
            function.__code__ = code


def read_fault(kind: str, sentence: str, check: str, where: tuple[str, str] = FOUR_BAR, **fault: Any) -> Planted:
    """Return the fault of the suite of one [[fault]] table of `planted.toml`, with the function `check` that must detect it.

    With the key `file`, `fault` has the arguments of `plant`. Otherwise it has arguments with which the check itself plants the
    fault on the linkage and scenario `where`.
    """
    sound: Any = getattr(checks, check)  # the check, run without the fault
    if "file" in fault:

        def check_with_fault() -> str | None:
            with plant(**fault):
                return sound()  # type: ignore[no-any-return]

        return Planted(kind, sentence, sound, check_with_fault)
    return Planted(kind, sentence, partial(sound, tuple(where)), partial(sound, tuple(where), **fault))


PLANTED = tuple(read_fault(**x) for x in TABLES["fault"])


def smallest(check: Callable[[float], str | None]) -> float:
    """Return the smallest size of a fault that a check detects, to 5 %, by bisection on a logarithmic scale.

    The check returns a sentence if it detects a fault of a given size, and otherwise None.

    Raises:
        ValueError: the check does not detect a fault of the size 1e-2, or detects one of the size 1e-17.
    """
    undetected, detected = 1e-17, 1e-2
    if check(detected) is None or check(undetected) is not None:
        raise ValueError(f"a fault of size {detected:g} is not detected, or one of size {undetected:g} is")
    while detected > 1.05 * undetected:
        middle = float(np.sqrt(undetected * detected))
        if check(middle) is None:
            undetected = middle
        else:
            detected = middle
    return detected


# kind of fault -> unit of its size, and check of a fault of this size
SIZES: dict[str, tuple[str, Callable[[float], str | None]]] = {
    "inertia": ("of the crank's inertia", lambda x: checks.check_model(alter={"of": "crank", "inertia": 1 + x})),
    "length": ("m of the coupler's length", lambda x: checks.check_model(alter={"joint": "B", "by": x})),
    "damping": ("of the brake's damping", lambda x: checks.check_model(alter={"of": "brake", "c": 1 + x})),
    "time": ("s of every sample's time", checks.check_sample_times),
}

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
    """Diagnose an engine with a planted fault on a linkage and scenario, by default those in which the fault shows."""
    which = where or fault.where
    mechanism, chosen = load(*which), Choice(integrator="rk4", step=STEP)
    run, projected = partial(one_run, Faulty(fault), mechanism), replace(chosen, stabilization="projection")
    return diagnose_runs(run, mechanism, truth(which, UNTIL), ladder(chosen, adaptive=False), UNTIL, projected=projected)


def diagnose_sound(where: tuple[str, str]) -> str | None:
    """Return a sentence if the diagnosis of an engine without a fault names one on the linkage and scenario `where`."""
    verdict = diagnose_fault(CLEAN, where)
    return None if verdict.cause in SOUND else f"an engine without a fault: {verdict.verdict}"


def selftest(only: Sequence[str] = (), told: Callable[[str], object] = lambda _: None) -> SelfTest:
    """Plant every fault of the chosen kinds, and also run every check while no fault is planted.

    Without a planted fault, a sentence that a check returns is a false alarm. With "models" among the kinds, the smallest detected
    fault of each kind in SIZES is determined.

    Args:
        only: the kinds of faults to plant, a part of KINDS; by default all.
        told: called with each sentence of progress.
    """
    started, kinds = time.process_time(), only or KINDS
    chosen = [x for x in PLANTED if x.kind in kinds]
    sound: dict[str, Check] = {f"{x.kind}: {x.sound}": x.sound for x in chosen}
    if ADAPTERS in kinds:
        sound |= {f"{ADAPTERS}: {' '.join(x)}": partial(diagnose_sound, x) for x in (FOUR_BAR, CRANK_SLIDER, DRIVEN)}
    told(f"{len(sound)} checks without planted faults")
    alarms = [sentence for sentence in map(_run_check, sound.values()) if sentence is not None]
    findings: list[Finding] = []
    for kind in kinds:
        told(f"faults in {kind}")
        for fault in (x for x in chosen if x.kind == kind):
            sentence = _run_check(fault.check)
            findings.append(Finding(kind, fault.sentence, sentence is not None, sentence or "the check detects nothing"))
        for engine_fault in ENGINES if kind == ADAPTERS else ():
            verdict = diagnose_fault(engine_fault)
            said = f"{verdict.cause}: {verdict.verdict}"
            findings.append(Finding(kind, engine_fault.sentence, verdict.cause is engine_fault.cause, said))
    sizes: tuple[Smallest, ...] = ()
    if "models" in kinds:
        told("the smallest faults that are detected")
        sizes = tuple(Smallest(name, smallest(check), unit) for name, (unit, check) in SIZES.items())
    took = time.process_time() - started
    return SelfTest(tuple(findings), tuple(alarms), len(sound) - len(alarms), sizes, took)


def _run_check(check: Check) -> str | None:
    """Run a check; return its sentence on the fault that it detected or on its own failure, or None."""
    try:
        return check()
    except Exception as error:
        return f"the check fails: {type(error).__name__}: {in_a_sentence(error)}"
