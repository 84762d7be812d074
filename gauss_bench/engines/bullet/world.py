"""Linkages in Bullet: `TreeWorld` has a tree of joints, `BodyWorld` free bodies; point-to-point constraints close the loops.

Traps of PyBullet 3.2.7, which reports none of them:

    changeDynamics     If one call sets linearDamping, angularDamping or maxJointVelocity together with mass or inertia, it sets
                       mass and inertia of the base, and frees the base. So damping and the limit of speeds are set in calls of
                       their own.
    damping            By default, damping of 0.04 slows every link of a tree, by terms linear and quadratic in the link's speed.
    speeds             By default, joints cannot be faster than 100 rad/s or m/s.
    motors             By default, a motor brakes every joint.
    inertias           The inertias of a body without a collision shape are zero until they are set.
    torques            Bullet forgets applied forces and torques after a step.
    rigid bodies       Rigid bodies feel no torque in their first step.
    closures           By default, a loop closure exerts an impulse of at most 500 N s in a step.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np

from gauss_bench.engines.following import wind
from gauss_bench.engines.shared import closing_pins, measure_gaps, spatial
from gauss_bench.engines.tree import Tree, turning
from gauss_bench.mechanism.coordinates import rotate
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.terms import Array

ORIGIN: Sequence[float] = (0.0, 0.0, 0.0)
UPWARDS: Sequence[float] = (0.0, 0.0, 1.0)
LEVEL = (0.0, 0.0, 0.0, 1.0)  # quaternion of a frame that is not turned
NO_SHAPE = -1
FASTEST = 1e9  # [rad/s, m/s] limit of joint speeds, beyond every speed of a linkage
STRONGEST = 1e9  # [N s, N m s] limit of the impulse of a closure or motor in a step


class World:
    """A world of Bullet with a solver and gravity; `set_step` must be called before the first step.

    Attributes:
        constraints: Bullet's numbers of the closures.
    """

    def __init__(self, pybullet: Any, mechanism: Mechanism, options: Mapping[str, Any]):
        self.pybullet, self.options = pybullet, options
        self.client: int = pybullet.connect(pybullet.DIRECT)
        finalize(self, pybullet.disconnect, self.client)  # a world that is no longer used does not stay connected
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
        """Call a function of PyBullet for this world."""
        return function(*arguments, **keywords, physicsClientId=self.client)

    def _set_damping_and_limits(self, body: int) -> None:
        """Set the damping of all links of a Bullet body to the option `damping`, and the limit of joint speeds to FASTEST."""
        damping = self.options["damping"]
        # index -1 is the base, but Bullet has one value of each number for all links and joints of the body
        self._call(self.pybullet.changeDynamics, body, -1, linearDamping=damping, angularDamping=damping)
        self._call(self.pybullet.changeDynamics, body, -1, maxJointVelocity=FASTEST)

    def _close(self, a: tuple[int, int], b: tuple[int, int], point_a: Sequence[float], point_b: Sequence[float]) -> None:
        """Make a point of the link `a` coincide with a point of the link `b`.

        Args:
            a, b: Bullet's index of the body, and index of the link in this body, for each of the two links.
            point_a, point_b: (3,) the points relative to the links' centres of mass, in Bullet's frames [m].
        """
        kind = self.pybullet.JOINT_POINT2POINT
        self.constraints.append(self._call(self.pybullet.createConstraint, *a, *b, kind, ORIGIN, point_a, point_b))

    def set_step(self, step: float) -> None:
        """Set the step size [s], and the limit of forces so that the largest impulse of closures and motors stays the same."""
        self.strongest = STRONGEST / step
        self._call(self.pybullet.setTimeStep, step)
        for constraint in self.constraints:
            self._call(self.pybullet.changeConstraint, constraint, maxForce=self.strongest)

    def set_residual(self, residual: float) -> None:
        """Set the squared change of a relative speed [m^2/s^2] below which the solver's iteration ends."""
        self._call(self.pybullet.setPhysicsEngineParameter, solverResidualThreshold=residual)


class Joint(NamedTuple):
    """A joint of Bullet's tree, and the link that the joint carries.

    Attributes:
        parent: number of the parent joint, counted from 1; 0 is the base.
        turns: whether the joint is a hinge; otherwise it is a slide.
        axis, origin: (3,) the joint's axis, and its position [m] relative to the parent joint.
        centre: (3,) centre of mass of the link in the joint's frame [m].
        mass, inertia: of the link [kg], [kg m^2].
    """

    parent: int
    turns: bool
    axis: Sequence[float]
    origin: Sequence[float] = ORIGIN
    centre: Sequence[float] = ORIGIN
    mass: float = 0.0
    inertia: float = 0.0


