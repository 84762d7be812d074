"""The motion of a linkage whose coordinates are all driven: the object that `gauss-bench kinematics --json` prints."""

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NotRequired, TypedDict, cast

import numpy as np
import pandas as pd

from gauss_bench import metrics
from gauss_bench.api.driven import free_at_start, load_with_drivers, move_by_drivers
from gauss_bench.api.simulate import LinkState, Observed, PointState, link_states, list_observed, point_states
from gauss_bench.api.telling import HIDDEN, UNLESS_EMPTY, Result, Told, nobody
from gauss_bench.kinematics.basic_coordinates import basic_motion, branch_of
from gauss_bench.kinematics.link_units import link_type
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.motion import LimitOfMotion, SingularPosition, describe_drivers
from gauss_bench.kinematics.singular import ChangePoint, singular_positions
from gauss_bench.kinematics.topology import find_graph
from gauss_bench.mechanism.coordinates import motion_of_links
from gauss_bench.mechanism.evaluate import Evaluator
from gauss_bench.mechanism.model import GROUND, Driver, Mechanism, Point
from gauss_bench.runs.offers import ChoiceError
from gauss_bench.terms import Array
from gauss_bench.trajectory import Curve, Trajectory

MOST_INTERVALS = 100_000  # largest number of intervals of a motion
UNITS = {  # units of the states of links and points, for the heads of columns
    **{"x": "m", "y": "m", "theta": "rad"},
    **{"vx": "m/s", "vy": "m/s", "omega": "rad/s"},
    **{"ax": "m/s^2", "ay": "m/s^2", "alpha": "rad/s^2"},
}
LONGEST_TRAVEL = 2e4  # [rad, m] largest travel of a driver: solvers follow it in parts of at most 0.3 rad, which takes some seconds


class DriverState(TypedDict):
    """The motion of a driver.

    Attributes:
        angle: (k,) driven angle [rad]; if the driver moves a slide or a length, the same values [m] as under `position` or
            `length`, for programs that use this older key.
        position: (k,) driven position of a slide [m]; length: (k,) driven length, also of a cylinder [m].
        speed: (k,) first time derivative of the driven value [rad/s] or [m/s].
        acceleration: (k,) second time derivative of the driven value [rad/s^2] or [m/s^2].
    """

    angle: Array
    position: NotRequired[Array]
    length: NotRequired[Array]
    speed: Array
    acceleration: Array


class BranchChange(TypedDict):
    """A change of the assembly branch: a group of links becomes its mirror image between two samples.

    Attributes:
        t: time of the first sample after the change [s].
        group: name of the group of links that changes from one assembly to its mirror image.
        before, after: assembly of the group before and after the change, +1 or -1.
    """

    t: float
    group: str
    before: int
    after: int


class DescribedSingular(TypedDict):
    """A limit or dead centre.

    Attributes:
        coordinate: name of the link (for its angle) or slide that reverses.
        kind: "limit" if this coordinate is the driving one, else "dead centre".
        value: value of the coordinate at the position [rad, m].
        crank, crank_deg: angle of the crank there [rad] and [degrees]; null if the driving coordinate is no angle.
        input: name of the driving coordinate; input_value: its value there [rad, m].
    """

    coordinate: str
    kind: str
    value: float
    crank: float
    crank_deg: float
    input: str
    input_value: float


