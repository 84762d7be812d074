"""Check this machine: versions, the processor, threads, caches, and each engine on a small linkage.

Only the Python interpreter and the suite's own formulations are required. If an optional part, such as a library or a compiler, is
missing, the checkup reports what does not work without it.
"""

import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from gauss_bench.api.simulate import simulate
from gauss_bench.api.telling import Result, Told, nobody
from gauss_bench.bench.provenance import environment
from gauss_bench.compiler import user_cache
from gauss_bench.engines import SAFE, get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.c_code import NO_COMPILER, compiler
from gauss_bench.linkage.load import built_in, load
from gauss_bench.reach import ABSENT
from gauss_bench.runs.apart import find_unbuilt
from gauss_bench.runs.offers import Offer, offers
from gauss_bench.runs.worker import THREADS, WorkerFailure, get_worker
from gauss_bench.trajectory import Status

TRIED, ENGINE_LIMIT = "crank_slider", 60.0  # linkage and time limit [s] of the trial run, which may include compiling C code
DURATION, STEP = 0.01, 1e-3  # [s] of the trial run
EXTENDED = 63  # bits of a mantissa from which long double counts as extended precision
OLDEST = (3, 11)  # oldest supported version of Python
NEEDED = ("gauss", "lagrange")  # own formulations that must work on every machine


@dataclass(frozen=True)
class Finding:
    """One item of the checkup.

    Attributes:
        name: name of the item, such as "processor".
        value: the version, size or place that was found.
        status: "ok", "missing" for an absent optional part, "invalid" for an engine whose run the judge rejects, or "broken".
        message: the consequence, or an empty text.
    """

    name: str
    value: str
    status: str = "ok"
    message: str = ""


@dataclass(frozen=True)
class Checkup(Result):
    """The result of the checkup.

    Attributes:
        verdict: the result in one sentence.
        usable: whether the suite's own formulations and files work on this machine.
        findings: items on the machine and the installation.
        engines: one item per engine, from a run of the crank-slider over 0.01 s.
    """

    verdict: str
    usable: bool
    findings: tuple[Finding, ...]
    engines: tuple[Finding, ...]

    @property
    def succeeded(self) -> bool:
        return self.usable


def doctor(told: Told = nobody) -> Checkup:
    """Check this machine and this installation; `told` is called with a sentence before each engine is tried."""
    known = offers()
    findings = (*_check_machine(), _check_linkages(), _check_cache(), _check_compiler(), *_check_builds(known))
    engines = tuple(_try_engine(offer, told) for offer in known)
    broken = [x.name for x in findings if x.status == "broken"]
    broken += [x.name for x in engines if x.name in NEEDED and x.status != "ok"]
    lacking = [x.name for x in (*findings, *engines) if x.status in ("missing", "broken")]
    verdict = f"usable, without {', '.join(lacking)}" if lacking else "everything works"
    if broken:
        verdict = f"not usable: {', '.join(broken)}"
    return Checkup(verdict, not broken, findings, engines)


def _check_machine() -> Iterator[Finding]:
    """Yield findings on the interpreter, the processor, threads, the precision of long double, and packages."""
    facts = environment()
    is_recent = sys.version_info >= OLDEST
    needed = "" if is_recent else f"needs {OLDEST[0]}.{OLDEST[1]} or later"
    yield Finding("Python", facts["python"], "ok" if is_recent else "broken", needed)
    yield Finding("platform", facts["platform"])
    yield Finding("processor", f"{facts['cpu'] or 'unknown'}, {facts['cores']} cores")
    yield Finding("BLAS", facts["blas"])
    threads = [f"{name}={os.environ[name]}" for name in THREADS if name in os.environ]
    yield Finding("threads", ", ".join(threads) or "the library's default", message="timed runs use one thread")
    bits = np.finfo(np.longdouble).nmant
    consequence = "" if bits >= EXTENDED else "references that are not certified have the error bars of double precision"
    yield Finding("long double", f"{bits + 1} bits", "ok" if bits >= EXTENDED else "missing", consequence)
    yield Finding("packages", ", ".join(f"{name} {version}" for name, version in facts["versions"].items()))


def _check_linkages() -> Finding:
    """Read and assemble every built-in linkage."""
    names = sorted(built_in())
    for name in names:
        try:
            load(name)
        except Exception as error:
            return Finding("linkages", f"{len(names)} built in", "broken", f"{name}: {error}")
    return Finding("linkages", f"{len(names)} built in, each assembled")


def _check_cache() -> Finding:
    """Report the folder and the size of the cache of compiled code."""
    path = user_cache.trusted_folder()
    if path is None:
        why = f"{user_cache.folder()} is not a private folder of this user; linkages are compiled anew in each run"
        return Finding("cache", "none", "missing", why)
    sizes = [x.stat().st_size for x in path.glob("*.o")]
    return Finding("cache", f"{path}: {len(sizes)} compiled linkages, {sum(sizes) / 1e6:.1f} MB")


def _check_compiler() -> Finding:
    """Report the C compiler, which some engines need."""
    path = compiler()
    if path is None:
        without = f"{NO_COMPILER}; by_hand cannot run, and casadi runs in its own virtual machine, which is slower"
        return Finding("C compiler", "none", "missing", without)
    return Finding("C compiler", path)


def _check_builds(known: Iterable[Offer]) -> Iterator[Finding]:
    """Report whether the code that an engine compiles once per user is built, can be built later, or cannot be built."""
    for offer in (x for x in known if x.usable and "build_once" in x.methods):
        name = f"{offer.name}, compiled"
        choices = [Choice(x.name, x.integrator, x.stabilization) for x in offer.variants.values()]
        try:
            if lacking := _find_lacking(offer, choices):
                yield Finding(name, "none", "missing", lacking)
            elif unbuilt := find_unbuilt(offer.name, [x.settings for x in choices], get_worker(offer.name)):
                yield Finding(name, "not built yet", "missing", f"the first search or run that needs {unbuilt} builds it")
            else:
                yield Finding(name, "built")
        except WorkerFailure as failure:
            yield Finding(name, "none", "broken", str(failure))


def _find_lacking(offer: Offer, choices: Iterable[Choice]) -> str:
    """Return why an engine's code cannot be compiled on this machine, such as a missing compiler; "" if no choice lacks anything.

    The result is "" for an adapter of another package (not in SAFE), because this process must not import it.
    """
    if offer.name not in SAFE:
        return ""
    refusals = (get(offer.name).skip(load(TRIED), choice) for choice in choices)
    return next((x for x in refusals if x and ABSENT.search(x)), "")


def _try_engine(offer: Offer, told: Told) -> Finding:
    """Run an engine on the crank-slider for DURATION, and report the judge's verdict on the run."""
    told(f"trying {offer.name}")
    if not offer.usable:
        missing = offer.status is Status.SKIP
        return Finding(offer.name, offer.version, "missing" if missing else "broken", offer.reason)
    run = simulate(TRIED, offer.name, step=STEP, at=[0.0, DURATION], limit=ENGINE_LIMIT)
    status = {Status.OK: "ok", Status.INVALID: "invalid", Status.SKIP: "missing"}.get(run.status, "broken")
    version = "; ".join(filter(None, (offer.version, offer.environment)))
    return Finding(offer.name, version, status, "" if status == "ok" else run.message)
