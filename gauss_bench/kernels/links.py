"""Positions and velocities of link-fixed points as expressions, one sine and cosine per link at most.

An arm r = exp(i theta) s has constant components s in the link's frame. The frame is turned by a constant phase where most of the
link's points then lie on an axis, which saves four multiplications a point:

    r = exp(i (theta + phi)) (exp(-i phi) s)

Slides tie the angles of links together, theta_b = theta_g + turn. Tied links share one sine and cosine, and one that is tied to
the ground has none: on the constraints nothing changes, and the motion never leaves these rows, which are linear.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gauss_bench.kernels.node import Graph, Node
from gauss_bench.kernels.parameters import Parameters
from gauss_bench.kernels.planar import Vector
from gauss_bench.kernels.sampling import SPEED, scales
from gauss_bench.mechanism.model import (
    GROUND,
    AngleDriver,
    AxisSpringDamper,
    JointDamping,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    Revolute,
    SlideDriver,
    SpringDamper,
)

AXIS = 1e-14  # of a vector's length: less is rounding of a right angle


@dataclass(frozen=True)
class Tie:
    """The angle of a link: that of `root` plus `offset` [rad]; the ground's angle is 0."""

    root: int
    offset: float


def tied_angles(mechanism: Mechanism) -> tuple[Tie, ...]:
    """For every link the angle it follows through slides."""
    ties = [Tie(i, 0.0) for i in range(len(mechanism.links))]
    for slide in (j for j in mechanism.joints if isinstance(j, Prismatic)):
        guide, block = (Tie(GROUND, 0.0) if p.link == GROUND else ties[p.link] for p in (slide.guide, slide.block))
        old, new, offset = block.root, guide.root, guide.offset + slide.turn - block.offset
        if old == GROUND:
            old, new, offset = new, old, -offset
        if old != new:
            ties = [Tie(new, x.offset + offset) if x.root == old else x for x in ties]
    return tuple(ties)


def free_angles(mechanism: Mechanism) -> tuple[Tie, ...]:
    """Every link for itself: exact off the constraints too."""
    return tuple(Tie(i, 0.0) for i in range(len(mechanism.links)))


def points_of(mechanism: Mechanism) -> list[Point]:
    """The points at which something acts, once each."""
    found: list[Point] = [x for e in mechanism.knife_edges for x in (e.point,)]
    pairs = [*mechanism.joints, *(p for f in mechanism.forces if isinstance(f, JointDamping) for p in f.pairs)]
    for joint in pairs:
        found += [joint.a, joint.b] if isinstance(joint, Revolute) else [joint.guide, joint.block]
    for driver in mechanism.drivers:
        if not isinstance(driver, AngleDriver):
            found += [driver.joint.guide, driver.joint.block] if isinstance(driver, SlideDriver) else [driver.a, driver.b]
    for force in mechanism.forces:
        match force:
            case PointForce():
                found.append(force.point)
            case SpringDamper():
                found += [force.a, force.b]
            case AxisSpringDamper():
                found += [force.point, force.origin]
    return list({(p.link, *map(float, p.local)): p for p in found}.values())


def directions_of(mechanism: Mechanism) -> list[tuple[int, float]]:
    """Link and angle of every link-fixed line that something acts along."""
    found = [(j.guide.link, j.angle) for j in mechanism.joints if isinstance(j, Prismatic)]
    found += [(e.point.link, e.angle) for e in mechanism.knife_edges]
    found += [(f.origin.link, f.angle) for f in mechanism.forces if isinstance(f, AxisSpringDamper)]
    return found + [(f.frame, float(np.arctan2(f.value[1], f.value[0]))) for f in mechanism.forces if isinstance(f, PointForce)]


def phases(mechanism: Mechanism, ties: Sequence[Tie]) -> dict[int, float]:
    """For every root the angle [rad] of the frame in which most vectors lie on an axis; 0 unless another is better."""
    vectors: dict[int, list[complex]] = {}
    fixed = [(p.link, complex(*map(float, p.local))) for p in points_of(mechanism)]
    fixed += [(link, complex(np.cos(x), np.sin(x))) for link, x in directions_of(mechanism)]
    for link, s in fixed:
        if link != GROUND and abs(s) > 0 and ties[link].root != GROUND:
            vectors.setdefault(ties[link].root, []).append(s / abs(s) * np.exp(1j * ties[link].offset))
    return {root: _best_phase(found) for root, found in vectors.items()}