def list_joints(mechanism: Mechanism, tree: Tree) -> list[Joint]:
    """List Bullet's joints in the order of the tree coordinates.

    At y = 0, Bullet's frames of all links are parallel, so a link such as the block of a slide is turned by a constant angle
    relative to its frame in Bullet. Points are turned by this angle here, because a quaternion in Bullet would round it. Three
    joints in a row carry a free link: two slides without mass and a hinge.
    """
    angles = turning(tree).constants  # (links + 1,) [rad], these constant angles; the ground's is the last, at index -1
    carriers = {GROUND: 0}  # link -> number, counted from 1, of the joint that carries the link; 0 is the base
    origins: dict[int, Array] = {GROUND: np.zeros(2)}  # link -> vector from its centre of mass to its joint, in Bullet's frame
    joints: list[Joint] = []
    for b in tree.branches:
        mass, inertia = mechanism.links[b.link].mass, mechanism.links[b.link].inertia
        if b.kind == "free":  # after a joint was appended, its number is len(joints)
            joints.append(Joint(0, turns=False, axis=(1.0, 0.0, 0.0)))
            joints.append(Joint(len(joints), turns=False, axis=(0.0, 1.0, 0.0)))
            joints.append(Joint(len(joints), turns=True, axis=UPWARDS, mass=mass, inertia=inertia))
            origins[b.link] = np.zeros(2)
        else:
            place = spatial(rotate(b.parent_anchor + b.base, angles[b.parent]) - origins[b.parent])
            axis = UPWARDS if b.kind == "revolute" else spatial(rotate(b.axis, angles[b.parent]))
            origins[b.link] = rotate(b.anchor, angles[b.link])
            centre = spatial(-origins[b.link])
            joints.append(Joint(carriers[b.parent], b.kind == "revolute", axis, place, centre, mass, inertia))
        carriers[b.link] = len(joints)
    return joints


class TreeWorld(World):
    """A world of Bullet in which a tree of joints carries the links of a linkage; if `closed` is false, the loops stay open.

    Attributes:
        carriers: link -> Bullet's index of the link, which is that of the joint that carries it; -1 for the ground.
    """

    def __init__(self, pybullet: Any, mechanism: Mechanism, tree: Tree, options: Mapping[str, Any], closed: bool = True):
        super().__init__(pybullet, mechanism, options)
        self.pins = closing_pins(tree)
        self.angles = turning(tree).constants
        joints = list_joints(mechanism, tree)
        self.joint_indices = list(range(len(joints)))
        # the last coordinate of a branch is that of the joint that carries its link: a free link hangs on three joints in a row
        self.carriers = {GROUND: -1} | {b.link: b.at + len(b.coordinates) - 1 for b in tree.branches}
        self.body = self._add_body(joints)
        self._set_damping_and_limits(self.body)
        for k in self.joint_indices:  # switches off the motor that brakes each joint
            self._call(pybullet.setJointMotorControl2, self.body, k, pybullet.VELOCITY_CONTROL, force=0)
        for a, b in self.pins if closed else ():
            link_a, link_b = (self.body, self.carriers[a.link]), (self.body, self.carriers[b.link])
            self._close(link_a, link_b, self._pivot(a), self._pivot(b))
        # a run calls both functions at every step, so their arguments are bound once
        bound = {"bodyUniqueId": self.body, "jointIndices": self.joint_indices, "physicsClientId": self.client}
        self._push = partial(pybullet.setJointMotorControlArray, controlMode=pybullet.TORQUE_CONTROL, **bound)
        self._read = partial(pybullet.getJointStates, **bound)

    def _add_body(self, joints: Sequence[Joint]) -> Any:
        """Add the tree to the world, with masses and inertias, and return Bullet's number of the tree."""
        pybullet, count = self.pybullet, len(joints)
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
            linkJointTypes=[pybullet.JOINT_REVOLUTE if x.turns else pybullet.JOINT_PRISMATIC for x in joints],
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

    def _pivot(self, point: Point) -> list[float]:
        """Return a point (3,) [m] relative to the centre of mass of its link, in Bullet's frame."""
        return spatial(rotate(point.local, self.angles[point.link]))

    def put(self, y: Array, dy: Array) -> None:
        """Set the tree state y, dy (n,)."""
        for k in self.joint_indices:
            self._call(self.pybullet.resetJointState, self.body, k, float(y[k]), float(dy[k]))

    def state(self) -> tuple[Array, Array]:
        """Return the tree state y, dy (n,)."""
        states = self._read()
        return np.array([x[0] for x in states]), np.array([x[1] for x in states])

    def drive(self, joint: int, rate: float) -> None:
        """Make the motor of a joint reach a speed `rate` [rad/s, m/s] within the next step."""
        motor = {"targetVelocity": rate, "velocityGain": 1.0, "force": self.strongest}
        self._call(self.pybullet.setJointMotorControl2, self.body, joint, self.pybullet.VELOCITY_CONTROL, **motor)

    def step(self, tau: Sequence[float]) -> None:
        """Take a step with the forces tau (n,) [N, N m] in the joints."""
        self._push(forces=tau)
        self._advance()

    def gaps(self) -> Array:
        """Return point b minus point a of every closing pin (pins, 2) [m], by Bullet's own kinematics."""

        def place(point: Point) -> Array:
            """Return the place (2,) [m] of a point in the world."""
            link, pivot = self.carriers[point.link], np.array(self._pivot(point)[:2])
            if link < 0:  # the ground
                return pivot
            centre, quaternion, *_ = self._call(self.pybullet.getLinkState, self.body, link, computeForwardKinematics=True)
            # computed here, because PyBullet's multiplyTransforms has errors of 1e-8
            return np.array(centre[:2]) + rotate(pivot, 2 * np.arctan2(quaternion[2], quaternion[3]))

        return measure_gaps(self.pins, place)


