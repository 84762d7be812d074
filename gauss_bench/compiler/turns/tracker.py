"""The samples of the lanes: one linkage cut into parts, or a linkage to each lane; and what happens to a lane that stops.

The samples of one linkage are cut into as many parts as there are lanes. Where the parts begin is found first, by one lane in
strides of at most STRIDE; then all parts are followed side by side. Of many linkages each lane follows one, from a start that is
reached from the file's own by changing the open numbers little by little, on the same side of every guard.

Where a lane stops, the way to that sample is divided; where that does not help either, the library's closure is asked. What it
closes is taken over; where it finds a limit or a singular position, the motion ends, and no later sample is reported as closed.

Starts of linkages with other dimensions than the file's, which are known for the file's alone. The numbers go from the one to the
other little by little, in steps that grow, with a guess from the last two steps; every guard keeps its side on the way, so that the
assembly stays the same. Source: Allgower and Georg, Introduction to Numerical Continuation Methods (2003), chapter 2.

The library knows a linkage by its numbers alone, so that open parameters are put into a mechanism first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import pairwise
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss_bench.compiler.elimination.loop_program import ClosureProgram, loop_values
from gauss_bench.compiler.errors import KernelError
from gauss_bench.compiler.turns.follow import LARGEST, TURN, Course, Followed, Follower
from gauss_bench.kinematics.errors import MotionError, SingularPosition
from gauss_bench.kinematics.inputs import Input
from gauss_bench.kinematics.loop_closure import loop_motion
from gauss_bench.kinematics.loop_equations import LoopEquations
from gauss_bench.mechanism import coordinates
from gauss_bench.mechanism.model import AngleDriver, Driver, Joint, LengthDriver, Link, Mechanism, Point, Prismatic, Revolute
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array


class Lost(ArithmeticError):
    """The inputs cannot be followed to a sample.

    Attributes:
        kind: "limit of motion", "singular position" or "not assembled".
        inputs: the last ones that were reached [rad, m].
    """

    def __init__(self, text: str, kind: str, inputs: Mapping[str, float]):
        self.kind, self.inputs = kind, inputs
        super().__init__(text)


@dataclass(frozen=True, eq=False)
class NextSample:
    """From a closed state q (n,) to inputs u with rates w and second rates b (K,), known variables as the loops count them."""

    q: Array
    u: Array
    w: Array
    b: Array


class Judge:
    """The library's closure for one linkage and the open numbers p."""

    def __init__(
        self, mechanism: Mechanism, inputs: Sequence[Input], phases: Array, names: tuple[str, ...], points: Sequence[Point]
    ):
        self.mechanism, self.inputs, self.phases, self.names, self.points = mechanism, inputs, phases, names, points

    def mechanism_with(self, p: Array) -> Mechanism:
        """The mechanism with the open numbers p (n_p,)."""
        return with_numbers(self.mechanism, dict(zip(self.names, p.tolist(), strict=True)))

    def step(self, step: NextSample, p: Array) -> Array:
        """The row of numbers of a sample.

        Raises:
            Lost: the library cannot get there either.
        """
        mechanism = replace(self.mechanism_with(p), q0=step.q)
        levels = zip(step.u + self.phases, step.w, step.b, strict=True)
        given = [replace(x, law=_hold(*level)) for x, level in zip(self.inputs, levels, strict=True)]
        try:
            motion = loop_motion(mechanism, given, np.array([1.0]))
        except MotionError as error:
            kind = "singular position" if isinstance(error, SingularPosition) else "limit of motion"
            raise Lost(str(error).rpartition(": ")[2], kind, error.inputs) from error
        q, v, a = motion.q[0], motion.v[0], motion.a[0]
        return np.concatenate([q, v, a, *(_point(mechanism, point, q, v, a) for point in self.points)])


def _hold(*levels: Any) -> MotionLaw:
    return MotionLaw("held", lambda t: levels)


def _point(mechanism: Mechanism, point: Point, q: Array, v: Array, a: Array) -> Array:
    """Position, velocity and acceleration (6,) of a point."""
    moved = _move(mechanism, point)
    return np.concatenate(
        [coordinates.position(q, moved), coordinates.velocity(q, v, moved), coordinates.acceleration(q, v, a, moved)]
    )


