"""What is run: cases, and the suites they are gathered in."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

from gauss_bench.bench.asked import duration, usable_steps
from gauss_bench.bench.offers import offer
from gauss_bench.engines import COMPILED, OWN, names
from gauss_bench.engines.base import Choice
from gauss_bench.mechanism.load import load

SCENARIOS = {"crank_slider": "paper", "four_bar": "torque", "six_bar": "torque", "eight_bar": "torque"}
REDUNDANT = {"parallelogram": "torque"}
DURATION = 2.0  # [s] headline comparisons end there: by then every linkage has been through its fastest turns


@dataclass(frozen=True, order=True)
class Case:
    """One cell of the table: the key of everything.

    Attributes:
        linkage: name of a built-in linkage, or a path.
        scenario: of that file; "" for its first with a start.
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

    def key(self) -> str:
        """A text that names the case and nothing else."""
        return "|".join(f"{value:g}" if isinstance(value, float) else str(value) for value in asdict(self).values())


def variants(engine: str, integrators: int | None = None) -> list[tuple[str, str, str]]:
    """The (settings, integrator, stabilization) an engine is shown at: its defaults, its best, and what a user would try.

    Every setting with every integrator (or the first few) without stabilisation, and every stabilisation at the defaults. Own
    formulations other than `gauss` and `gauss-native` differ in algebra alone, so their first integrator says all there is to say.
    """
    adapter = offer(engine)
    if not adapter.usable:
        return [("default", "", "none")]  # one row, which says why
    first_setting, first_integrator = next(iter(adapter.settings)), adapter.integrators[0]
    if engine in (*OWN, *COMPILED) and engine not in ("gauss", COMPILED[0]):
        return [(first_setting, first_integrator, "none")]
    crossed = [(s, i, "none") for s in adapter.settings for i in adapter.integrators[:integrators]]
    stabilized = [(first_setting, first_integrator, s) for s in adapter.stabilizations if s != "none"]
    return crossed + stabilized


def crossed(
    linkages: dict[str, str], engines: list[str], steps: tuple[float, ...], t_end: float, integrators: int | None = None
) -> Iterator[Case]:
    """All engines at their variants on all linkages (name or path -> scenario)."""
    for linkage, scenario in linkages.items():
        for engine in engines:
            for settings, integrator, stabilization in variants(engine, integrators):
                used = steps[-1:] if integrator == "dop853" else steps
                for step in used:
                    yield Case(linkage, scenario, engine, settings, integrator, stabilization, step, t_end)


def quick(linkages: dict[str, str] | None = None, engines: list[str] | None = None) -> list[Case]:
    """Every engine on every linkage at three steps over two seconds, with its first two integrators.

    Where no linkages are named, the redundant one at one step: there the question is not how exact, but whether at all.
    """
    headline = crossed(linkages or SCENARIOS, engines or names(), (1e-2, 1e-3, 1e-4), DURATION, 2)
    redundant = {} if linkages else REDUNDANT
    return [*headline, *crossed(redundant, engines or names(), (1e-3,), DURATION, 2)]


def full(linkages: dict[str, str] | None = None, engines: list[str] | None = None) -> list[Case]:
    """The quick suite with every integrator, and the conservative scenarios, where energy is the judge, over five seconds."""
    conservative = {x: "conservative" for x in linkages or SCENARIOS if "conservative" in load(x).scenarios}
    steps = (1e-2, 1e-3, 1e-4)
    headline = crossed(linkages or SCENARIOS, engines or names(), steps, DURATION)
    return [*headline, *crossed(conservative, engines or names(), steps, 5.0)]


def gate(linkages: dict[str, str] | None = None, engines: list[str] | None = None) -> list[Case]:
    """What the accuracy gate runs: two steps, so that the order of convergence shows, over one second."""
    return list(crossed(linkages or SCENARIOS, engines or names(), (1e-2, 1e-3), 1.0, 2))


LISTED = {*SCENARIOS.items(), *REDUNDANT.items()}


def as_asked(cases: list[Case], until: float | None = None, steps: Sequence[float] | None = None) -> list[Case]:
    """The cases with the end and the steps that a user asks for; a linkage that no suite lists runs as long as its scenario says.

    Raises:
        ChoiceError: an end or a step that cannot be used.
    """
    found: dict[Case, None] = {}
    for case in cases:
        listed = (case.linkage, case.scenario) in LISTED
        end = duration(load(case.linkage, case.scenario or None).duration, case.t_end if listed else None, until)
        wanted = usable_steps(steps or (case.step,), end)
        used = wanted[-1:] if case.integrator == "dop853" else wanted
        found |= {replace(case, step=step, t_end=end): None for step in used}
    return list(found)


SUITES = {"quick": quick, "full": full, "gate": gate}
