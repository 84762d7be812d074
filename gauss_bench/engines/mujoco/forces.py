"""The forces of a linkage as elements of MuJoCo. This module does not import MuJoCo.

The angle of a link is a sum of hinge coordinates, theta = e . y + const. A force is modelled only if one of these elements
represents it exactly; otherwise the linkage is skipped:

    torque                                                            constant generalised force on the hinges of the chain
    force along a slide, with its reaction on the guide               constant generalised force on the slide
    force at a point                                                  site transmission; if the force keeps its direction in the
                                                                      world, with a reference site there
    spring and damper between points                                  spatial tendon
    spring and damper on an angle or a slide, L = e . y + const       stiffness and damping of one joint, or a fixed tendon
    spring and damper along an axis                                   site transmission with a reference site, k rest - k x - c x'
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import assert_never

import numpy as np

from gauss_bench.engines.shared import PARALLEL
from gauss_bench.engines.tree import Branch, Tree, Turning
from gauss_bench.engines.tree import turning as turning  # where plug-ins look for it
from gauss_bench.mechanism.coordinates import rate, rotate, value
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import (
    GROUND,
    Along,
    Angle,
    Distance,
    Law,
    Load,
    Mechanism,
    Point,
    PointForce,
    Torque,
    Weighted,
    factor_of,
)
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

ALIGNED = 1e-12  # [m] by which rounding may move two points off one line


@dataclass(frozen=True, eq=False)
class Steady:
    """The constant generalised force `value` times `force` (n,) on the tree coordinates.

    Attributes:
        names: forces of the linkage that make it: a force along a slide and its reaction are two.
    """

    force: Array
    value: float = 1.0
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class OnJoints:
    """Force k (rest - L) - c dL/dt on L = row . y + constant, where row (n,) has entries of 0 and +-1."""

    row: Array
    constant: float
    k: float
    c: float
    rest: float


@dataclass(frozen=True, eq=False)
class Tendon:
    """A force law on the distance between two points."""

    a: Point
    b: Point
    law: Law


@dataclass(frozen=True, eq=False)
class AtSite:
    """Force (bias . [1, L, dL/dt]) * direction at a point, with the opposite force on the frame.

    `direction` (2,) is fixed in the link of `frame`; L is the coordinate of the point along it, measured from `frame`. Without a
    frame, `direction` is fixed in the point's own link and nothing takes the reaction.

    Attributes:
        name: the force of the linkage.
        constant: whether it is a constant force as a whole, so that a single control can change it.
    """

    name: str
    point: Point
    frame: Point | None
    direction: Array
    bias: tuple[float, float, float]
    constant: bool = False


Native = Steady | OnJoints | Tendon | AtSite


def native_forces(mechanism: Mechanism, tree: Tree) -> list[Native]:
    """Return all forces that do not vary with time as elements of MuJoCo.

    Raises:
        RunFailure: a force has no exact element (status SKIP); the message names the force and the reason.
    """
    turns = turning(tree)
    steady = [f for f in mechanism.forces if not factor_of(f)]
    motors = [Steady(turns.rows[f.link] - turns.rows[f.reaction], f.value, (f.name,)) for f in steady if isinstance(f, Torque)]
    motors += slide_motors([f for f in steady if isinstance(f, PointForce)], mechanism, tree, turns)
    done = {name for motor in motors for name in motor.names}
    others = [(f.name, load) for f in steady if f.name not in done for load in f.to_loads()]
    return [*motors, *(x for name, load in others for x in native(name, load, mechanism, tree, turns))]


def slide_motors(forces: Sequence[PointForce], mechanism: Mechanism, tree: Tree, turns: Turning) -> list[Steady]:
    """Return the forces that act along a slide of the tree alone: on the block, and the opposite one on a guide that moves."""
    motors: list[Steady] = []
    done: set[str] = set()
    slides = [b for b in tree.branches if b.kind == "prismatic"]
    for f in forces:
        for b in (b for b in slides if f.name not in done and f.point.link == b.link):
            value = along_slide(f, b, turns)
            if value is None:
                continue
            reactions = [g.name for g in forces if g.name not in done and is_reaction(g, f, b, mechanism, turns)]
            if b.parent != GROUND and not reactions:
                continue
            names = (f.name, *reactions[:1])
            sliding = np.zeros(tree.n)
            sliding[b.at] = 1.0
            motors.append(Steady(sliding, value, names))
            done.update(names)
    return motors


def along_slide(f: PointForce, b: Branch, turns: Turning) -> float | None:
    """Return a force's component along the axis of a slide; None if it is zero or has another direction."""
    if not turns.together(f.frame, b.parent):
        return None
    force = rotate(f.value, turns.constants[f.frame] - turns.constants[b.parent])
    across = b.axis[0] * force[1] - b.axis[1] * force[0]
    return float(b.axis @ force) if force.any() and abs(across) <= PARALLEL * np.linalg.norm(force) else None


