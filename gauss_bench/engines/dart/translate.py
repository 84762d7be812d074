"""A linkage as a DART world: links hang in a skeleton of joints, and a ball constraint closes each pin that the skeleton leaves open.

The tree coordinates y are also DART's, in DART's order. Frames of links lie at their centres of mass. Springs and dampers on one
coordinate are DART's own, unless a setting wants them explicit; `given.py` computes all other forces. A driven joint has DART's
actuator for velocities.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.engines.dart.given import GivenForces
from gauss_bench.engines.shared import closing_pins, driven_coordinates, jointed, spatial
from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.mechanism.coordinates import position
from gauss_bench.mechanism.model import GROUND, LengthDriver, Mechanism, Point
from gauss_bench.mechanism.motion_laws import MotionLaw
from gauss_bench.terms import Array

OUT_OF_PLANE = [0.0, 0.0, 1.0]


def refusal(mechanism: Mechanism, tree: Tree) -> str | None:
    """Return the reason why DART cannot prescribe what is driven, or None if it can."""
    if None in driven_coordinates(mechanism, tree):
        return "DART prescribes coordinates of the tree of joints, and the driven angle is none"
    length = next((x.name for x in mechanism.drivers if isinstance(x, LengthDriver)), None)
    return f"DART prescribes coordinates of joints, not the length {length}" if length else None


@dataclass(eq=False)
class Built:
    """A DART world with one skeleton.

    Attributes:
        world, skeleton: of DART.
        order: (n,) DART's index of every tree coordinate.
        pins: the bodies of each closing pin besides the ground, and its place at the start.
        start: (2, n) tree state at the start.
        closures: Python's references to the constraints.
    """

    world: Any
    skeleton: Any
    order: Array
    pins: list[tuple[list[Any], Array]]
    start: Array
    closures: list[Any]

    def put(self, y: Array, dy: Array) -> None:
        """Set the tree state y, dy (n,)."""
        positions, speeds = np.empty_like(y), np.empty_like(dy)
        positions[self.order], speeds[self.order] = y, dy
        self.skeleton.setPositions(positions)
        self.skeleton.setVelocities(speeds)

    def command(self, values: Array) -> None:
        """Set the generalised forces, and the speeds of driven coordinates, for the next steps (n,)."""
        ordered = np.empty_like(values)
        ordered[self.order] = values
        self.skeleton.setCommands(ordered)

    @property
    def y(self) -> Array:
        """The tree coordinates (n,)."""
        return np.asarray(self.skeleton.getPositions()[self.order])

    @property
    def dy(self) -> Array:
        """The rates of the tree coordinates (n,)."""
        return np.asarray(self.skeleton.getVelocities()[self.order])

    def restart(self, constraint: Any) -> None:
        """Put the world to its start, with new closures by DART's module of constraints, which remember no earlier impulse.

        Trap: a closure takes its anchors from the pose in which it is made.
        """
        self.world.reset()
        self.put(*self.start)
        constraints = self.world.getConstraintSolver()
        constraints.removeAllConstraints()
        self.closures = [constraint.BallJointConstraint(*bodies, place) for bodies, place in self.pins]
        for closure in self.closures:
            constraints.addConstraint(closure)


class Builder:
    """Builds a DART world of a mechanism; `whole` is false for the open tree without drivers."""

    def __init__(self, dartpy: Any, mechanism: Mechanism, tree: Tree, forces: GivenForces, whole: bool = True):
        self.dartpy, self.mechanism, self.tree, self.forces, self.whole = dartpy, mechanism, tree, forces, whole
        self.skeleton = dartpy.dynamics.Skeleton("linkage")
        self.bodies: dict[int, Any] = {}
        self.coordinates: dict[int, tuple[Any, int]] = {}  # tree coordinate -> joint, and which of its coordinates

    def build(self) -> Built:
        """Return the world with all its parts; its closures are made by `restart`."""
        world, mechanism = self.dartpy.simulation.World(), self.mechanism
        world.setGravity(spatial(mechanism.gravity))
        asleep = world.getDeactivationOptions()  # by default DART stops what moves slowly
        asleep.mEnabled = False
        world.setDeactivationOptions(asleep)
        self.skeleton.disableSelfCollisionCheck()
        for branch in self.tree.branches:
            self._add_link(branch)
        self._add_springs()
        if self.whole:
            for at, _ in driven(mechanism, self.tree):
                joint, _ = self.coordinates[at]
                joint.setActuatorType(self.dartpy.dynamics.ActuatorType.VELOCITY)
        world.addSkeleton(self.skeleton)
        order = np.array([joint.getIndexInSkeleton(k) for joint, k in (self.coordinates[i] for i in range(self.tree.n))])
        pins = [self._pin(a, b) for a, b in closing_pins(self.tree)] if self.whole else []
        start = np.array(self.tree.relative(mechanism.q0, mechanism.v0))
        return Built(world, self.skeleton, order, pins, start, [])

    def _add_link(self, b: Branch) -> None:
        """Add the joint and the body of a branch."""
        create = {
            "revolute": self.skeleton.createRevoluteJointAndBodyNodePair,
            "prismatic": self.skeleton.createPrismaticJointAndBodyNodePair,
            "free": self.skeleton.createPlanarJointAndBodyNodePair,
        }
        joint, body = create[b.kind](self.bodies.get(b.parent))
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
        for k in range(joint.getNumDofs()):
            self.coordinates[b.at + k] = joint, k

    def _frame(self, origin: Array, angle: float = 0.0) -> Any:
        """Return DART's transform of a frame of the plane with its origin (2,) [m] and angle [rad]."""
        cosine, sine = np.cos(angle), np.sin(angle)
        frame = self.dartpy.math.Isometry3()
        frame.set_translation(np.array(spatial(origin)))
        frame.set_rotation(np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]))
        return frame

    def _add_springs(self) -> None:
        """Add the springs and dampers of joints; those on one coordinate become one, with the mean of their rest positions."""
        n = self.tree.n
        stiffness, damping, preload = np.zeros(n), np.zeros(n), np.zeros(n)
        for load in self.forces.own:
            along = np.abs(load.row)  # at most one entry
            stiffness += load.k * along
            damping += load.c * along
            preload += load.k * (load.rest - load.constant) * load.row
        for at, (joint, k) in self.coordinates.items():
            joint.setDampingCoefficient(k, damping[at])
            if stiffness[at]:
                joint.setSpringStiffness(k, stiffness[at])
                joint.setRestPosition(k, preload[at] / stiffness[at])

    def _pin(self, a: Point, b: Point) -> tuple[list[Any], Array]:
        """Return the bodies of a closing pin besides the ground, and its place at the start."""
        bodies = [self.bodies[x.link] for x in (a, b) if x.link != GROUND]
        return bodies, np.array(spatial(position(self.mechanism.q0, a)))


def select_solver(dartpy: Any, built: Built, iterations: int) -> None:
    """Let PGS, with so many iterations and no tolerance that would end it earlier, solve for the impulses in place of Dantzig's method.

    DART's solvers have no constructor in Python: a world's second one, for problems on which the first fails, is PGS.
    """
    constraints = built.world.getConstraintSolver()
    solver = constraints.getSecondaryBoxedLcpSolver()
    solver.setOption(dartpy.constraint.PgsBoxedLcpSolverOption(iterations, 0.0, 0.0))
    constraints.setBoxedLcpSolver(solver)


def driven(mechanism: Mechanism, tree: Tree) -> list[tuple[int, MotionLaw]]:
    """List the driven tree coordinates with their laws."""
    found = zip(driven_coordinates(mechanism, tree), jointed(mechanism), strict=True)
    return [(at, driver.law) for at, driver in found if at is not None]