def _best_phase(vectors: list[complex]) -> float:
    def off_axis(phase: float) -> int:
        turned = [s * np.exp(-1j * phase) for s in vectors]
        return sum(min(abs(s.real), abs(s.imag)) > AXIS for s in turned)

    candidates = [0.0, *(float(np.angle(s)) for s in vectors)]
    return min(candidates, key=lambda x: (off_axis(x), abs(x)))


@dataclass(frozen=True, eq=False)
class State:
    """Names of the inputs that hold time, positions and velocities, and their values at the samples (k,), (k, n), (k, n)."""

    t: str
    q: str
    v: str
    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray


class Links:
    """The links of one mechanism at one state; `exact` where expressions must hold off the constraints too."""

    def __init__(self, graph: Graph, mechanism: Mechanism, parameters: Parameters, state: State, exact: bool = False):
        self.graph, self.mechanism, self.parameters, self.state, self.exact = graph, mechanism, parameters, state, exact
        self.ties = free_angles(mechanism) if exact else tied_angles(mechanism)
        self.phases = phases(mechanism, self.ties)
        self.scale = [float(x) for x in scales(mechanism)]
        self.zero = graph.constant(0.0)
        self.arms: dict[tuple[object, ...], Vector] = {}

    @property
    def time(self) -> Node:
        return self.graph.input(self.state.t, 0, self.state.times, 1.0)

    def coordinate(self, k: int) -> Node:
        return self.graph.input(self.state.q, k, self.state.positions[:, k], self.scale[k])

    def rate(self, k: int) -> Node:
        return self.graph.input(self.state.v, k, self.state.velocities[:, k], SPEED * self.scale[k])

    def angle(self, link: int) -> Node:
        """theta as it stands in the state; the ground's is 0."""
        return self.zero if link == GROUND else self.coordinate(3 * link + 2)

    def omega(self, link: int) -> Node:
        """Angular speed; a tied link has that of its root."""
        root = GROUND if link == GROUND else self.ties[link].root
        return self.zero if root == GROUND else self.rate(3 * root + 2)

    def centre(self, link: int) -> Vector:
        return Vector(self.coordinate(3 * link), self.coordinate(3 * link + 1))

    def centre_velocity(self, link: int) -> Vector:
        return Vector(self.rate(3 * link), self.rate(3 * link + 1))

    def number(self, name: str) -> Node:
        return self.parameters.node(self.graph, name)

    def local(self, point: Point) -> Vector:
        """The point in its link's frame, from the centre of mass."""
        owner, name = point.name.split(".", 1)
        if f"points.{owner}.{name}.x" not in self.parameters.all:
            return self.fixed(*point.local)
        x, y = (self.number(f"points.{owner}.{name}.{axis}") for axis in "xy")
        if point.link == GROUND:
            return Vector(x, y)
        return Vector(x - self.number(f"links.{owner}.com.x"), y - self.number(f"links.{owner}.com.y"))

    def fixed(self, x: float, y: float) -> Vector:
        return Vector(self.graph.constant(float(x)), self.graph.constant(float(y)))

    def rotated(self, link: int, s: Vector) -> Vector:
        """A link-fixed vector in world axes."""
        tie = Tie(GROUND, 0.0) if link == GROUND else self.ties[link]
        phase = self.phases.get(tie.root, 0.0)
        s = s.rotated(self._unit(tie.offset - phase))
        if tie.root == GROUND:
            return s
        theta = self.coordinate(3 * tie.root + 2) + phase
        return s.rotated(Vector(self.graph.cos(theta), self.graph.sin(theta)))

    def _unit(self, theta: float) -> Vector:
        return self.fixed(*(0.0 if abs(x) < AXIS else x for x in (np.cos(theta), np.sin(theta))))

    def direction(self, link: int, angle: float) -> Vector:
        """Unit vector at an angle [rad] of the link's frame, in world axes."""
        return self.rotated(link, self._unit(angle))

    def arm(self, point: Point) -> Vector:
        """From the centre of mass to the point, in world axes; zero for the ground."""
        key = (point.name, *point.local.tolist())
        if key not in self.arms:
            fixed = point.link == GROUND
            self.arms[key] = self.fixed(0.0, 0.0) if fixed else self.rotated(point.link, self.local(point))
        return self.arms[key]

    def position(self, point: Point) -> Vector:
        return self.local(point) if point.link == GROUND else self.centre(point.link) + self.arm(point)

    def velocity(self, point: Point) -> Vector:
        if point.link == GROUND:
            return self.fixed(0.0, 0.0)
        return self.centre_velocity(point.link) + self.arm(point).turned(self.omega(point.link))
