"""The sections and fields of a suite file: one class for each section."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

FORMAT = "gauss-bench-suite/1"
PLAIN = ("gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16", "lagrange-native")

Linkages = Mapping[str, str]  # name -> scenario
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, gt=0)]
Flag = Annotated[bool, Field(strict=True)]


class Section(BaseModel):
    """A section of a suite; an unknown field is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class OnLinkages(Section):
    """A part about linkages.

    Attributes:
        linkages: name of a linkage, or path of its file relative to the suite's folder -> scenario.
        any_linkage: whether the part is run for any linkage that a user names; else only for those that it lists.
    """

    linkages: Linkages
    any_linkage: Flag = False


class Accuracy(OnLinkages):
    """Runs judged by their trajectories: engines x their variants x steps.

    Attributes:
        engines: names; empty for all engines.
        integrators: the first so many of each engine, or those of these names; None for all.
        plain: engines that are run with their defaults only, because they differ from others in algebra, not in integration.
        steps: [s], from large to small.
        until: [s] end of the runs.
    """

    engines: tuple[str, ...] = ()
    integrators: Count | tuple[str, ...] | None = None
    plain: tuple[str, ...] = PLAIN
    steps: tuple[Positive, ...] = Field(min_length=1)
    until: Positive


class LeftOut(Section):
    """Cases of the suite's accuracy parts that are not run, with the reason that the report gives.

    A field that is empty matches everything.

    Attributes:
        linkages, engines, settings, integrators, stabilizations: names that match.
        steps: [s] that match.
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
        integrators: the first so many of each engine; None for all.
        plain: engines that are timed with their defaults only.
        step: [s] of the steps that are timed.
        processes: that race, one after the other.
        rounds: of the race in each of them.
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
    """Cold builds: the first model of an engine in a new process, with one step.

    Attributes:
        engines: names.
        step: [s].
    """

    engines: tuple[str, ...]
    step: Positive


class Steps(Section):
    """Steps in engines' own loops, taken from the races: compiled formulations against a rival.

    Attributes:
        own: formulation -> engine.
        stabilizations: those of the compiled formulations.
        rival, settings: the rival engine and its settings that are compared.
        targets: stabilisation -> linkage -> least ratio, for the first of `own`.
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
        step: [s].
        rounds: number of rounds in each process.
        processes: number of processes, each with a race on every linkage.
    """

    compiled: tuple[str, str]
    step: Positive
    rounds: Count
    processes: Count


class RightHandSide(Section):
    """One right-hand side, taken from the races.

    Attributes:
        own, rival, settings: engines, and the settings of the rival that are shown.
        target: least ratio in loops, on the linkages `target_of`; target_of: names of these linkages.
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
    """Accelerations of compiled formulations against numpy.

    Attributes:
        states: number of random states.
        target: largest relative difference.
    """

    states: Count
    target: Positive


class Method(Section):
    """Everything that is chosen but the step.

    Attributes:
        engine, settings, integrator, stabilization: names, as the command line has them.
    """

    engine: str
    settings: str = "default"
    integrator: str = "rk4"
    stabilization: str = "none"


class Search(OnLinkages):
    """The cheapest way of every engine to be as exact as required over the whole run, searched for among its variants.

    Attributes:
        engines: names; empty for all but the formulations in numpy.
        own: engines to whose cheapest way ratios are taken.
        until: [s] end of the runs; a shorter scenario ends as it does.
        position, angle, force: the largest errors that are required [m], [rad], [N], one by one.
        end: largest errors of positions at the last sample that are required [m].
        budget: evaluations of one variant on one linkage.
        most_steps: of a run: smaller steps are not tried.
        steps_of: engine -> the same, of engines whose methods are of a lower order than others.
        processes: that race what passed, one after the other.
        rounds: of the race in each of them.
        lead: [s] of a run at fixed steps that is timed; longer ones are cut and scaled.
        aims: engine -> how many times as long as our own cheapest way its searched best should take, at least ...
        aimed: ... at these requirements of position [m].
        authors: paths of files of settings by engines' authors, beside those in their rooms.
        brief: whether only the variants are searched that an engine tries first, of all engines of the suite, those in numpy too.
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
        engines: names; empty for all engines, with those that can be installed and are not.
        redundant: linkages with redundant rows, whose accuracy cases the table shows too.
        step, until: [s] of the runs.
        processes: starts of each engine, one after the other.
        position: [m] the accuracies at which the table shows the cost of each engine's searched best.
    """

    engines: tuple[str, ...] = ()
    redundant: Linkages = {}
    step: Positive
    until: Positive
    processes: Count = 3
    position: tuple[Positive, ...]


class Batch(OnLinkages):
    """Many trajectories at once.

    Attributes:
        states: trajectories.
        step, step_count: [s] and how many of each trajectory.
        own, rival, settings: engines, and the rival's settings.
        rival_step_count: of each trajectory: fewer, which changes nothing in the time of one.
        processes: that race, one after the other.
        rounds: of the race in each of them.
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
    """Right-hand sides of chains.

    Attributes:
        sizes: windows.
        rounds: of a race.
        processes: how many; each races once at every number of windows.
        large: windows from which on growth is told.
    """

    sizes: tuple[Count, ...]
    rounds: Count
    processes: Count = 1
    large: Count


class LongRuns(OnLinkages):
    """Drift and energy of long runs with projection.

    Attributes:
        duration, step: [s]; a second run takes half the step.
        drift: [m, rad], [m/s, rad/s] largest residual.
        order, margin: of the energy's error.
    """

    duration: Positive
    step: Positive
    drift: Positive
    order: Positive
    margin: Positive


class Turns(OnLinkages):
    """Compiled kinematics over a turn.

    Attributes:
        samples: positions of a turn.
        rounds: of a race.
        processes: that race, one after the other.
        targets: linkage -> least positions per second.
        error: largest relative error.
    """

    samples: Count
    rounds: Count
    processes: Count = 1
    targets: Mapping[str, Positive] = {}
    error: Positive


class Geometry(OnLinkages):
    """Kinematics three independent ways, and for `searched` linkages the searches for their assembly.

    Attributes:
        searched: names of these linkages.
    """

    searched: tuple[str, ...] = ()


class Driving(OnLinkages):
    """Torques that drive a turn, by every way listed.

    Attributes:
        step: [s].
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
    """A whole suite; sections may be told several times, and those of the suites named in `with` come first.

    Attributes:
        format: edition of the grammar of suites.
        title: for the report.
        parts: names of suites to build on, or paths of their files; the key in a file is `with`.
        hours: within which it ends on two cores that nobody else uses; what is interrupted goes on where it was.
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