class BodyWorld(World):
    """A world of Bullet in which the links of a linkage are free bodies, in absolute coordinates; if `closed`, pins join them."""

    def __init__(self, pybullet: Any, mechanism: Mechanism, options: Mapping[str, Any], closed: bool = True):
        super().__init__(pybullet, mechanism, options)
        self.bodies = [self._add_body(link.mass, link.inertia) for link in mechanism.links]
        bodies = [*self.bodies, self._add_body(0.0, 0.0)]  # the ground is the last, at the index GROUND = -1
        self._advance()  # Bullet sets the inertias of rigid bodies at the end of the first step, and ignores torques in this step
        for pin in mechanism.pins if closed else ():
            a, b = ((bodies[point.link], -1) for point in (pin.a, pin.b))  # -1: the body itself, not a link of a tree
            self._close(a, b, spatial(pin.a.local), spatial(pin.b.local))

    def _add_body(self, mass: float, inertia: float) -> Any:
        """Add a rigid body without a shape, fixed if its mass is 0, and return Bullet's number of the body."""
        pybullet = self.pybullet
        body = self._call(pybullet.createMultiBody, baseMass=mass, baseCollisionShapeIndex=NO_SHAPE, useMaximalCoordinates=1)
        if mass:
            self._call(pybullet.changeDynamics, body, -1, mass=mass, localInertiaDiagonal=[inertia] * 3)
            self._set_damping_and_limits(body)
        return body

    def put(self, q: Array, v: Array) -> None:
        """Set the absolute state q, v (3 links,); the first call of `state` must come after this."""
        self.angles = angles(q).copy()  # angles when they were last set or read: `state` counts turns from them
        for body, place, angle, speed, omega in zip(self.bodies, places(q), angles(q), places(v), angles(v), strict=True):
            quaternion = (0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2)))
            self._call(self.pybullet.resetBasePositionAndOrientation, body, spatial(place), quaternion)
            self._call(self.pybullet.resetBaseVelocity, body, spatial(speed), (0.0, 0.0, float(omega)))

    def state(self) -> tuple[Array, Array]:
        """Return the absolute state q, v (3 links,); between two calls, no link may turn by half a turn or more."""
        q, v = np.empty(3 * len(self.bodies)), np.empty(3 * len(self.bodies))
        for k, body in enumerate(self.bodies):
            place, quaternion = self._call(self.pybullet.getBasePositionAndOrientation, body)
            speed, omega = self._call(self.pybullet.getBaseVelocity, body)
            places(q)[k], places(v)[k] = place[:2], speed[:2]
            angles(q)[k], angles(v)[k] = 2 * np.arctan2(quaternion[2], quaternion[3]), omega[2]
        angles(q)[:] = wind(angles(q), self.angles)  # a quaternion gives an angle only up to whole turns
        self.angles = angles(q).copy()
        return q, v

    def drive(self, joint: int, rate: float) -> None:
        """Raise TypeError, because free bodies have no motors; `Bullet.skip` refuses drivers."""
        raise TypeError("free bodies have no motors")

    def step(self, forces: Sequence[float]) -> None:
        """Take a step with forces and torques (3 links,) at the centres of mass, in the world's axes."""
        for k, body in enumerate(self.bodies):
            x, y, torque = forces[3 * k : 3 * k + 3]
            if x or y:
                place, _ = self._call(self.pybullet.getBasePositionAndOrientation, body)
                self._call(self.pybullet.applyExternalForce, body, -1, (x, y, 0.0), place, self.pybullet.WORLD_FRAME)
            if torque:
                self._call(self.pybullet.applyExternalTorque, body, -1, (0.0, 0.0, torque), self.pybullet.WORLD_FRAME)
        self._advance()
