"""A linkage as a DART world: a skeleton (tree of joints) carries the links, and a ball constraint closes each pin outside the tree.

DART's coordinates are the tree coordinates y in another order. Frames of links lie at their centres of mass. Springs and dampers
that act on one coordinate become elements of DART, which treats them implicitly, unless the knob `joint_forces` is "explicit". The
adapter passes all other forces to DART before each step. A driven joint uses DART's velocity actuator.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gauss_bench.engines.given_forces import GivenForces, on_one_joint
from gauss_bench.engines.shared import closing_pins, drivers_by_coordinate, measure_gaps, spatial
from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.mechanism.spaces import angles, places
from gauss_bench.terms import Array

OUT_OF_PLANE = [0.0, 0.0, 1.0]
IMPLICIT, EXPLICIT = "implicit", "explicit"  # values of the knob `joint_forces`


def forces_of(mechanism: Mechanism, tree: Tree, joint_forces: str) -> GivenForces:
    """Return a mechanism's forces; if `joint_forces` is IMPLICIT, springs and dampers on one coordinate are DART's elements."""
    return GivenForces(mechanism, tree, lambda load: joint_forces == IMPLICIT and on_one_joint(load))


@dataclass(eq=False)
class Built:
    """A DART world with one skeleton.

    Attributes:
        world, skeleton: DART's objects.
        bodies: DART's bodies, in the order of the links.
        order: (n,) DART's index of every tree coordinate.
        pins: for each closing pin, its two ends: DART's body (None for the ground) and the point (3,) in its frame [m].
        start: (2, n) tree state y, dy at the start.
        closures: Python's references to the constraints, which keep them alive.
    """

    world: Any
    skeleton: Any
    bodies: list[Any]
    order: Array
    pins: list[tuple[tuple[Any, Array], tuple[Any, Array]]]
    start: Array
    closures: list[Any] = field(default_factory=list)

    def put(self, y: Array, dy: Array) -> None:
        """Set the tree state y, dy (n,)."""
        positions, speeds = np.empty_like(y), np.empty_like(dy)
        positions[self.order], speeds[self.order] = y, dy
        self.skeleton.setPositions(positions)
        self.skeleton.setVelocities(speeds)

    def command(self, values: Array) -> None:
        """Set the forces (n,) on the tree coordinates for the next steps; a driven coordinate is given its speed instead."""
        ordered = np.empty_like(values)
        ordered[self.order] = values
        self.skeleton.setCommands(ordered)

    def push(self, forces: Array) -> None:
        """Set the forces and torques (3 links,) on the links, at their centres of mass, for the next steps."""
        for body, force, torque in zip(self.bodies, places(forces), angles(forces), strict=True):
            body.setExtForce(spatial(force))  # replaces the earlier force and torque, so that torques do not add up over steps
            body.addExtTorque([0.0, 0.0, torque], False)  # False: about the axis of the world

    @property
    def y(self) -> Array:
        """The tree coordinates (n,)."""
        return np.asarray(self.skeleton.getPositions()[self.order])

    @property
    def dy(self) -> Array:
        """The rates of the tree coordinates (n,)."""
        return np.asarray(self.skeleton.getVelocities()[self.order])

    def restart(self, constraint: Any) -> None:
        """Reset the world to the start, and replace the closures: new ones have no stored impulse of an earlier run.

        Trap: a closure connects the points that coincide when it is made. `constraint` is DART's module of constraints.
        """
        self.world.reset()
        self.put(*self.start)
        constraints = self.world.getConstraintSolver()
        constraints.removeAllConstraints()
        self.closures = []
        for pin in self.pins:
            bodies = [body for body, _ in pin if body is not None]  # a body that is left out stands for the ground
            self.closures.append(constraint.BallJointConstraint(*bodies, place(*pin[0])))
            constraints.addConstraint(self.closures[-1])

    def gaps(self) -> Array:
        """Return point b minus point a of every closing pin (pins, 2) [m], by DART's own kinematics."""
        return measure_gaps(self.pins, lambda end: place(*end))


