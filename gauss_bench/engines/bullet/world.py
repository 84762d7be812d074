"""A linkage in a world of Bullet: as a tree of links whose open pins are closed by constraints, or as free links.

Bullet's frames never turn against each other at y = 0: the constant angle between block and guide of a slide is taken into the
points of the block, so that no angle is rounded to a quaternion. A free link is three joints, with two links of no mass between.

Traps of PyBullet 3.2.7, none of which it reports:

    changeDynamics     sends mass and inertia to the base, and frees it, if the same call sets linearDamping, angularDamping or
                       maxJointVelocity: these are set in calls of their own
    damping            of 0.04 slows every link, in proportion to the speed and to its square
    speeds             of joints are cut at 100 rad/s or m/s
    motors             brake every joint
    inertias           are zero without a collision shape, until they are set
    torques            are forgotten after a step
    rigid bodies       feel no torque in their first step
    closures           exert at most an impulse of 500 N s in a step
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import finalize

import numpy as np

from gauss_bench.engines.following import wind
from gauss_bench.engines.shared import closing_pins, spatial
from gauss_bench.engines.tree import Tree, turning
from gauss_bench.mechanism.coordinates import rotate
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.terms import Array

LEVEL = (0.0, 0.0, 0.0, 1.0)  # quaternion of no turn
UPWARDS: Sequence[float] = (0.0, 0.0, 1.0)
ORIGIN: Sequence[float] = (0.0, 0.0, 0.0)
NO_SHAPE = -1
FASTEST = 1e9  # [rad/s, m/s] beyond every speed of a linkage
STRONGEST = 1e9  # [N s, N m s] impulse that a closure or motor may exert in a step


@dataclass(frozen=True)
class Joint:
    """A joint of Bullet's tree, with the link that hangs in it.

    Attributes:
        parent: index of the parent among Bullet's joints, from 1 on; 0 is the base.
        origin: of the joint in the parent's frame [m]; axis: there.
        centre: centre of mass of the link in the joint's frame [m].
        mass [kg]; inertia [kg m^2].
    """

    parent: int
    turns: bool
    origin: Sequence[float]
    axis: Sequence[float]
    centre: Sequence[float]
    mass: float
    inertia: float


def list_joints(mechanism: Mechanism, tree: Tree) -> list[Joint]:
    """List Bullet's joints in the order of the tree coordinates."""
    angles = turning(tree).constants  # by which frames of links are turned against Bullet's at y = 0; the last is the ground's
    carriers = {GROUND: 0}  # link -> 1 + index of the joint that carries it
    origins: dict[int, Array] = {GROUND: np.zeros(2)}  # link -> its joint relative to its centre of mass, in Bullet's frame
    joints: list[Joint] = []
    for b in tree.branches:
        mass, inertia = mechanism.links[b.link].mass, mechanism.links[b.link].inertia
        if b.kind == "free":
            joints.append(Joint(0, False, ORIGIN, (1.0, 0.0, 0.0), ORIGIN, 0.0, 0.0))
            joints.append(Joint(len(joints), False, ORIGIN, (0.0, 1.0, 0.0), ORIGIN, 0.0, 0.0))
            joints.append(Joint(len(joints), True, ORIGIN, UPWARDS, ORIGIN, mass, inertia))
            carriers[b.link], origins[b.link] = len(joints), np.zeros(2)
            continue
        place = spatial(rotate(b.parent_anchor + b.base, angles[b.parent]) - origins[b.parent])
        axis = UPWARDS if b.kind == "revolute" else spatial(rotate(b.axis, angles[b.parent]))
        origins[b.link] = rotate(b.anchor, angles[b.link])
        centre = spatial(-origins[b.link])
        joints.append(Joint(carriers[b.parent], b.kind == "revolute", place, axis, centre, mass, inertia))
        carriers[b.link] = len(joints)
    return joints


