"""Joint forces by OpenSim: reactions in the tree's joints, and forces of the point constraints that close its loops.

The suite's convention is fx, fy on the second link of a joint, and the moment about the joint's point on this link. The reaction
that OpenSim reports includes two kinds of forces that the joint of the linkage does not exert. They are subtracted:

    loads on coordinates:   A torque, slide motor, spring or damper is a force on a coordinate in OpenSim, and is transmitted by
                            the coordinate's joint. In the linkage, it acts directly on the links that the load's entry names.
    drivers:                The force that moves a prescribed coordinate acts in a direction in which the joint is free.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from gauss_bench.engines.opensim.translate import Built
from gauss_bench.engines.shared import drivers_by_coordinate
from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.engines.tree_loads import OtherLoad, sort_loads
from gauss_bench.mechanism.coordinates import Placed, position, rotate
from gauss_bench.mechanism.equations import generalise
from gauss_bench.mechanism.evaluate import list_determined
from gauss_bench.mechanism.model import GROUND, Load, Mechanism, Point, loads
from gauss_bench.mechanism.spaces import Vec, angle_at, place_at, wedge
from gauss_bench.terms import Array


class JointForces:
    """A reader of joint forces from states of a mechanism's OpenSim model.

    Joints whose forces are not unique, because of redundant constraint rows, are left out.

    Attributes:
        joints: pairs of a branch of the tree (a link with its joint) and OpenSim's object for the joint.
        pins: pairs of a pin that closes a loop and OpenSim's object for its constraint.
        on_bodies: loads that OpenSim applies to bodies; all other loads are forces on coordinates.
        driven: index of a driven tree coordinate -> its driver.
        subtrees: link -> the link itself and all its descendants in the tree.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, built: Built):
        self.mechanism = mechanism
        determined = list_determined(mechanism)
        joints, constraints = built.model.getJointSet(), built.model.getConstraintSet()
        self.joints = [(b, joints.get(f"joint{b.at}")) for b in tree.branches if b.joint and b.joint.name in determined]
        self.pins = [(pin, constraints.get(k)) for k, pin in enumerate(tree.closures) if pin.name in determined]
        self.on_bodies = [x.load for x in sort_loads(mechanism, tree) if isinstance(x, OtherLoad)]
        self.driven = drivers_by_coordinate(mechanism, tree)
        self.subtrees = {b.link: [b.link] for b in tree.branches}
        for b in reversed(tree.branches):  # a child's list is complete before it is added to its parent's
            if b.parent != GROUND:
                self.subtrees[b.parent] += self.subtrees[b.link]

    def read(self, state: Any, q: Array, v: Array) -> Mapping[str, Array]:
        """Return name of a joint -> (3,) fx, fy [N] on its second link and moment [N m] about the joint's point.

        `state` is OpenSim's, with accelerations, and q, v (n,) is the same state in absolute coordinates.
        """
        # (n,) generalised forces of the loads that OpenSim applies to coordinates: all loads minus those on bodies
        on_coordinates = generalised(loads(self.mechanism.forces), q, v) - generalised(self.on_bodies, q, v)
        forces = {b.joint.name: self._read_joint(b, joint, state, q, on_coordinates) for b, joint in self.joints if b.joint}
        for pin, constraint in self.pins:
            # OpenSim writes constraint forces on the left side of the equations of motion. So its entry for the first body is minus
            # the force on this body: the force on the second body. Trap: the entry's components are given in the frame of the
            # nearest common ancestor of both bodies in the tree, which may be turned.
            values, (a, b) = constraint.getRecordValues(state), pin.ends
            common = [link for link, subtree in self.subtrees.items() if a.link in subtree and b.link in subtree]
            nearest = min(common, key=lambda link: len(self.subtrees[link]), default=GROUND)
            force = turn_with(nearest, np.array([values.get(0), values.get(1)]), q)
            forces[pin.name] = np.array([*force, 0.0])  # a pin exerts no moment about its point
        return forces

    def _read_joint(self, b: Branch, joint: Any, state: Any, q: Array, on_coordinates: Array) -> Array:
        """Return (3,) fx, fy [N] on the second link of a branch's joint, and the moment [N m] about the joint's point on this link.

        `joint` is OpenSim's; `on_coordinates` (n,) are the forces on the links by loads that are forces on coordinates in OpenSim.
        """
        assert b.joint
        second = b.joint.ends[1]
        about = position(q, second)  # (2,) [m] the joint's point
        reaction = joint.calcReactionOnChildExpressedInGround(state)  # about the origin of the child's frame
        force, moment = np.array([reaction.get(1).get(i) for i in range(2)]), reaction.get(0).get(2)
        moment += moment_of(position(q, Point(b.link, b.anchor, "")) - about, force)
        # OpenSim's reaction carries the loads on coordinates of the link and of its descendants. In the linkage they act on the
        # links themselves, and not through the joint, so they are subtracted.
        for link in self.subtrees[b.link]:
            push = place_at(on_coordinates, link)  # (2,) [N] at the link's centre of mass
            force = force - push
            moment -= angle_at(on_coordinates, link) + moment_of(place_at(q, link) - about, push)
        if b.at in self.driven and b.kind == "revolute":  # the whole moment is the driver's torque: a pin itself exerts none
            moment = 0.0
        elif b.at in self.driven:  # the force of a slide's driver acts on the block's point, so it has no moment about this point
            axis = turn_with(b.parent, b.axis, q)
            force = force - axis * (axis @ force)
        sign = 1.0 if second.link == b.link else -1.0  # if the second link is the parent, its force is opposite
        return sign * np.array([*force, moment])


def turn_with(link: int, vector: Array, q: Array) -> Array:
    """Return the components (2,) in the world of a vector (2,) in the frame of a link or of the ground."""
    return vector if link == GROUND else rotate(vector, np.asarray(angle_at(q, link)))


def moment_of(arm: Array, force: Array) -> float:
    """Return the moment [N m] of a force (2,) [N] at an arm (2,) [m]."""
    return float(wedge(Vec(*arm), Vec(*force)))


def generalised(acting: Iterable[Load], q: Array, v: Array) -> Array:
    """Return the generalised forces (n,) of loads at a state q, v (n,)."""
    at, Q = Placed(q, v), np.zeros_like(q)
    for load in acting:
        for k, x in generalise(at, load).items():
            Q[k] += x
    return Q
