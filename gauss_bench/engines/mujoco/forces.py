"""The forces of a linkage as elements of MuJoCo. This module does not import MuJoCo.

The angle of a link is a sum of hinge coordinates, theta = e . y + const. A force is modelled only if one of these elements
represents it exactly; otherwise the linkage is skipped:

    torque                                                            constant generalised force on the hinges of the chain
    force at a point                                                  site transmission; if the force keeps its direction in the
                                                                      world, with a reference site there
    spring and damper between points                                  spatial tendon
    spring and damper on an angle or a slide, L = e . y + const       stiffness and damping of one joint, or a fixed tendon
    spring and damper along an axis                                   site transmission with a reference site, k rest - k x - c x'
"""

from dataclasses import dataclass, replace
from typing import assert_never

import numpy as np

from gauss_bench.engines.shared import PARALLEL
from gauss_bench.engines.tree import Tree, Turning
from gauss_bench.engines.tree import turning as turning  # where plug-ins look for it
from gauss_bench.mechanism.coordinates import rate, rotate, value
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, Along, Angle, Distance, Law, Load, Mechanism, Point, PointForce, Weighted, factor_of
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status


@dataclass(frozen=True, eq=False)
class Steady:
    """A constant generalised force (n,) on the tree coordinates."""

    force: Array


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
    """

    point: Point
    frame: Point | None
    direction: Array
    bias: tuple[float, float, float]


Native = Steady | OnJoints | Tendon | AtSite


def native_forces(mechanism: Mechanism, tree: Tree) -> list[Native]:
    """Return all forces that do not vary with time as elements of MuJoCo.

    Raises:
        RunFailure: a force has no exact element (status SKIP); the message names the force and the reason.
    """
    turns = turning(tree)
    steady = [f for f in mechanism.forces if not factor_of(f)]
    return [x for f in steady for load in f.to_loads() for x in native(f.name, load, mechanism, tree, turns)]


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
            return on_joints(turns.rows[b] - turns.rows[a], turns.constants[b] - turns.constants[a], load)
        case Along():
            return along_axis(name, load.coordinate, load, mechanism, tree, turns)
        case Distance(a, b):
            return [Tendon(a, b, load)]
        case Weighted():
            raise TypeError(f"force {name}: a law on a sum of coordinates is not given to MuJoCo here")
        case _:
            assert_never(load.coordinate)


def on_joints(row: Array, constant: float, law: Law) -> list[Native]:
    """Return the elements for a law on L = row . y + constant; the constant part of the law is a generalised force."""
    elements: list[Native] = []
    if law.bias:
        elements.append(Steady(law.bias * row))
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
    if turns.together(f.frame, GROUND):
        world = Point(GROUND, np.zeros(2), "ground")
        return [AtSite(f.point, world, rotate(f.value, turns.constants[f.frame]), bias)]
    if turns.together(f.frame, link):
        return [AtSite(f.point, None, rotate(f.value, turns.constants[f.frame] - turns.constants[link]), bias)]
    if turns.apart(f.frame, link):
        frame = Point(f.frame, np.zeros(2), "centre of mass")
        return [AtSite(f.point, frame, f.value, bias), AtSite(frame, None, f.value, bias)]
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
        return on_joints(*sliding, law)
    origin, point = along.origin.link, along.point.link
    if turns.turns_with(origin, point):
        axis = unit(along.angle, along.across)
        return [AtSite(along.point, along.origin, axis, (law.bias + law.k * law.rest, -law.k, -law.c))]
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
