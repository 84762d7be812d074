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

from dataclasses import dataclass

import numpy as np

from gauss_bench.engines import tree_loads
from gauss_bench.engines.tree import Tree, Turning, turning
from gauss_bench.mechanism.coordinates import rotate
from gauss_bench.mechanism.frames import unit
from gauss_bench.mechanism.model import GROUND, Along, Distance, Law, Mechanism, Point, PointForce
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status


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


Native = tree_loads.Steady | tree_loads.OnJoints | Tendon | AtSite


def native_forces(mechanism: Mechanism, tree: Tree) -> list[Native]:
    """Return all forces that do not vary with time as elements of MuJoCo.

    Raises:
        RunFailure: a force has no exact element (status SKIP); the message names the force and the reason.
    """
    turns = turning(tree)
    elements: list[Native] = []
    for load in tree_loads.sort_loads(mechanism, tree):
        elements += other_load(load, mechanism, turns) if isinstance(load, tree_loads.OtherLoad) else [load]
    return elements


def other_load(other: tree_loads.OtherLoad, mechanism: Mechanism, turns: Turning) -> list[Native]:
    """Return the elements for a load that is no law on tree coordinates."""
    load = other.load
    if isinstance(load, PointForce):
        return point_force(load, turns)
    match load.coordinate:
        case Along():
            return [along_axis(other.name, load.coordinate, load, mechanism, turns)]
        case Distance(a, b):
            return [Tendon(a, b, load)]
        case _:
            raise TypeError(f"force {other.name}: MuJoCo is given no law on {load.coordinate} here")


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


def along_axis(name: str, along: Along, law: Law, mechanism: Mechanism, turns: Turning) -> AtSite:
    """Return the site transmission for a law along an axis to which no slide is parallel.

    Trap: a site transmission leaves out the torque that acts when the reference site turns. It is exact only if every hinge that
    turns the reference site also turns the other site, because such a hinge does not change the coordinate.

    Raises:
        RunFailure: it is not exact (status SKIP).
    """
    origin, point = along.origin.link, along.point.link
    if turns.turns_with(origin, point):
        axis = unit(along.angle, along.across)
        return AtSite(name, along.point, along.origin, axis, (law.bias + law.k * law.rest, -law.k, -law.c))
    names = mechanism.link_name(origin), mechanism.link_name(point)
    text = f"MuJoCo has no exact axis for {name}: in the tree, {names[0]} turns on a hinge that does not turn {names[1]}"
    raise RunFailure(Status.SKIP, text)
