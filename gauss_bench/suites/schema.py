"""The sections and fields of a suite file: one class for each section."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

FORMAT = "gauss-bench-suite/1"
# engines that differ from others in algebra alone, so that one integrator is enough
PLAIN = ("gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16", "lagrange-native")

Linkages = Mapping[str, str]  # name or path -> scenario
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, gt=0)]
Flag = Annotated[bool, Field(strict=True)]


class Section(BaseModel):
    """A section of a suite; an unknown field is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class OnLinkages(Section):
    """A part of a suite that lists linkages.

    Attributes:
        linkages: name of a linkage, or path of its file relative to the suite's folder -> scenario.
        any_linkage: whether the part is run for any linkage that a user names; else it is run for the listed ones alone.
    """

    linkages: Linkages
    any_linkage: Flag = False


class Accuracy(OnLinkages):
    """Runs whose trajectories are judged: engines with their settings, integrators and stabilisations, at several steps.

    Attributes:
        engines: names; empty for all engines.
        integrators: a number n for the first n integrators of each engine, or names of integrators; None for all.
        plain: engines that are run with their defaults only.
        steps: [s], from large to small.
        until: end of the runs [s].
    """

    engines: tuple[str, ...] = ()
    integrators: Count | tuple[str, ...] | None = None
    plain: tuple[str, ...] = PLAIN
    steps: tuple[Positive, ...] = Field(min_length=1)
    until: Positive


class LeftOut(Section):
    """Cases of the suite's accuracy parts that are not run, with the reason that the report gives.

    A case matches if each field here is empty or contains the case's own value.

    Attributes:
        linkages, engines, settings, integrators, stabilizations: names that match.
        steps: steps [s] that match.
        why: the reason, in a sentence.
    """

    linkages: tuple[str, ...] = ()
    engines: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    integrators: tuple[str, ...] = ()
    stabilizations: tuple[str, ...] = ()
    steps: tuple[Positive, ...] = ()
    why: str = Field(min_length=10)


class Cost(OnLinkages):
    """The race of a linkage, which times all its engines interleaved.

    Attributes:
        engines: names; empty for all engines.
        integrators: a number n for the first n integrators of each engine; None for all.
        plain: engines that are timed with their defaults only.
        step: length of the timed steps [s].
        processes: number of processes that race, one after the other.
        rounds: number of rounds in each process.
        batch: engines whose steps of many trajectories at once are timed too.
        bare: engines whose bare library call and empty call are timed too.
        processor: whether the processor's latency and rate are timed too.
    """

    engines: tuple[str, ...] = ()
    integrators: Count | None = None
    plain: tuple[str, ...] = ()
    step: Positive
    processes: Count = 1
    rounds: Count
    batch: tuple[str, ...] = ()
    bare: tuple[str, ...] = ()
    processor: Flag = False


class ColdBuilds(OnLinkages):
    """Cold builds: the first model of an engine in a new process, and its first step.

    Attributes:
        engines: names.
        step: length of the step [s].
    """

    engines: tuple[str, ...]
    step: Positive


class Steps(Section):
    """Ratios of the times of a step, each engine in its own loop: compiled formulations against a rival, timed side by side.

    Attributes:
        own: formulation -> engine.
        stabilizations: names of the compiled formulations' stabilisations.
        rival: the engine that they are compared with.
        settings: names of the rival's settings.
        targets: stabilisation -> linkage -> least ratio, for the first formulation of `own`.
    """

    own: Mapping[str, str]
    stabilizations: tuple[str, ...]
    rival: str
    settings: tuple[str, ...]
    targets: Mapping[str, Mapping[str, Positive]] = {}


class Claim(OnLinkages):
    """The claim that n - m unknowns are cheaper than n + m.

    Attributes:
        compiled: the engines with n - m and with n + m unknowns.
        step: length of the timed steps [s].
        rounds: number of rounds in each process.
        processes: number of processes, each with a race on every linkage.
    """

    compiled: tuple[str, str]
    step: Positive
    rounds: Count
    processes: Count


class RightHandSide(Section):
    """Ratios of the times of one right-hand side, from engines that are timed side by side.

    Attributes:
        own, rival: the compiled engine and its rival.
        settings: names of the rival's settings.
        target: least ratio of the rival's time to that of the compiled engine, if each calls it in its own loop.
        target_of: names of the linkages with this target.
    """

    own: str
    rival: str
    settings: tuple[str, ...]
    target: Positive
    target_of: tuple[str, ...]


class Bounds(Section):
    """The time of an engine's steps compared with the processor's limits, computed from the races.

    Attributes:
        own: the engine.
    """

    own: str


class Agreement(OnLinkages):
    """Comparison of the accelerations of compiled formulations with those in numpy.

    Attributes:
        states: number of random states.
        target: largest relative difference.
    """

    states: Count
    target: Positive


class Method(Section):
    """An engine with its settings, integrator and stabilisation.

    Attributes:
        engine, settings, integrator, stabilization: names, as on the command line.
    """

    engine: str
    settings: str = "default"
    integrator: str = "rk4"
    stabilization: str = "none"