@dataclass(frozen=True, eq=False)
class Kinematics(Result):
    """The motion of a driven linkage at k times.

    Attributes:
        status: "ok", or "stopped" if the motion ends before the scenario's duration; message: why the motion ends.
        mechanism, scenario: names of the linkage and scenario.
        method: "loop", "basic" or "native".
        t: (k,) times [s].
        driver: motion of the first driver; drivers: name of a driver -> motion of the driver.
        links, points: name of a link or point -> motion of the link or point.
        link_types: name of a link, or "ground" -> type of the link in Wang's notation of link units (`kinematics/link_units.py`).
        loops: names of the joints around each loop.
        branch: name of a group of links -> assembly of the group at the start, +1 or its mirror image -1; branch_changes: changes
            between both assemblies during the motion.
        iterations: (k,) iterations of the solver at each time, or None if the method does not count them.
        singular: limits and dead centres of the linkage, or a sentence on why they cannot be listed.
        observed: names of the points and links that are shown.
        loads: the largest and mean loads of joints, welds and drivers; None if `forces` was not set.
        model: the driven linkage; trajectory: states of its links; shown: the observed points; load_curves: the loads at every
            time. Dictionaries leave these four out.
    """

    status: str
    message: str
    mechanism: str
    scenario: str
    method: str
    t: Array
    driver: DriverState
    drivers: dict[str, DriverState]
    links: dict[str, LinkState]
    points: dict[str, PointState]
    loops: list[tuple[str, ...]]
    branch: Mapping[str, int]
    iterations: Array | None
    singular: list[DescribedSingular] | str
    link_types: dict[str, str]
    branch_changes: list[BranchChange]
    observed: Observed
    model: Mechanism = field(metadata=HIDDEN)
    trajectory: Trajectory = field(metadata=HIDDEN)
    shown: tuple[Point, ...] = field(metadata=HIDDEN)
    loads: metrics.Loads | None = field(default=None, metadata=UNLESS_EMPTY)
    load_curves: tuple[Curve, ...] = field(default=(), metadata=HIDDEN)

    @property
    def succeeded(self) -> bool:
        return self.status == "ok"

    @property
    def notices(self) -> tuple[str, ...]:
        return (self.message,) if self.message else ()


def find_points(mechanism: Mechanism, names: list[str] | None) -> tuple[Point, ...]:
    """Return the points with these names, "link.point" each, or the observed points of the file if `names` is None.

    Raises:
        ChoiceError: there is no such point.
    """
    mechanism = mechanism.whole
    if names is None:
        return mechanism.observed_points
    index = {link.name: i for i, link in enumerate(mechanism.links)}
    points = []
    for name in names:
        link, _, point = name.partition(".")
        if link not in index or point not in mechanism.links[index[link]].points:
            raise ChoiceError(f"no point {name!r}; links are {', '.join(index)}, and points are named link.point")
        points.append(mechanism.point(index[link], point))
    return tuple(points)


