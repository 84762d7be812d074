"""The setting of each engine that holds a user's requirements on a linkage: what `gauss-bench recommend --json` prints."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

from gauss_bench.advice.answer import Answer, setting_said
from gauss_bench.advice.budget import LANES, Budget
from gauss_bench.advice.recommending import BEATS, Better, Recommender
from gauss_bench.api.exchange import tell_plainly
from gauss_bench.api.telling import Result, Told, nobody, render
from gauss_bench.bench.ways import Run, space
from gauss_bench.engines import COMPILED, DERIVED, FOREIGN, OWN, all_names
from gauss_bench.engines.base import Choice, Variant
from gauss_bench.exchange.snippets import WRITERS, holds, snippet
from gauss_bench.linkage.load import load
from gauss_bench.reach import UNITS
from gauss_bench.runs.offers import ChoiceError, Offer, check_budget, duration, offers
from gauss_bench.runs.worker import WorkerFailure

BUDGET = 60.0  # [s]
FIRST = ("dop853_fixed", "rk4", "dop853")  # integrators that answer early, of an engine that names no variants


@dataclass(frozen=True, eq=False)
class Recommendation(Result):
    """For every engine the cheapest setting that holds the requirement, or why there is none.

    Attributes:
        mechanism, scenario: what was run; until: how long [s].
        required: kind -> the largest error that is allowed [m], [rad], [N]; settings hold half of it.
        truth: how the motion is known that errors are measured against; certified: whether by a certificate.
        known: kind -> how far that may be off [m], [rad], [N].
        answers: from the fastest engine on; then those that do not hold it.
        advice: one sentence.
        remarks: what has to be known besides.
        complete: whether every variant of every engine was tried to its end.
    """

    mechanism: str
    scenario: str
    until: float
    required: Mapping[str, float]
    truth: str
    certified: bool
    known: Mapping[str, float]
    answers: tuple[Answer, ...]
    advice: str
    remarks: tuple[str, ...]
    complete: bool

    @property
    def succeeded(self) -> bool:
        return any(x.status == "ok" for x in self.answers)

    @property
    def text(self) -> str:  # type: ignore[override]
        settings = [setting_of(x) if x.status == "ok" else "" for x in self.answers]
        return render("recommend", self, units=UNITS, said=settings)


def recommend(
    linkage: str,
    position: float | None = None,
    angle: float | None = None,
    force: float | None = None,
    until: float | None = None,
    engines: Sequence[str] | None = None,
    scenario: str | None = None,
    settings: str | None = None,
    budget: float | None = None,
    told: Told = nobody,
    better: Better = lambda answer: None,
) -> Recommendation:
    """The cheapest setting of each engine whose error over the whole run is at most half of what is required.

    Candidates and their errors are the same in every run; only what the budget leaves untried depends on the clock, and who is
    faster of those that hold.

    Args:
        linkage: name of a built-in linkage, or a path.
        position, angle, force: the largest error that is allowed of any link's centre of mass [m] or angle [rad], or of any joint's
            force [N]; at least one of them, and all that are given hold together.
        until: end of the run [s]; the scenario's duration where not given.
        engines: names; all where not given.
        scenario: of the file; the first with a start where not given.
        settings: of the only engine that is asked, as in `simulate`: which step holds with them.
        budget: seconds that all of it may take (60), but for those in which others had the processor; however busy the machine,
            it ends after 1.45 times as many by the clock on the wall.
        told: is told how far things are, a sentence at a time.
        better: is given an answer of an engine as soon as there is one, and every one that needs less work; not raced yet.

    Raises:
        LinkageError: the file has faults.
        ChoiceError: a requirement, time or setting that cannot be used.
        KeyError: unknown engine.
        NoTruth: the motion is not known well enough to judge by.
    """
    wanted = list_requirements(position=position, angle=angle, force=force)
    seconds = Budget(check_budget(budget, BUDGET))
    mechanism = load(linkage, scenario)
    end = duration(mechanism.duration, until=until)
    offered = offers(list(dict.fromkeys(engines)) if engines else order_kinds())
    if settings is not None and len(offered) != 1:
        raise ChoiceError("settings are those of one engine: name it with --engine")
    spaces = {x.name: variants(x, settings) for x in offered}
    run = Run(linkage, mechanism, end)
    with Recommender(run, wanted, spaces, seconds, told, better) as recommender:
        searched = recommender.search()
        answers = recommender.answers(recommender.race())
        with ThreadPoolExecutor(LANES) as lanes:
            answers = list(lanes.map(lambda x: with_snippet(recommender, x), answers))
    return Recommendation(
        mechanism=mechanism.name,
        scenario=mechanism.scenario,
        until=end,
        required=wanted,
        truth=searched.truth.told,
        certified=searched.truth.certified,
        known=searched.truth.bars,
        answers=tuple(answers),
        advice=advice(answers, wanted),
        remarks=tuple(remarks(run, answers)),
        complete=all(x.complete for x in answers),
    )


def with_snippet(recommender: Recommender, answer: Answer) -> Answer:
    """The answer with its program, or with why there is none; where the engine is, if it needs its library to be written."""
    if answer.status != "ok":
        return answer
    run, limits = recommender.run, " and ".join(f"{x:g} {UNITS[kind]}" for kind, x in recommender.wanted.items())
    errors = " and ".join(f"{answer.errors[kind]:.1e} {UNITS[kind]}" for kind in recommender.wanted)
    remark = f"Holds {limits} over {run.until:g} s: {errors} with {answer.engine}, {setting_of(answer)}."
    choice = (answer.settings, answer.integrator, answer.stabilization, answer.step or run.until / BEATS, answer.tolerance)
    arguments = (run.linkage, run.mechanism.scenario, answer.engine, choice, run.until, remark)
    try:
        needs_library = answer.engine in WRITERS
        program = recommender.asked(answer.engine, snippet_there, arguments) if needs_library else snippet_there(*arguments)
    except WorkerFailure as failure:
        program = {"refused": str(failure)}
    match program:
        case {"text": str(text)}:
            return replace(answer, snippet=text)
        case {"refused": str(reason)} | {"missing": str(reason)}:
            return replace(answer, message="; ".join(filter(None, (answer.message, reason))))
    return answer


def snippet_there(linkage: str, scenario: str, engine: str, choice: Sequence[Any], until: float, remark: str) -> dict[str, Any]:
    """`snippet` as plain data."""
    mechanism = replace(load(linkage, scenario), duration=until)
    return tell_plainly(lambda: {"text": snippet(mechanism, linkage, engine, Choice(*choice), until, (remark,))})


def list_requirements(**limits: float | None) -> dict[str, float]:
    """The requirements, by kind.

    Raises:
        ChoiceError: nothing is, or an error that is no positive number.
    """
    wanted = {kind: x for kind, x in limits.items() if x is not None}
    if not wanted:
        raise ChoiceError("say what is required: --position, --angle or --force")
    for kind, x in wanted.items():
        if not (math.isfinite(x) and x > 0):
            raise ChoiceError(f"the {kind} error that is allowed must be a positive number of {UNITS[kind]}, not {x:g}")
    return wanted


def order_kinds() -> list[str]:
    """All engines, those first that answer first."""
    first, last = [*COMPILED, *DERIVED, *FOREIGN], [*OWN]
    return [*first, *(x for x in all_names() if x not in first + last), *last]


def variants(engine: Offer, settings: str | None = None) -> list[Variant]:
    """The variants of an engine that are tried, in order."""
    if not engine.usable:
        return []
    if settings is not None:
        options = engine.resolve_settings(settings)
        tried = [Variant(settings, i, s, options) for i in engine.integrators for s in engine.stabilizations]
    else:
        tried = space(engine)
    tried = [x for x in tried if holds(engine.name, x.integrator, x.stabilization, str(x.options.get("code", "")))]

    def rank(x: Variant) -> tuple[int, bool]:
        if engine.first:
            return engine.first.index(x.name) if x.name in engine.first else len(engine.first), False
        return FIRST.index(x.integrator) if x.integrator in FIRST else len(FIRST), x.stabilization != "none"

    return sorted(tried, key=rank)


def remarks(run: Run, answers: Sequence[Answer]) -> list[str]:
    """Sentences on what the answers do not say: that motion is prescribed, and of which engines not every variant was tried."""
    sentences = []
    if run.mechanism.drivers:
        names = ", ".join(d.name for d in run.mechanism.drivers)
        free = "nothing is left to move freely" if run.mechanism.dof == len(run.mechanism.drivers) else "the rest moves freely"
        sentences.append(f"the motion of {names} is prescribed, {free}: errors tell how well engines follow it")
    for x in answers:
        if x.loops:
            told = ", ".join(f"{loop} {times:.3g}" for loop, times in x.loops.items())
            sentences.append(f"{x.engine} by who runs its loop, in times of the fastest engine: {told}")
        if x.in_python and x.engine not in OWN:
            sentences.append(f"the time of {x.engine} holds of this suite's own in Python: {x.in_python}")
    short = [x.engine for x in answers if not x.complete]
    if short:
        sentences.append(f"time ended before every variant was tried of {', '.join(short)}: a larger --budget may find better ones")
    return sentences


def advice(answers: Sequence[Answer], wanted: Mapping[str, float]) -> str:
    """One sentence to act on."""
    limit, more = " and ".join(f"{x:g} {UNITS[kind]}" for kind, x in wanted.items()), "raise --budget or the limit"
    held = [x for x in answers if x.status == "ok"]
    if not held:
        near = [x for x in answers if x.errors]
        if not near:
            return f"No engine runs this linkage within the budget: raise --budget, or see the reasons above for {limit}."
        best = min(near, key=lambda x: max(x.errors.get(k, math.inf) / y for k, y in wanted.items()))
        came = " and ".join(f"{best.errors[k]:.1e} {UNITS[k]}" for k in wanted if k in best.errors)
        return f"No setting holds half of {limit} within the budget; {best.engine} is nearest with {came}: {more}."
    best = held[0]
    errors = " and ".join(f"{best.errors[k]:.1e} {UNITS[k]}" for k in wanted)
    takes = "" if best.seconds is None else f" in {duration_of(best.seconds)} a run"
    others = [x for x in held[1:] if x.engine in FOREIGN and x.ratio is not None]
    than = f"; of other libraries {others[0].engine} comes next, {others[0].ratio:.3g} times as long" if others else ""
    return f"Take {best.engine} with {setting_of(best)}: it holds {limit} with {errors}{takes}{than}."


def setting_of(answer: Answer) -> str:
    """A setting in words."""
    size = f"tolerance {answer.tolerance:.2g}" if answer.step is None else f"step {answer.step:.4g} s"
    return f"{setting_said(answer.settings, answer.integrator, answer.stabilization)}, {size}"


def duration_of(seconds: float) -> str:
    """Seconds in the unit that suits them."""
    scale, unit = next(((x, u) for x, u in ((1.0, "s"), (1e-3, "ms")) if seconds >= x), (1e-6, "us"))
    return f"{seconds / scale:.3g} {unit}"
