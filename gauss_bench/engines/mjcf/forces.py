"""The forces of a linkage as elements of MuJoCo. This module does not import MuJoCo.

A force is translated only if an element of MuJoCo expresses it exactly; otherwise the linkage is refused. The elements are:

    torque:                                               constant generalised force on the hinges between the two links
    force along a slide, with its reaction on the guide:  constant generalised force on the slide
    force at a point:                                     actuator with a site transmission; if the direction of the force is fixed
                                                          in the world, the reference site is a point of the world
    spring and damper between points:                     spatial tendon
    spring and damper on an angle or a slide:             stiffness and damping of one joint, or a fixed tendon, L = e . y + const
    spring and damper along an axis:                      actuator with a site transmission and a reference site, with the force
                                                          bias + k rest - k x - c x'
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
    """A force along a direction at a point, with the opposite force on the link of the point `frame`.

    The size of the force is bias[0] + bias[1] L + bias[2] dL/dt, where L is the coordinate of the point along the direction,
    measured from `frame`.

    Attributes:
        frame: point from which the length L is measured, on the link that takes the opposite force. None for a force whose
            direction is fixed in the link of `point`, and which has no opposite force.
        direction: (2,) direction of the force, fixed in the link of `frame`, or in the link of `point` if `frame` is None.
        constant: whether this element alone is a constant force of the linkage, so that one control can change that force.
    """

    name: str
    point: Point
    frame: Point | None
    direction: Array
    bias: tuple[float, float, float]
    constant: bool = False


Native = tree_loads.Steady | tree_loads.OnJoints | Tendon | AtSite


def native_forces(mechanism: Mechanism, tree: Tree) -> list[Native]:
    """Return all forces of a mechanism as elements of MuJoCo, except those that vary with time or the direction of motion.

    Raises:
        RunFailure: a force has no exact element (status SKIP); the message names the force and the reason.
    """
    turns = turning(tree)
    elements: list[Native] = []
    for load in tree_loads.sort_loads(mechanism, tree):
        elements += other_load(load, mechanism, turns) if isinstance(load, tree_loads.OtherLoad) else [load]
    return elements


def refuse_forces(mechanism: Mechanism, tree: Tree) -> str | None:
    """Return the reason why elements of MuJoCo cannot express a force, or None if they can express all."""
    try:
        native_forces(mechanism, tree)
    except RunFailure as failure:
        return str(failure)
    return None


def other_load(other: tree_loads.OtherLoad, mechanism: Mechanism, turns: Turning) -> list[Native]:
    """Return the elements of MuJoCo for a load that cannot be written as a spring and damper on tree coordinates.

    Raises:
        RunFailure: no element expresses the load exactly (status SKIP).
    """
    load = other.load
    if isinstance(load, PointForce):
        return point_force(load, turns)
    match load.coordinate:
        case Along():
            return [along_axis(other.name, load.coordinate, load, mechanism, turns)]
        case Distance(a, b):
            return [Tendon(a, b, load)]
        case _:
            raise TypeError(f"force {other.name}: the adapter of MuJoCo does not support a law on {load.coordinate}")


def point_force(f: PointForce, turns: Turning) -> list[Native]:
    """Return the elements of MuJoCo for a constant force at a point; a RunFailure if none express it exactly."""
    link, bias = f.point.link, (1.0, 0.0, 0.0)  # the element's force is bias . [1, L, dL/dt]: constant
    if not f.value.any():
        return []  # a force of zero needs no element, and has no direction in which a motor could change it
    if turns.together(f.frame, GROUND):  # the angle between the link `f.frame` and the ground is constant
        world = Point(GROUND, np.zeros(2), "ground")
        return [AtSite(f.name, f.point, world, rotate(f.value, turns.constants[f.frame]), bias, constant=True)]
    if turns.together(f.frame, link):
        turned = rotate(f.value, turns.constants[f.frame] - turns.constants[link])
        return [AtSite(f.name, f.point, None, turned, bias, constant=True)]
    # The reference site on a third link determines the direction; a second element cancels the opposite force there. This is exact
    # only if no hinge turns both links.
    if turns.apart(f.frame, link):
        frame = Point(f.frame, np.zeros(2), "centre of mass")
        return [AtSite(f.name, f.point, frame, f.value, bias), AtSite(f.name, frame, None, f.value, bias)]
    raise RunFailure(Status.SKIP, f"MuJoCo cannot turn the force {f.name} with a link whose hinges also turn the link of its point")


def along_axis(name: str, along: Along, law: Law, mechanism: Mechanism, turns: Turning) -> AtSite:
    """Return the element of MuJoCo for a force law along an axis to which no slide is parallel; a RunFailure if it is not exact.

    Trap: MuJoCo's site transmission leaves out the torque that the force law exerts on the link of the reference site. So the
    element is exact only if every hinge that turns the reference site also turns the other site: such a hinge does not change the
    coordinate, so the missing torque would do no work.
    """
    origin, point = along.origin.link, along.point.link
    if turns.turns_with(origin, point):
        axis = unit(along.angle, along.across)
        return AtSite(name, along.point, along.origin, axis, (law.bias + law.k * law.rest, -law.k, -law.c))
    names = mechanism.link_name(origin), mechanism.link_name(point)
    text = f"MuJoCo has no exact axis for {name}: in the tree, a hinge turns {names[0]} and does not turn {names[1]}"
    raise RunFailure(Status.SKIP, text)
