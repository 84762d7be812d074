"""Which of a linkage's forces MuJoCo has, and in what form; nothing here needs MuJoCo.

Angles of links are sums of hinge coordinates, theta = e . y + const. Forces have one of these forms, exactly, or none:

    torque                          constant generalised force on the hinges of the chain
    force at a point                site transmission; with a reference site in the world where the force does not turn
    spring and damper of points     spatial tendon
    ... on L = e . y + const        stiffness and damping of one joint, or a fixed tendon
    ... along an axis               site transmission with a reference site, force = k rest - k x - c x'
"""

from dataclasses import dataclass

import numpy as np

from gauss_bench.engines.shared import PARALLEL, unit
from gauss_bench.mechanism.forces import axis_state, rotated
from gauss_bench.mechanism.model import (
    GROUND,
    AxisSpringDamper,
    Force,
    Joint,
    JointDamping,
    Mechanism,
    Point,
    PointForce,
    Prismatic,
    RotationalSpringDamper,
    SpringDamper,
    Torque,
)
from gauss_bench.mechanism.tree import Tree
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status


@dataclass(frozen=True, eq=False)
class Coordinate:
    """Force k (rest - L) - c dL/dt on L = row . y + constant, where row (n,) has entries of 0 and +-1."""

    row: Array
    constant: float
    k: float
    c: float
    rest: float


@dataclass(frozen=True, eq=False)
class AtSite:
    """Force (bias . [1, L, dL/dt]) * direction at a point, the opposite one on the frame.

    `direction` (2,) is fixed in the link of `frame`, or of `point` where `frame` is None and nothing takes the reaction;
    L is the coordinate of the point along it, from `frame`.
    """

    point: Point
    frame: Point | None
    direction: Array
    bias: tuple[float, float, float]


Native = Torque | SpringDamper | Coordinate | AtSite


@dataclass(frozen=True, eq=False)
class Turning:
    """Angles of links as theta = rows . y + constants: (links + 1, n) and (links + 1,); the last row is the ground."""

    rows: Array
    constants: Array

    def together(self, a: int, b: int) -> bool:
        """Whether two links never turn relative to each other."""
        return bool((self.rows[a] == self.rows[b]).all())

    def turns_with(self, a: int, b: int) -> bool:
        """Whether every hinge that turns link a turns b as well."""
        return bool((self.rows[a] <= self.rows[b]).all())

    def apart(self, a: int, b: int) -> bool:
        """Whether no hinge turns both links."""
        return not (self.rows[a] * self.rows[b]).any()


def turning(tree: Tree) -> Turning:
    rows, constants = np.zeros((tree.links + 1, tree.n)), np.zeros(tree.links + 1)
    for b in tree.branches:
        rows[b.link], constants[b.link] = rows[b.parent], constants[b.parent] + b.turn
        if b.kind != "prismatic":
            rows[b.link, b.at + (2 if b.kind == "free" else 0)] = 1.0
    return Turning(rows, constants)


def native_forces(mechanism: Mechanism, tree: Tree) -> list[Native]:
    """All forces in MuJoCo's terms.

    Raises:
        RunFailure: a skip, naming the force that has no exact form and why.
    """
    turns = turning(tree)
    return [x for f in mechanism.forces for x in native_force(f, mechanism, tree, turns)]


def native_force(f: Force, mechanism: Mechanism, tree: Tree, turns: Turning) -> list[Native]:
    match f:
        case Torque() | SpringDamper():
            return [f]
        case PointForce():
            return point_force(f, turns)
        case RotationalSpringDamper():
            return [between(turns, f.a, f.b, f.k, f.c, f.rest)]
        case AxisSpringDamper():
            return [axis_force(f, mechanism, tree, turns)]
        case JointDamping():
            return [pair_damping(pair, f.c, tree, turns) for pair in f.pairs]


def between(turns: Turning, a: int, b: int, k: float, c: float, rest: float) -> Coordinate:
    """A torsion spring and damper on theta_b - theta_a."""
    return Coordinate(turns.rows[b] - turns.rows[a], turns.constants[b] - turns.constants[a], k, c, rest)


def pair_damping(pair: Joint, c: float, tree: Tree, turns: Turning) -> Coordinate:
    """Damping of one pair; a slide is always a branch of the tree, or the mechanism has been refused."""
    if not isinstance(pair, Prismatic):
        return between(turns, pair.a.link, pair.b.link, 0.0, c, 0.0)
    row = np.zeros(tree.n)
    row[[b.at for b in tree.branches if b.joint is pair]] = 1.0
    return Coordinate(row, 0.0, 0.0, c, 0.0)


def point_force(f: PointForce, turns: Turning) -> list[Native]:
    """A constant force that turns with the world, with the link it acts on, or with a link whose hinges do not move the point.

    In the last case a second force takes the reaction off the link that only gives the direction.
    """
    link, bias = f.point.link, (1.0, 0.0, 0.0)
    if turns.together(f.frame, GROUND):
        world = Point(GROUND, np.zeros(2), "ground")
        return [AtSite(f.point, world, rotated(f.value, turns.constants[f.frame]), bias)]
    if turns.together(f.frame, link):
        return [AtSite(f.point, None, rotated(f.value, turns.constants[f.frame] - turns.constants[link]), bias)]
    if turns.apart(f.frame, link):
        frame = Point(f.frame, np.zeros(2), "centre of mass")
        return [AtSite(f.point, frame, f.value, bias), AtSite(frame, None, f.value, bias)]
    raise RunFailure(Status.SKIP, f"MuJoCo cannot turn the force {f.name} with a link whose hinges move its point")


def axis_force(f: AxisSpringDamper, mechanism: Mechanism, tree: Tree, turns: Turning) -> Coordinate | AtSite:
    """A spring on a slide's own coordinate, or a site transmission.

    The force of a site transmission lacks what the turning of the reference site adds to the rate of the coordinate, except where
    both sites turn on the same hinge, which leaves the coordinate alone.
    """
    on_slide = slide_coordinate(f, mechanism, tree)
    if on_slide is not None:
        return on_slide
    if turns.turns_with(f.origin.link, f.point.link):
        return AtSite(f.point, f.origin, unit(f.angle), (f.k * f.rest, -f.k, -f.c))
    origin, point = mechanism.link_name(f.origin.link), mechanism.link_name(f.point.link)
    text = f"MuJoCo has no exact axis for {f.name}: in the tree, {origin} turns on a hinge that does not turn {point}"
    raise RunFailure(Status.SKIP, text)


def slide_coordinate(f: AxisSpringDamper, mechanism: Mechanism, tree: Tree) -> Coordinate | None:
    """The spring as one on the slide between the two links, if its axis is parallel to the slide's."""
    pair = {f.point.link, f.origin.link}
    branch = next((b for b in tree.branches if b.kind == "prismatic" and {b.link, b.parent} == pair), None)
    if branch is None:
        return None
    y, _ = tree.relative(mechanism.q0, mechanism.v0)
    sliding = np.zeros(tree.n)
    sliding[branch.at] = 1.0
    q, v, _ = tree.absolute(y, sliding, np.zeros(tree.n))
    x, rate, _ = axis_state(q, v, f.point, f.origin, f.angle)  # sliding at unit speed: the rate is the cosine
    _, across, _ = axis_state(q, v, f.point, f.origin, f.angle + np.pi / 2)
    if abs(across) > PARALLEL:
        return None
    sign = float(np.sign(rate))
    return Coordinate(sign * sliding, float(x) - sign * y[branch.at], f.k, f.c, f.rest)
