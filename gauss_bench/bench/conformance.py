"""What an engine of whoever must keep to, found out from outside: by runs in a worker, whose answers nobody believes.

    conformance("my_engine")          an installed plug-in, or one of the built-in engines
    conformance("my_package.adapter:Engine")     a class that is not installed as a plug-in yet

Each check is small: two linkages for a tenth of a second, and every kind of force alone. It tells a translation that is wrong, not
an integrator that is coarse: how exact an engine is, the suites find out.
"""

import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gauss_bench.bench.measure import accelerations, mechanism_of
from gauss_bench.engines import get
from gauss_bench.engines.base import Choice, Model
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.runs.apart import Request, run_apart
from gauss_bench.runs.offers import Offer, offers
from gauss_bench.runs.one_run import Asked, Run, nothing, sampling_at
from gauss_bench.runs.worker import Worker, kept
from gauss_bench.suites.read import FOLDER
from gauss_bench.terms import Array
from gauss_bench.trajectory import Status, Trajectory

LIMIT = 60.0  # [s] of one run; the slowest engine generates and compiles C in it
STEP, DURATION = 1e-3, 0.1  # [s]
ODD = (0.0, 0.0137, 0.02, 0.0555, 0.1)  # [s] times that a step of a millisecond misses
START = 1e-9  # of the first sample, relative to the linkage's size and speed
DERIVED = 0.02  # of velocities against differences of positions, and accelerations of velocities: the median, of the largest
LATE = 0.75  # steps: first-order methods put rates half a step beside the differences of what they integrate
AWAY = 0.05  # of the linkage's size, from our own motion after a tenth of a second
EFFECT = 0.5  # of a force's effect on the acceleration: a soft constraint takes a quarter of it, a wrong sign twice
KINDS, LOADED = FOLDER / "linkages" / "kinds.toml", "loaded"  # a linkage and a scenario with every kind of force


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: what an engine must keep to.
        passed: whether it does; None where it could not be asked.
        message: what is wrong, or why it could not be asked.
    """

    name: str
    passed: bool | None
    message: str = ""


def conformance(name: str, told: Callable[[str], None] = lambda sentence: None) -> list[Check]:
    """All checks of an engine, by name or as MODULE:CLASS; `told` hears of each before it is made.

    Raises:
        KeyError: there is no engine of that name.
    """
    offer = offers([name])[0]
    described = Check("describes itself", offer.usable, offer.reason)
    if not offer.usable:
        return [described]
    worker = kept(name)  # which has described it already
    try:
        with TemporaryDirectory() as folder:
            subject = _Subject(offer, worker, Path(folder))
            checks = [described]
            for check in CHECKS:
                told(check.__doc__ or "")
                checks += check(subject)
            return checks
    finally:
        worker.stop()


@dataclass(frozen=True, eq=False)
class _Subject:
    """An engine under its own defaults, and the worker it runs in."""

    offer: Offer
    worker: Worker
    folder: Path

    @cached_property
    def whole(self) -> dict[str, Run]:
        """The same run of each linkage, at every step, that most checks look at."""
        return {linkage: self.run(linkage, scenario, EVERY_STEP) for linkage, scenario in LINKAGES}

    def run(self, linkage: str, scenario: str, times: Array, ask: Asked = nothing, answers: int = 0) -> Run:
        mechanism = mechanism_of(linkage, scenario)
        choice = self.offer.choose(None, None, None, STEP)
        request = Request(linkage, scenario, self.offer.name, choice, sampling_at(STEP, times), ask, 0.0, answers)
        return run_apart(request, mechanism, LIMIT, self.worker)


LINKAGES = (("crank_slider", "paper"), ("four_bar", "torque"))
EVERY_STEP = STEP * np.arange(round(DURATION / STEP) + 1)


def _judged(
    subject: _Subject, name: str, look: Callable[[Mechanism, Trajectory], str], times: Array | None = None
) -> Iterator[Check]:
    """One check on each linkage; `look` says what is wrong with a trajectory, at every step or these times, or nothing."""
    for linkage, scenario in LINKAGES:
        run = subject.whole[linkage] if times is None else subject.run(linkage, scenario, times)
        title = f"{name} ({linkage})"
        if run.trajectory is None:
            yield Check(title, None if run.status is Status.SKIP else False, run.message)
        else:
            message = look(mechanism_of(linkage, scenario), run.trajectory)
            yield Check(title, not message, message)


def _times(subject: _Subject) -> Iterator[Check]:
    """Samples are at the times asked for."""
    yield from _judged(subject, "samples are at the times asked for", lambda m, x: "", np.array(ODD))


def _start(subject: _Subject) -> Iterator[Check]:
    """The first sample is the start."""

    def look(m: Mechanism, x: Trajectory) -> str:
        gap = max(np.abs(x.q[0] - m.q0).max(), np.abs(x.v[0] - m.v0).max() / max(1.0, np.abs(m.v0).max()))
        return (
            ""
            if gap <= START
            else f"it is {gap:.1e} (m, rad, or of the largest speed) away: units, order of links, or a step too many"
        )

    yield from _judged(subject, "the first sample is the start", look)


def _derivatives(subject: _Subject) -> Iterator[Check]:
    """Velocities belong to positions, and accelerations to velocities."""

    def look(m: Mechanism, x: Trajectory) -> str:
        for low, high, words in ((x.q, x.v, "velocities"), (x.v, x.a, "accelerations")):
            slope, told = (low[2:] - low[:-2]) / (x.t[2:] - x.t[:-2])[:, None], high[1:-1]
            apart = np.median(np.abs(slope - told).max(axis=1)) / max(np.abs(slope).max(), 1e-12)
            if apart > DERIVED:
                return f"{words} and differences are {apart:.1%} apart: units, order of links, a reference point, or another time"
            if abs(late := lateness(slope, told)) > LATE:
                return f"{words} are {abs(late):.2g} steps {'late' if late > 0 else 'early'}"
        return ""

    yield from _judged(subject, "velocities and accelerations are derivatives", look)


def lateness(slope: Array, told: Array) -> float:
    """By how many samples rates (k, n) come after those that differences show (k, n), in the mean of least squares."""
    change = (slope[2:] - slope[:-2]) / 2
    scale = float((change * change).sum())
    return float(((slope - told)[1:-1] * change).sum()) / scale if scale else 0.0


def _motion(subject: _Subject) -> Iterator[Check]:
    """Links are where the equations of motion take them."""

    def look(m: Mechanism, x: Trajectory) -> str:
        model = get("gauss").build(m, Choice("default", "rk4", "projection", STEP))
        model.prepare(x.t)
        model.run()
        true, size = model.read(), max(np.ptp(m.q0.reshape(-1, 3)[:, :2]), 1e-3)
        gap = np.abs(x.q[-1] - true.q[-1]).reshape(-1, 3)
        apart = max(gap[:, :2].max() / size, gap[:, 2].max())
        return (
            ""
            if apart <= AWAY
            else f"after {x.t[-1]:g} s a link is {apart:.2g} of the linkage's size, or rad, from where it should be"
        )

    yield from _judged(subject, "links are where they should be", look)


def _same_again(subject: _Subject) -> Iterator[Check]:
    """The same run gives the same bits."""
    for linkage, scenario in LINKAGES[-1:]:
        runs = [subject.whole[linkage], *(subject.run(linkage, scenario, EVERY_STEP, ask) for ask in (nothing, run_before))]
        first, second, third = (run.trajectory for run in runs)
        if first is None or second is None or third is None:
            told = next(run.message for run in runs if run.trajectory is None)
            yield Check("a run repeats bit by bit", None if runs[0].status is Status.SKIP else False, told)
            continue
        yield Check("a run repeats bit by bit", _equal(first, second), "" if _equal(first, second) else "two runs differ")
        told = "" if _equal(first, third) else "a model that has run before gives another motion: prepare must reset everything"
        yield Check("a model can run again", not told, told)


def _undisturbed(subject: _Subject) -> Iterator[Check]:
    """Asking for an acceleration changes nothing."""
    linkage, scenario = LINKAGES[-1]
    m = mechanism_of(linkage, scenario)
    plain, asked = subject.whole[linkage], subject.run(linkage, scenario, EVERY_STEP, asking(m), m.n)
    if plain.trajectory is None or asked.trajectory is None:
        yield Check("asking for an acceleration changes nothing", None if plain.status is Status.SKIP else False, asked.message)
        return
    told = "" if asked.answer is not None and np.isfinite(np.asarray(asked.answer, dtype=float)).all() else "it is not finite"
    yield Check("an acceleration is a finite number for each coordinate", not told, told)
    told = "" if _equal(plain.trajectory, asked.trajectory) else "a run goes another way after a question at its start"
    yield Check("asking for an acceleration changes nothing", not told, told)


def _steps(subject: _Subject) -> Iterator[Check]:
    """Steps are counted."""
    if subject.offer.integrators[0] in subject.offer.adaptive:
        yield Check("steps are counted", None, "its first integrator chooses its own steps")
        return
    wanted = len(EVERY_STEP) - 1

    def look(m: Mechanism, x: Trajectory) -> str:
        return "" if x.steps == wanted else f"{x.steps} steps are told, {wanted} of {STEP:g} s were asked for"

    yield from _judged(subject, "steps are counted", look)


def _forces(subject: _Subject) -> Iterator[Check]:
    """Each kind of force acts as defined."""
    text = KINDS.read_text(encoding="utf-8")
    document = tomllib.loads(text)
    loaded = re.search(rf"\[scenarios\.{LOADED}\].*?(?=\n\[scenarios\.(?!{LOADED}))", text, re.DOTALL)
    assert loaded, f"{KINDS} has no scenario {LOADED}"
    kinds = {name: document["forces"][name] for name in document["scenarios"][LOADED]["forces"]}
    alone = [
        re.sub(r"forces = \[.*\]", f"forces = {forces}", loaded[0]).replace(f"scenarios.{LOADED}", f"scenarios.{name}")
        for name, forces in {"none": "[]", **{x: f'["{x}"]' for x in kinds}}.items()
    ]
    file = subject.folder / "kinds.toml"
    file.write_text("\n".join([text, *alone]), encoding="utf-8")
    bare, unloaded = _at_start(subject, str(file), "none"), _truth(str(file), "none")
    for name, force in kinds.items():
        title = f"a {force['type']} acts as defined ({name})"
        acting = _at_start(subject, str(file), name)
        if isinstance(bare, Run) or isinstance(acting, Run):
            lost = bare if isinstance(bare, Run) else acting
            assert isinstance(lost, Run)
            yield Check(title, None if lost.status is Status.SKIP else False, lost.message)
            continue
        true = _truth(str(file), name) - unloaded
        message = effect(acting - bare, true)
        yield Check(title, not message, message)


def effect(measured: Array, true: Array) -> str:
    """What is wrong with a force's effect on the accelerations (n,), or nothing."""
    if np.abs(measured - true).max() <= EFFECT * np.abs(true).max():
        return ""
    factor = float(measured @ true / (true @ true))
    if np.abs(measured).max() <= 1e-6 * np.abs(true).max():
        return "it has no effect"
    if np.abs(measured + true).max() <= EFFECT * np.abs(true).max():
        return "it acts in the opposite direction"
    return f"its effect is {factor:.3g} times what it should be, in the direction that it should have"


