"""Find the cheapest setting of each engine that meets a user's accuracy requirements.

The result is the object that `gauss-bench recommend --json` prints.
"""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from gauss_bench.advice.answer import Answer, format_errors, format_limits, format_setting
from gauss_bench.advice.budget import LANES, Budget
from gauss_bench.advice.recommending import WRITTEN, Better, Recommender
from gauss_bench.api.program_error import describe_error, describe_reference
from gauss_bench.api.programs import write_program
from gauss_bench.api.telling import Result, Told, nobody, render
from gauss_bench.bench.ways import Run, space
from gauss_bench.engines import COMPILED, DERIVED, ELSEWHERE, FOREIGN, OWN, SAFE, all_names
from gauss_bench.engines.authors import candidates_of, read_settings
from gauss_bench.engines.base import Variant
from gauss_bench.exchange.errors import ExchangeError
from gauss_bench.exchange.export import can_export
from gauss_bench.linkage.load import built_in, find, load
from gauss_bench.reach import BY_AUTHORS, UNITS
from gauss_bench.runs.offers import ChoiceError, Offer, check_budget, check_positive, duration, offers
from gauss_bench.runs.worker import WorkerFailure
from gauss_bench.trajectory import RunFailure

BUDGET = 60.0  # [s] default of the time for the whole search
FIRST = ("dop853_fixed", "rk4", "dop853")  # integrators that are tried first if an engine does not name its first variants