class Search(OnLinkages):
    """The search, among all variants of each engine, for the cheapest setting that holds a requirement over the whole run.

    Attributes:
        engines: names; empty for all engines except the formulations in numpy.
        own: engines whose cheapest setting is the denominator of ratios.
        until: end of the runs [s]; a shorter scenario ends earlier.
        position, angle, force: requirements, each a largest error [m], [rad], [N].
        end: requirements on the error of positions at the last sample [m].
        budget: most evaluations of one variant on one linkage.
        most_steps: most steps of a run.
        steps_of: engine -> most steps of a run, for engines whose methods have a low order.
        processes: number of processes that race, one after the other.
        rounds: number of rounds in each process.
        lead: time of a run at equal steps that is timed [s]; the time of a longer run is extrapolated.
        aims: engine -> least ratio of the time of its cheapest setting to that of the cheapest own setting.
        aimed: requirements on positions [m] at which `aims` count.
        authors: paths of files of settings by engines' authors, besides those in the engines' folders.
        brief: whether only the variants that an engine tries first are searched, and the formulations in numpy too.
    """

    engines: tuple[str, ...] = ()
    own: tuple[str, ...]
    until: Positive
    position: tuple[Positive, ...] = ()
    angle: tuple[Positive, ...] = ()
    force: tuple[Positive, ...] = ()
    end: tuple[Positive, ...] = ()
    budget: Count
    most_steps: Count
    steps_of: Mapping[str, Count] = {}
    processes: Count = 7
    rounds: Count
    lead: Positive
    aims: Mapping[str, Positive] = {}
    aimed: tuple[Positive, ...] = ()
    authors: tuple[str, ...] = ()
    brief: Flag = False


class SameQuestions(OnLinkages):
    """The same questions to every engine: whether a run repeats bit by bit, joint forces, start and size.

    Attributes:
        engines: names; empty for all engines, including those that can be installed and are not.
        redundant: linkages with redundant rows, whose accuracy cases the table shows too.
        step, until: step and end of the runs [s].
        processes: number of starts of each engine.
        position: requirements [m] at which the table shows the cost of each engine's cheapest setting.
    """

    engines: tuple[str, ...] = ()
    redundant: Linkages = {}
    step: Positive
    until: Positive
    processes: Count = 3
    position: tuple[Positive, ...]


class Batch(OnLinkages):
    """Times of many trajectories that are computed at once.

    Attributes:
        states: number of trajectories.
        step: length of a step [s].
        step_count: number of steps of each trajectory.
        own, rival: the compiled engine and its rival.
        settings: the rival's settings.
        rival_step_count: number of steps of the rival's trajectories, which may be fewer because the time of one step counts.
        processes: number of processes that race, one after the other.
        rounds: number of rounds in each process.
        targets: linkage -> least ratio.
    """

    states: Count
    step: Positive
    step_count: Count
    own: str
    rival: str
    settings: str
    rival_step_count: Count
    processes: Count = 1
    rounds: Count
    targets: Mapping[str, Positive] = {}


class Growth(Section):
    """Times of right-hand sides against the number of loops.

    Attributes:
        sizes: numbers of windows of the N-four-bar.
        rounds: number of rounds of a race.
        processes: number of processes; each races once at every size.
        large: least size to which exponents are fitted.
    """

    sizes: tuple[Count, ...]
    rounds: Count
    processes: Count = 1
    large: Count


class LongRuns(OnLinkages):
    """Drift and energy of long runs with projection.

    Attributes:
        duration: of the runs [s].
        step: of the first run [s]; a second run takes half the step.
        drift: largest residual of positions [m, rad] and velocities [m/s, rad/s].
        order, margin: least order of the energy's error is order - margin.
    """

    duration: Positive
    step: Positive
    drift: Positive
    order: Positive
    margin: Positive


class Turns(OnLinkages):
    """Times of compiled kinematics over a turn.

    Attributes:
        samples: number of positions of a turn.
        rounds: number of rounds of a race.
        processes: number of processes that race, one after the other.
        targets: linkage -> least number of positions per second.
        error: largest relative error.
    """

    samples: Count
    rounds: Count
    processes: Count = 1
    targets: Mapping[str, Positive] = {}
    error: Positive


class Geometry(OnLinkages):
    """Comparison of three independent methods of kinematics, and searches for the assembly.

    Attributes:
        searched: names of the linkages whose assembly is searched for.
    """

    searched: tuple[str, ...] = ()


class Driving(OnLinkages):
    """Errors of the torque that drives a linkage through a turn.

    Attributes:
        step: of the runs [s].
        ways: engines with their settings.
    """

    step: Positive
    ways: tuple[Method, ...]


class Papers(Section):
    """Tables about the papers and published values.

    Attributes:
        tables: their names.
    """

    tables: tuple[Literal["audit", "reproduction", "published", "paper_motion"], ...]


class Certificates(Section):
    """The table of certificates.

    Attributes:
        table: its name.
    """

    table: Literal["certificates"] = "certificates"


class Suite(Section):
    """A whole suite. A section may occur several times; the sections of the suites named in `with` come first.

    Attributes:
        format: edition of the grammar of suites.
        title: for the report.
        parts: names of suites to build on, or paths of their files; the key in a file is `with`.
        hours: within which the suite ends on two idle cores; an interrupted run can be resumed.
    """

    format: Literal["gauss-bench-suite/1"]
    title: str
    hours: Positive | None = None
    parts: tuple[str, ...] = Field(default=(), alias="with")
    accuracy: tuple[Accuracy, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    cost: tuple[Cost, ...] = ()
    cold_builds: tuple[ColdBuilds, ...] = ()
    steps: tuple[Steps, ...] = ()
    claim: tuple[Claim, ...] = ()
    right_hand_side: tuple[RightHandSide, ...] = ()
    bounds: tuple[Bounds, ...] = ()
    agreement: tuple[Agreement, ...] = ()
    search: tuple[Search, ...] = ()
    field: tuple[SameQuestions, ...] = ()
    batch: tuple[Batch, ...] = ()
    growth: tuple[Growth, ...] = ()
    long_runs: tuple[LongRuns, ...] = ()
    turns: tuple[Turns, ...] = ()
    geometry: tuple[Geometry, ...] = ()
    driving: tuple[Driving, ...] = ()
    papers: tuple[Papers, ...] = ()
    certificates: tuple[Certificates, ...] = ()
