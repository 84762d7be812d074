"""A linkage as a tree of Bullet's joints; point-to-point constraints close the pins that the tree leaves open.

The frames of all links in Bullet are parallel when all joint coordinates y are zero. So Bullet's frame of a link may be turned by a
constant angle against the link's own frame, as for the block of a slide. The coordinates of the points on the link include this
angle, so that no quaternion rounds it. A link that is not connected to the ground by the tree is carried by three joints in a row,
which are two slides and a hinge, and by two massless links between these joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gauss_bench.engines.bullet.world import NO_SHAPE, ORIGIN, World
from gauss_bench.engines.shared import closing_pins, measure_gaps, spatial
from gauss_bench.engines.tree import Tree, turning
from gauss_bench.mechanism.coordinates import rotate
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.terms import Array

LEVEL = (0.0, 0.0, 0.0, 1.0)  # quaternion of a frame that is not turned
UPWARDS: Sequence[float] = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Joint:
    """A joint of Bullet's tree, and the link that the joint carries.

    Attributes:
        parent: number of the parent joint, counted from 1; 0 is the base.
        turns: whether the joint is a hinge; otherwise it is a slide.
        origin: (3,) place of the joint in the parent's frame [m].
        axis: (3,) axis of the joint in the parent's frame.
        centre: (3,) centre of mass of the link in the joint's frame [m].
        mass, inertia: of the link [kg], [kg m^2].
    """

    parent: int
    turns: bool
    origin: Sequence[float]
    axis: Sequence[float]
    centre: Sequence[float]
    mass: float
    inertia: float


def list_joints(mechanism: Mechanism, tree: Tree) -> list[Joint]:
    """List Bullet's joints in the order of the tree coordinates; a branch that is not "free" makes one joint.

    Bullet's frames of all links are parallel at y = 0; the links' own frames are rotated relative to Bullet's by constant angles.
    """
    angles = turning(tree).constants  # (links + 1,) [rad] of these constant angles; the ground's is the last, at index -1
    carriers = {GROUND: 0}  # link -> number of the joint that carries the link; numbers count from 1, and 0 is the base
    origins: dict[int, Array] = {GROUND: np.zeros(2)}  # link -> its joint relative to its centre of mass, in Bullet's frame
    joints: list[Joint] = []
    for b in tree.branches:
        mass, inertia = mechanism.links[b.link].mass, mechanism.links[b.link].inertia
        if b.kind == "free":
            # slides along x and y that carry no mass, then a hinge that carries the link; after a joint was appended, its number
            # is len(joints), because numbers count from 1
            joints.append(Joint(0, turns=False, origin=ORIGIN, axis=(1.0, 0.0, 0.0), centre=ORIGIN, mass=0.0, inertia=0.0))
            joints.append(
                Joint(len(joints), turns=False, origin=ORIGIN, axis=(0.0, 1.0, 0.0), centre=ORIGIN, mass=0.0, inertia=0.0)
            )
            joints.append(Joint(len(joints), turns=True, origin=ORIGIN, axis=UPWARDS, centre=ORIGIN, mass=mass, inertia=inertia))
            carriers[b.link], origins[b.link] = len(joints), np.zeros(2)
            continue
        place = spatial(rotate(b.parent_anchor + b.base, angles[b.parent]) - origins[b.parent])
        axis = UPWARDS if b.kind == "revolute" else spatial(rotate(b.axis, angles[b.parent]))
        origins[b.link] = rotate(b.anchor, angles[b.link])
        centre = spatial(-origins[b.link])
        joints.append(Joint(carriers[b.parent], b.kind == "revolute", place, axis, centre, mass, inertia))
        carriers[b.link] = len(joints)
    return joints


class TreeWorld(World):
    """A world of Bullet in which a tree of joints carries the links of a linkage; if `closed` is false, the loops stay open."""

    def __init__(self, pybullet: Any, mechanism: Mechanism, tree: Tree, options: Mapping[str, Any], closed: bool = True):
        """Add the tree of joints to a new world, without the motors that brake joints by default, and close its loops."""
        super().__init__(pybullet, mechanism, options)
        self.tree, self.pins = tree, closing_pins(tree)
        self.joints = list_joints(mechanism, tree)
        self.all = list(range(len(self.joints)))
        self.body = self._add_body()
        self._set_damping_and_limits(self.body)
        for k in self.all:  # switches off the motor that brakes each joint
            self._call(pybullet.setJointMotorControl2, self.body, k, pybullet.VELOCITY_CONTROL, force=0)
        for a, b in self.pins if closed else ():
            near, far = (self.body, self.carrier(a.link)), (self.body, self.carrier(b.link))
            self._close(near, far, self._pivot(a), self._pivot(b))
        # a run calls these two at every step, so their arguments are bound once
        joints = {"bodyUniqueId": self.body, "jointIndices": self.all, "physicsClientId": self.client}
        self._push = partial(pybullet.setJointMotorControlArray, controlMode=pybullet.TORQUE_CONTROL, **joints)
        self._read = partial(pybullet.getJointStates, **joints)

    def _add_body(self) -> Any:
        """Add the tree to the world, with masses and inertias, and return Bullet's number of the tree."""
        pybullet, joints, count = self.pybullet, self.joints, len(self.joints)
        kinds = [pybullet.JOINT_REVOLUTE if x.turns else pybullet.JOINT_PRISMATIC for x in joints]
        body = self._call(
            pybullet.createMultiBody,
            baseMass=0.0,
            baseCollisionShapeIndex=NO_SHAPE,
            baseVisualShapeIndex=NO_SHAPE,
            linkMasses=[x.mass for x in joints],
            linkCollisionShapeIndices=[NO_SHAPE] * count,
            linkVisualShapeIndices=[NO_SHAPE] * count,
            linkPositions=[x.origin for x in joints],
            linkOrientations=[LEVEL] * count,
            linkInertialFramePositions=[x.centre for x in joints],
            linkInertialFrameOrientations=[LEVEL] * count,
            linkParentIndices=[x.parent for x in joints],
            linkJointTypes=kinds,
            linkJointAxis=[x.axis for x in joints],
        )
        for k, joint in enumerate(joints):
            inertia = [joint.inertia] * 3  # only the moment about the third axis acts
            self._call(pybullet.changeDynamics, body, k, mass=joint.mass, localInertiaDiagonal=inertia)
        return body

    def damp(self, coefficients: Array) -> None:
        """Set the damping (n,) of the joints [N s/m, N m s/rad]."""
        for k, c in enumerate(coefficients):
            self._call(self.pybullet.changeDynamics, self.body, k, jointDamping=float(c))

    def carrier(self, link: int) -> int:
        """Return Bullet's index of a link; -1 for the ground."""
        if link == GROUND:
            return -1
        (branch,) = [b for b in self.tree.branches if b.link == link]
        # a free link hangs on three joints in a row: slide along x, slide along y, hinge; the third carries the link
        return branch.at + (2 if branch.kind == "free" else 0)

    def _pivot(self, point: Point) -> list[float]:
        """Return a point (3,) [m] relative to the centre of mass of its link, in Bullet's frame."""
        return spatial(rotate(point.local, turning(self.tree).constants[point.link]))

    def put(self, y: Array, dy: Array) -> None:
        """Set the tree state y, dy (n,)."""
        for k in self.all:
            self._call(self.pybullet.resetJointState, self.body, k, float(y[k]), float(dy[k]))

    def state(self) -> tuple[Array, Array]:
        """Return the tree state y, dy (n,)."""
        states = self._read()
        return np.array([x[0] for x in states]), np.array([x[1] for x in states])

    def drive(self, joint: int, rate: float) -> None:
        """Let the motor of a joint reach a speed `rate` [rad/s, m/s] within the next step."""
        motor = {"targetVelocity": rate, "velocityGain": 1.0, "force": self.strongest}
        self._call(self.pybullet.setJointMotorControl2, self.body, joint, self.pybullet.VELOCITY_CONTROL, **motor)

    def step(self, tau: Sequence[float]) -> None:
        """Take a step with the forces tau (n,) [N, N m] in the joints."""
        self._push(forces=tau)
        self._advance()

    def gaps(self) -> Array:
        """Return point b minus point a of every closing pin (pins, 2) [m], by Bullet's own kinematics."""
        return measure_gaps(self.pins, self._place)

    def _place(self, point: Point) -> Array:
        """Return the place (2,) [m] of a point in the world, by Bullet's own kinematics."""
        link, pivot = self.carrier(point.link), self._pivot(point)
        if link < 0:
            return np.array(pivot[:2])
        centre, turn, *_ = self._call(self.pybullet.getLinkState, self.body, link, computeForwardKinematics=True)
        # PyBullet's multiplyTransforms would be exact to 1e-8 only
        return np.array(centre[:2]) + rotate(np.array(pivot[:2]), 2 * np.arctan2(turn[2], turn[3]))