def with_numbers(mechanism: Mechanism, numbers: Mapping[str, float]) -> Mechanism:
    """A mechanism with other dimensions: points and centres of mass of links, points of the ground, offsets of slides.

    Raises:
        KernelError: a number that is no dimension.
    """
    if not numbers:
        return mechanism
    tables = {"ground": {k: np.array(x, dtype=float) for k, x in mechanism.ground_points.items()}}
    tables |= {link.name: {k: np.array(x, dtype=float) for k, x in link.points.items()} for link in mechanism.links}
    centres = {link.name: np.array(link.com, dtype=float) for link in mechanism.links}
    offsets: dict[str, float] = {}
    for name, value in numbers.items():
        match name.split("."):
            case ["points", owner, point, axis]:
                tables[owner][point]["xy".index(axis)] = value
            case ["links", owner, "com", axis]:
                centres[owner]["xy".index(axis)] = value
            case ["joints", joint, "offset"]:
                offsets[joint] = value
            case _:
                raise KernelError(f"{name} is no dimension of {mechanism.name}: kinematics does not depend on it")
    links = tuple(_link(link, tables[link.name], centres[link.name]) for link in mechanism.links)
    made = replace(mechanism, links=links, ground_points=tables["ground"])
    joints = tuple(_joint(made, joint, offsets) for joint in mechanism.joints)
    return replace(made, joints=joints, drivers=tuple(_driver(made, driver, joints) for driver in mechanism.drivers))


def _link(link: Link, points: Mapping[str, Array], com: Array) -> Link:
    return replace(link, points=points, com=com)


def _move(mechanism: Mechanism, point: Point) -> Point:
    """The point where the mechanism has it; one that no table names stays."""
    name = point.name.partition(".")[2]
    known = mechanism.ground_points if point.link < 0 else mechanism.links[point.link].points
    return mechanism.point(point.link, name) if name in known else point


def _joint(mechanism: Mechanism, joint: Joint, offsets: Mapping[str, float]) -> Joint:
    if isinstance(joint, Revolute):
        return replace(joint, a=_move(mechanism, joint.a), b=_move(mechanism, joint.b))
    guide, block = _move(mechanism, joint.guide), _move(mechanism, joint.block)
    return replace(joint, guide=guide, block=block, offset=offsets.get(joint.name, joint.offset))


def _driver(mechanism: Mechanism, driver: Driver, joints: Sequence[Joint]) -> Driver:
    if isinstance(driver, AngleDriver):
        return driver
    if isinstance(driver, LengthDriver):
        return replace(driver, a=_move(mechanism, driver.a), b=_move(mechanism, driver.b))
    slide = next(j for j in joints if isinstance(j, Prismatic) and j.name == driver.joint.name)
    return replace(driver, joint=slide)


class Status(IntEnum):
    """The way in which a sample was closed."""

    CLOSED = 0
    LIBRARY = 1  # by the library's closure
    LOST = 2  # not: the numbers are NaN


@dataclass(frozen=True)
class Loss:
    """The place and the cause of a motion's end.

    Attributes:
        linkage: row of the parameters; 0 for one linkage.
        sample: the first that could not be closed.
        kind: "limit of motion", "singular position" or "not assembled".
        inputs: name -> value [rad, m] up to which it went.
        text: one sentence.
    """

    linkage: int
    sample: int
    kind: str
    inputs: dict[str, float]
    text: str


@dataclass(frozen=True, eq=False)
class Start:
    """The start of a linkage.

    Attributes:
        x: (U,) unknowns, NaN where there is no start; u: (K,) inputs.
        signs: (G,) that the guards keep.
        fault: why there is no start.
    """

    x: Array
    u: Array
    signs: Array
    fault: str = ""


