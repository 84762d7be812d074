"""The sections and fields of a suite file: one class for each kind of section.

A suite file is a TOML file that lists measurements; each section describes one measurement.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

FORMAT = "gauss-bench-suite/1"
# engines that differ from others in their linear algebra alone: they are run with their default settings only
PLAIN = ("gauss_pinv", "lagrange", "schur", "udwadia_kalaba", "yuan_ge_eq16", "lagrange-native")

Linkages = Mapping[str, str]  # name or path -> scenario
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True, gt=0)]
Flag = Annotated[bool, Field(strict=True)]


class Section(BaseModel):
    """A section of a suite; an unknown field is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class OnLinkages(Section):
    """A section of a suite that lists the linkages on which it is run.

    Attributes:
        linkages: name of a linkage, or path of its file relative to the suite's folder -> scenario.
        any_linkage: whether the section can be run for any linkage that a user names; if not, for the listed linkages alone.
    """

    linkages: Linkages
    any_linkage: Flag = False


class Accuracy(OnLinkages):
    """Runs whose trajectories are judged: engines with their settings, integrators and stabilisations, at several steps.

    Attributes:
        engines: names of engines; empty for all engines.
        integrators: a number n for the first n integrators of each engine, or names of integrators; None for all integrators.
        plain: names of engines that are run with their default settings only.
        steps: integration steps [s], from large to small.
        until: end of the runs [s].
    """

    engines: tuple[str, ...] = ()
    integrators: Count | tuple[str, ...] | None = None
    plain: tuple[str, ...] = PLAIN
    steps: tuple[Positive, ...] = Field(min_length=1)
    until: Positive


class LeftOut(Section):
    """Cases of the suite's sections `accuracy` that are not run, with the reason that the report gives.

    A case is not run if each field here is empty or contains the value that the case has for this field.

    Attributes:
        linkages, engines, settings, integrators, stabilizations: names of cases that are not run.
        steps: integration steps [s] of cases that are not run.
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
    """The race of engines on a linkage: they are timed in turns, so that disturbances affect all of them alike.

    Attributes:
        engines: names of engines; empty for all engines.
        integrators: a number n for the first n integrators of each engine; None for all integrators.
        plain: names of engines that are timed with their default settings only.
        step: length of the timed steps [s].
        processes: number of processes that time all engines, one process after the other.
        rounds: number of rounds in each process; in a round, every engine is timed once.
        batch: names of engines whose steps of many trajectories at once are timed too.
        bare: names of engines for which a call of the library alone, and an empty call, are timed too.
        processor: whether the latency and the rate of the processor's arithmetic are timed too.
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
    """Times in which an engine builds its first model in a new process, and computes its first step (cold builds).

    Attributes:
        engines: names of engines.
        step: length of the step [s].
    """

    engines: tuple[str, ...]
    step: Positive


class Steps(Section):
    """Ratios of the times of one step: a competing engine, the rival, to compiled formulations of the suite, timed side by side.

    Attributes:
        own: name of a formulation -> name of the engine that runs the formulation compiled.
        stabilizations: names of the compiled formulations' stabilisations.
        rival: name of the engine with which the compiled formulations are compared.
        settings: names of the rival's settings.
        targets: name of a stabilisation -> linkage -> smallest ratio of times that the first formulation of `own` should reach.
    """

    own: Mapping[str, str]
    stabilizations: tuple[str, ...]
    rival: str
    settings: tuple[str, ...]
    targets: Mapping[str, Mapping[str, Positive]] = {}


class Claim(OnLinkages):
    """The claim that equations with n - m unknowns are cheaper than equations with n + m, for n coordinates and m constraints.

    Attributes:
        compiled: names of two engines, which solve equations with n - m and with n + m unknowns.
        step: length of the timed steps [s].
        rounds: number of rounds in each process.
        processes: number of processes, each of which times both engines on every linkage.
    """

    compiled: tuple[str, str]
    step: Positive
    rounds: Count
    processes: Count


class RightHandSide(Section):
    """Ratios of the times of one evaluation of the right-hand side (the accelerations at a state), timed side by side.

    Attributes:
        own, rival: name of the suite's compiled engine, and name of the engine with which it is compared.
        settings: names of the rival's settings.
        target: smallest required ratio of the rival's time to the time of `own`, if each evaluates in its own loop.
        target_of: names of the linkages for which this ratio is required.
    """

    own: str
    rival: str
    settings: tuple[str, ...]
    target: Positive
    target_of: tuple[str, ...]


class Bounds(Section):
    """Comparison of the time of an engine's steps, measured in the sections `cost`, with the limits of the processor.

    Attributes:
        own: name of the engine.
    """

    own: str


class Agreement(OnLinkages):
    """Comparison of the accelerations of compiled formulations with those in numpy.

    Attributes:
        states: number of random states.
        target: largest allowed relative difference between the accelerations.
    """

    states: Count
    target: Positive


class Method(Section):
    """An engine with its settings, integrator and stabilisation.

    Attributes:
        engine, settings, integrator, stabilization: names as on the command line.
    """

    engine: str
    settings: str = "default"
    integrator: str = "rk4"
    stabilization: str = "none"


