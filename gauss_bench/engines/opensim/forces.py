"""Forces of joints by OpenSim: reactions in the tree's joints, and forces of the point constraints that close its loops.

Both are turned into the suite's convention: fx, fy on the second link of a joint, and the moment about its point. OpenSim's
reaction is everything that passes from one link to the other, and so includes what the joint itself does not exert:

    loads on coordinates   a torque, slide motor, spring or damper that is a force on a coordinate in OpenSim: there it passes
                           through that coordinate's joint, in the linkage it acts on the links that it names
    drivers                the force on a prescribed coordinate, along which the joint is free
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
    """Reads joint forces from states of a mechanism's OpenSim model.

    Joints whose forces redundant rows leave undetermined are left out: Simbody's multipliers are one of many solutions there.
    """

    def __init__(self, mechanism: Mechanism, tree: Tree, built: Built):
        self.mechanism, self.tree = mechanism, tree
        determined = list_determined(mechanism)
        joints, constraints = built.model.getJointSet(), built.model.getConstraintSet()
        kept = [b for b in tree.branches if b.joint and b.joint.name in determined]
        self.joints = [(b, joints.get(f"joint{b.at}")) for b in kept]
        pins = [(joint, constraints.get(k)) for k, joint in enumerate(tree.closures)]
        self.pins = [(pin, constraint) for pin, constraint in pins if pin.name in determined]
        self.on_bodies = [x.load for x in sort_loads(mechanism, tree) if isinstance(x, OtherLoad)]
        self.driven = drivers_by_coordinate(mechanism, tree)
        self.beyond = links_beyond(tree)

    def read(self, state: Any, q: Array, v: Array) -> Mapping[str, Array]:
        """Return name of a joint -> (3,) fx, fy [N] on its second link and moment [N m] about its point.

        Args:
            state: OpenSim's, with its accelerations.
            q, v: (n,) the same state in absolute coordinates.
        """
        on_coordinates = generalised(loads(self.mechanism.forces), q, v) - generalised(self.on_bodies, q, v)
        found = {b.joint.name: self._read_joint(b, joint, state, q, on_coordinates) for b, joint in self.joints if b.joint}
        for pin, constraint in self.pins:
            found[pin.name] = np.array([*self._read_pin(*pin.ends, constraint, state, q), 0.0])
        return found

    def _read_joint(self, b: Branch, joint: Any, state: Any, q: Array, on_coordinates: Array) -> Array:
        """Return fx, fy and moment (3,) of a joint of the tree.

        Args:
            joint: OpenSim's.
            on_coordinates: (n,) generalised forces of the loads that OpenSim has on coordinates.
        """
        assert b.joint
        second = b.joint.ends[1]
        about = position(q, second)
        reaction = joint.calcReactionOnChildExpressedInGround(state)  # about the origin of the child's frame
        force, moment = np.array([reaction.get(1).get(i) for i in range(2)]), reaction.get(0).get(2)
        moment += moment_of(position(q, Point(b.link, b.anchor, "")) - about, force)
        for i in self.beyond[b.link]:
            push = place_at(on_coordinates, i)
            force = force - push
            moment -= angle_at(on_coordinates, i) + moment_of(place_at(q, i) - about, push)
        if b.at in self.driven and b.kind == "revolute":
            moment = 0.0
        elif b.at in self.driven:  # a driver's force acts on the point of the block, so that it has no moment about it
            axis = turn_with(b.parent, b.axis, q)
            force = force - axis * (axis @ force)
        sign = 1.0 if second.link == b.link else -1.0  # a joint used backwards has its second link as parent
        return sign * np.array([*force, moment])

    def _read_pin(self, a: Point, b: Point, constraint: Any, state: Any, q: Array) -> Array:
        """Return the force (2,) of a closing pin on its second link.

        OpenSim lists for each body what stands at the left of the equations of motion, so that the first body's entry is the force
        on the second. Trap: Simbody gives it in the frame of the outermost body from which both hang, and that may turn.
        """
        values = constraint.getRecordValues(state)
        force = np.array([values.get(0), values.get(1)])
        return turn_with(nearest_common(self.beyond, a.link, b.link), force, q)


def turn_with(link: int, vector: Array, q: Array) -> Array:
    """Return a vector (2,) of a link's frame, or of the ground's, in the world's."""
    return vector if link == GROUND else rotate(vector, np.asarray(angle_at(q, link)))


def moment_of(arm: Array, force: Array) -> float:
    """Return the moment of a force (2,) at an arm (2,)."""
    return float(wedge(Vec(*arm), Vec(*force)))


def generalised(acting: Iterable[Load], q: Array, v: Array) -> Array:
    """Return the generalised forces (n,) of loads at a state q, v (n,)."""
    at, Q = Placed(q, v), np.zeros_like(q)
    for load in acting:
        for k, x in generalise(at, load).items():
            Q[k] += x
    return Q


def links_beyond(tree: Tree) -> dict[int, list[int]]:
    """Return link -> the links that hang on it in the tree, with itself."""
    beyond = {b.link: [b.link] for b in tree.branches}
    for b in reversed(tree.branches):  # children before their parents
        if b.parent != GROUND:
            beyond[b.parent] += beyond[b.link]
    return beyond


def nearest_common(beyond: Mapping[int, list[int]], a: int, b: int) -> int:
    """Return the outermost link on which two links hang; GROUND if there is none."""
    both = [link for link, hanging in beyond.items() if a in hanging and b in hanging]
    return min(both, key=lambda link: len(beyond[link]), default=GROUND)