class Builder:
    """Builds a DART world of a mechanism, whose loops are still open.

    Attributes:
        forces: the applied loads; DART itself models the springs and dampers in `forces.own`.
        motors: whether driven joints follow motion laws; otherwise they move freely.
        bodies: link -> DART's body.
        coordinates: index of a tree coordinate -> DART's joint, and the index within it.
    """

    def __init__(self, dartpy: Any, mechanism: Mechanism, tree: Tree, forces: GivenForces, motors: bool = True):
        self.dartpy, self.mechanism, self.tree, self.forces, self.motors = dartpy, mechanism, tree, forces, motors
        self.skeleton = dartpy.dynamics.Skeleton("linkage")
        self.bodies: dict[int, Any] = {}
        self.coordinates: dict[int, tuple[Any, int]] = {}

    def build(self) -> Built:
        """Return the simulation world with open loops; `Built.restart` adds the constraints that close them."""
        world, mechanism = self.dartpy.simulation.World(), self.mechanism
        world.setGravity(spatial(mechanism.gravity))
        asleep = world.getDeactivationOptions()  # by default DART stops bodies that move slowly
        asleep.mEnabled = False
        world.setDeactivationOptions(asleep)
        self.skeleton.disableSelfCollisionCheck()
        for branch in self.tree.branches:
            self._add_link(branch)
        self._add_springs()
        if self.motors:
            for at in drivers_by_coordinate(mechanism, self.tree):
                self.coordinates[at][0].setActuatorType(self.dartpy.dynamics.ActuatorType.VELOCITY)
        world.addSkeleton(self.skeleton)
        order = np.array([joint.getIndexInSkeleton(k) for joint, k in (self.coordinates[i] for i in range(self.tree.n))])
        ends = [[(self.bodies.get(x.link), np.array(spatial(x.local))) for x in pin] for pin in closing_pins(self.tree)]
        start = np.array(self.tree.relative(mechanism.q0, mechanism.v0))
        bodies = [self.bodies[i] for i in range(len(mechanism.links))]
        return Built(world, self.skeleton, bodies, order, [(a, b) for a, b in ends], start)

    def _add_link(self, b: Branch) -> None:
        """Add the joint and the rigid body of one branch of the tree (a link with the joint that carries it)."""
        create = {
            "revolute": self.skeleton.createRevoluteJointAndBodyNodePair,
            "prismatic": self.skeleton.createPrismaticJointAndBodyNodePair,
            "free": self.skeleton.createPlanarJointAndBodyNodePair,
        }
        pair = create[b.kind](self.bodies.get(b.parent))
        joint, body = pair[0], pair[1]
        joint.setName(f"joint{b.at}")
        body.setName(f"link{b.link}")
        if b.kind == "free":
            joint.setXYPlane()
        else:
            joint.setAxis(OUT_OF_PLANE if b.kind == "revolute" else spatial(b.axis))
        joint.setTransformFromParentBodyNode(self._frame(b.parent_anchor + b.base))
        joint.setTransformFromChildBodyNode(self._frame(b.anchor, -b.turn))
        link = self.mechanism.links[b.link]
        body.setInertia(self.dartpy.dynamics.Inertia(link.mass, np.zeros(3), link.inertia * np.eye(3)))
        self.bodies[b.link] = body
        for k in range(3 if b.kind == "free" else 1):
            self.coordinates[b.at + k] = joint, k

    def _frame(self, origin: Array, angle: float = 0.0) -> Any:
        """Return DART's transform of a frame in the plane, given by its origin (2,) [m] and angle [rad]."""
        cosine, sine = np.cos(angle), np.sin(angle)
        frame = self.dartpy.math.Isometry3()
        frame.set_translation(np.array(spatial(origin)))
        frame.set_rotation(np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]))
        return frame

    def _add_springs(self) -> None:
        """Add the springs and dampers of joints.

        In DART a coordinate has only one spring; its rest position is the mean of those of all springs, weighted by stiffness.
        """
        stiffness, preload, damping = np.zeros(self.tree.n), np.zeros(self.tree.n), self.forces.joint_damping
        for load in self.forces.own:
            stiffness += load.k * np.abs(load.row)  # the row has at most one entry, 1 or -1
            preload += load.k * (load.rest - load.constant) * load.row
        for at, (joint, k) in self.coordinates.items():
            joint.setDampingCoefficient(k, damping[at])
            if stiffness[at]:
                joint.setSpringStiffness(k, stiffness[at])
                joint.setRestPosition(k, preload[at] / stiffness[at])


def place(body: Any, point: Array) -> Array:
    """Return the place (3,) in the world [m] of a point (3,) given in the frame of a body; the body None is the ground."""
    return point if body is None else np.asarray(body.getTransform().multiply(point))


def select_pgs(dartpy: Any, built: Built, iterations: int) -> None:
    """Make projected Gauss-Seidel (PGS), with exactly `iterations` iterations, the solver of impulses in place of Dantzig's method.

    DART's solvers have no constructor in Python, but every world has a PGS solver as its secondary solver. A world does not accept
    its own secondary solver as its primary one, so the solver is taken from a new world.
    """
    solver = dartpy.simulation.World().getConstraintSolver().getSecondaryBoxedLcpSolver()
    solver.setOption(dartpy.constraint.PgsBoxedLcpSolverOption(iterations, 0.0, 0.0))
    built.world.getConstraintSolver().setBoxedLcpSolver(solver)
