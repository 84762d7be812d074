"""A check of this machine: versions, the processor, threads, caches, and each engine tried on a small linkage.

    doctor() -> Checkup

Only the interpreter and the suite's own formulations are required. Anything else may be missing; the checkup then says what does
not work without it.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gauss_bench.api.simulate import simulate
from gauss_bench.api.telling import Result
from gauss_bench.bench.provenance import environment
from gauss_bench.compiler import user_cache
from gauss_bench.engines import SAFE, get
from gauss_bench.engines.base import Choice
from gauss_bench.engines.c_code import NO_COMPILER, compiler
from gauss_bench.linkage.load import built_in, load
from gauss_bench.reach import ABSENT
from gauss_bench.runs.apart import find_unbuilt
from gauss_bench.runs.offers import Offer, offers
from gauss_bench.runs.worker import THREADS, WorkerFailure, keep
from gauss_bench.trajectory import Status

TRIED, ENGINE_LIMIT = "crank_slider", 60.0  # [s] the slowest engine generates and compiles C first
DURATION, STEP = 0.01, 1e-3  # [s] of the trial
EXTENDED = 63  # bits of a mantissa from which long double counts as extended precision
OLDEST = (3, 11)
NEEDED = ("gauss", "lagrange")  # own formulations that must work here; `yuan_ge_eq16`, for one, is wrong as published


@dataclass(frozen=True)
class Finding:
    """One item of the checkup.

    Attributes:
        name: of the item, such as "processor".
        value: what was found.
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
        verdict: one sentence.
        usable: whether the suite's own formulations and files work here.
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


def doctor(told: Callable[[str], None] = lambda sentence: None) -> Checkup:
    """Check this machine and this installation; `told` is called with a sentence before each engine is tried."""
    there = offers()
    findings = (*_check_machine(), _check_linkages(), _check_cache(), _check_compiler(), *_check_builds(there))
    tried = []
    for offer in there:
        told(f"trying {offer.name}")
        tried.append(_try_engine(offer))
    engines = tuple(tried)
    return Checkup(_summarize(findings, engines), not _list_broken(findings, engines), findings, engines)


def _check_machine() -> Iterator[Finding]:
    here = environment()
    recent = sys.version_info >= OLDEST
    needed = "" if recent else f"needs {OLDEST[0]}.{OLDEST[1]} or later"
    yield Finding("Python", here["python"], "ok" if recent else "broken", needed)
    yield Finding("platform", here["platform"])
    yield Finding("processor", f"{here['cpu'] or 'unknown'}, {here['cores']} cores")
    yield Finding("BLAS", here["blas"])
    threads = [f"{name}={os.environ[name]}" for name in THREADS if name in os.environ]
    yield Finding(
        "threads", ", ".join(threads) or "as many as the library likes", message="what is timed runs with one, in workers"
    )
    bits = np.finfo(np.longdouble).nmant
    long = "" if bits >= EXTENDED else "references that are not certified have the error bars of double precision"
    yield Finding("long double", f"{bits + 1} bits", "ok" if bits >= EXTENDED else "missing", long)
    yield Finding("packages", ", ".join(f"{name} {version}" for name, version in here["versions"].items()))


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
    """Find the cache in which compiled code is kept between runs."""
    path = user_cache.is_trusted()
    if path is None:
        why = f"{user_cache.folder()} is not a folder that this user alone may enter; linkages are compiled anew in each run"
        return Finding("cache", "none", "missing", why)
    sizes = [x.stat().st_size for x in path.glob("*.o")]
    return Finding("cache", f"{path}: {len(sizes)} compiled linkages, {sum(sizes) / 1e6:.1f} MB")


def _check_compiler() -> Finding:
    path = compiler()
    if path is None:
        return Finding("C compiler", "none", "missing", f"{NO_COMPILER}; by_hand does not run, and casadi in its virtual machine")
    return Finding("C compiler", str(Path(path)))


def _check_builds(there: Iterable[Offer]) -> Iterator[Finding]:
    """Report for each engine with code that is compiled once per user: built, not built yet, or why it cannot be built."""
    for offer in (x for x in there if x.usable and "build_once" in x.methods):
        name, choices = f"{offer.name}, compiled", [Choice(x.name, x.integrator, x.stabilization) for x in offer.variants.values()]
        if lacking := _find_lacking(offer, choices):
            yield Finding(name, "none", "missing", lacking)
            continue
        try:
            what = find_unbuilt(offer.name, [x.settings for x in choices], keep(offer.name))
        except WorkerFailure as failure:
            yield Finding(name, "none", "broken", str(failure))
            continue
        if what:
            yield Finding(name, "not built yet", "missing", f"a search builds {what}, and so does whoever names its settings")
        else:
            yield Finding(name, "built")


def _find_lacking(offer: Offer, choices: Iterable[Choice]) -> str:
    """Return what this machine lacks to compile the code of an adapter of this package, or an empty text."""
    if offer.name not in SAFE:
        return ""
    skipped = (get(offer.name).skip(load(TRIED), choice) for choice in choices)
    return next((x for x in skipped if x and ABSENT.search(x)), "")


def _try_engine(offer: Offer) -> Finding:
    """Run an engine on the crank-slider for DURATION, judged like any other run."""
    if not offer.usable:
        missing = offer.status is Status.SKIP
        return Finding(offer.name, offer.version, "missing" if missing else "broken", offer.reason)
    run = simulate(TRIED, offer.name, step=STEP, at=[0.0, DURATION], limit=ENGINE_LIMIT)
    status = {Status.OK: "ok", Status.INVALID: "invalid", Status.SKIP: "missing"}.get(run.status, "broken")
    lives = "; ".join(filter(None, (offer.version, offer.environment)))
    return Finding(offer.name, lives, status, "" if status == "ok" else run.message)


def _list_broken(findings: tuple[Finding, ...], engines: tuple[Finding, ...]) -> list[str]:
    """List the broken or missing items that the suite requires."""
    wrong = [x.name for x in engines if x.name in NEEDED and x.status != "ok"]
    return [*(x.name for x in findings if x.status == "broken"), *wrong]


def _summarize(findings: tuple[Finding, ...], engines: tuple[Finding, ...]) -> str:
    if broken := _list_broken(findings, engines):
        return f"not usable: {', '.join(broken)}"
    without = [x.name for x in (*findings, *engines) if x.status in ("missing", "broken")]
    return f"usable, without {', '.join(without)}" if without else "everything works"