class Search(OnLinkages):
    """The search among all variants of each engine for the cheapest setting that meets the requirements in the whole run.

    Attributes:
        engines: names of engines; empty for all engines except the formulations in numpy.
        own: names of the suite's engines whose cheapest setting is the denominator of ratios.
        until: end of the runs [s]; a run ends earlier if the scenario is shorter.
        position, angle, force: largest allowed errors [m], [rad], [N]; each number is one requirement.
        end: largest allowed errors of positions at the last sample [m]; each number is one requirement.
        budget: largest number of runs of one variant on one linkage.
        most_steps: largest number of steps of a run.
        steps_of: name of an engine -> largest number of steps of a run, for engines whose methods have a low order.
        processes: number of processes that time the settings, one process after the other.
        rounds: number of rounds in each process.
        lead: duration of the part of a run with equal steps that is timed [s]; the time of a longer run is extrapolated.
        aims: name of an engine -> smallest intended ratio of the time of its cheapest setting to the time of the cheapest setting
            of `own`.
        aimed: required errors of positions [m] for which the ratios in `aims` count.
        authors: paths of files with settings that engines' authors contributed, besides those in the engines' folders.
        brief: whether the search takes only the variants that an engine tries first, and includes the formulations in numpy.
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
    """The same measurements of every engine: whether a run repeats bit for bit, joint forces, start-up time, installed size.

    Attributes:
        engines: names of engines; empty for all engines, including those that can be installed and are not.
        redundant: linkages with redundant constraint rows; the table also shows the results of their cases in sections `accuracy`.
        step, until: integration step and end of the runs [s].
        processes: number of times that each engine is started in a new process.
        position: required errors of positions [m] for which the table shows the cost of each engine's cheapest setting.
    """

    engines: tuple[str, ...] = ()
    redundant: Linkages = {}
    step: Positive
    until: Positive
    processes: Count = 3
    position: tuple[Positive, ...]


class Batch(OnLinkages):
    """Computing times of many trajectories that are simulated together.

    Attributes:
        states: number of trajectories.
        step: length of a step [s].
        step_count: number of steps of each trajectory.
        own, rival: name of the suite's compiled engine, and name of the engine with which it is compared.
        settings: name of the rival's settings.
        rival_step_count: number of steps of the rival's trajectories, which may be smaller because the time of one step is
            compared.
        processes: number of processes that time both engines, one process after the other.
        rounds: number of rounds in each process.
        targets: linkage -> smallest required ratio of the rival's time of one step to that of `own`.
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
    """Times of the right-hand side (the accelerations at a state) against the number of loops of a linkage.

    Attributes:
        sizes: numbers of loops of the N-four-bar.
        rounds: number of rounds of a timed comparison.
        processes: number of processes, each of which times all engines once at every size.
        large: smallest size that is used to fit the exponents with which the times grow with the size.
    """

    sizes: tuple[Count, ...]
    rounds: Count
    processes: Count = 1
    large: Count


class LongRuns(OnLinkages):
    """Drift and energy of long runs with projection.

    Attributes:
        duration: duration of the runs [s].
        step: integration step of the first run [s]; a second run takes half of this step.
        drift: largest allowed constraint residual of positions [m, rad] and of velocities [m/s, rad/s].
        order, margin: the energy error must decrease with the step at least with the order `order - margin`.
    """

    duration: Positive
    step: Positive
    drift: Positive
    order: Positive
    margin: Positive


class Turns(OnLinkages):
    """Times of compiled kinematics (positions, velocities and accelerations) over one full turn of the crank.

    Attributes:
        samples: number of positions in one turn.
        rounds: number of rounds of the timing.
        processes: number of processes that time the kinematics, one process after the other.
        targets: linkage -> smallest required number of positions per second of computing time.
        error: largest allowed relative error.
    """

    samples: Count
    rounds: Count
    processes: Count = 1
    targets: Mapping[str, Positive] = {}
    error: Positive


class Geometry(OnLinkages):
    """Comparison of three independent methods of kinematics, and of searches that find the assembled position of a linkage.

    Attributes:
        searched: names of the linkages whose assembled position is searched for.
    """

    searched: tuple[str, ...] = ()


class Driving(OnLinkages):
    """Errors of the torque that drives a linkage through one full turn of the crank.

    Attributes:
        step: integration step of the runs [s].
        ways: engines that are run, each with its setting.
    """

    step: Positive
    ways: tuple[Method, ...]


class Papers(Section):
    """Tables about the papers and published values.

    Attributes:
        tables: names of the tables.
    """

    tables: tuple[Literal["audit", "reproduction", "published", "paper_motion"], ...]


class Certificates(Section):
    """The table of certificates.

    Attributes:
        table: name of the table.
    """

    table: Literal["certificates"] = "certificates"


class Suite(Section):
    """A whole suite. A section may occur several times; the sections of the suites named in `with` come first.

    Attributes:
        format: edition of the grammar of suite files.
        title: title of the report.
        parts: names of suites on which this one builds, or paths of their files; the key in a file is `with`.
        hours: time [h] within which the suite ends on two idle cores; an interrupted run can be resumed.
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