@dataclass(frozen=True, eq=False)
class Recommendation(Result):
    """The cheapest setting of every engine that meets the accuracy requirement, or the reason why none does.

    Attributes:
        mechanism, scenario: names of the linkage and scenario; until: end of the run [s].
        required: kind of error -> largest allowed error [m], [rad], [N]. A setting is accepted only if its measured errors are at
            most half of the allowed ones.
        truth: how the reference motion was made; certified: whether a certificate confirms the reference.
        known: kind of error -> error bar of the reference [m], [rad], [N].
        answers: one answer per engine. First come the accurate settings that were timed, the fastest first, then the accurate
            settings that were not timed, and then the engines without an accurate setting.
        advice: the advice in one sentence.
        remarks: sentences on limits of the answers.
        complete: whether every variant of every engine was tried.
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
        return render("recommend", self, units=UNITS, settings=settings, recommended=recommended_answer(self.answers))


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
    authors: Sequence[str | Path] = (),
) -> Recommendation:
    """Find the cheapest setting of each engine whose error over the whole run is at most half of the requirement.

    The candidate settings and their errors are the same in every call with the same arguments. Two things depend on the clock:
    which candidates are not tried within the budget, and which of the accurate settings is the fastest.

    Args:
        linkage: name of a built-in linkage, or a path.
        position, angle, force: largest allowed error of any link's centre of mass [m] or angle [rad], or of any joint force [N]. At
            least one limit is needed, and a setting must meet all limits that are given.
        until: end of the run [s]; by default the scenario's duration.
        engines: names of engines; by default all.
        scenario: name of a scenario; by default the first one that gives the motion a start.
        settings: settings of a single engine, as in `simulate`; the search then varies integrator, stabilization and step.
        budget: longest time of the whole call [s]; by default 60. Time in which other programs had the processor is not counted,
            but the elapsed time is at most 1.45 times the budget. The program of the recommended setting is written even if the
            budget is used up.
        told: function that is called with each sentence of progress.
        better: function that is called with the first answer of an engine and with every cheaper one, before settings are timed.
        authors: files of settings that engines' authors have contributed. These settings get an answer of their own beside the
            answer with the suite's settings for the same engine.

    Raises:
        LinkageError: the linkage file has faults.
        SettingsFault: a file of settings has faults.
        ChoiceError: a requirement, time or setting cannot be used.
        KeyError: an engine is unknown.
        NoTruth: no reference is accurate enough.
    """
    wanted = list_requirements(position=position, angle=angle, force=force)
    seconds = Budget(check_budget(budget, BUDGET))
    mechanism = load(linkage, scenario)
    end = duration(mechanism.duration, until=until)
    offered = offers(engines or order_engines())
    if settings is not None and len(offered) != 1:
        raise ChoiceError("settings are those of one engine: name it with --engine")
    if settings is not None and authors:
        raise ChoiceError("--settings tries only these settings, and --authors adds others: give one of them")
    spaces = {x.name: list_variants(x, settings) for x in offered}
    owned = list_owned([x.name for x in offered], authors) if settings is None else {}
    run = Run(linkage, mechanism, end)
    with Recommender(run, wanted, spaces, seconds, told, better, owned) as recommender:
        truth = recommender.search()
        answers = recommender.answers(recommender.race())
        best = recommended_answer(answers)
        # [s] for writing each program if the budget is used up
        least = [WRITTEN if x is best else 1.0 for x in answers]
        with ThreadPoolExecutor(LANES) as lanes:
            answers = list(lanes.map(partial(with_snippet, recommender), answers, least))
    return Recommendation(
        mechanism=mechanism.name,
        scenario=mechanism.scenario,
        until=end,
        required=wanted,
        truth=truth.description,
        certified=truth.certified,
        known=truth.bars,
        answers=tuple(answers),
        advice=write_advice(answers, wanted),
        remarks=tuple(list_remarks(run, answers)),
        complete=all(x.complete for x in answers),
    )


def with_snippet(recommender: Recommender, answer: Answer, least: float) -> Answer:
    """Return an answer with the program that runs the answer's setting, or with the reason why no program can be written.

    If writing the program needs the engine's library, the engine's worker process writes it, and has at least `least` seconds even
    if the budget is used up.
    """
    if answer.status != "ok":
        return answer
    run, errors = recommender.run, format_errors(answer.errors, recommender.wanted)
    remarks = [
        f"Holds {format_limits(recommender.wanted)} over {run.until:g} s: {errors} with {answer.engine}, {setting_of(answer)}."
    ]
    reference = recommender.truth
    if reference is not None:
        remarks.append(describe_error(answer.errors["position"], answer.errors["angle"]))
        remarks.append(describe_reference(reference.description, reference.bar))
    call = partial(recommender.call_worker, answer.engine, least=least)
    mechanism = replace(run.mechanism, duration=run.until)
    try:
        source = find(run.linkage)  # a user's file gets its whole path, so that the program finds it from any folder
        linkage = str(source.resolve()) if source.is_file() and run.linkage not in built_in() else run.linkage
        text = write_program(call, linkage, mechanism, answer.engine, answer.choose(run.until), tuple(remarks))
    except (ExchangeError, ImportError, RunFailure, WorkerFailure) as reason:
        return replace(answer, message="; ".join(filter(None, (answer.message, str(reason)))))
    return replace(answer, snippet=text)


def list_requirements(**limits: float | None) -> dict[str, float]:
    """Return kind of error ("position", "angle", "force") -> largest allowed error, without the limits that are None.

    Raises:
        ChoiceError: all limits are None, or a limit is not a positive number.
    """
    wanted = {kind: x for kind, x in limits.items() if x is not None}
    if not wanted:
        raise ChoiceError("say what is required: --position, --angle or --force")
    for kind, x in wanted.items():
        check_positive(f"the {kind} error that is allowed", x, f" of {UNITS[kind]}")
    return wanted


def list_owned(engines: Sequence[str], files: Sequence[str | Path]) -> dict[str, list[Variant]]:
    """Return name of an engine -> settings that the engine's authors have contributed.

    The settings are those of the given files and those that the suite includes. Engines without contributed settings are left out.

    Raises:
        ChoiceError: a file is for an engine that is not among `engines`.
        SettingsFault: a file has faults.
    """
    for path in files:
        name = read_settings(Path(path)).engine
        if name not in engines:
            raise ChoiceError(f"{path}: engine: {name} is not among the engines of this search, {', '.join(engines)}")
    owned = {name: candidates_of(name, files) for name in engines}
    return {name: candidates for name, candidates in owned.items() if candidates}


def order_engines() -> list[str]:
    """Return the names of all engines, with the slow ones last: the suite's own formulations in Python."""
    first, last = [*COMPILED, *DERIVED, *FOREIGN], [*OWN]
    return [*first, *(x for x in all_names() if x not in first + last), *last]


def list_variants(engine: Offer, settings: str | None = None) -> list[Variant]:
    """Return the variants of an engine, or those with the given settings, in the order in which the search tries them."""
    if not engine.usable:
        return []
    if settings is not None:
        options = engine.resolve_settings(settings)
        tried = [Variant(settings, i, s, options) for i in engine.integrators for s in engine.stabilizations]
    else:
        tried = space(engine)
    # only variants for which `export` can write a program
    tried = [x for x in tried if can_export(engine.name, x.integrator, x.stabilization, str(x.options.get("code", "")))]

    def rank(x: Variant) -> tuple[int, bool]:
        """Return the sort key of a variant: its place in the engine's own order, if the engine has one.

        Otherwise the key is the place of the integrator in FIRST, with variants without stabilization before the others.
        """
        if engine.first:
            return place_in(engine.first, x.name), False
        return place_in(FIRST, x.integrator), x.stabilization != "none"

    return sorted(tried, key=rank)


