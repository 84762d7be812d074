"""A linkage as a Pinocchio model: a tree of joints in relative coordinates, and the point constraints that close it.

The tree coordinates y are also Pinocchio's configuration vector, so `Tree` alone maps them to absolute states. A_k is the placement
of link k's centre of mass in the frame of the joint that carries it. The joints are placed as follows, where T shifts, R turns
about z, and RZ, PX, PY are Pinocchio's joint types:

    revolute    A_parent T(anchor on the parent),                  RZ,    A = T(-anchor)
    prismatic   A_parent T(anchor + base) R(axis),                 PX,    A = R(turn - axis) T(-anchor)
    free        PX, PY, RZ from the ground at the centre of mass,         A = 1

Each pin that closes a loop becomes a CONTACT_3D constraint: two rows in the plane and a third that is identically zero.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from gauss_bench.engines import tree_model
from gauss_bench.engines.pinocchio.across_releases import set_gains
from gauss_bench.engines.shared import closing_pins, spatial
from gauss_bench.engines.tree import Branch, Tree
from gauss_bench.engines.tree_model import OpenModel
from gauss_bench.mechanism.model import GROUND, Mechanism, Point
from gauss_bench.terms import Array
from gauss_bench.trajectory import RunFailure, Status

AGREEMENT = 1e-10  # relative: rounding causes about 1e-14, a wrong sign or lever about 1


class Multibody:
    """A mechanism built with the module `pin`: Pinocchio's model of the tree, and the constraints that close it.

    Attributes:
        carriers: for every link and the ground, the joint that carries it and the placement of its centre of mass in that joint.
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
        pin, link = self.pin, mechanism.links[b.link]
        name = b.joint.name if b.joint else ""
        parent, centre = self.carriers[b.parent]
        match b.kind:
            case "revolute":
                joint = self._joint(name, parent, pin.JointModelRZ(), centre * self.planar(b.parent_anchor))
                own = self.planar(-b.anchor)
            case "prismatic":
                direction = float(np.arctan2(b.axis[1], b.axis[0]))
                placement = centre * self.planar(b.parent_anchor + b.base, direction)
                joint = self._joint(name, parent, pin.JointModelPX(), placement)
                own = self.planar(np.zeros(2), b.turn - direction) * self.planar(-b.anchor)
            case _:
                joint, own = 0, pin.SE3.Identity()
                for axis, kind in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("theta", pin.JointModelRZ())):
                    joint = self._joint(f"{link.name}.{axis}", joint, kind, pin.SE3.Identity())
        # the moments of inertia of a flat plate, of which only the third acts in the plane
        lamina = np.diag([link.inertia / 2, link.inertia / 2, link.inertia])
        self.model.appendBodyToJoint(joint, pin.Inertia(link.mass, np.zeros(3), lamina), own)
        self.carriers[b.link] = joint, own

    def _joint(self, name: str, parent: int, kind: Any, placement: Any) -> int:
        joint: int = self.model.addJoint(parent, kind, placement, name)
        return joint

    def planar(self, origin: Array, angle: float = 0.0) -> Any:
        """Return the SE3 of a planar displacement (2,) [m] and rotation [rad]; without a rotation it is exact."""
        c, s = np.cos(angle), np.sin(angle)
        return self.pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array(spatial(origin)))

    def place(self, point: Point) -> tuple[int, Any]:
        """Return the joint that carries a point, and the point's placement in the frame of that joint."""
        joint, centre = self.carriers[point.link]
        return joint, centre * self.planar(point.local)

    def constraints(self, gains: tuple[float, float]) -> Any:
        """Return one point constraint for each closing pin, with Baumgarte gains Kp, Kd; its rows are along the world's axes."""
        pin = self.pin
        rows = pin.StdVec_RigidConstraintModel()
        for a, b in self.pins:
            if a.link == GROUND:  # lcaba does not accept the ground as the first joint
                a, b = b, a
            frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            row = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *self.place(a), *self.place(b), frame)
            set_gains(row, gains)
            rows.append(row)
        return rows

    def mass(self, y: Array) -> Array:
        """Return the mass matrix (n, n) at tree coordinates y (n,)."""
        return np.array(self.pin.crba(self.model, self.model.createData(), y))  # both triangles are filled

    def describe(self, y: Array, dy: Array) -> OpenModel:
        """Return the model of the open tree at a tree state y, dy (n,), by Pinocchio's own kinematics and dynamics."""
        data = self.model.createData()
        forces = -np.array(self.pin.nonLinearEffects(self.model, data, y, dy))
        self.pin.forwardKinematics(self.model, data, y)

        def world_place(point: Point) -> Array:
            joint, placement = self.place(point)
            return np.array((data.oMi[joint] * placement).translation)[:2]

        gaps = np.array([world_place(b) - world_place(a) for a, b in self.pins]).reshape(-1, 2)
        return OpenModel(gaps, self.mass(y), forces)


def verify(body: Multibody, mechanism: Mechanism, tree: Tree) -> None:
    """Compare the generated model, to which only gravity is applied, with the linkage; only Pinocchio's solver remains unchecked.

    Raises:
        RunFailure: mass matrix, forces or gaps differ.
    """
    tree_model.verify(replace(mechanism, forces=()), tree, body.describe, AGREEMENT)