def is_reaction(g: PointForce, f: PointForce, b: Branch, mechanism: Mechanism, turns: Turning) -> bool:
    """Tell whether g on the guide of a slide is opposite to f on its block, on the same line: else they also turn the links."""
    if g.point.link != b.parent or not turns.together(g.frame, b.parent):
        return False
    forces = (rotate(x.value, turns.constants[x.frame] - turns.constants[b.parent]) for x in (f, g))
    offset = value(Along(g.point, f.point, float(np.arctan2(b.axis[1], b.axis[0])), across=True), mechanism.q0)
    return bool(np.abs(sum(forces)).max() <= PARALLEL * np.abs(f.value).max() and abs(offset) <= ALIGNED)


def native(name: str, load: Load, mechanism: Mechanism, tree: Tree, turns: Turning) -> list[Native]:
    """Return the elements for one load of the force `name`."""
    match load:
        case PointForce():
            return point_force(load, turns)
        case Law():
            pass
        case _:
            assert_never(load)
    match load.coordinate:
        case Angle(a, b):
            return on_joints(name, turns.rows[b] - turns.rows[a], turns.constants[b] - turns.constants[a], load)
        case Along():
            return along_axis(name, load.coordinate, load, mechanism, tree, turns)
        case Distance(a, b):
            return [Tendon(a, b, load)]
        case Weighted():
            raise TypeError(f"force {name}: a law on a sum of coordinates is not given to MuJoCo here")
        case _:
            assert_never(load.coordinate)


def on_joints(name: str, row: Array, constant: float, law: Law) -> list[Native]:
    """Return the elements for a law on L = row . y + constant; the constant part of the law is a generalised force."""
    elements: list[Native] = []
    if law.bias:
        elements.append(Steady(row, law.bias, (name,)))
    if law.k or law.c:
        elements.append(OnJoints(row, constant, law.k, law.c, law.rest))
    return elements


def point_force(f: PointForce, turns: Turning) -> list[Native]:
    """Return the elements for a constant force that is fixed in the world, in its own link, or in another link.

    If it is fixed in another link, it is exact only if that link's hinges do not move the point. That link only gives the
    direction: a second force cancels the reaction on it.

    Raises:
        RunFailure: the force is fixed in a link whose hinges move the point (status SKIP).
    """
    link, bias = f.point.link, (1.0, 0.0, 0.0)
    if not f.value.any():
        return []  # without a direction it cannot become a motor either
    if turns.together(f.frame, GROUND):
        world = Point(GROUND, np.zeros(2), "ground")
        return [AtSite(f.name, f.point, world, rotate(f.value, turns.constants[f.frame]), bias, constant=True)]
    if turns.together(f.frame, link):
        turned = rotate(f.value, turns.constants[f.frame] - turns.constants[link])
        return [AtSite(f.name, f.point, None, turned, bias, constant=True)]
    if turns.apart(f.frame, link):
        frame = Point(f.frame, np.zeros(2), "centre of mass")
        return [AtSite(f.name, f.point, frame, f.value, bias), AtSite(f.name, frame, None, f.value, bias)]
    raise RunFailure(Status.SKIP, f"MuJoCo cannot turn the force {f.name} with a link whose hinges move its point")


def along_axis(name: str, along: Along, law: Law, mechanism: Mechanism, tree: Tree, turns: Turning) -> list[Native]:
    """Return the elements for a law along an axis: on the coordinate of a parallel slide, or else a site transmission.

    Trap: a site transmission leaves out the torque that acts when the reference site turns. It is exact only if every hinge that
    turns the reference site also turns the other site, because such a hinge does not change the coordinate.

    Raises:
        RunFailure: neither is exact (status SKIP).
    """
    sliding = slide_coordinate(along, mechanism, tree)
    if sliding is not None:
        return on_joints(name, *sliding, law)
    origin, point = along.origin.link, along.point.link
    if turns.turns_with(origin, point):
        axis = unit(along.angle, along.across)
        return [AtSite(name, along.point, along.origin, axis, (law.bias + law.k * law.rest, -law.k, -law.c))]
    names = mechanism.link_name(origin), mechanism.link_name(point)
    text = f"MuJoCo has no exact axis for {name}: in the tree, {names[0]} turns on a hinge that does not turn {names[1]}"
    raise RunFailure(Status.SKIP, text)


def slide_coordinate(along: Along, mechanism: Mechanism, tree: Tree) -> tuple[Array, float] | None:
    """Return the row and constant that express a coordinate along an axis by that of a slide between the same two links.

    None if there is no such slide in the tree, or its axis is not parallel to this one.
    """
    pair = {along.point.link, along.origin.link}
    branch = next((b for b in tree.branches if b.kind == "prismatic" and {b.link, b.parent} == pair), None)
    if branch is None:
        return None
    y, _ = tree.relative(mechanism.q0, mechanism.v0)
    sliding = np.zeros(tree.n)
    sliding[branch.at] = 1.0
    q, v, _ = tree.absolute(y, sliding, np.zeros(tree.n))
    # as the slide moves at unit speed, the rates along and across the axis are cosine and sine of the angle between both
    cosine, sine = rate(along, q, v), rate(replace(along, across=not along.across), q, v)
    if abs(sine) > PARALLEL:
        return None
    sign = float(np.sign(cosine))
    return sign * sliding, float(value(along, q)) - sign * y[branch.at]