class World:
    """A linkage in a world of Bullet of its own, which takes one step after another: what both kinds of worlds share.

    `set_step` must be called before the first step.

    Attributes:
        constraints: Bullet's numbers of the closures.
    """

    def __init__(self, pybullet: Any, mechanism: Mechanism, options: Mapping[str, Any]):
        self.pybullet, self.options = pybullet, options
        self.client: int = pybullet.connect(pybullet.DIRECT)
        finalize(self, pybullet.disconnect, self.client)
        self.constraints: list[int] = []
        self._call(
            pybullet.setPhysicsEngineParameter,
            numSolverIterations=options["iterations"],
            solverResidualThreshold=options["residual"],
            erp=options["erp"],
            numSubSteps=options["substeps"],
            constraintSolverType=getattr(pybullet, f"CONSTRAINT_SOLVER_LCP_{options['solver']}"),
        )
        self._call(pybullet.setGravity, *spatial(mechanism.gravity))
        self._advance = partial(pybullet.stepSimulation, physicsClientId=self.client)

    def _call(self, function: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
        return function(*arguments, **keywords, physicsClientId=self.client)

    def _free_from_limits(self, body: int) -> None:
        """Set the damping of a body's links, and raise the limit of its speeds."""
        damping = self.options["damping"]
        self._call(self.pybullet.changeDynamics, body, -1, linearDamping=damping, angularDamping=damping)
        self._call(self.pybullet.changeDynamics, body, -1, maxJointVelocity=FASTEST)

    def _close(self, a: tuple[int, int], b: tuple[int, int], near: Sequence[float], far: Sequence[float]) -> None:
        """Let a point of a link coincide with one of another, both given relative to the centres of mass, in Bullet's frames.

        Args:
            a, b: Bullet's numbers of the body and of its link.
        """
        kind = self.pybullet.JOINT_POINT2POINT
        self.constraints.append(self._call(self.pybullet.createConstraint, *a, *b, kind, ORIGIN, near, far))

    def set_step(self, step: float) -> None:
        """Set the length of a step [s], and the forces that closures and motors may exert, which Bullet keeps as impulses."""
        self.strongest = STRONGEST / step
        self._call(self.pybullet.setTimeStep, step)
        for constraint in self.constraints:
            self._call(self.pybullet.changeConstraint, constraint, maxForce=self.strongest)

    def set_residual(self, residual: float) -> None:
        """Set the squared change of a relative speed [m^2/s^2] at which the iteration ends."""
        self._call(self.pybullet.setPhysicsEngineParameter, solverResidualThreshold=residual)


class TreeWorld(World):
    """A linkage as a tree of joints, in its tree coordinates; without `closed` it has no closures."""

    def __init__(self, pybullet: Any, mechanism: Mechanism, tree: Tree, options: Mapping[str, Any], closed: bool = True):
        super().__init__(pybullet, mechanism, options)
        self.tree, self.pins = tree, closing_pins(tree)
        self.joints = list_joints(mechanism, tree)
        self.all = list(range(len(self.joints)))
        self.body = self._add_body()
        self._free_from_limits(self.body)
        for k in self.all:
            self._call(pybullet.setJointMotorControl2, self.body, k, pybullet.VELOCITY_CONTROL, force=0)
        for a, b in self.pins if closed else ():
            sides = [(self.body, self._carrier(point.link)) for point in (a, b)]
            self._close(sides[0], sides[1], self._pivot(a), self._pivot(b))
        # bound once, because a run calls them at every step
        joints = {"bodyUniqueId": self.body, "jointIndices": self.all, "physicsClientId": self.client}
        self._push = partial(pybullet.setJointMotorControlArray, controlMode=pybullet.TORQUE_CONTROL, **joints)
        self._read = partial(pybullet.getJointStates, **joints)

    def _add_body(self) -> int:
        """Add the tree to the world, with masses and inertias, and return Bullet's number of it."""
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
        return int(body)

    def damp(self, coefficients: Array) -> None:
        """Set the damping (n,) of the joints [N s/m, N m s/rad]."""
        for k, c in enumerate(coefficients):
            self._call(self.pybullet.changeDynamics, self.body, k, jointDamping=float(c))

    def _carrier(self, link: int) -> int:
        """Return Bullet's index of a link, -1 for the ground."""
        if link == GROUND:
            return -1
        (branch,) = [b for b in self.tree.branches if b.link == link]
        return branch.at + (2 if branch.kind == "free" else 0)

    def _pivot(self, point: Point) -> list[float]:
        """Return a point relative to the centre of mass of its link, in Bullet's frame."""
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
        """Let the motor of a joint reach a rate [rad/s, m/s] within the next step."""
        mode = self.pybullet.VELOCITY_CONTROL
        self._call(
            self.pybullet.setJointMotorControl2,
            self.body,
            joint,
            mode,
            targetVelocity=rate,
            velocityGain=1.0,
            force=self.strongest,
        )

    def step(self, tau: Sequence[float]) -> None:
        """Take a step with the forces tau (n,) in the joints."""
        self._push(forces=tau)
        self._advance()

    def gaps(self) -> Array:
        """Return point b minus point a of every closing pin (pins, 2) [m], by Bullet's own kinematics."""
        places = [[self._place(point) for point in pin] for pin in self.pins]
        return np.array([b - a for a, b in places]).reshape(-1, 2)

    def _place(self, point: Point) -> Array:
        """Return where a point is (2,) [m], by Bullet's own kinematics."""
        link, pivot = self._carrier(point.link), self._pivot(point)
        if link < 0:
            return np.array(pivot[:2])
        centre, turn, *_ = self._call(self.pybullet.getLinkState, self.body, link, computeForwardKinematics=True)
        # not by PyBullet's multiplyTransforms, which is right to 1e-8 only
        return np.array(centre[:2]) + rotate(np.array(pivot[:2]), 2 * np.arctan2(turn[2], turn[3]))


class BodyWorld(World):
    """A linkage as free links, in absolute coordinates: every pin is a closure. Without `closed` it has none."""

    def __init__(self, pybullet: Any, mechanism: Mechanism, options: Mapping[str, Any], closed: bool = True):
        super().__init__(pybullet, mechanism, options)
        self.bodies = [self._add_body(link.mass, link.inertia) for link in mechanism.links]
        ground = self._add_body(0.0, 0.0)
        self._advance()  # Bullet takes up the inertias of rigid bodies at the end of a step; in the first, torques have no effect
        self.angles = angles(mechanism.q0).copy()  # of the links when they were last read, from which turns are counted
        for pin in mechanism.pins if closed else ():
            a, b = ((ground if point.link == GROUND else self.bodies[point.link], -1) for point in (pin.a, pin.b))
            self._close(a, b, spatial(pin.a.local), spatial(pin.b.local))

    def _add_body(self, mass: float, inertia: float) -> int:
        """Add a rigid body without a shape, and return Bullet's number of it."""
        pybullet = self.pybullet
        body = int(self._call(pybullet.createMultiBody, baseMass=mass, baseCollisionShapeIndex=NO_SHAPE, useMaximalCoordinates=1))
        if mass:
            self._call(pybullet.changeDynamics, body, -1, mass=mass, localInertiaDiagonal=[inertia] * 3)
            self._free_from_limits(body)
        return body

    def put(self, q: Array, v: Array) -> None:
        """Set the absolute state q, v (3 links,)."""
        self.angles = angles(q).copy()
        for body, place, angle, speed, omega in zip(self.bodies, places(q), angles(q), places(v), angles(v), strict=True):
            quaternion = (0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2)))
            self._call(self.pybullet.resetBasePositionAndOrientation, body, spatial(place), quaternion)
            self._call(self.pybullet.resetBaseVelocity, body, spatial(speed), (0.0, 0.0, float(omega)))

    def state(self) -> tuple[Array, Array]:
        """Return the absolute state q, v (3 links,); links must turn by less than half a turn between two calls."""
        q, v = np.empty(3 * len(self.bodies)), np.empty(3 * len(self.bodies))
        for k, body in enumerate(self.bodies):
            place, turn = self._call(self.pybullet.getBasePositionAndOrientation, body)
            speed, spin = self._call(self.pybullet.getBaseVelocity, body)
            places(q)[k], places(v)[k] = place[:2], speed[:2]
            angles(q)[k], angles(v)[k] = 2 * np.arctan2(turn[2], turn[3]), spin[2]
        angles(q)[:] = wind(angles(q), self.angles)
        self.angles = angles(q).copy()
        return q, v

    def drive(self, joint: int, rate: float) -> None:
        """Refuse: motors are in joints of a tree, and `refusal` lets no driven linkage come here."""
        raise TypeError("free bodies have no motors")

    def step(self, forces: Sequence[float]) -> None:
        """Take a step with the forces (3 links,) at the centres of mass, in the world's axes."""
        for k, body in enumerate(self.bodies):
            x, y, torque = forces[3 * k : 3 * k + 3]
            if x or y:
                place, _ = self._call(self.pybullet.getBasePositionAndOrientation, body)
                self._call(self.pybullet.applyExternalForce, body, -1, (x, y, 0.0), place, self.pybullet.WORLD_FRAME)
            if torque:
                self._call(self.pybullet.applyExternalTorque, body, -1, (0.0, 0.0, torque), self.pybullet.WORLD_FRAME)
        self._advance()