@dataclass(frozen=True, eq=False)
class Motion:
    """One linkage to be followed.

    Attributes:
        levels: (k, 3 K) inputs, rates, second rates; one array for all linkages that share them.
        p: (n_p,) open numbers.
    """

    levels: Array
    p: Array
    start: Start

    @property
    def u(self) -> Array:
        return self.levels[:, : self.levels.shape[1] // 3]


STRIDE = 0.1  # [rad, lengths] of an input between two closures: the second-order prediction then misses by a few 1e-4
CLOSED = 4e-15  # of the loops' vectors: four times what rounding of sines and sums leaves
MANY = 8  # unknowns; beyond, strides are shorter
SUBDIVISIONS = (8, 64)  # of a way that could not be gone at once
FEW = 4  # samples of a part, at least


class Tracker:
    """Follows motions with the runners of one program: `states` stores whole rows, `path` the unknowns alone, in one lane."""

    def __init__(
        self, program: ClosureProgram, equations: LoopEquations, states: Follower, path: Follower, judge: Judge, lanes: int
    ):
        self.program, self.equations, self.states, self.path = program, equations, states, path
        self.judge, self.lanes = judge, lanes
        length = max(program.lengths, default=1.0)
        many = max(1.0, sqrt(program.unknowns / MANY))  # what bounds a way and a correction is the norm of all unknowns
        self.per_stride = np.where(program.known_angles, 1.0, 1.0 / length) * many / STRIDE

    def tolerance(self, u: Array, x: Array) -> float:
        """|A|^2 of a closed sample, of the squared vectors in it: angles of many turns are rounded more coarsely."""
        turns = max(_largest(u), _largest(x))
        return (CLOSED * (1.0 + turns / 8.0)) ** 2

    def start(self, x: Array, u: Array, p: Array) -> Start:
        """The start at a closed state, with the signs of its guards.

        Raises:
            Lost: not closed, or too near a singular position to tell assemblies apart.
        """
        still = Start(x, u, np.zeros(self.program.guards))
        followed, _ = self._single(still, u[None], p)
        if not followed.closed[0]:
            raise Lost("the start is not closed, or at a singular position", "not assembled", self.named(u))
        return replace(still, x=followed.x[0], signs=np.sign(followed.guards[0]))

    def named(self, u: Array) -> dict[str, float]:
        """Name -> value of inputs as their laws count them."""
        return self.equations.input_values(np.concatenate([np.zeros(self.program.unknowns), u]))

    def _single(self, start: Start, u: Array, p: Array) -> tuple[Followed, Array]:
        """One lane along u (k, K), and its unknowns (k, U)."""
        k, K = u.shape
        inputs = np.zeros((1, k + 1, 3 * K))
        inputs[0, :k, :K], inputs[0, k, :K] = u, u[-1]
        rows = np.empty((k, self.program.unknowns))
        where = np.zeros(1, dtype=np.int64)
        course = Course(start.x[None], start.signs[None], inputs, p[None], where, rows, self.tolerance(u, start.x))
        return self.path.run(course), rows

    def strides(self, u: Array) -> float:
        """Strides from one sample to the next where they are farthest apart, of samples (..., k, K)."""
        return _largest((u[..., 1:, :] - u[..., :-1, :]) * self.per_stride)

    def track(self, motion: Motion, rows: Array, status: NDArray[np.int8]) -> Loss | None:
        """One linkage: fills its rows (k, R) and status (k,)."""
        parts, count = self.cut(len(motion.levels))
        starts, levels = self._starts(motion, parts, count), motion.levels[: parts * count]
        inputs = np.empty((parts, count + 1, levels.shape[1]))
        inputs[:, :count], inputs[:, count] = levels.reshape(parts, count, -1), levels[count - 1 :: count]
        inputs[:-1, count] = levels[count::count]
        signs, p = (x[None].repeat(parts, axis=0) for x in (motion.start.signs, motion.p))
        tolerance = self.tolerance(motion.u, starts)
        followed = self.states.run(Course(starts, signs, inputs, p, np.arange(parts) * count, rows, tolerance))
        self._check_turns(followed.x, count)
        whole = parts * count == len(motion.levels) and (followed.closed == count).all()
        if whole and self._join(followed.x[:-1], starts[1:]):
            return None
        return self._mend(motion, rows, status, starts, followed, count)

    def _join(self, ends: Array, starts: Array) -> bool:
        """Tell whether states (..., U) lie near those a sample before, and so in the same assembly."""
        gaps = (starts - ends) / self.program.lengths
        return bool((np.sqrt((gaps * gaps).sum(axis=-1)) < 2 * TURN).all())

    def track_many(self, motions: Sequence[Motion], rows: Array, status: NDArray[np.int8], threads: int = 1) -> list[Loss]:
        """Many linkages with as many samples each: fills rows (linkages, k, R) and status (linkages, k)."""
        k, first = len(motions[0].levels), motions[0]
        shared = all(m.levels is first.levels for m in motions)
        inputs = np.stack([np.concatenate([m.levels, m.levels[-1:]]) for m in (motions[:1] if shared else motions)])
        x = self._walk_in(motions)
        course = Course(
            x,
            np.array([m.start.signs for m in motions]),
            inputs,
            np.array([m.p for m in motions]),
            np.arange(len(motions)) * k,
            rows.reshape(-1, rows.shape[-1]),
            self.tolerance(inputs[..., : self.program.inputs], x),
        )
        followed = self.states.run(course, threads)
        self._check_turns(followed.x, k)
        losses = []
        for i in np.flatnonzero(followed.closed < k).tolist():
            one = slice(i, i + 1)
            alone = Followed(followed.closed[one], followed.x[one], followed.guards[one])
            lost = self._mend(motions[i], rows[i], status[i], x[one], alone, k)
            losses += [] if lost is None else [replace(lost, linkage=i)]
        return losses

    def _walk_in(self, motions: Sequence[Motion]) -> Array:
        """Unknowns (linkages, U) at everyone's first sample, from everyone's start; NaN where the way there must be mended."""
        ways = np.array([m.u[0] - m.start.u for m in motions])
        steps = max(1, ceil(_largest(ways * self.per_stride)))
        parts = np.minimum(np.arange(steps + 2) / steps, 1.0)
        inputs = np.zeros((len(motions), steps + 2, 3 * self.program.inputs))
        inputs[:, :, : self.program.inputs] = np.array([m.start.u for m in motions])[:, None] + parts[:, None] * ways[:, None]
        x, signs = np.array([m.start.x for m in motions]), np.array([m.start.signs for m in motions])
        followed = self.ends(x, signs, inputs, np.array([m.p for m in motions]))
        return np.where((followed.closed == steps + 1)[:, None], followed.x, np.nan)

    def ends(self, x: Array, signs: Array, inputs: Array, p: Array) -> Followed:
        """A lane for each linkage, as in Course; only where it ends is kept."""
        count = inputs.shape[1] - 1
        rows = np.empty((len(x) * count, self.program.width))
        where = np.arange(len(x)) * count
        return self.states.run(Course(x, signs, inputs, p, where, rows, self.tolerance(inputs[..., : self.program.inputs], x)))

    def cut(self, samples: int) -> tuple[int, int]:
        """Parts, and samples of each; a few more may be left."""
        parts = self.lanes if samples >= FEW * self.lanes else 1
        return parts, samples // parts

    def _starts(self, motion: Motion, parts: int, count: int) -> Array:
        """Unknowns (parts, U) at the first sample of each part, NaN from where they could not be found."""
        u, start = motion.u, motion.start
        lead = max(1, ceil(_largest((u[0] - start.u) * self.per_stride)))
        each = min(count, max(1, ceil(count * self.strides(u))))
        nodes = np.arange(1, (parts - 1) * each + 1) * count // each
        way = start.u + (np.arange(lead) / lead)[:, None] * (u[0] - start.u)
        path = self._walk(motion, np.concatenate([way, u[:1], u[nodes]]))
        return path[lead::each]

    def _walk(self, motion: Motion, u: Array) -> Array:
        """Unknowns along the inputs u (k, K), from the start; NaN from where the way is lost."""
        path = np.full((len(u), self.program.unknowns), np.nan)
        at, x = 0, motion.start.x
        while at < len(u):
            followed, rows = self._single(Start(x, u[at], motion.start.signs), u[at:], motion.p)
            closed = int(followed.closed[0])
            path[at : at + closed] = rows[:closed]
            at += closed
            if at == len(u) or not closed:
                break
            ahead = self._between(motion, followed.x[0], u[at - 1], u[at])
            if ahead is None:
                break
            x = ahead
        return path

    def _between(self, motion: Motion, x: Array, before: Array, after: Array) -> Array | None:
        """Unknowns at `after` from those at `before`, on a way that is divided ever more finely."""
        for parts in SUBDIVISIONS:
            u = before + np.linspace(0.0, 1.0, parts + 1)[:, None] * (after - before)
            followed, _ = self._single(Start(x, before, motion.start.signs), u, motion.p)
            if followed.closed[0] == parts + 1:
                return np.asarray(followed.x[0])
        return None

    def _mend(
        self, motion: Motion, rows: Array, status: NDArray[np.int8], starts: Array, followed: Followed, count: int
    ) -> Loss | None:
        """Close what the lanes left open, part after part; the loss where the motion ends."""
        x, k = motion.start.x, len(motion.levels)
        if motion.start.fault:
            rows[:], status[:] = np.nan, Status.LOST
            return Loss(0, 0, "not assembled", self.named(motion.start.u), motion.start.fault)
        for part, closed in enumerate([*followed.closed.tolist(), 0]):
            at, end = part * count, k if part == len(starts) else (part + 1) * count
            if closed and (part == 0 or self._join(x, starts[part])):
                at, x = at + closed, followed.x[part]
            while at < end:
                try:
                    at, x = self._onward(motion, rows, status, at, end, x)
                except Lost as lost:
                    rows[at:], status[at:] = np.nan, Status.LOST
                    return Loss(0, at, lost.kind, dict(lost.inputs), str(lost))
        return None

    def _onward(self, motion: Motion, rows: Array, status: NDArray[np.int8], at: int, end: int, x: Array) -> tuple[int, Array]:
        """From the state x before a sample: close it and what follows; the next sample and the state before that."""
        before = motion.u[at - 1] if at else motion.start.u
        ahead = self._between(motion, x, before, motion.u[at])
        if ahead is not None:
            followed = self._follow_one(motion, ahead, at, end, rows)
            if followed.closed[0]:
                return at + int(followed.closed[0]), followed.x[0]
        n = self.program.n
        q = rows[at - 1, :n] if at else self.state(motion, x)
        rows[at] = self.judge.step(NextSample(q.copy(), *np.split(motion.levels[at], 3)), motion.p)
        status[at] = Status.LIBRARY
        return at + 1, loop_values(self.equations, self.judge.mechanism_with(motion.p), rows[at, :n])[: self.program.unknowns]

    def _follow_one(self, motion: Motion, x: Array, at: int, end: int, rows: Array) -> Followed:
        """One lane through the samples from `at` to `end`."""
        inputs = np.concatenate([motion.levels[at:end], motion.levels[end - 1 : end]])[None]
        where, signs = np.array([at]), motion.start.signs[None]
        return self.states.run(Course(x[None], signs, inputs, motion.p[None], where, rows, self.tolerance(motion.u, x)))

    def state(self, motion: Motion, x: Array) -> Array:
        """q (n,) at the start."""
        one = replace(motion, levels=hold(motion.start))
        rows = np.empty((1, self.program.width))
        self._follow_one(one, x, 0, 1, rows)
        return rows[0, : self.program.n]

    def _check_turns(self, x: Array, count: int) -> None:
        """No angle may have gone where its sine is not exact: it moves at most half a radian between samples.

        Raises:
            ValueError: it may have.
        """
        if _largest(x) + 0.5 * count > LARGEST:
            raise ValueError(f"too many samples or turns in one sweep: {count} samples of a part")


def hold(start: Start) -> Array:
    """Levels (1, 3 K) of inputs that rest at the start."""
    return np.concatenate([start.u, 0.0 * start.u, 0.0 * start.u])[None]


def _largest(x: Array) -> float:
    """The largest size among numbers, those that are none left out."""
    return float(np.fmax.reduce(np.abs(x), axis=None, initial=0.0))


STEPS = (32, 256)  # the last is the longest, a sixteenth or a 128th of the way
APART = "with these numbers the linkage cannot be assembled where the file has it, coming from there"


def deform_starts(tracker: Tracker, start: Start, nominal: Array, p: Array) -> list[Start]:
    """The starts of linkages with numbers p (linkages, n_p), from that with the nominal ones; with a fault where there is none."""
    ends = np.full((len(p), len(start.x)), np.nan)
    for steps in STEPS:
        left = np.flatnonzero(~np.isfinite(ends).all(axis=1))
        if len(left):
            ends[left] = _deform(tracker, start, nominal, p[left], steps)
    faults = ["" if good else APART for good in np.isfinite(ends).all(axis=1)]
    return [replace(start, x=x, fault=fault) for x, fault in zip(ends, faults, strict=True)]


def _deform(tracker: Tracker, start: Start, nominal: Array, p: Array, steps: int) -> Array:
    """Unknowns (linkages, U), NaN where lost."""
    inputs = hold(start).repeat(2, axis=0)[None]
    signs = start.signs[None].repeat(len(p), axis=0)
    before = x = start.x[None].repeat(len(p), axis=0)
    last = 1.0
    for a, b in pairwise(np.linspace(0.0, 1.0, steps + 1) ** 2):
        guess = x + (x - before) * ((b - a) / last)
        followed = tracker.ends(guess, signs, inputs, nominal + b * (p - nominal))
        x, before, last = np.where(followed.closed[:, None] == 1, followed.x, np.nan), x, b - a
    return np.asarray(x)
