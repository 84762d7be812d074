"""A linkage as a DART world: a skeleton (tree of joints) carries the links, and a ball constraint closes each pin outside the tree.

DART's coordinates are the tree coordinates y in another order. Frames of links lie at their centres of mass. Springs and dampers
that act on one coordinate become elements of DART, which treats them implicitly, unless the knob `joint_forces` is "explicit". The
adapter computes all other forces except gravity. A driven joint uses DART's velocity actuator.
"""

from collections.abc import Mapping
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


class World:
    """A DART world with the skeleton of a mechanism, whose loops are open until `restart` closes them.

    Attributes:
        world, skeleton: DART's objects.
        forces: the applied loads; DART itself models the springs and dampers in `forces.own`.
        bodies: DART's bodies, in the order of the links.
        coordinates: index of a tree coordinate, in ascending order -> DART's joint, and the index within the joint.
        order: (n,) DART's index of every tree coordinate.
        pins: for each closing pin, its two ends: DART's body (None for the ground) and the point (3,) in its frame [m].
        start: tree state y, dy (n,) at the start.
        closures: Python's references to the constraints, which keep them alive.
    """

    def __init__(self, dartpy: Any, mechanism: Mechanism, forces: GivenForces, options: Mapping[str, Any], motors: bool = True):
        """Build the world; without `motors`, driven joints move freely."""
        self.dartpy, self.mechanism, self.forces, self.tree, self.options = dartpy, mechanism, forces, forces.tree, options
        self.skeleton = dartpy.dynamics.Skeleton("linkage")
        self.world = dartpy.simulation.World()
        self.world.setGravity(spatial(mechanism.gravity))
        deactivation = self.world.getDeactivationOptions()  # by default DART stops bodies that move slowly
        deactivation.mEnabled = False
        self.world.setDeactivationOptions(deactivation)
        self.skeleton.disableSelfCollisionCheck()
        bodies: dict[int, Any] = {}  # link -> DART's body
        self.coordinates: dict[int, tuple[Any, int]] = {}
        for branch in self.tree.branches:
            bodies[branch.link] = self._add_link(branch, bodies.get(branch.parent))
        self._add_springs()
        if motors:
            for index in drivers_by_coordinate(mechanism, self.tree):
                joint, _ = self.coordinates[index]
                joint.setActuatorType(dartpy.dynamics.ActuatorType.VELOCITY)
        self.world.addSkeleton(self.skeleton)
        self.order = np.array([joint.getIndexInSkeleton(k) for joint, k in self.coordinates.values()])
        # `get` returns None for the ground, which is not in `bodies`
        ends = [[(bodies.get(point.link), np.array(spatial(point.local))) for point in pin] for pin in closing_pins(self.tree)]
        self.pins = [(a, b) for a, b in ends]
        self.bodies = [bodies[i] for i in range(len(mechanism.links))]
        self.start = self.tree.relative(mechanism.q0, mechanism.v0)
        if options["lcp"] == "PGS":
            self._select_pgs(options["pgs_iterations"])

    def put(self, y: Array, dy: Array) -> None:
        """Set the tree state y, dy (n,)."""
        positions, speeds = np.empty_like(y), np.empty_like(dy)
        positions[self.order], speeds[self.order] = y, dy
        self.skeleton.setPositions(positions)
        self.skeleton.setVelocities(speeds)

    def command(self, values: Array) -> None:
        """Set the `values` (n,) for the next steps: forces on tree coordinates, and speeds of driven coordinates."""
        ordered = np.empty_like(values)
        ordered[self.order] = values
        self.skeleton.setCommands(ordered)

    def push(self, forces: Array) -> None:
        """Set the forces and torques (3 links,) on the links, at their centres of mass, for the next steps."""
        for body, force, torque in zip(self.bodies, places(forces), angles(forces), strict=True):
            body.setExtForce(spatial(force))  # replaces the earlier force and torque, so that torques do not add up over steps
            body.addExtTorque([0.0, 0.0, torque], False)  # False: about the axis of the world

    def state(self) -> tuple[Array, Array]:
        """Return the tree state y, dy (n,)."""
        return self.skeleton.getPositions()[self.order], self.skeleton.getVelocities()[self.order]

    def restart(self) -> None:
        """Reset the world to the start, and replace the closures: new ones have no stored impulse of an earlier run."""
        self.world.reset()
        self.put(*self.start)
        self.world.getConstraintSolver().removeAllConstraints()
        self.close()

    def close(self) -> None:
        """Close the loops. Trap: a closure connects the points that coincide when it is made."""
        self.closures: list[Any] = []
        for a, b in self.pins:
            bodies = [body for body, _ in (a, b) if body is not None]  # DART pins a single body to the world
            self.closures.append(self.dartpy.constraint.BallJointConstraint(*bodies, place(*a)))
            self.world.getConstraintSolver().addConstraint(self.closures[-1])

    def set_options(self, erp: float) -> None:
        """Set the options of closures; `erp` is the share of a gap that a step closes.

        Trap: these are static variables in DART, so all closures in a process have the values that were set last.
        """
        closures = self.dartpy.constraint.BallJointConstraint
        closures.setErrorReductionParameter(erp)
        closures.setConstraintForceMixing(self.options["cfm"])
        closures.setMaxErrorReductionVelocity(self.options["max_error_reduction_velocity"])
        closures.setErrorAllowance(0.0)

    def gaps(self) -> Array:
        """Return point b minus point a of every closing pin (pins, 2) [m], by DART's own kinematics."""
        return measure_gaps(self.pins, lambda end: place(*end))

    def _add_link(self, b: Branch, parent: Any) -> Any:
        """Add the joint and the rigid body of one branch of the tree, and return the body; `parent` is None for the ground."""
        kind = {"revolute": "Revolute", "prismatic": "Prismatic", "free": "Planar"}[b.kind]  # DART's word
        pair = getattr(self.skeleton, f"create{kind}JointAndBodyNodePair")(parent)
        joint, body = pair[0], pair[1]  # by index, because the stand-in that records a script has no length
        joint.setName(f"joint{b.at}")
        body.setName(f"link{b.link}")
        if b.kind == "free":
            joint.setXYPlane()
        else:
            joint.setAxis(OUT_OF_PLANE if b.kind == "revolute" else spatial(b.axis))
        joint.setTransformFromParentBodyNode(self._make_frame(b.parent_anchor + b.base))
        joint.setTransformFromChildBodyNode(self._make_frame(b.anchor, -b.turn))
        link = self.mechanism.links[b.link]
        body.setInertia(self.dartpy.dynamics.Inertia(link.mass, np.zeros(3), link.inertia * np.eye(3)))
        for k in range(len(b.coordinates)):
            self.coordinates[b.at + k] = joint, k
        return body

    def _make_frame(self, origin: Array, angle: float = 0.0) -> Any:
        """Return a frame in the plane, given by its origin (2,) [m] and angle [rad], as a transform of DART."""
        cosine, sine = np.cos(angle), np.sin(angle)
        frame = self.dartpy.math.Isometry3()
        frame.set_translation(np.array(spatial(origin)))
        frame.set_rotation(np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]))
        return frame

    def _add_springs(self) -> None:
        """Add the springs and dampers of joints.

        DART has one spring for each coordinate; it rests at the mean of all springs' rest positions, weighted by stiffness.
        """
        # preload: the sum of stiffness times rest position
        stiffness, preload, damping = np.zeros(self.tree.n), np.zeros(self.tree.n), self.forces.joint_damping
        for load in self.forces.own:
            stiffness += load.k * np.abs(load.row)  # the row has at most one nonzero entry, 1 or -1
            preload += load.k * (load.rest - load.constant) * load.row
        for index, (joint, k) in self.coordinates.items():
            joint.setDampingCoefficient(k, damping[index])
            if stiffness[index]:
                joint.setSpringStiffness(k, stiffness[index])
                joint.setRestPosition(k, preload[index] / stiffness[index])

    def _select_pgs(self, iterations: int) -> None:
        """Let exactly `iterations` iterations of projected Gauss-Seidel (PGS) find the impulses, in place of Dantzig's method.

        DART's solvers have no constructor in Python, but every world has a PGS solver as its secondary solver. A world does not
        accept its own secondary solver as its primary one, so the solver is taken from a new world.
        """
        solver = self.dartpy.simulation.World().getConstraintSolver().getSecondaryBoxedLcpSolver()
        solver.setOption(self.dartpy.constraint.PgsBoxedLcpSolverOption(iterations, 0.0, 0.0))
        self.world.getConstraintSolver().setBoxedLcpSolver(solver)


def place(body: Any, point: Array) -> Array:
    """Return the place (3,) in the world [m] of a point (3,) given in the frame of a body; the body None is the ground."""
    return point if body is None else np.asarray(body.getTransform().multiply(point))
