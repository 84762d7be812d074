"""A linkage as a Pinocchio model: a tree of joints in relative coordinates, and the point constraints that close it.

Pinocchio's configuration vector holds the tree coordinates y. Placements are rigid transformations: A is that of a link's centre of
mass in the frame of its joint, A_parent that of the parent link, T a translation and R a rotation about z. Joints are placed in
the frame of the parent's joint. Each kind of branch has a joint type of Pinocchio (RZ, PX, PY):

    revolute:    The joint RZ is placed at A_parent T(anchor on the parent), and A = T(-anchor).
    prismatic:   The joint PX is placed at A_parent T(anchor + base) R(axis), and A = R(turn - axis) T(-anchor).
    free:        The joints PX, PY and RZ in series connect the link to the ground, and A is the identity.

Each pin that closes a loop becomes a CONTACT_3D constraint, which has two rows in the plane, and a third row that is always zero.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from gauss_bench.engines import tree_model
from gauss_bench.engines.pinocchio.across_releases import set_gains
from gauss_bench.engines.shared import closing_pins, measure_gaps, spatial
from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.engines.tree_model import OpenModel
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

AGREEMENT = 1e-10  # relative: rounding causes about 1e-14, a wrong sign or lever about 1


class Multibody:
    """A mechanism built with the module `pin`: Pinocchio's model of the tree, and the constraints that close it.

    Attributes:
        carriers: link or ground -> index of the joint of Pinocchio that carries it, and A, the placement of its centre of mass in
            the frame of this joint.
        pins: the pairs of points that must coincide to close the loops.
    """

    def __init__(self, pin: Any, mechanism: Mechanism, tree: Tree):
        self.pin, self.model = pin, pin.Model()
        self.model.gravity.linear = np.array(spatial(mechanism.gravity))
        self.carriers: dict[int, tuple[int, Any]] = {GROUND: (0, pin.SE3.Identity())}
        for b in tree.branches:
            self._add_link(mechanism, b)
        self.pins = closing_pins(tree)
        if not self.model.check(self.model.createData()):
            raise RunFailure(Status.ERROR, "Pinocchio refuses the generated tree: its own check of the model fails")

    def _add_link(self, mechanism: Mechanism, b: Branch) -> None:
        """Add the joints and the body of a branch (a link with the joint that carries it), as the head of this file describes."""
        pin, link = self.pin, mechanism.links[b.link]
        name = b.joint.name if b.joint else ""
        parent, centre = self.carriers[b.parent]  # centre: A_parent; own: A
        match b.kind:
            case "revolute":
                joint = self._add_joint(name, parent, pin.JointModelRZ(), centre * self.planar(b.parent_anchor))
                own = self.planar(-b.anchor)
            case "prismatic":
                direction = float(np.arctan2(b.axis[1], b.axis[0]))
                placement = centre * self.planar(b.parent_anchor + b.base, direction)
                joint = self._add_joint(name, parent, pin.JointModelPX(), placement)
                own = self.planar(np.zeros(2), b.turn - direction) * self.planar(-b.anchor)
            case _:
                joint, own = 0, pin.SE3.Identity()
                for axis, kind in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("theta", pin.JointModelRZ())):
                    joint = self._add_joint(f"{link.name}.{axis}", joint, kind, pin.SE3.Identity())
        # the moments of inertia of a flat plate; only the third acts in the plane
        lamina = np.diag([link.inertia / 2, link.inertia / 2, link.inertia])
        self.model.appendBodyToJoint(joint, pin.Inertia(link.mass, np.zeros(3), lamina), own)
        self.carriers[b.link] = joint, own

    def _add_joint(self, name: str, parent: int, kind: Any, placement: Any) -> Any:
        """Add a joint at a placement in the frame of the joint `parent`, and return Pinocchio's index of it."""
        return self.model.addJoint(parent, kind, placement, name)

    def planar(self, origin: Array, angle: float = 0.0) -> Any:
        """Return the SE3 with an origin (2,) [m] in the plane and an angle [rad] about z; it is exact if the angle is 0."""
        c, s = np.cos(angle), np.sin(angle)
        return self.pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array(spatial(origin)))

    def place(self, point: Point) -> tuple[int, Any]:
        """Return the joint that carries a point, and the point's placement in the joint's frame."""
        joint, placement = self.carriers[point.link]
        return joint, placement * self.planar(point.local)

    def constraints(self, gains: tuple[float, float]) -> Any:
        """Return a point constraint for each closing pin, with Baumgarte's gains Kp, Kd and rows along the world's axes."""
        pin = self.pin
        rows = pin.StdVec_RigidConstraintModel()
        for a, b in self.pins:
            if a.link == GROUND:  # lcaba does not accept the ground as the first of the two
                a, b = b, a
            frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            row = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *self.place(a), *self.place(b), frame)
            set_gains(row, gains)
            rows.append(row)
        return rows

    def mass(self, y: Array) -> Array:
        """Return the mass matrix (n, n) of the open tree at y (n,)."""
        return np.array(self.pin.crba(self.model, self.model.createData(), y))  # both triangles are filled

    def describe(self, y: Array, dy: Array) -> OpenModel:
        """Return the loop gaps, mass matrix and forces that Pinocchio computes for the open tree at a tree state y, dy (n,)."""
        data = self.model.createData()
        forces = -np.array(self.pin.nonLinearEffects(self.model, data, y, dy))
        self.pin.forwardKinematics(self.model, data, y)

        def world_place(point: Point) -> Array:
            joint, placement = self.place(point)
            return np.array((data.oMi[joint] * placement).translation)[:2]

        return OpenModel(measure_gaps(self.pins, world_place), self.mass(y), forces)


def verify(body: Multibody, mechanism: Mechanism, tree: Tree) -> None:
    """Compare Pinocchio's model, in which only gravity acts, with the linkage; this checks all but Pinocchio's solver.

    Raises:
        RunFailure: mass matrix, forces or gaps differ.
    """
    tree_model.verify(without_forces(mechanism), tree, body.describe, AGREEMENT)


@lru_cache(maxsize=16)
def without_forces(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without its forces, the same object in all calls, so that `evaluator_of` stores its equations once."""
    return replace(mechanism, forces=())
