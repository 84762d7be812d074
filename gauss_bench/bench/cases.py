"""List the accuracy cases of a suite: each linkage with each engine, setting, integrator, stabilisation and step."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from gauss_bench.engines import names
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import Offer, duration, offer, usable_steps
from gauss_bench.suites.read import read_suite
from gauss_bench.suites.schema import PLAIN, LeftOut, Suite

LISTED = {x for name in ("quick", "exhaustive") for part in read_suite(name).accuracy for x in part.linkages.items()}
Variant = tuple[str, str, str]  # settings, integrator, stabilisation


@dataclass(frozen=True, order=True)
class Case:
    """A case of the accuracy table; its fields are the key of its rows.

    Attributes:
        linkage: name of a built-in linkage, or a path.
        scenario: of that file; "" for the first one that has a start.
        engine, settings, integrator, stabilization: names as the engine offers them.
        step: [s]; where an integrator chooses its own steps, only the spacing of the samples.
        t_end: [s].
    """

    linkage: str
    scenario: str
    engine: str
    settings: str
    integrator: str
    stabilization: str
    step: float
    t_end: float

    @property
    def choice(self) -> Choice:
        return Choice(self.settings, self.integrator, self.stabilization, self.step)


def variants(
    engine: Offer, integrators: int | Sequence[str] | None = None, plain: bool = False, asked: str | None = None
) -> list[Variant]:
    """Return the (settings, integrator, stabilization) under which an engine is run.

    These are every setting with every integrator, without stabilisation, and every stabilisation with the defaults.

    Args:
        integrators: only the first so many integrators, or only those of these names.
        plain: only the defaults of the engine.
        asked: only this setting.

    Raises:
        ChoiceError: the engine has no such settings.
    """
    if not engine.usable:
        return [("default", "", "none")]  # one case, whose row has the reason
    if asked is not None:
        engine.require_settings(asked)
    if integrators is None or isinstance(integrators, int):
        chosen = engine.integrators[:integrators]
    else:
        chosen = tuple(x for x in engine.integrators if x in integrators)
    labels = [*engine.settings] if asked is None else [asked]
    first = (labels[0], (chosen or engine.integrators)[0])
    if plain:
        return [(*first, "none")]
    every = [(s, i, "none") for s in labels for i in chosen]
    return every + [(*first, s) for s in engine.stabilizations if s != "none"]


def cross(
    linkages: Mapping[str, str],
    engines: Sequence[str],
    steps: Sequence[float],
    t_end: float,
    integrators: int | Sequence[str] | None = None,
    plain: Sequence[str] = PLAIN,
    asked: str | None = None,
) -> Iterator[Case]:
    """Yield the cases of all linkages (name or path -> scenario) with all engines, at their variants or at the setting `asked`."""
    for linkage, scenario in linkages.items():
        for name in engines:
            engine = offer(name)
            shown = variants(engine, integrators, name in plain) if asked is None else variants(engine, asked=asked)
            for settings, integrator, stabilization in shown:
                for step in steps[-1:] if integrator in engine.adaptive else steps:
                    yield Case(linkage, scenario, name, settings, integrator, stabilization, step, t_end)


def as_asked(chosen: Sequence[Case], until: float | None = None, steps: Sequence[float] | None = None) -> list[Case]:
    """Return the cases with the end and the steps [s] that a user asks for.

    Without an end, a linkage and scenario that no suite lists runs for the duration of its scenario.

    Raises:
        ChoiceError: the end or a step cannot be used.
    """
    adapted: dict[Case, None] = {}
    scenario_duration = cache(lambda linkage, scenario: load(linkage, scenario or None).duration)
    for case in chosen:
        suite = case.t_end if (case.linkage, case.scenario) in LISTED else None
        end = duration(scenario_duration(case.linkage, case.scenario), suite, until)
        wanted = usable_steps(steps or (case.step,), end)
        used = wanted[-1:] if case.integrator in offer(case.engine).adaptive else wanted
        adapted |= {replace(case, step=step, t_end=end): None for step in used}
    return list(adapted)


def cases(suite: Suite) -> list[Case]:
    """Return the cases of a suite, each once, without those that it leaves out."""
    distinct: dict[Case, None] = {}
    for part in suite.accuracy:
        chosen = part.engines or names()
        distinct |= dict.fromkeys(cross(part.linkages, chosen, part.steps, part.until, part.integrators, part.plain))
    return [case for case in distinct if not any(is_left_out(case, x) for x in suite.left_out)]


def is_left_out(case: Case, rule: LeftOut) -> bool:
    """Tell whether a rule leaves a case out: every field that the rule fills must match."""
    pairs = (
        (rule.linkages, case.linkage),
        (rule.engines, case.engine),
        (rule.settings, case.settings),
        (rule.integrators, case.integrator),
        (rule.stabilizations, case.stabilization),
        (rule.steps, case.step),
    )
    return all(not wanted or value in wanted for wanted, value in pairs)