def _at_start(subject: _Subject, file: str, scenario: str) -> Array | Run:
    """The engine's acceleration at the start (n,), or the run that did not come to it."""
    m = mechanism_of(file, scenario)
    run = subject.run(file, scenario, np.array([0.0, STEP]), asking(m), m.n)
    return run if run.status is Status.SKIP or run.answer is None else np.asarray(run.answer, dtype=float)[0]


def asking(m: Mechanism) -> Asked:
    """A question for the acceleration at the start of a linkage, which is asked in the worker: (1, n)."""
    return partial(accelerations, np.zeros(1), m.q0[None], m.v0[None])


def _truth(file: str, scenario: str) -> Array:
    m = mechanism_of(file, scenario)
    return get("gauss").build(m, Choice("default", "rk4")).acceleration(0.0, m.q0, m.v0)


def run_before(model: Model) -> None:
    """Let a model run once before it is measured; asked in the worker."""
    model.prepare(EVERY_STEP)
    model.run()
    model.read()


def _equal(one: Trajectory, other: Trajectory) -> bool:
    return all(np.array_equal(getattr(one, x), getattr(other, x)) for x in ("t", "q", "v", "a"))


CHECKS = (_times, _start, _derivatives, _motion, _same_again, _undisturbed, _steps, _forces)