def kinematics(
    linkage: str,
    scenario: str | None = None,
    driver: str | None = None,
    intervals: int = 360,
    points: list[str] | None = None,
    method: str = "loop",
    *,
    hold: list[str] | None = None,
    steps: int | None = None,
    told: Told = nobody,
    forces: bool = False,
) -> Kinematics:
    """Compute positions, velocities and accelerations of a driven linkage over the scenario's duration.

    Args:
        linkage: name of a built-in linkage, or a path.
        scenario: name of a scenario with a driver; by default the first one.
        driver: "LAW" or "LAW:key=value,..." with the keys of a scenario's driver; by default the scenario's own drivers. If the
            text names no start, the driver starts at the first value of the scenario's driver, or at the assembled position.
        intervals: number of equal parts of the duration; there is one more position.
        points: names of points to report, as "link.point"; by default those that the file observes.
        method: "loop" (link units), "basic" (point coordinates) or "native" (compiled loops; needs the extra "kernel").
        hold: "NAME" or "NAME=VALUE" of links, slides and pins that must not move; by default the scenario's own list. VALUE is a
            link's angle or the relative angle of a pin's two links [degrees], or a slide's position [m]; without VALUE the angle
            or position keeps its value at the start.
        steps: older name of `intervals`, which is accepted for one more release.
        told: function that is called with a sentence when the motion begins, after all arguments were checked.
        forces: also find by inverse dynamics the loads of joints, welds and drivers under gravity and the scenario's forces.

    Raises:
        LinkageError: the linkage file or the driver's table has faults.
        ChoiceError: the driver's text, a name in `hold`, a point or the method is invalid; or a coordinate is not driven; or a
            driver travels too far; or the loads are not determined.
    """
    if steps is not None:
        warnings.warn("kinematics(steps=) is now kinematics(intervals=)", DeprecationWarning, stacklevel=2)
        intervals = steps
    if method not in METHODS:
        raise ChoiceError(f"no method {method!r}; there are {', '.join(METHODS)}")
    if not 1 <= intervals <= MOST_INTERVALS:
        raise ChoiceError(f"intervals must be at least 1 and at most {MOST_INTERVALS}, not {intervals}")
    mechanism = load_with_drivers(linkage, scenario, driver, hold, with_forces=forces)
    _check_all_driven(mechanism)
    shown = find_points(mechanism, points)
    times = np.linspace(0.0, mechanism.duration, intervals + 1)
    _check_travel(mechanism, times)
    told(f"{mechanism.name}, scenario {mechanism.scenario}: {intervals + 1} positions")
    states, iterations, stopped = move_by_drivers(mechanism, times, METHODS[method])
    curves = _find_loads(mechanism, states) if forces else ()
    driven_by = {x.name: describe_driver(x, states.t) for x in mechanism.drivers}
    graph, links = find_graph(mechanism), motion_of_links(mechanism, states)
    types = {x.name: link_type(graph.elements(k)) for k, x in enumerate(mechanism.links)}
    return Kinematics(
        status="stopped" if stopped else "ok",
        message=stopped,
        mechanism=mechanism.name,
        scenario=mechanism.scenario,
        method=method,
        t=states.t,
        driver=next(iter(driven_by.values())),
        drivers=driven_by,
        links=link_states(mechanism.whole, links),
        points=point_states(shown, links),
        loops=[loop.joints for loop in graph.loops],
        branch=branch_of(mechanism, mechanism.q0),
        iterations=iterations,
        singular=describe_singular(mechanism),
        link_types=types | {"ground": link_type(graph.elements(GROUND), frame=True)},
        branch_changes=_find_branch_changes(mechanism, states),
        observed=list_observed(mechanism, shown),
        model=mechanism,
        trajectory=links,
        shown=shown,
        loads=metrics.summarise_loads(mechanism, states, curves) if curves else None,
        load_curves=curves,
    )


def _find_loads(mechanism: Mechanism, states: Trajectory) -> tuple[Curve, ...]:
    """Return the curves of the forces and moments of joints, welds and drivers along a motion.

    Raises:
        ChoiceError: dry friction leaves the loads undetermined, or the iteration of the loads does not converge.
    """
    try:
        return tuple(metrics.load_curves(Evaluator(mechanism), states))
    except ArithmeticError as error:
        raise ChoiceError(f"{mechanism.name}: the forces of this motion are not determined: {error}") from error


def describe_driver(driver: Driver, times: Array) -> DriverState:
    """Return the motion of a driver at times (k,) [s].

    The driven value is given twice: under the key of linkage files (angle, position or length), and under the older key "angle".
    """
    value, speed, acceleration = driver.law(times)
    state = DriverState(angle=value, speed=speed, acceleration=acceleration)
    return cast(DriverState, state | {driver.key: value})


def _check_travel(mechanism: Mechanism, times: Array) -> None:
    """Check that no driver travels further than LONGEST_TRAVEL over the times (k,) [s].

    Raises:
        ChoiceError: a driver travels further, or its law gives a value that is not a number.
    """
    for driver in mechanism.drivers:
        with np.errstate(all="ignore"):
            travel = float(np.abs(np.diff(driver.law(times)[0])).sum())
        if not travel <= LONGEST_TRAVEL:  # NaN is refused too
            raise ChoiceError(
                f"{mechanism.name}: driver {driver.name} travels {travel:.3g} (rad or m) in {mechanism.duration:g} s; "
                f"at most {LONGEST_TRAVEL:g} are allowed: take a slower law, or a shorter duration in scenario {mechanism.scenario}"
            )


def _check_all_driven(mechanism: Mechanism) -> None:
    """Check that the drivers leave no coordinate free; else raise a ChoiceError that names those to hold."""
    if free := free_at_start(mechanism):
        # names alone: "crank" of "angle of crank", "piston" of "slide piston"
        names = [x.partition(" of ")[2] or x.partition(" ")[2] for x in free]
        options = "; ".join(f"`--hold {x}`" for x in names)
        raise ChoiceError(
            f"{mechanism.name}: the drivers leave {len(free)} free ({', '.join(free)}): drive each, or hold it at its start "
            f"by {options}, or by `hold = {names}` in scenario {mechanism.scenario}".replace("'", '"')
        )