def place_in(names: Sequence[str], name: str) -> int:
    """Return the index of a name in `names`; a name that is not in `names` comes after all of them."""
    return names.index(name) if name in names else len(names)


def list_remarks(run: Run, answers: Sequence[Answer]) -> list[str]:
    """Return sentences on limits of the answers: prescribed motion, loops in Python, and variants that were not tried."""
    sentences = []
    if run.mechanism.drivers:
        names = ", ".join(d.name for d in run.mechanism.drivers)
        free = "and no freedom is left" if run.mechanism.dof == len(run.mechanism.drivers) else "and the rest moves freely"
        sentences.append(f"the motion of {names} is prescribed {free}: errors tell how well engines follow it")
    for x in answers:
        if x.loops:
            ratios = ", ".join(f"{loop} {ratio:.3g}" for loop, ratio in x.loops.items())
            sentences.append(f"run time of {x.engine} / that of the fastest engine, by the program that runs the steps: {ratios}")
        # SAFE, ELSEWHERE: engines with adapters of this suite; other adapters are plug-ins
        if x.in_python and x.engine not in OWN:
            code = "Python code of this suite" if x.engine in (*SAFE, *ELSEWHERE) else "Python code besides its library"
            sentences.append(f"the time of {x.engine} includes {code}: {x.in_python}")
    incomplete = ", ".join(dict.fromkeys(x.engine for x in answers if not x.complete))
    if incomplete:
        sentences.append(f"the budget ended before all variants of {incomplete} were tried: a larger --budget may find better ones")
    return sentences


def recommended_answer(answers: Sequence[Answer]) -> Answer | None:
    """Return the recommended answer: the fastest timed one, else the first accurate one; None if no setting is accurate."""
    accurate = [x for x in answers if x.status == "ok"]
    timed = [x for x in accurate if x.ratio is not None]
    return next(iter(timed or accurate), None)


def write_advice(answers: Sequence[Answer], wanted: Mapping[str, float]) -> str:
    """Return the advice: which setting to take, or what to do if none meets the requirement; `answers` has the fastest first."""
    best = recommended_answer(answers)
    if best is None:
        return advise_without(answers, wanted)
    time = " (no setting was raced)" if best.seconds is None else f" in {format_duration(best.seconds)} a run"
    libraries = [x for x in answers if x is not best and x.engine in (*FOREIGN, *ELSEWHERE) and x.ratio is not None]
    next_best = f"; the next library, {libraries[0].engine}, takes {libraries[0].ratio:.3g} times as long" if libraries else ""
    unraced = [x.engine for x in answers if x is not best and x.status == "ok" and x.ratio is None]
    more = f" Accurate, not raced: {', '.join(unraced)}." if unraced and best.ratio is not None else ""
    errors = format_errors(best.errors, wanted)
    return f"Take {best.engine} with {setting_of(best)}: it holds {format_limits(wanted)} with {errors}{time}{next_best}.{more}"


def advise_without(answers: Sequence[Answer], wanted: Mapping[str, float]) -> str:
    """Return the advice if no setting meets the requirement.

    The advice names the engine whose errors come nearest to the requirement. If no engine has errors, the advice says that no run
    ended in time, or that no engine can run the linkage. Accepted errors are at most half of the allowed ones, because the error of
    the reference may add to them.
    """
    limit, remedy = format_limits(wanted), "raise --budget or the limit"
    with_errors = [x for x in answers if x.errors]
    if with_errors:
        nearest = min(with_errors, key=lambda x: max(x.errors.get(k, math.inf) / y for k, y in wanted.items()))
        errors = format_errors(nearest.errors, wanted)
        return f"No setting holds half of {limit} within the budget; {nearest.engine} is nearest with {errors}: {remedy}."
    if any(x.status == "not tried" for x in answers):
        return (
            f"Whether {limit} can be held is unknown, because no run ended within the budget: see the reasons above, or {remedy}."
        )
    return f"No engine runs this linkage, so none holds {limit}: see the reasons above."


def setting_of(answer: Answer) -> str:
    """Return the setting that was recommended for an engine, as text."""
    words = format_setting(answer.settings, answer.integrator, answer.stabilization, answer.step, answer.tolerance)
    return f"{words}, {BY_AUTHORS}" if answer.owner else words


def format_duration(seconds: float) -> str:
    """Return a duration [s] as text in s, ms or us."""
    if seconds >= 1.0:
        return f"{seconds:.3g} s"
    return f"{seconds * 1e3:.3g} ms" if seconds >= 1e-3 else f"{seconds * 1e6:.3g} us"
