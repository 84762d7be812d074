"""List the accuracy cases of a suite: each linkage with each engine, setting, integrator, stabilisation and step."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

from gauss_bench.engines import names
from gauss_bench.engines.base import Choice
from gauss_bench.linkage.load import load
from gauss_bench.runs.offers import Offer, duration, offer, usable_steps
from gauss_bench.suites.read import read_suite
from gauss_bench.suites.schema import PLAIN, LeftOut, Suite

# (linkage, scenario) of the cases of two suites, whose runs end as the suite states; other runs end with the scenario
LISTED = {place for name in ("quick", "exhaustive") for part in read_suite(name).accuracy for place in part.linkages.items()}


class Combination(NamedTuple):
    """The names of settings, an integrator and a stabilisation of an engine."""

    settings: str
    integrator: str
    stabilization: str


@dataclass(frozen=True, order=True)
class Case:
    """A case of the accuracy table; its fields are the key of its rows.

    `linkage` is a name or a path; `scenario` is "" for the linkage's first scenario with a start. `step` [s] is the spacing of the
    samples if the integrator chooses its own steps. The run ends at `t_end` [s].
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
        """The setting of the run, as the object that engines accept."""
        return Choice(self.settings, self.integrator, self.stabilization, self.step)


def combinations(
    engine: Offer, integrators: int | Sequence[str] | None = None, plain: bool = False, asked: str | None = None
) -> list[Combination]:
    """Return the combinations of setting, integrator and stabilisation with which an engine is run; the first is the default.

    Every setting is combined with every integrator, without stabilisation; each stabilisation is combined with the default setting
    and the default integrator.

    Args:
        integrators: number of integrators, counted from the first, or their names; None for all.
        plain: whether the only combination is the default one.
        asked: the only setting; None for all.

    Raises:
        ChoiceError: the engine has no setting `asked`.
    """
    if not engine.usable:
        return [Combination("default", "", "none")]  # for a single row, which has the reason
    if asked is not None:
        engine.resolve_settings(asked)
    if integrators is None or isinstance(integrators, int):
        chosen = engine.integrators[:integrators]
    else:
        chosen = tuple(x for x in engine.integrators if x in integrators)
    labels = [*engine.settings] if asked is None else [asked]
    default = Combination(labels[0], (chosen or engine.integrators)[0], "none")
    if plain:
        return [default]
    unstabilised = [Combination(label, integrator, "none") for label in labels for integrator in chosen]
    return unstabilised + [default._replace(stabilization=x) for x in engine.stabilizations if x != "none"]


def cross(
    linkages: Mapping[str, str],
    engines: Sequence[str],
    steps: Sequence[float],
    t_end: float,
    integrators: int | Sequence[str] | None = None,
    plain: Sequence[str] = PLAIN,
    asked: str | None = None,
) -> Iterator[Case]:
    """Yield the cases: every linkage (with its scenario) with every engine, every combination of its options, and every step size.

    Steps [s] are from large to small; an integrator that chooses its own steps is run with the last one. Engines in `plain` are run
    with their defaults, unless a setting is `asked` for. `integrators` and `asked` are as in `combinations`.
    """
    for linkage, scenario in linkages.items():
        for name in engines:
            engine = offer(name)
            for chosen in combinations(engine, integrators, plain=asked is None and name in plain, asked=asked):
                for step in steps[-1:] if chosen.integrator in engine.adaptive else steps:
                    yield Case(linkage, scenario, name, *chosen, step, t_end)


def adapt_cases(chosen: Sequence[Case], until: float | None = None, steps: Sequence[float] | None = None) -> list[Case]:
    """Return the cases of a suite with the end and the steps [s] that a user gives in place of the suite's, without duplicates.

    If the user gives no end, a case ends as its suite states or, if its scenario is not LISTED, at the end of the scenario.

    Raises:
        ChoiceError: the end or a step cannot be used.
    """
    adapted: dict[Case, None] = {}
    scenario_duration = cache(lambda linkage, scenario: load(linkage, scenario or None).duration)
    for case in chosen:
        suite_end = case.t_end if (case.linkage, case.scenario) in LISTED else None
        end = duration(scenario_duration(case.linkage, case.scenario), suite_end, until)
        used = usable_steps(steps or (case.step,), end)
        if case.integrator in offer(case.engine).adaptive:  # it chooses its own steps: one case is enough
            used = used[-1:]
        adapted |= {replace(case, step=step, t_end=end): None for step in used}
    return list(adapted)


def cases(suite: Suite) -> list[Case]:
    """Return the cases of a suite without duplicates, and without those that a rule of `left_out` excludes."""
    distinct: dict[Case, None] = {}
    for part in suite.accuracy:
        engines = part.engines or names()
        distinct |= dict.fromkeys(cross(part.linkages, engines, part.steps, part.until, part.integrators, part.plain))
    return [case for case in distinct if not any(is_left_out(case, rule) for rule in suite.left_out)]


def is_left_out(case: Case, rule: LeftOut) -> bool:
    """Tell whether a rule excludes a case: each field of the rule that is not empty lists the case's value of this field."""
    pairs = (
        (rule.linkages, case.linkage),
        (rule.engines, case.engine),
        (rule.settings, case.settings),
        (rule.integrators, case.integrator),
        (rule.stabilizations, case.stabilization),
        (rule.steps, case.step),
    )
    return all(value in named for named, value in pairs if named)