def _find_branch_changes(mechanism: Mechanism, states: Trajectory) -> list[BranchChange]:
    """Return all changes of the assembly branch during a motion, in the order of time."""
    branches = [branch_of(mechanism, q) for q in states.q]  # at each sample: name of a group of links -> +1 or -1
    changes: list[BranchChange] = []
    for t, (before, after) in zip(states.t[1:].tolist(), pairwise(branches), strict=True):
        changed = [group for group in before if before[group] != after[group]]
        changes += [BranchChange(t=t, group=group, before=before[group], after=after[group]) for group in changed]
    return changes


def native_motion(mechanism: Mechanism, times: Array) -> Trajectory:
    """Compute the motion at times (k,) [s] by compiled loop closure.

    Raises:
        ValueError: the drivers do not fit the linkage, or llvmlite is not installed.
        LimitOfMotion, SingularPosition: the motion ends early; the exception has the motion up to there.
    """
    from gauss_bench.compiler.closure import compile_closure

    closure = compile_closure(mechanism, backend="llvm")
    # value, rate and second rate of every driver; a constant law returns scalars
    laws = [[np.broadcast_to(x, np.shape(times)) for x in driver.law(times)] for driver in mechanism.drivers]
    sweep = closure.sweep(np.array(laws).reshape(len(laws), 3, len(times)).T)
    motion = Trajectory(times, sweep.q, sweep.v, sweep.a, 0)
    loss = sweep.loss  # where and why the motion ended early; None if the motion reached the last time
    if loss is None:
        return motion
    kind = SingularPosition if loss.kind == "singular position" else LimitOfMotion
    where = describe_drivers(mechanism, loss.inputs)
    text = f"{mechanism.name} stops at {where} on the way to t = {times[loss.sample]:.6g} s: {loss.text}"
    raise kind(text, loss.inputs, float(times[loss.sample]), motion[: loss.sample])


METHODS: dict[str, Callable[..., Any]] = {"loop": loop_motion, "basic": basic_motion, "native": native_motion}


def columns(result: Kinematics) -> Iterator[tuple[str, Array]]:
    """Yield name and values (k,) of every column of a motion's table: times, drivers, links, points and loads.

    A constant law may give a single value instead of k values.
    """
    yield "t [s]", result.t
    for driver in result.model.drivers:
        unit, state = driver.coordinate.unit, cast(Mapping[str, Array], result.drivers[driver.name])
        for key, per in ((driver.key, ""), ("speed", "/s"), ("acceleration", "/s^2")):
            yield f"{driver.name}.{key} [{unit}{per}]", state[key]
    for states in (result.links, result.points):
        for name, values in states.items():
            for key, samples in cast(Mapping[str, Array], values).items():
                yield f"{name}.{key} [{UNITS[key]}]", samples
    for curve in result.load_curves:
        yield f"{curve.name} [{curve.unit}]", curve.values


def table(result: Kinematics) -> pd.DataFrame:
    """Return a motion as a table with one row per time and columns that name their units, as in the table of `simulate`."""
    names, values = zip(*columns(result), strict=True)
    return pd.DataFrame(np.column_stack([np.broadcast_to(x, result.t.shape) for x in values]), columns=list(names))


def describe_singular(mechanism: Mechanism) -> list[DescribedSingular] | str:
    """Return the limits and dead centres of a linkage with one degree of freedom, or a sentence on why they cannot be listed."""
    try:
        positions = singular_positions(mechanism)
    except (ValueError, ChangePoint) as error:
        return str(error)
    return [
        DescribedSingular(
            coordinate=s.coordinate,
            kind=s.kind,
            value=s.value,
            crank=s.crank,
            crank_deg=float(np.degrees(s.crank)),
            input=s.driving.name,
            input_value=s.input,
        )
        for s in positions
    ]
